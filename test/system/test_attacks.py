# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Running nodes under attack: held controls, bent positions, sideways twists, bad boxes, texts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import math
from pathlib import Path
from signal import SIGKILL
import socket
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Twist, Vector3
import pytest
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool

from stage.devices import DRIVE, MUX, TIMEOUTS, UNHURRIED, VSC
from stage.fort_vsc_nodes import NodeBench, serial_bench
from stage.multicast_rig import free_port
from stage.mux_talkers import MuxBench, sticks
from stage.rig import latched, NodeProcess, Observer
from stage.spine import DEADMAN, Spine, STICK
from stage.talkers import Talker

pytestmark = pytest.mark.waits(60)


# -- what an operator holds while the mux is killed and started again ----------------------------

LEVEL, AXIS_BUTTON = 3, 4
HELD = Joy(axes=[0.0, 0.8, *[0.0] * 4], buttons=[1, 0, 0, 1, 1, 0, 0, 0])
BUTTONS: dict[str, Any] = {
    'operator__fort__speed_levels': [0.3, 1.0],
    'operator__fort__speed_button': LEVEL,
    'operator__fort__axis_buttons': [AXIS_BUTTON],
    'reset_topic': 'panel/reset_button',
}


def held_but(**let_go: bool) -> Joy:
    """Return what is held; without the stick, the deadman."""
    buttons = [int(not let_go.get('deadman')), *HELD.buttons[1:]]
    return Joy(axes=sticks().axes if let_go.get('stick') else HELD.axes, buttons=buttons)


@contextlib.contextmanager
def mux_with(observer: Observer, **parameters: Any) -> Iterator[MuxBench]:
    mux = MuxBench(observer, **parameters)
    try:
        yield mux
    finally:
        mux.close()


@pytest.mark.proof
def test_mux_killed_and_restarted_moves_nothing_whatever_is_held(observer: Observer) -> None:
    with mux_with(observer, **BUTTONS) as mux:
        button = mux.talker(Bool, 'panel/reset_button', Bool(data=False))
        mux.ready()
        mux.joy.message = Joy(axes=sticks().axes, buttons=HELD.buttons)
        mux.wait(lambda: mux.says('ACTIVE'), 'control')
        mux.joy.message = HELD
        mux.wait(lambda: any(mux.demand), 'motion')
        button.message = Bool(data=True)
        mux.node.end(SIGKILL)
        mux.enable.clear()
        mux.command.clear()
        mux.start()
        mux.wait(lambda: mux.says('STOPPED') and mux.command.messages, 'the next one', 20.0)

        def still() -> bool:
            moved = any(any(each.velocity) for each in mux.command.messages)
            return not (moved or any(mux.enable.data))

        def holds(joy: Joy, pressed: bool, seconds: float = 0.8) -> None:
            mux.joy.message, button.message = joy, Bool(data=pressed)
            observer.holds_for(still, seconds, 'nothing enabled, nothing but 0')

        holds(HELD, pressed=True)
        holds(HELD, pressed=False)  # the release of a press that was never heard to begin
        holds(HELD, pressed=True, seconds=0.4)
        holds(HELD, pressed=False)  # a whole press, but the stick is held
        holds(held_but(stick=True), pressed=True, seconds=0.4)
        holds(held_but(stick=True), pressed=False)  # but the deadman
        holds(held_but(deadman=True), pressed=True, seconds=0.4)
        holds(held_but(deadman=True), pressed=False)
        assert mux.says('STOPPED'), mux.report()
        mux.joy.message = sticks()
        mux.wait(mux.may_reset, 'a reset would count')
        holds(sticks(), pressed=True, seconds=0.4)
        mux.joy.message = HELD  # in the moment of the release
        holds(HELD, pressed=False)
        mux.joy.message = sticks()
        mux.ready()
        mux.enable.clear()
        mux.command.clear()
        holds(held_but(deadman=True), pressed=False)
        holds(HELD, pressed=False)  # without a rest before the deadman
        mux.joy.message = sticks()
        mux.ready()
        holds(sticks(), pressed=False, seconds=0.2)
        mux.joy.message = Joy(axes=sticks().axes, buttons=HELD.buttons)
        mux.wait(lambda: mux.says('ACTIVE'), 'control, by a new deadman')
        mux.joy.message = HELD
        mux.wait(lambda: any(mux.demand), 'motion')


# -- soft ends on positions that go wrong --------------------------------------------------------

END, ZONE, FASTEST = 5.0, 2.5, 10.0
SLIP = FASTEST * 0.15  # rad, while a position is on its way on a busy machine
BENT = 'bent/joint_states'
ENDS: dict[str, Any] = {
    f'joint.{joint}.{name}': value
    for joint in ('left', 'right')
    for name, value in (('position_min', -END), ('position_max', END), ('slow_zone', ZONE))
}


class Bent:
    """Passes on the drive's speeds, with positions as of an encoder. :ivar fault: of these."""

    spine: Spine

    def __init__(self, observer: Observer) -> None:
        self.fault, self._at = '', 3.0  # rad, from where on
        self._late: list[tuple[float, JointState]] = []
        self._publisher = observer.node.create_publisher(JointState, f'/{BENT}', 10)
        observer.node.create_subscription(JointState, f'/{DRIVE}/joint_states', self._take, 10)
        observer.node.create_timer(0.005, self._pass_on)

    def _take(self, message: Any) -> None:
        delay = 0.1 if self.fault == 'late' else 0.0
        message.position = places(self.spine)
        if max(message.position) > self._at:
            bent: Callable[[float], float] = {
                'frozen': lambda at: self._at,
                'jumps': lambda at: at - 2.0 * END,
                'is NaN': lambda at: math.nan,
                'is infinite': lambda at: -math.inf,
                'changes sign': lambda at: -at,
            }.get(self.fault, lambda at: at)
            bare = self.fault == 'is without positions'
            message.position = [] if bare else [bent(at) for at in message.position]
        self._late.append((time.monotonic() + delay, message))
        self._pass_on()

    def _pass_on(self) -> None:
        while self._late and self._late[0][0] <= time.monotonic():
            self._publisher.publish(self._late.pop(0)[1])


@pytest.fixture(scope='module')
def ended(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Spine, Bent, Talker]]:
    """Give a spine with soft ends whose positions may be bent, and a second operator."""
    second = {'topic': 'second/joy', 'priority': 20, 'mixing': 'arcade', 'axis': [1, 0]}
    second |= {'scale': [FASTEST], 'timeout': 1.5}
    parameters: dict[str, dict[str, Any]] = {
        **UNHURRIED,
        MUX: {
            **UNHURRIED[MUX],
            'feedback.topic': BENT,
            'feedback.timeout': 6.0 * TIMEOUTS[MUX]['feedback.timeout'],
            'operators': ['fort', 'second'],
            **{f'operator.second.{name}': value for name, value in second.items()},
            **ENDS,
        },
    }
    with Observer() as observer:
        bent = Bent(observer)
        joy = Talker(observer, Joy, '/second/joy', sticks())
        with Spine(tmp_path_factory.mktemp('ends'), observer, parameters) as spine:
            bent.spine = spine
            yield spine, bent, joy


def places(spine: Spine) -> list[float]:
    places: Any = spine.drive.simulator.describe()['position_rad']
    return list(places)


def drive_outwards(spine: Spine, bent: Bent, stick: float = 1.0) -> float:
    """Hold the stick for as long as anything moves; return how far the farthest joint came."""
    spine.ready()
    spine.vsc.apply(f'button {DEADMAN} 1')
    spine.wait(lambda: spine.mux_says('ACTIVE'), 'control')
    spine.vsc.apply(f'stick {STICK} {stick}')
    since, farthest = time.monotonic(), 0.0

    def rests() -> bool:
        nonlocal farthest
        farthest = max(farthest, *(math.copysign(1.0, stick) * at for at in places(spine)))
        return time.monotonic() > since + 1.0 and spine.drive.rpm < 0.3

    spine.wait(rests, 'standstill', 20.0)
    spine.let_go()
    return farthest


@pytest.mark.proof
@pytest.mark.parametrize(
    ('fault', 'beyond'),
    [
        ('', SLIP),
        ('late', SLIP),
        ('frozen', SLIP),
        ('is NaN', SLIP),
        ('is infinite', SLIP),
        ('is without positions', SLIP),
        ('jumps', ZONE / 2.0 + SLIP),  # until it is noticed
        ('changes sign', ZONE / 2.0 + SLIP),
    ],
)
def test_joint_stays_within_its_way_on_positions_that_go_wrong(
    ended: tuple[Spine, Bent, Talker], fault: str, beyond: float
) -> None:
    spine, bent, _ = ended
    bent.fault = ''
    spine.rest()
    bent.fault = fault
    assert drive_outwards(spine, bent) <= END + beyond
    if fault in ('jumps', 'changes sign', 'is NaN', 'is infinite', 'is without positions'):
        spine.wait(lambda: spine.mux_says('STOPPED'), 'a stop')
    if fault == 'frozen':
        spine.wait(lambda: spine.is_rested('fort'), 'rest')  # he tries again, without a reset
        spine.hold(1.0)
        spine.observer.holds_for(lambda: max(places(spine)) <= END + beyond, 1.0, 'no further')
        spine.let_go()


def no_way_out(spine: Spine, since: float) -> bool:
    """Tell whether nothing that was sent to the drive since then turns it further outwards."""
    return not any(
        packet.enables and max(packet.values) > 0 for packet in spine.drive.packets(since)
    )


@pytest.mark.proof
def test_joint_beyond_its_end_goes_only_back_for_a_new_mux_and_two_operators(
    ended: tuple[Spine, Bent, Talker],
) -> None:
    spine, bent, second = ended
    bent.fault = ''
    spine.rest()
    drive_outwards(spine, bent)

    def turn(_: Any, now: float) -> None:
        for axis in spine.drive.simulator._axes:
            axis.motor.position = END + 0.3  # by hand

    spine.drive.call(turn)
    spine.nodes[MUX].end(SIGKILL)
    spine.restart_and_meet(MUX)
    since = time.monotonic()
    spine.ready()
    spine.hold(1.0)
    spine.wait(lambda: spine.mux_says('ACTIVE'), 'control')
    spine.observer.holds_for(lambda: no_way_out(spine, since), 0.8, 'not outwards')
    for _ in range(2):  # from one to the other, both pushing outwards
        spine.wait(lambda: spine.condition("operator 'second'") == 'rested', 'a rested second')
        second.message = sticks(0.0, deadman=True)
        spine.wait(lambda: spine.values.get('owner') == 'second', 'the second in control')
        second.message = sticks(1.0, deadman=True)
        spine.observer.holds_for(lambda: no_way_out(spine, since), 0.5, 'not outwards')
        second.message = sticks()
        spine.let_go()
        spine.ready()
        spine.hold(1.0)
        spine.wait(lambda: spine.values.get('owner') == 'fort', 'the first in control')
        spine.observer.holds_for(lambda: no_way_out(spine, since), 0.5, 'not outwards')
    spine.vsc.apply(f'stick {STICK} -0.5')
    spine.wait(lambda: max(places(spine)) < END, 'the way back')
    spine.let_go()


# -- a base that also goes sideways --------------------------------------------------------------

OMNI: dict[str, Any] = {
    'output': 'twist',
    'joints': ['linear', 'lateral', 'angular'],
    'operator__fort__mixing': 'none',
    'operator__fort__axis': [1, 0, 3],
    'operator__fort__scale': [1.0],
    'autonomy__topic': 'plan',
    'autonomy__type': 'Twist',
    'joint__linear__max': 2.0,
    'joint__lateral__max': 1.0,
    'joint__angular__max': 4.0,
    **{
        f'joint__{joint}__{name}': 100.0
        for joint in ('linear', 'lateral', 'angular')
        for name in ('acceleration', 'deceleration')
    },
}


def way(twist: Any) -> tuple[float, ...]:
    """Return all six of a twist, those that a base on the ground has first."""
    linear, angular = twist.linear, twist.angular
    return (linear.x, linear.y, angular.z, linear.z, angular.x, angular.y)


def plan(x: float = 0.0, y: float = 0.0, turn: float = 0.0, **more: float) -> Twist:
    linear = Vector3(x=x, y=y, z=more.get('z', 0.0))
    return Twist(linear=linear, angular=Vector3(x=more.get('roll', 0.0), z=turn))


@pytest.mark.proof
def test_base_goes_sideways_as_it_is_asked_and_no_other_way(observer: Observer) -> None:
    with mux_with(observer, **OMNI) as mux:
        autonomy = mux.talker(Twist, 'plan', plan())

        def select() -> None:
            mux.ready()
            autonomy.message = plan()
            mux.wait(lambda: mux.explains('~/select_autonomy'), 'rested autonomy')
            assert mux.select_autonomy().success
            mux.wait(lambda: mux.says('ACTIVE'), 'ACTIVE')

        def goes(*wanted: float) -> bool:
            return way(mux.command.last) == pytest.approx((*wanted, *[0.0] * (6 - len(wanted))))

        select()
        for asked, wanted in (
            (plan(y=0.5), (0.0, 0.5)),
            (plan(y=-0.5), (0.0, -0.5)),
            (plan(x=1.0, y=0.5, turn=-1.0), (1.0, 0.5, -1.0)),
            (plan(x=2.0, y=4.0, turn=-4.0), (0.5, 1.0, -1.0)),  # the same curve, slower
            (plan(x=1.0, y=1e5, turn=1.0), (1e-5, 1.0, 1e-5)),
            (plan(y=0.5, z=3.0, roll=2.0), (0.0, 0.5)),
        ):
            autonomy.message = asked
            mux.wait(lambda wanted=wanted: goes(*wanted), f'{wanted}, not {mux.command.last}')
        for asked in (plan(y=math.nan), plan(x=0.5, y=-math.inf), plan(y=1e300), plan(z=math.inf)):
            mux.command.clear()
            autonomy.message = asked
            mux.wait(lambda: mux.says('STOPPED') and mux.is_stopped(), f'a stop at {asked}')
            assert all(abs(v) < 1.0 for m in mux.command.messages for v in way(m))
            autonomy.message = plan(y=0.5)  # sound again, which moves nothing
            observer.holds_for(lambda: not any(way(mux.command.last)), 0.3, 'standstill')
            select()
            autonomy.message = plan(y=0.5)
            mux.wait(lambda: goes(0.0, 0.5), 'sideways again')
        assert mux.select_autonomy(False).success
        autonomy.message = plan()
        mux.ready()
        mux.joy.message = sticks(deadman=True)
        mux.wait(lambda: mux.says('ACTIVE'), 'an operator in control')
        mux.joy.message = Joy(axes=[-1.0, *[0.0] * 5], buttons=[1, *[0] * 7])
        mux.wait(lambda: goes(0.0, -1.0), 'to the right')
        mux.joy.message = Joy(axes=[math.nan, *[0.0] * 5], buttons=[1, *[0] * 7])
        mux.wait(lambda: mux.says('STOPPED') and mux.is_stopped(), 'a stop')


# -- a box that answers wrongly ------------------------------------------------------------------

RELEASED, PRESSED = 0b0011, 0b0000  # both channels of the e-stop; bit 2 is the reset button
RESET = 0b0100


class BadBox:
    """A Modbus TCP server by hand. :ivar answers: how; see ``_answer``. :ivar inputs: bits."""

    def __init__(self, port: int) -> None:
        self.url = f'socket://127.0.0.1:{port}'
        self.answers, self.inputs, self.asked = 'well', RELEASED, 0
        self._address = ('127.0.0.1', port)
        self._connections: list[socket.socket] = []
        self.listen()

    def listen(self) -> None:
        self._server = socket.create_server(self._address)
        threading.Thread(target=self._accept, args=(self._server,), daemon=True).start()

    def close(self) -> None:
        """End, as by a restart: all connections with it."""
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        while self._connections:
            with contextlib.suppress(OSError):
                self._connections.pop().shutdown(socket.SHUT_RDWR)

    def _accept(self, server: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection = server.accept()[0]
                self._connections.append(connection)
                threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        before = b''
        with contextlib.suppress(OSError):
            while question := connection.recv(260):
                self.asked += 1
                before = self._answer(connection, question[:12], before)

    def _answer(self, connection: socket.socket, question: bytes, before: bytes) -> bytes:
        number, unit = int.from_bytes(question[:2], 'big'), question[6]

        def answer(number: int, unit: int, bits: int) -> bytes:
            head = (number % 0x10000).to_bytes(2, 'big') + b'\0\0\0\4'
            return head + bytes((unit, 2, 1, bits))

        sound = answer(number, unit, self.inputs)
        wrong = {
            'well': sound,
            'stale': before,
            'another number': answer(number + 1, unit, RELEASED | RESET),
            'another unit': answer(number, unit + 8, RELEASED | RESET),
            'other registers': sound[:7] + b'\3\2\0\3',
            'half': answer(number, unit, RELEASED | RESET)[:8],
            'more registers': sound[:5] + b'\5' + sound[6:8] + bytes((2, RELEASED | RESET, 0)),
            'no bits': sound[:5] + b'\3' + sound[6:8] + b'\0',
        }
        connection.sendall(wrong.get(self.answers, b''))
        return before if self.answers == 'stale' else answer(number, unit, RELEASED | RESET)


@pytest.fixture(scope='module')
def box() -> Iterator[tuple[Observer, BadBox, NodeProcess, Any, Any]]:
    parameters = {
        'transport': 'tcp',
        'reset_line': 2,
        'link_timeout': 1.0,
        'answer_time': 0.2,
    }
    box = BadBox(free_port())
    with (
        Observer() as observer,
        NodeProcess('io_bridge.node', {**parameters, 'port': box.url}) as n,
    ):
        estop = observer.record(Bool, '/io_bridge/estop', latched())
        yield observer, box, n, estop, observer.record(Bool, '/io_bridge/reset_button')
        box.close()


@pytest.mark.parametrize(
    'answers',
    [
        *('stale', 'another number', 'more registers', 'a restart'),
        *(
            pytest.param(each, marks=pytest.mark.proof)
            for each in ('another unit', 'other registers', 'half', 'no bits', 'nothing')
        ),
    ],
)
def test_box_that_answers_wrongly_releases_no_stop_and_presses_no_button(
    box: tuple[Observer, BadBox, NodeProcess, Any, Any], answers: str
) -> None:
    observer, server, node, estop, button = box

    def says(stop: bool) -> None:
        observer.wait_for(
            lambda: estop.last == Bool(data=stop), 10.0, lambda: f'{stop}; {node.output[-800:]}'
        )

    server.answers, server.inputs = 'well', RELEASED
    says(False)
    server.inputs, server.answers = PRESSED, answers  # at once: it never says that well
    if answers == 'a restart':
        server.close()
        server.answers = 'well'
        says(True)
        server.listen()
    says(True)
    button.clear()
    observer.holds_for(lambda: estop.last.data and not any(button.data), 1.5, 'a stop, no reset')
    server.answers = 'well'
    asked = server.asked
    observer.wait_for(lambda: server.asked > asked + 5, 10.0, 'questions')
    observer.holds_for(lambda: estop.last.data and not any(button.data), 0.3, 'a stop, no reset')
    server.inputs = RELEASED
    says(False)


# -- texts ---------------------------------------------------------------------------------------

TEXTS = ('x' * 50_000, 'Kräne\n\x07\x1b[2J\0', '{}{0}%s', '', '\u202e\u2028\u0661')
KEYS = (
    'code.1000000000',
    f'code.{"9" * 5000}',
    'code.1.node',
    'code.1.self',
    'code.1',
    'code',
    '',
)


def hostile(name: str, n: int) -> DiagnosticStatus:
    """Return a status of nonsense; each ``n`` has another one."""
    text, key = TEXTS[n % len(TEXTS)], KEYS[n % len(KEYS)]
    state = ('ACTIVE', 'STOPPED', text)[n % 3]
    pairs = {'state': state, 'code': text, 'code.1': text, key: text, 'owner': text}
    values = [KeyValue(key=each, value=value.replace('\0', '')) for each, value in pairs.items()]
    return DiagnosticStatus(name=name, level=b'\2', message=text.replace('\0', ''), values=values)


@pytest.mark.proof
def test_status_of_nonsense_and_in_floods_delays_no_stop_of_the_vsc(
    observer: Observer, tmp_path: Path
) -> None:
    bench: NodeBench = serial_bench(tmp_path, observer, show_status='hostile')
    try:
        space = bench.name.rpartition('/')[0]
        bench.start_anew()
        flood = observer.publisher(DiagnosticStatus, f'{space}/hostile', latched())
        stop = Talker(observer, Bool, f'{bench.name}/software_estop', Bool(data=False), rate=20.0)
        numbers = iter(range(10**6))

        def alive() -> bool:
            for _ in range(3):
                flood.publish(hostile('mux', next(numbers)))
            heard = time.monotonic() - bench.estop.times[-1] < 1.0
            return heard and bench.says(bench.estop, False) and bench.node.process.poll() is None

        observer.holds_for(alive, 2.0, 'a node that is well')
        shown = bench.vsc.simulator.describe()['names']
        assert all(line.isascii() and line.isprintable() for line in shown.values()), shown
        sound = DiagnosticStatus(values=[KeyValue(key='state', value='READY')])

        def is_shown() -> bool:
            flood.publish(sound)
            return str(bench.vsc.simulator.display).startswith('READY')

        bench.wait(is_shown, 'READY on the display')
        asked = time.monotonic()
        stop.message = Bool(data=True)
        bench.wait(lambda: alive() is None or bench.says(bench.estop, True), 'its stop')
        assert time.monotonic() - asked < 1.0
        stop.leave()
    finally:
        bench.close()


def test_diagnostics_of_nonsense_delay_no_stop_of_the_mux(observer: Observer) -> None:
    with mux_with(observer) as mux:
        says = observer.publisher(DiagnosticArray, '/diagnostics')
        mux.active()
        names = [f'{mux.space}/{node}: device'.lstrip('/') for node in (DRIVE, VSC)]
        for n in range(len(TEXTS) * len(KEYS)):
            says.publish(DiagnosticArray(status=[hostile(name, n) for name in names]))
            observer.spin()
        observer.holds_for(lambda: mux.says('ACTIVE') or mux.held_up(), 0.5, 'ACTIVE')
        cause = time.monotonic()
        assert mux.trip().success
        mux.stopped_since(cause)
