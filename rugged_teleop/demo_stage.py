"""
What a demo plays on: simulated devices on ports of their own, the stack as a child, a watcher.

Nothing of it meets a robot: it has its own ROS domain on this machine only, and its own scratch
directory, which is gone afterwards.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import contextlib
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import threading
import time
from types import TracebackType
from typing import Any
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool
from std_msgs.msg import String
from std_srvs.srv import Trigger

from akron_can_bridge.simulator import Simulator as MonitorSimulator
from esi_drive_bridge.protocol import Command
from esi_drive_bridge.protocol import command_parser
from esi_drive_bridge.protocol import Layout
from esi_drive_bridge.simulator import Simulator as DriveSimulator
from fort_vsc_bridge.simulator import Simulator as VscSimulator
from rugged_teleop.canbuses import CanBusDevice
from rugged_teleop.canbuses import free_channel
from rugged_teleop.demo_relay import Relay
from rugged_teleop.domains import claim_domain
from rugged_teleop.domains import shared
from rugged_teleop.multicasts import free_port
from rugged_teleop.multicasts import MulticastDevice
from rugged_teleop.ports import Chunk
from rugged_teleop.ptys import PtyDevice
from ssc_bridge.simulator import Settings as SscSettings
from ssc_bridge.simulator import Simulator as SscSimulator
from vm110_bridge.simulator import Simulator as UnitSimulator

LAYOUT = Layout.DUAL
ESTOPS = {
    'VSC': '/fort_vsc_bridge/estop',
    'VM-110': '/vm110_bridge/estop',
    'drive': '/esi_drive_bridge/estop',
    'monitor': '/akron_can_bridge/estop',
    'SSC': '/ssc_bridge/estop',
}
SERVICES = {
    'reset': '/safety_mux/reset',
    'trip': '/safety_mux/trip',
    'clear_errors': '/esi_drive_bridge/clear_errors',
}
# The stop of each remote reaches the hardware chain of the other; see docs/safety_mux.md.
CHAINS = {
    'fort_vsc_bridge:~/software_estop': 'safety_mux/stop_demand/fort',
    'vm110_bridge:~/hold_output': 'safety_mux/stop_demand/vm110',
}
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_OVERLAP = 0.1  # s of bytes before the wanted ones, for a packet that began there
_LEAVE_TIME = 3.0
_SHUT_US = 1000  # the throttle's failsafe; see config/demo.yaml
# The transmitter's switch at 1 ms, where the table has SERIAL, and its deadman released.
_AT_HAND = ('channel 1 1000', 'channel 4 1000')


class DemoError(Exception):
    """The demo cannot go on: its stack does not start, or has ended."""


class Packet(NamedTuple):
    """A command packet, and when its last byte was read (seconds, monotonic)."""

    at: float
    command: Command

    @property
    def enables(self) -> bool:
        """Whether any axis is told to be enabled."""
        return any(axis.enable for axis in self.command.axes)

    @property
    def moves(self) -> bool:
        """Whether any enabled axis is told to turn."""
        return any(axis.enable and axis.value for axis in self.command.axes)


def packets_in(chunks: list[Chunk], since: float) -> list[Packet]:
    """Return the command packets that were complete after ``since``."""
    parser, packets = command_parser(LAYOUT), []
    for at, data in chunks:
        packets += [Packet(at, command) for command in parser.feed(data, at)]
    return [packet for packet in packets if packet.at > since]


def demo_config() -> Path:
    """Return the path of the stack's parameters."""
    try:
        return shared('config/demo.yaml')
    except FileNotFoundError as error:
        raise DemoError(str(error)) from error


class Watcher:
    """A node that keeps the newest of what the stack publishes, spun by a thread of its own."""

    def __init__(self) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.axes: tuple[float, ...] = ()
        self.buttons: tuple[int, ...] = ()
        self.estops: dict[str, tuple[float, bool]] = {}  # arrival, value
        self.states: deque[tuple[float, str]] = deque(maxlen=1000)  # each change
        self.message = ''  # of the mux's status
        self.values: dict[str, str] = {}
        self.velocities: dict[str, float] = {}  # rad/s by joint
        self._closing = False
        self._node = rclpy.create_node('rugged_teleop_demo')
        self._relay = Relay(self._node)
        self._subscribe()
        self._clients = {
            name: self._node.create_client(Trigger, service) for name, service in SERVICES.items()
        }
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name='watcher', daemon=True)
        self._thread.start()

    @property
    def state(self) -> str:
        """The mux's state; empty before the first word of it."""
        return self.states[-1][1] if self.states else ''

    @property
    def inhibits(self) -> list[str]:
        """Why nothing moves, in the mux's words."""
        return [text for name, text in self.values.items() if name.startswith('inhibit')]

    def clear(self, name: str, within: float = 0.3) -> bool:
        """Tell whether this e-stop (see ESTOPS) was heard lately, and said false."""
        at, value = self.estops.get(name, (-within, True))
        return not value and time.monotonic() - at < within

    def ask(self, service: str, on_reply: Callable[[bool, str], None]) -> None:
        """Call a service; ``on_reply`` gets success and message, on another thread."""
        client = self._clients[service]
        if not client.service_is_ready():
            on_reply(False, f'nobody offers {SERVICES[service]}')
            return

        def reply(future: Any) -> None:
            response = future.result()
            on_reply(response.success, response.message)

        client.call_async(Trigger.Request()).add_done_callback(reply)

    def call(self, service: str, timeout: float = 5.0) -> tuple[bool, str]:
        """Call a service and wait. :raises DemoError: no answer within ``timeout`` seconds."""
        done, replies = threading.Event(), []

        def on_reply(success: bool, message: str) -> None:
            replies.append((success, message))
            done.set()

        self.ask(service, on_reply)
        if not done.wait(timeout):
            raise DemoError(f'{SERVICES[service]} gives no answer within {timeout:g} s')
        return replies[0]

    def close(self) -> None:
        """Leave the graph."""
        self._closing = True
        self._executor.shutdown()
        self._thread.join(1.0)
        self._node.destroy_node()
        rclpy.try_shutdown()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except Exception:  # rclpy's own, of handles that are gone
            if not self._closing:
                raise

    def _subscribe(self) -> None:
        create = self._node.create_subscription
        create(Joy, '/fort_vsc_bridge/joy', self._on_joy, 10)
        for name, topic in ESTOPS.items():
            create(Bool, topic, lambda message, name=name: self._on_estop(name, message), _LATCHED)
        create(String, '/safety_mux/state', self._on_state, _LATCHED)
        create(DiagnosticStatus, '/safety_mux/status', self._on_status, _LATCHED)
        create(JointState, '/esi_drive_bridge/joint_states', self._on_joints, 10)

    def _on_joy(self, message: Any) -> None:
        self._relay.take_joy(message)
        self.axes, self.buttons = tuple(message.axes), tuple(message.buttons)

    def _on_estop(self, name: str, message: Any) -> None:
        self.estops[name] = (time.monotonic(), message.data)

    def _on_state(self, message: Any) -> None:
        self._relay.active = message.data == 'ACTIVE'
        if message.data != self.state:
            self.states.append((time.monotonic(), message.data))

    def _on_status(self, message: Any) -> None:
        self.message = message.message
        self.values = {value.key: value.value for value in message.values}

    def _on_joints(self, message: Any) -> None:
        self._relay.take_joints(message)
        self.velocities = dict(zip(message.name, message.velocity, strict=False))


def _ssc_simulator() -> SscSimulator:
    """Return an SSC that shuts the throttle by itself when its receiver gives no signal."""
    settings = SscSettings()
    settings.constants[0] = _SHUT_US
    simulator = SscSimulator(settings)
    for command in _AT_HAND:
        simulator.apply(command)
    return simulator


class Stage:
    """
    Everything that a demo needs, running from construction to ``close``. A context manager.

    :raises DemoError: something of it cannot be started.
    """

    def __init__(self) -> None:
        self._scratch = tempfile.TemporaryDirectory(prefix='rugged_teleop_demo_')
        self._cleanup = contextlib.ExitStack()
        self._cleanup.callback(self._scratch.cleanup)
        try:
            self._start(Path(self._scratch.name))
        except BaseException as error:
            self._cleanup.close()
            if isinstance(error, OSError | RuntimeError):  # no port, no domain
                raise DemoError(str(error)) from error
            raise

    def _start(self, scratch: Path) -> None:
        self._cleanup.enter_context(claim_domain())
        os.environ['ROS_LOG_DIR'] = str(scratch / 'log')
        add = self._cleanup.enter_context
        self.vsc = add(PtyDevice(VscSimulator(), scratch / 'fort_vsc'))
        self.drive = add(PtyDevice(DriveSimulator(), scratch / 'esi_drive'))
        self.unit = add(MulticastDevice(UnitSimulator(), free_port()))
        self.monitor = add(CanBusDevice(MonitorSimulator(), free_channel()))
        self.ssc = add(PtyDevice(_ssc_simulator(), scratch / 'ssc'))
        self._output = scratch / 'output'
        self.stack = self._start_stack()
        self._cleanup.callback(self._end_stack)
        self.started_at = time.monotonic()
        self.watcher = Watcher()
        self._cleanup.callback(self.watcher.close)

    def _start_stack(self) -> subprocess.Popen[bytes]:
        command = [sys.executable, '-m', 'rugged_teleop.stack', '--ros-args']
        command += ['--params-file', str(demo_config())]
        command += ['-p', f'fort_vsc_bridge:port:={self.vsc.path}']
        command += ['-p', f'esi_drive_bridge:port:={self.drive.path}']
        command += ['-p', f'vm110_bridge:input_port:={self.unit.port}']
        command += ['-p', f'akron_can_bridge:channel:={self.monitor.channel}']
        command += ['-p', f'ssc_bridge:port:={self.ssc.path}']
        command += [word for rule in CHAINS.items() for word in ('-r', ':='.join(rule))]
        with self._output.open('wb') as output:
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                cwd=Path(__file__).resolve().parent.parent,
            )

    def packets(self, since: float) -> list[Packet]:
        """Return the command packets that the drive got after ``since`` (seconds, monotonic)."""
        return packets_in(self.drive.received(since - _OVERLAP), since)

    def output(self, lines: int = 20) -> str:
        """Return the last lines that the stack has printed."""
        return '\n'.join(self._output.read_text(errors='replace').splitlines()[-lines:])

    def check(self) -> None:
        """:raises DemoError: the stack has ended."""
        status = self.stack.poll()
        if status is not None:
            raise DemoError(f'the stack has ended with status {status}:\n{self.output()}')

    def end_stack(self, timeout: float = _LEAVE_TIME) -> int:
        """End the stack by SIGTERM; return its exit status, negative if it had to be killed."""
        if self.stack.poll() is None:
            self.stack.send_signal(signal.SIGCONT)
            self.stack.terminate()
        try:
            return self.stack.wait(timeout)
        except subprocess.TimeoutExpired:
            self.stack.kill()
            return self.stack.wait()

    def _end_stack(self) -> None:
        self.end_stack()

    def close(self) -> None:
        """End the stack, and take away all that was made."""
        self._cleanup.close()

    def __enter__(self) -> Stage:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
