# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The machine that the random campaign harms, and the remote in its operator's hand."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
import contextlib
from pathlib import Path
import resource
import signal
import threading
import time
from typing import Any, Final, NamedTuple

from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool

from assurance.benchmarks.rig import busy_cores, family, title, wires_of
from assurance.beside import BESIDE, Beside
from esi_drive_bridge.simulator import Simulator as DriveSimulator
from rugged_teleop.multicasts import free_port, LOOPBACK, MulticastDevice
from rugged_teleop.ports import DevicePort
from rugged_teleop.stack import wiring
from stage.devices import DRIVE, MUX, Stage, TIMEOUTS, UNIT, VSC
from stage.rig import NodeProcess, Observer
from stage.talkers import Diagnostics, Talker
from vm110_bridge.simulator import Simulator as UnitSimulator

NODES = (VSC, UNIT, MUX, DRIVE)  # without those of ``Setting.all_devices``
STACK = 'stack'
_DISCOVERY = 0.05  # s in which a subscriber that a publisher knows knows the publisher, too
NOISE_PERIOD = 0.004  # s
_FULL = Joy(axes=[0.0, 1.0, 0.0, 0.0, 0.0, 0.0], buttons=[1, *[0] * 7])
SECOND: Final[dict[str, Any]] = {  # what a second publisher says, on what somebody listens to
    f'/{VSC}/joy': _FULL,
    f'/{VSC}/estop': Bool(data=False),
    f'/{DRIVE}/estop': Bool(data=False),
    f'/{MUX}/command': JointState(name=['left', 'right'], velocity=[9.0, 9.0]),
    f'/{MUX}/enable': Bool(data=True),
    f'/{MUX}/estop': Bool(data=False),
}
MORE_SECOND: Final[dict[str, Any]] = {f'/{name}/estop': Bool(data=False) for name in BESIDE}
_NEIGHBOUR = """
import signal, sys, threading, time
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool, String
rclpy.init()
node = rclpy.create_node('neighbour')
for kind, topic in ((Bool, 'safety_mux/estop'), (Bool, 'fort_vsc_bridge/estop'),
                    (Bool, 'esi_drive_bridge/estop'), (Joy, 'fort_vsc_bridge/joy')):
    node.create_subscription(kind, topic, lambda message: None, 10)
publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
message = DiagnosticArray(status=[DiagnosticStatus(name='x' * 1000)])
asked = threading.Event()
signal.signal(signal.SIGUSR1, lambda *_: asked.set())
def flood():
    while asked.wait():
        asked.clear()
        end = time.monotonic() + 1.0
        while time.monotonic() < end:
            publisher.publish(message)
threading.Thread(target=flood, daemon=True).start()
print('neighbour is ready', flush=True)
rclpy.spin(node)
"""


class LyingDrive(DriveSimulator):
    """A drive that may tell another speed than its motors have."""

    factor = 1.0

    def _feedback(self, axis: Any) -> int:
        return min(max(round(super()._feedback(axis) * self.factor), -32768), 32767)


class Setting(NamedTuple):
    """
    All nodes in one process; a factor for their time-outs, on a busy machine; two hosts.

    :param all_devices: false: without SSC and Akron unit, where a processor is slow.
    """

    stack: bool = False
    patience: float = 1.0
    two_hosts: bool = False
    all_devices: bool = True

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes, in whatever processes."""
        return (*NODES, *BESIDE) if self.all_devices else NODES


def address_space(pid: int) -> int:
    """Return the bytes that a process has mapped."""
    pages = int(Path(f'/proc/{pid}/statm').read_text().split()[0])
    return pages * resource.getpagesize()


def descriptors(pid: int) -> int:
    """Return one more than the highest descriptor of a process."""
    return 1 + max(int(path.name) for path in Path(f'/proc/{pid}/fd').iterdir())


class Machine(Stage):
    """
    VSC bridge, mux and drive node on simulated devices, and a VM-110's, which has a stop alone.

    They are four processes, or one; SSC and Akron unit beside them make two more.
    """

    def __init__(self, folder: Path, observer: Observer, setting: Setting) -> None:
        super().__init__(folder, observer, setting.nodes)
        self.setting, self.is_patient = setting, setting.patience > 1.0
        self.drive.exchange(LyingDrive(command_timeout=0.1 * setting.patience))
        self.unit = self.add(MulticastDevice(UnitSimulator(), free_port()))
        self.devices: dict[str, Any] = {VSC: self.vsc, UNIT: self.unit, DRIVE: self.drive}
        self.windows: list[float] = []  # moments at which the deadman was pressed, all at rest
        self.held = False
        self.ended: list[NodeProcess] = []  # which have printed something
        self.neighbour: NodeProcess | None = None
        self._noise: threading.Event | None = None
        self._seconds: list[Talker] = []
        self._busy = contextlib.ExitStack()
        self._limited: list[tuple[int, int, tuple[int, int]]] = []
        self._parameters: dict[str, dict[str, Any]] = {
            VSC: {'port': str(self.vsc.path)},
            DRIVE: {'port': str(self.drive.path)},
            UNIT: {'input_port': self.unit.port, 'interface_address': LOOPBACK},
            MUX: {
                'reset_silence': 0.0,
                'feedback.topic': f'{DRIVE}/joint_states',
                'estop_sources': ['fort', 'drive', 'vm110'],
                'estop.vm110.topic': f'{UNIT}/estop',
            },
        }
        self.wired = {DRIVE: str(self.drive.path)}  # actuators' nodes, and where their wires are
        defaults = [TIMEOUTS]
        self.beside = Beside(self, folder) if setting.all_devices else None
        if self.beside:
            self.devices |= self.beside.devices
            self.wired |= self.beside.wired
            self._give(self.beside.parameters)
            defaults.append(self.beside.DEFAULTS)
        self.diagnostics = {name: Diagnostics(observer, name) for name in self.wired}
        if self.is_patient:
            for table in defaults:
                self._give(table, setting.patience)
        for name in self.names:
            self.start_node(name)

    def _give(self, parameters: Mapping[str, Mapping[str, Any]], factor: float = 0.0) -> None:
        """Add parameters of nodes. :param factor: of all values; 0: as they are."""
        for name, values in parameters.items():
            given = self._parameters.setdefault(name, {})
            given |= {key: value * factor if factor else value for key, value in values.items()}

    @property
    def names(self) -> tuple[str, ...]:
        """The processes."""
        return (STACK,) if self.setting.stack else self.setting.nodes

    def start_node(self, name: str) -> None:
        """Start one of ``names``, or start it again."""
        if name == STACK:
            nodes = self.setting.nodes
            given = {f'{n}:{key}': v for n in nodes for key, v in self._parameters[n].items()}
            self.start(STACK, 'rugged_teleop.stack', given, ('--', *nodes))
        else:
            self.start(name, f'{name}.node', self._parameters[name], wiring([name]))

    def start(self, name: str, module: str, parameters: Any, arguments: Iterable[str]) -> None:
        if name in self.nodes:
            self.ended.append(self.nodes[name])
        super().start(name, module, parameters, arguments)

    def owner(self, name: str) -> str:
        """Return the process that this node is in."""
        return STACK if self.setting.stack else name

    def wires(self, name: str) -> list[int]:
        """Return the processes that own the wire of this node."""
        process = self.nodes[self.owner(name)].process
        found = wires_of(process.pid) if process.poll() is None else []
        return [pid for pid in found if title(pid).startswith(f'{name}: ')]

    def processes(self) -> list[int]:
        """Return the nodes and their wires."""
        running = [node.process for node in self.nodes.values() if node.process.poll() is None]
        return [pid for process in running for pid in family(process.pid)]

    def start_neighbour(self) -> None:
        """Have another process listen to all e-stops."""
        if self.neighbour is None or self.neighbour.process.poll() is not None:
            self.neighbour = self._exits.enter_context(NodeProcess(source=_NEIGHBOUR))
            self.neighbour.wait_output('neighbour is ready')

    def pause(self, seconds: float) -> None:
        """Spin for so long."""
        end = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() >= end, 'time', seconds + 5.0)

    # What the persons at the remotes do.

    def arm_unit(self) -> None:
        """Arm the VM-110's remote; nothing, if the base unit does not allow it just now."""
        with contextlib.suppress(ValueError):
            self.unit.apply('arm 1')

    def hold(self) -> None:
        self.windows.append(time.monotonic())
        self.held = True
        self.vsc.apply('button left_down 1', 'stick left_y 0.5')
        if self.beside:
            self.beside.ask(motion=True)

    def let_go(self) -> float:
        self.held = False
        if self.beside:
            self.beside.ask(motion=False)
        return self.vsc.apply('stick left_y 0', 'button left_down 0')

    # What is undone after whatever was done.

    def noise(self, device: DevicePort, noise: Callable[[], list[bytes]]) -> None:
        """Have the device's line carry more between its frames, every NOISE_PERIOD."""
        self._noise = ended = threading.Event()

        def speak(_: Any, now: float) -> None:
            for data in noise():
                device._lines['out'].put(data, now)

        def run() -> None:
            while not ended.wait(NOISE_PERIOD):
                with contextlib.suppress(RuntimeError):
                    device.call(speak)

        threading.Thread(target=run, daemon=True).start()

    def second(self, topic: str, rate: float) -> float:
        """Publish where somebody else does; return the moment of its first message."""
        message = {**SECOND, **MORE_SECOND}[topic]
        talker = Talker(self.observer, type(message), topic, message, rate=rate)
        self._seconds.append(talker)
        self.wait(talker.publisher.get_subscription_count, f'a subscriber of {topic}')
        self.pause(_DISCOVERY * self.setting.patience)
        at = time.monotonic()
        talker.say()
        return at

    def saturate(self) -> None:
        self._busy.enter_context(busy_cores())

    def limit(self, kind: int, used: Callable[[int], int]) -> None:
        """Let nodes and wires have no more of a resource than they use."""
        for pid in self.processes():
            before = resource.prlimit(pid, kind)
            resource.prlimit(pid, kind, (used(pid), before[1]))
            self._limited.append((pid, kind, before))

    def calm(self) -> None:
        """Take back what this process does beside the nodes."""
        if self._noise:
            self._noise.set()
        for talker in self._seconds:
            talker.leave()
        self._seconds.clear()
        self._busy.close()
        for pid, kind, before in self._limited:
            with contextlib.suppress(ProcessLookupError):  # it could not do without
                resource.prlimit(pid, kind, before)
        self._limited.clear()

    def restart_ended(self) -> None:
        """Start each node again that has ended."""
        for name in self.names:
            if self.nodes[name].process.poll() is not None:
                self.start_node(name)

    def mend(self) -> None:
        """Have lines and devices sound, and all nodes running."""
        self.calm()
        self.restart_ended()
        for name in self.names:
            self.nodes[name].signal(signal.SIGCONT)
        self.vsc.apply('clear', 'radio on', 'estop remote off', 'ack', 'mode operational')
        self.drive.apply('clear', 'mute off', 'deaf off')
        self.unit.apply('clear', 'stop 1 off', 'radio 1 on')
        if self.beside:
            self.beside.mend()

    def close(self) -> None:
        self.calm()
        super().close()
