# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Faults planted on running nodes: ~/status, the doctor and the status page name each by one code.

A VSC and a drive on ptys, bridge, mux and drive node a process each, and the page's node.
RUGGED_TELEOP_IMAGES=1 writes the pictures of docs/faults.md besides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import os
from pathlib import Path
import re
from signal import SIGCONT, SIGKILL, SIGSTOP
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from lifecycle_msgs.srv import ChangeState
import pytest
from rclpy.qos import ReliabilityPolicy
from std_msgs.msg import Bool, String

from rugged_teleop.doctor.findings import Finding
from rugged_teleop.doctor.graph import graph_findings, listen
from rugged_teleop.reasons import catalogue
from stage.devices import DRIVE, END_TRIP, MUX, TIMEOUTS, TRIP, VSC
from stage.page_rig import Viewer
from stage.rig import NodeProcess, Observer, ROOT
from stage.spine import Spine
from test.rugged_teleop.status_page.chromium import Browser

DOC = ROOT / 'docs' / 'faults.md'
READING = 20 * 200 / 60  # words in 20 s, at 200 a minute
NOISE = bytes((7 * n) % 251 | 1 for n in range(64))
CLEAR = 'mux.reset.due'  # what is left once a fault is mended
PICTURED = (
    *('stop on the remote', 'wired stop', 'remote off', 'VSC unplugged', 'remote paused'),
    *('overcurrent', 'drive silent', 'node of the VSC killed', 'second publisher', 'stick held'),
)
SIZES = {'': (1280, 720), '_phone': (360, 640)}
Undo = Callable[[], object]


class Machine(Spine):
    """The spine, and who looks at it. :param folder: for ports."""

    def __init__(self, folder: Path, observer: Observer) -> None:
        # Here it is the words that count, and a busy machine is late.
        patient = {
            node: {name: 1.0 for name in limits if 'vm110' not in name and 'feedback' not in name}
            for node, limits in TIMEOUTS.items()
        }
        super().__init__(folder, observer, patient)
        self._graph = listen(observer.node)
        self.page = self.add_node(NodeProcess('rugged_teleop.status_page.node', {'port': 0}))
        found: Any = self.wait(
            lambda: re.search(r'status page: (http://\S+/)', self.page.output), 'the page', 30.0
        )
        self.address = found[1]
        self.viewer = Viewer(self.address)
        self._exits.callback(self.viewer.leave)
        self.rest()

    def add_node(self, node: NodeProcess) -> NodeProcess:
        """End this process with the machine."""
        return self._exits.enter_context(node)

    @property
    def code(self) -> str:
        """What the newest status names first."""
        return self.values.get('code', '')

    @property
    def on_page(self) -> dict[str, Any]:
        """What the page says to do now."""
        return dict(next(iter(self.viewer.mux.get('now', ())), {}))

    def findings(self) -> list[Finding]:
        return list(graph_findings(self._graph()))

    def named(self) -> list[str]:
        """Return what status, doctor and page name first."""
        still = [each.code for each in self.findings() if each.kind == 'still']
        return [self.code, *still, self.on_page.get('code', '')]

    def be(self, state: str) -> None:
        """Bring it there: STOPPED with nothing missing but a reset, READY, or ACTIVE at rest."""
        self.let_go()
        if self.values.get('state') != 'STOPPED':
            self.call(TRIP)
        self.wait(self._ended, 'no trip')
        self.vsc.apply('radio on')
        self.release()
        self.wait(lambda: self.code == CLEAR, 'nothing missing but a reset', 20.0)
        if state == 'STOPPED':
            return
        self.ready()
        if state == 'ACTIVE':
            self.vsc.apply('button left_down 1')
            self.wait(lambda: self.mux_says('ACTIVE'), 'control')

    def _ended(self) -> bool:
        """End a trip that there is; tell whether there is none."""
        if self.values.get('trip active') == 'true':
            self.call(END_TRIP)
            return False
        return self.values.get('state') == 'STOPPED'

    def transit(self, node: str, number: int) -> None:
        request = ChangeState.Request()
        request.transition.id = number
        assert self.observer.call(ChangeState, f'/{node}/change_state', request).success


# What plants each, and returns what mends it.


def vsc(*lines: str, undo: tuple[str, ...] = ()) -> Callable[[Machine], Undo]:
    """Have the VSC obey."""

    def plant(machine: Machine) -> Undo:
        machine.vsc.apply(*lines)
        mended = undo or ('estop remote off', 'estop vsc off', 'radio on', 'ack')
        return lambda: machine.vsc.apply(*mended, 'mode operational')

    return plant


def drive_fault(which: str) -> Callable[[Machine], Undo]:
    """Have the drive report an error, which it keeps until it is cleared."""

    def plant(machine: Machine) -> Undo:
        machine.drive.apply(f'fault {which} on')

        def mend() -> None:
            machine.drive.apply(f'fault {which} off')
            machine.clear_errors()

        return mend

    return plant


def unplugged(port: str) -> Callable[[Machine], Undo]:
    def plant(machine: Machine) -> Undo:
        getattr(machine, port).apply('unplug')
        return lambda: getattr(machine, port).apply('plug')

    return plant


def garbled(port: str) -> Callable[[Machine], Undo]:
    """Have bytes come that are no frames, as at another baud rate."""

    def plant(machine: Machine) -> Undo:
        device = getattr(machine, port)
        real = device.simulator
        device.swap(Noise(real))
        return lambda: device.swap(real)

    return plant


class Noise:
    """A device that is heard at a wrong baud rate; what it is told is lost."""

    def __init__(self, real: Any, silent: bool = False) -> None:
        self._real, self._next, self._silent = real, 0.0, silent

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)

    def receive(self, data: bytes, now: float) -> list[bytes]:
        return []

    def poll(self, now: float) -> list[bytes]:
        if now < self._next:
            return []
        self._next = now + 0.05
        return [] if self._silent else [NOISE]

    def deadline(self) -> float:
        return self._next


def silent(port: str) -> Callable[[Machine], Undo]:
    def plant(machine: Machine) -> Undo:
        device = getattr(machine, port)
        real = device.simulator
        device.swap(Noise(real, silent=True))
        return lambda: device.swap(real)

    return plant


def message_off(kind: int) -> Callable[[Machine], Undo]:
    def plant(machine: Machine) -> Undo:
        machine.vsc.enable_message(kind, False)
        return lambda: machine.vsc.enable_message(kind, True)

    return plant


def killed(node: str) -> Callable[[Machine], Undo]:
    def plant(machine: Machine) -> Undo:
        machine.nodes[node].signal(SIGKILL)
        return lambda: machine.restart_and_meet(node)

    return plant


def frozen(node: str) -> Callable[[Machine], Undo]:
    def plant(machine: Machine) -> Undo:
        machine.nodes[node].signal(SIGSTOP)
        return lambda: machine.nodes[node].signal(SIGCONT)

    return plant


def deactivated(node: str) -> Callable[[Machine], Undo]:
    def plant(machine: Machine) -> Undo:
        machine.transit(node, 4)
        return lambda: machine.transit(node, 3)

    return plant


def publisher(
    topic: str, kind: type, reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE
) -> Callable[[Machine], Undo]:
    """Have another process publish there, again and again."""
    source = f"""
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import {kind.__name__}
rclpy.init()
node = rclpy.create_node('somebody')
qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.{reliability.name})
other = node.create_publisher({kind.__name__}, '{topic}', qos)
node.create_timer(0.05, lambda: other.publish({kind.__name__}()))
rclpy.spin(node)
"""

    def plant(machine: Machine) -> Undo:
        somebody = machine.add_node(NodeProcess(source=source))
        return somebody.end

    return plant


def tripped(machine: Machine) -> Undo:
    machine.call(TRIP)
    return lambda: None


class Fault(NamedTuple):
    """:param state: of the mux before it."""

    name: str
    code: str
    plant: Callable[[Machine], Undo]
    state: str = 'STOPPED'


BEST_EFFORT = ReliabilityPolicy.BEST_EFFORT
ESTOP = f'/{VSC}/estop'
LET_GO = ('button left_down 0', 'stick left_y 0')
FAULTS = [
    Fault('nothing but the reset', CLEAR, lambda machine: lambda: None),
    Fault('stop on the remote', 'fort.estop.remote', vsc('estop remote on')),
    Fault('wired stop', 'fort.estop.wired', vsc('estop vsc on')),
    Fault('remote off', 'fort.estop.remote', vsc('radio off')),
    Fault('stick held', 'mux.operator.busy', vsc('stick left_y 0.5', undo=LET_GO)),
    Fault('VSC unplugged', 'port.missing', unplugged('vsc')),
    Fault('VSC silent', 'fort.link.silent', silent('vsc')),
    Fault('VSC at another baud', 'fort.link.garbled', garbled('vsc')),
    Fault('drive unplugged', 'port.missing', unplugged('drive')),
    Fault('drive silent', 'esi.link.silent', silent('drive')),
    Fault('drive at another baud', 'esi.link.garbled', garbled('drive')),
    Fault('overcurrent', 'esi.overcurrent.a', drive_fault('a overcurrent')),
    Fault('brake', 'esi.brake.b', drive_fault('b brake')),
    Fault('undervoltage', 'esi.undervoltage.a', drive_fault('a undervoltage')),
    Fault('hot motor', 'esi.motor_temperature.a', drive_fault('a motor_temp')),
    Fault('encoder', 'esi.loss_of_feedback.b', drive_fault('b loss_of_feedback')),
    Fault('node of the VSC killed', 'mux.source.stale', killed(VSC)),
    Fault('node of the drive frozen', 'mux.source.stale', frozen(DRIVE)),
    Fault('node of the VSC not active', 'node.inactive', deactivated(VSC)),
    Fault('mux not active', 'mux.inactive', deactivated(MUX)),
    Fault('second publisher', 'input.doubled', publisher(ESTOP, Bool)),
    Fault('publisher of another type', 'input.wrong_type', publisher(ESTOP, String)),
    Fault('publisher best effort', 'input.best_effort', publisher(ESTOP, Bool, BEST_EFFORT)),
    Fault('trip', 'mux.trip.active', tripped),
    Fault('deadman not pressed', 'mux.operator.press', lambda machine: lambda: None, 'READY'),
    Fault('remote paused', 'fort.remote.paused', vsc('mode pause', undo=LET_GO), 'READY'),
    Fault('remote in its menu', 'fort.remote.menu', vsc('mode menu', undo=LET_GO), 'READY'),
    Fault('stick at rest', 'mux.owner.zero', lambda machine: machine.let_go, 'ACTIVE'),
]
# The others are left to make proof.
KEPT = {
    *('nothing but the reset', 'stop on the remote', 'drive silent', 'trip', 'overcurrent'),
    *('node of the VSC not active', 'second publisher', 'deadman not pressed'),
}


@pytest.fixture(scope='module')
def machine() -> Iterator[Machine]:
    with (
        TemporaryDirectory(prefix='machine_') as folder,  # a short path: pictures show it
        Observer() as observer,
        Machine(Path(folder), observer) as result,
    ):
        yield result


@pytest.fixture(scope='module')
def browser(
    machine: Machine, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Browser | None]:
    """Give a browser that shows the page, where pictures are wanted."""
    if 'RUGGED_TELEOP_IMAGES' not in os.environ:
        yield None
        return
    result = Browser(tmp_path_factory.mktemp('chromium'))
    result.load(machine.address)
    yield result
    result.close()


def picture(browser: Browser, cause: str, name: str) -> None:
    """Write what is seen on a desk and on a phone."""
    browser.wait(f'document.querySelector("#now .cause")?.innerText === {cause!r}', cause)
    for end, size in SIZES.items():
        browser.show(*size)
        browser.picture(ROOT / 'docs' / 'images' / f'fault_{name}{end}.webp')


def in_docs(fault: Fault) -> str:
    """Return its row in docs/faults.md: what the first card says."""
    entry = catalogue()[fault.code]
    return f'| {fault.name} | `{fault.code}` | {entry.cause} | {entry.steps[0]} |'


def test_faults_are_listed_in_the_documents_and_nothing_else_is() -> None:
    rows = [line for line in DOC.read_text(encoding='utf-8').splitlines() if ' | `' in line]
    assert rows == [in_docs(fault) for fault in FAULTS]
    assert len(FAULTS) >= 25


@pytest.mark.waits(100)
@pytest.mark.parametrize(
    'fault',
    [
        pytest.param(each, marks=() if each.name in KEPT else pytest.mark.proof, id=each.name)
        for each in FAULTS
    ],
)
def test_fault_is_named_by_status_doctor_and_page_alike(
    machine: Machine, browser: Browser | None, fault: Fault
) -> None:
    machine.be(fault.state)
    mend = fault.plant(machine)

    def alike() -> bool:
        nonlocal mend
        if fault.state != 'STOPPED' and machine.values.get('state') == 'STOPPED':
            assert machine.held_up(), machine.story()
            mend()
            machine.be(fault.state)
            mend = fault.plant(machine)
        return machine.named() == [fault.code] * 3

    try:
        machine.observer.wait_for(
            alike,
            20.0,
            lambda: f'{fault.code} named alike, not {machine.named()}; {machine.story()}',
        )
        shown = machine.on_page
        assert 1 <= len(shown['steps']) <= 3
        assert all(len(line.split()) < 10 for line in (shown['cause'], *shown['steps'])), shown
        first = next(each for each in machine.findings() if each.kind == 'still')
        assert len(f'{first.text} {first.remedy}'.split()) <= READING
        if fault.name in PICTURED and browser is not None:
            picture(browser, shown['cause'], fault.name.lower().replace(' ', '_'))
    finally:
        mend()
