"""
The spine on a bench: VSC and drive on ptys in this process, each node a process of its own.

Every byte that crosses a pty is kept with the moment (seconds, monotonic) at which this side wrote
or read it. Reaction times are taken from these records.
"""

from __future__ import annotations

import binascii
from collections.abc import Iterator
from collections.abc import Mapping
from dataclasses import dataclass
import fcntl
import os
from pathlib import Path
import select
import signal
import struct
import subprocess
import sys
import time
from types import TracebackType
from typing import Any

from esi_drive_bridge.simulator import Simulator as DriveSimulator
from fort_vsc_bridge.simulator import Simulator as VscSimulator
from rugged_teleop.ports import Chunk
from rugged_teleop.ptys import PtyDevice
from rugged_teleop.stack import wiring
from test.rig import latched
from test.rig import NodeProcess
from test.rig import Observer
from test.rig import wait_for
from test.run_delay import RunDelay

VSC, MUX, DRIVE = 'fort_vsc_bridge', 'safety_mux', 'esi_drive_bridge'
MODULES = {VSC: 'fort_vsc_bridge.node', MUX: 'safety_mux.node', DRIVE: 'esi_drive_bridge.node'}
DEADMAN, STICK = 'left_down', 'left_y'  # the mux's defaults: button 0, axis 1


class _Socket:
    """What is at the end of the cable: a simulator that can be exchanged, and added bytes."""

    def __init__(self, simulator: Any) -> None:
        self.simulator = simulator
        self.added: list[bytes] = []

    def receive(self, data: bytes, now: float) -> None:
        self.simulator.receive(data, now)

    def poll(self, now: float) -> list[bytes]:
        added, self.added = self.added, []
        return [*added, *self.simulator.poll(now)]

    def deadline(self) -> float:
        return float(self.simulator.deadline())

    def apply(self, text: str) -> None:
        self.simulator.apply(text)

    def describe(self) -> dict[str, Any]:
        return dict(self.simulator.describe())


class Device:
    """
    A simulator on a port that is steered, unplugged and recorded.

    :param path: a link that the port is opened by. :param simulator: bytes and time, no port.
    """

    def __init__(self, path: Path, simulator: Any) -> None:
        self._socket = _Socket(simulator)
        self._port = PtyDevice(self._socket, path)
        self._since = 0.0  # what is older does not count
        self.path = str(path)  # what the node opens

    @property
    def simulator(self) -> Any:
        """The device itself. Look only; ``apply`` steers."""
        return self._socket.simulator

    def apply(self, *commands: str) -> float:
        """Steer port or simulator; return the moment of the last command."""
        return [self._port.apply(command) for command in commands][-1]

    def exchange(self, simulator: Any) -> None:
        """Put another device at the end of the cable, plugged in, with nothing on record."""

        def exchange(_: Any, now: float) -> None:
            self._socket.simulator = simulator
            simulator.poll(now)
            self._since = now

        self.apply('clear')
        self._port.call(exchange)

    def enable_message(self, kind: int, enabled: bool) -> None:
        """Switch one of a VSC's messages on or off; its interval stays."""
        messages = self.simulator.messages
        self._port.call(lambda *_: messages.update({kind: (enabled, messages[kind][1])}))

    def write(self, data: bytes) -> float:
        """Send bytes that the simulator knows nothing of; return the moment."""

        def add(_: Any, now: float) -> float:
            self._socket.added.append(data)
            return now

        since = self._port.call(add) - 1e-9

        def written() -> list[float]:
            return [chunk.at for chunk in self.sent(since) if chunk.data == data]

        return wait_for(written, 2.0, f'{data.hex()} on the wire')[0]

    def received(self, since: float = 0.0) -> list[Chunk]:
        """Return what was read from the node after ``since``."""
        return self._port.received(max(since, self._since))

    def sent(self, since: float = 0.0) -> list[Chunk]:
        """Return the frames that were written to the node after ``since``."""
        return self._port.sent(max(since, self._since))

    def last_sent(self, kind: int) -> float:
        """Return when a VSC's last message of this type was written."""
        return max(chunk.at for chunk in self.sent() if chunk.data[2] == kind)

    def close(self) -> None:
        """Take it away."""
        self._port.close()


@dataclass(frozen=True)
class Packet:
    """A command packet for two axes: when it came, flags and value of each (ESI manual 4.2)."""

    time: float
    flags: tuple[int, int]
    values: tuple[int, int]

    @property
    def enables(self) -> bool:
        """Tell whether an axis is enabled: bit 0 of its flags."""
        return any(flags & 1 for flags in self.flags)

    @property
    def moves(self) -> bool:
        """Tell whether it asks for motion."""
        return self.enables and any(self.values)


class Drive(Device):
    """A drive of two axes, with a reader of command packets that owes the bridge nothing."""

    def __init__(self, path: Path, simulator: Any = None) -> None:
        super().__init__(path, simulator or DriveSimulator())

    def packets(self, since: float = 0.0) -> list[Packet]:
        """Return the command packets that were complete after ``since``."""
        return [packet for packet in self._read(since - 0.1) if packet.time > since]

    def _read(self, since: float) -> Iterator[Packet]:
        buffer = b''
        for moment, data in self.received(since):
            buffer += data
            while (start := buffer.find(b'\xf0\xf0')) >= 0 and len(buffer) >= start + 10:
                body = buffer[start + 2 : start + 8]
                (crc,) = struct.unpack_from('<H', buffer, start + 8)
                if binascii.crc_hqx(body, 0xFFFF) != crc:
                    buffer = buffer[start + 1 :]
                    continue
                buffer = buffer[start + 10 :]
                a, value_a, b, value_b = struct.unpack('<BhBh', body)
                yield Packet(moment, (a, b), (value_a, value_b))

    def first_disable(self, since: float) -> Packet | None:
        """Return the first packet after ``since`` that disables both axes."""
        return next((p for p in self.packets(since) if not p.enables), None)

    @property
    def rpm(self) -> float:
        """The greatest speed of a motor."""
        return max(abs(float(axis.motor.rpm)) for axis in self.simulator._axes)

    @property
    def enabled(self) -> bool:
        """Tell whether an axis is enabled."""
        return any(axis.enabled for axis in self.simulator._axes)


class Spine:
    """
    VSC, mux and drive: three processes, two ptys, and an observer. Use it as a context manager.

    :param parameters: by node name, beside the ports.
    """

    def __init__(
        self,
        folder: Path,
        observer: Observer,
        parameters: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        from diagnostic_msgs.msg import DiagnosticStatus
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Bool
        from std_msgs.msg import String
        from std_srvs.srv import Trigger

        self.observer = observer
        self.vsc = Device(folder / 'vsc', VscSimulator())
        self.drive = Drive(folder / 'drive')
        self._parameters = parameters or {}
        self.nodes: dict[str, NodeProcess] = {}
        record = observer.record
        self.state = record(String, f'/{MUX}/state', latched())
        self.status = record(DiagnosticStatus, f'/{MUX}/status', latched())
        self.vsc_estop = record(Bool, f'/{VSC}/estop', latched())
        self.drive_estop = record(Bool, f'/{DRIVE}/estop', latched())
        self.mux_estop = record(Bool, f'/{MUX}/estop', latched())
        self.joints = record(JointState, f'/{DRIVE}/joint_states')
        self._services = {
            name: observer.node.create_client(Trigger, name)
            for name in (f'/{MUX}/reset', f'/{MUX}/trip', f'/{DRIVE}/clear_errors')
        }
        self._request = Trigger.Request()
        self._reset_at = 0.0

    def start(self, name: str) -> NodeProcess:
        """Start a node, or start it again."""
        parameters = dict(self._parameters.get(name, {}))
        device = {VSC: self.vsc, DRIVE: self.drive}.get(name)
        if device is not None:
            parameters['port'] = device.path
        self.nodes[name] = NodeProcess(MODULES[name], parameters, arguments=wiring([name]))
        return self.nodes[name]

    def call(self, name: str) -> Any:
        """Call one of the three Trigger services by its full name; return the response."""
        client = self._services[name]
        self.wait(client.service_is_ready, f'service {name}', 15.0)
        future = client.call_async(self._request)
        self.wait(future.done, f'response of {name}')
        return future.result()

    def reset(self) -> Any:
        """Call the mux's reset; return the response."""
        reply = self.call(f'/{MUX}/reset')
        self._reset_at = time.monotonic()
        return reply

    def wait(self, condition: Any, what: str, timeout: float = 10.0) -> Any:
        """Spin until it is true; the error says what the mux said last."""
        return self.observer.wait_for(condition, timeout, lambda: f'{what}; {self.story()}')

    def story(self) -> str:
        """Return in words where everything is."""
        status = self.status.last
        drive = self.drive.simulator.describe()
        return (
            f'mux: {self.state.last and self.state.last.data}, {status and status.message}; '
            f'drive enabled {drive["enabled"]}, command {drive["command"]}, '
            f'rpm {drive["rpm"]}; the drive node said last:\n{self.nodes[DRIVE].output[-400:]}'
        )

    # States.

    def rest(self) -> None:
        """Bring everything to the same start: alive, plugged in, nothing held, mux STOPPED."""
        self.vsc.exchange(VscSimulator())
        self.drive.exchange(DriveSimulator())
        for name in MODULES:
            if name not in self.nodes or self.nodes[name].process.poll() is not None:
                self.start(name)
        self.operational()
        self.vsc.apply('estop remote on')
        self.wait(lambda: self.mux_says('STOPPED'), 'STOPPED')
        self.release()
        self.observer.spin()
        self.wait(lambda: self.is_clear(self.vsc_estop), 'the VSC without a stop', 15.0)
        self.wait(lambda: self.is_clear(self.drive_estop), 'the drive without a stop', 15.0)

    @staticmethod
    def is_clear(estop: Any) -> bool:
        """Tell whether the newest of an e-stop's messages is false, and fresh."""
        fresh = bool(estop.times) and time.monotonic() - estop.times[-1] < 0.2
        return fresh and estop.last.data is False

    def mux_says(self, *states: str) -> bool:
        """Tell whether the newest state is one of these, such as ACTIVE; and fresh."""
        record = self.state
        fresh = bool(record.times) and time.monotonic() - record.times[-1] < 0.1
        return fresh and record.last.data in states

    def operational(self) -> None:
        """Let the remote be connected and in its operational mode."""
        self.vsc.apply('mode operational')

    def release(self) -> float:
        """Take a stop back on the remote, and acknowledge it; sticks count again."""
        return self.vsc.apply('estop remote off', 'estop vsc off', 'ack', 'mode operational')

    def ready(self) -> None:
        """Reset, once nothing else is missing, and let the operator rest for long enough."""
        self.wait(self.may_reset, 'nothing missing but a reset')
        reply = self.reset()
        assert reply.success, reply.message
        self.wait(lambda: self.mux_says('READY'), 'READY')
        self.wait(lambda: 'press the deadman' in self.status.last.message, 'a rested operator')

    def may_reset(self) -> bool:
        """
        Tell whether a fresh status names no inhibit but the stop itself and the reset.

        One that follows another within clear_time (0.5 s) counts as repeated, so wait for that.
        """
        if time.monotonic() < self._reset_at + 0.52 or not self.mux_says('STOPPED'):
            return False
        status = self.status.last
        if status is None or time.monotonic() - self.status.times[-1] > 0.3:
            return False
        inhibits = [value.value for value in status.values if value.key.startswith('inhibit')]
        return len(inhibits) == 2 and inhibits[1].startswith('waiting for reset')

    def hold(self, stick: float = 0.5) -> float:
        """Press the deadman, then push the stick; return when the stick moved."""
        self.vsc.apply(f'button {DEADMAN} 1')
        return self.vsc.apply(f'stick {STICK} {stick}')

    def let_go(self) -> None:
        """Release stick and deadman."""
        self.vsc.apply(f'stick {STICK} 0', f'button {DEADMAN} 0')

    def move(self) -> None:
        """Be in motion, from READY, by deadman and stick."""
        self.hold()
        self.wait(lambda: self.drive.enabled and self.drive.rpm > 20.0, 'motion')
        self._delay = RunDelay([node.process.pid for node in self.nodes.values()])

    def moving(self) -> None:
        """Be in motion, from STOPPED."""
        self.ready()
        self.move()

    def allowed(self, bound: float) -> float:
        """Return a bound (seconds) for what happened since the last motion began."""
        return bound + self._delay.seconds()

    def restart_rightly(self) -> None:
        """Show that the way back is open: all let go, reset, which moves nothing, deadman."""
        self.let_go()
        before = time.monotonic()
        self.ready()
        self.holds_still(before, 0.1)
        self.move()

    # What must hold.

    def disabled_after(self, cause: float, within: float) -> float:
        """Return the seconds from ``cause`` to the first disable packet; none enables later."""
        packet = self.wait(lambda: self.drive.first_disable(cause), 'a disable packet', 3.0)
        reaction = packet.time - cause
        within = self.allowed(within)
        assert reaction <= within, f'{reaction * 1e3:.0f} ms, allowed are {within * 1e3:.0f} ms'
        assert not any(p.enables for p in self.drive.packets(packet.time))
        return float(reaction)

    def holds_still(self, since: float, duration: float = 0.6) -> None:
        """Watch that no packet after ``since`` enables anything, for ``duration`` s more."""
        self.observer.holds_for(
            lambda: not any(packet.enables for packet in self.drive.packets(since)),
            duration,
            'disable packets only',
        )
        assert self.drive.packets(since), 'and packets never end'

    def __enter__(self) -> Spine:
        for name in MODULES:
            self.start(name)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for node in self.nodes.values():
            node.__exit__(kind, error, trace)
        self.vsc.close()
        self.drive.close()


class UntouchedPort:
    """A serial port that knows whether anybody has ever opened it."""

    def __init__(self) -> None:
        self._master = os.open('/dev/ptmx', os.O_RDWR | os.O_NOCTTY)
        fcntl.ioctl(self._master, 0x40045431, struct.pack('i', 0))  # TIOCSPTLCK
        (number,) = struct.unpack('i', fcntl.ioctl(self._master, 0x80045430, bytes(4)))  # TIOCGPTN
        self.path = f'/dev/pts/{number}'

    @property
    def was_opened(self) -> bool:
        """Tell whether it was opened and closed again: only then there is a hang-up to see."""
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        return any(events & select.POLLHUP for _, events in poll.poll(0))

    def close(self) -> None:
        """Give it back."""
        os.close(self._master)


def exit_of(module: str, *arguments: str, timeout: float = 20.0) -> tuple[int, str]:
    """Run a module to its end; return exit status and stderr."""
    process = subprocess.Popen(
        [sys.executable, '-m', module, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parent.parent,
    )
    try:
        _, error = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.communicate()
        raise
    return process.returncode, error
