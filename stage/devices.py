# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A stage: simulated devices on ports of their own, nodes as processes, and an observer of both.

The spine's tests and the demo play on it. Every byte that crosses a port is kept with the moment
(seconds, monotonic) at which this side wrote or read it; reaction times are taken from these
records.
"""

from __future__ import annotations

import binascii
from collections.abc import Callable, Iterable, Iterator, Mapping
import contextlib
import itertools
from pathlib import Path
import struct
import time
from typing import Any, Final, NamedTuple, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from esi_drive_bridge.simulator import Simulator as DriveSimulator
from fort_vsc_bridge.simulator import Simulator as VscSimulator
from rugged_teleop.ports import Chunk, DevicePort
from rugged_teleop.ptys import PtyDevice
from stage.rig import latched, NodeProcess, Observer, wait_for

VSC, UNIT, SSC = 'fort_vsc_bridge', 'vm110_bridge', 'ssc_bridge'
MONITOR, DRIVE, MUX = 'akron_can_bridge', 'esi_drive_bridge', 'safety_mux'
RESET, TRIP, END_TRIP = f'/{MUX}/reset', f'/{MUX}/trip', f'/{MUX}/end_trip'
CLEAR_ERRORS = f'/{DRIVE}/clear_errors'
# Of what a busy machine may make late, in s, as delivered.
TIMEOUTS: Final[dict[str, dict[str, float]]] = {
    VSC: {'link_timeout': 0.25},
    UNIT: {'link_timeout': 0.5},
    MUX: {
        'stall_limit': 0.1,
        'estop.fort.timeout': 0.25,
        'estop.drive.timeout': 0.25,
        'estop.vm110.timeout': 0.25,
        'estop.fort.age_limit': 0.25,
        'estop.drive.age_limit': 0.25,
        'estop.vm110.age_limit': 0.25,
        'drive_enabled_timeout': 0.25,
        'drive_enabled_age_limit': 0.25,
        'feedback.timeout': 0.25,
        'operator.fort.timeout': 0.25,
        'operator.fort.age_limit': 0.5,
        'neutral_time': 0.3,
    },
    DRIVE: {'command_timeout': 0.1, 'link_timeout': 0.25, 'age_limit': 0.25},
}
# What a machine of VSC, mux and drive has none of.
_NO_SUCH = ('estop.vm110.timeout', 'estop.vm110.age_limit', 'feedback.timeout')
# Of a spine where nothing is about time, so that a busy machine does not stop it.
UNHURRIED: Final[dict[str, dict[str, float]]] = {
    node: {name: 6.0 * limit for name, limit in TIMEOUTS[node].items() if name not in _NO_SUCH}
    for node in (VSC, MUX, DRIVE)
}
# In the answer of a service of a bridge that was held up, or whose wire was.
LATE_WORDS = ('the wire of', 'held up', 'frozen', 'takes nothing')
BETWEEN_RESETS = 0.55  # s; within clear_time of another one, or of a trip, a reset does nothing
_SILENCE = 5.1  # s; reset_silence, which has to follow a reset that came when there was no stop
_KEPT = 2000  # messages of each topic
_OVERLAP = 0.1  # s of bytes before the wanted ones, for a packet that began there
_DRIVE_PACKET = struct.Struct('<BhBh')  # flags and value of each axis (ESI manual 4.2)
_DRIVE_START, _DRIVE_SIZE = b'\xf0\xf0', 10

T = TypeVar('T')
_PortT = TypeVar('_PortT', bound=DevicePort)


class Exchangeable(DevicePort):
    """A port whose simulator can be exchanged for another."""

    since = 0.0  # what is older does not count

    @property
    def simulator(self) -> Any:
        """The device itself. Look only; ``apply`` steers."""
        return self._device

    def exchange(self, simulator: Any) -> None:
        """Put another device at the end of the cable, plugged in, with nothing on record."""
        self.apply('clear')
        self.since = self.swap(simulator)

    def swap(self, simulator: Any) -> float:
        """Put another device at the end of the cable; return the moment."""

        def swap(_: Any, now: float) -> float:
            simulator.poll(now)
            self._device = simulator
            return now

        return self.call(swap)

    def _recorded(self, direction: str, since: float) -> list[Chunk]:
        return super()._recorded(direction, max(since, self.since))


class Device(Exchangeable, PtyDevice):
    """
    A simulator on a serial port.

    :param path: a link that the port is opened by. :param simulator: bytes and time, no port.
    """

    def __init__(self, path: Path, simulator: Any) -> None:
        super().__init__(simulator, path)

    def enable_message(self, kind: int, enabled: bool) -> None:
        """Switch one of a VSC's messages on or off; its interval stays."""
        messages = self.simulator.messages
        self.call(lambda *_: messages.update({kind: (enabled, messages[kind][1])}))

    def write(self, data: bytes) -> float:
        """Send bytes that the simulator knows nothing of; return the moment."""

        def add(_: Any, now: float) -> float:
            self._lines['out'].put(data, now)
            return now

        since = self.call(add) - 1e-9

        def written() -> list[float]:
            return [chunk.at for chunk in self.sent(since) if chunk.data == data]

        return wait_for(written, 5.0, lambda: f'{data.hex()} on the wire; {self.describe()}')[0]

    def last_sent(self, kind: int) -> float:
        """Return when a VSC's last message of this type was written."""
        return max(chunk.at for chunk in self.sent() if chunk.data[2] == kind)


class Packet(NamedTuple):
    """A command packet for two axes: when its last byte came, flags and value of each axis."""

    time: float
    flags: tuple[int, int]
    values: tuple[int, int]

    @property
    def enables(self) -> bool:
        """Tell whether an axis is enabled: bit 0 of its flags."""
        return any(flags & 1 for flags in self.flags)

    @property
    def moves(self) -> bool:
        """Tell whether it asks an enabled axis for motion."""
        return any(
            flags & 1 and value for flags, value in zip(self.flags, self.values, strict=True)
        )


def packets_in(chunks: Iterable[Chunk]) -> Iterator[Packet]:
    """Yield the sound command packets for two axes; this reader owes the bridge nothing."""
    buffer = b''
    for moment, data in chunks:
        buffer += data
        while (start := buffer.find(_DRIVE_START)) >= 0 and len(buffer) >= start + _DRIVE_SIZE:
            body = buffer[start + 2 : start + 8]
            (crc,) = struct.unpack_from('<H', buffer, start + 8)
            if binascii.crc_hqx(body, 0xFFFF) != crc:
                buffer = buffer[start + 1 :]
                continue
            buffer = buffer[start + _DRIVE_SIZE :]
            a, value_a, b, value_b = _DRIVE_PACKET.unpack(body)
            yield Packet(moment, (a, b), (value_a, value_b))


def greatest_step(packets: Iterable[Packet]) -> int:
    """Return by how much one packet differs from the one before it, at most."""
    pairs = itertools.pairwise(packet.values for packet in packets)
    return max(abs(a - b) for before, after in pairs for a, b in zip(before, after, strict=True))


class Drive(Device):
    """A drive of two axes, unless ``simulator`` is another one."""

    def __init__(self, path: Path, simulator: Any = None) -> None:
        super().__init__(path, simulator or DriveSimulator())

    def packets(self, since: float = 0.0) -> list[Packet]:
        """Return the command packets that were complete after ``since``."""
        return [p for p in packets_in(self.received(since - _OVERLAP)) if p.time > since]

    def first_disable(self, since: float) -> Packet | None:
        """Return the first packet after ``since`` that disables both axes."""
        return next((p for p in self.packets(since) if not p.enables), None)

    def heard_farewell(self) -> bool:
        """Tell whether the newest three packets disable, and ask for nothing."""
        last = self.packets()[-3:]
        return len(last) == 3 and not any(p.enables or any(p.values) for p in last)

    def packets_since_disabled(self, since: float) -> list[Packet]:
        """Return the packets after ``since`` that follow the last one that disables."""
        enabling = itertools.takewhile(lambda p: p.enables, reversed(self.packets(since)))
        return list(enabling)[::-1]

    @property
    def rpm(self) -> float:
        """The greatest speed of a motor."""
        return max(abs(float(axis.motor.rpm)) for axis in self.simulator._axes)

    @property
    def enabled(self) -> bool:
        """Tell whether an axis is enabled."""
        return any(axis.enabled for axis in self.simulator._axes)


class Stage:
    """
    A VSC and a drive on ports, and what their nodes and the mux say. A context manager.

    :param folder: for the ports' links.
    :param nodes: those whose e-stops are recorded.
    """

    is_patient = False  # the nodes let a busy machine hold their wires up
    _read: Any = None  # the status that the values are of
    _values: Mapping[str, str] = {}

    def __init__(self, folder: Path, observer: Observer, nodes: Iterable[str]) -> None:
        self.observer = observer
        self._exits = contextlib.ExitStack()
        self.vsc = self.add(Device(folder / 'fort_vsc', VscSimulator()))
        self.drive = self.add(Drive(folder / 'esi_drive'))
        self.nodes: dict[str, NodeProcess] = {}
        self.state = self.record(String, f'/{MUX}/state')
        self.status = self.record(DiagnosticStatus, f'/{MUX}/status')
        self.estops = {name: self.record(Bool, f'/{name}/estop') for name in nodes}
        self._services = {  # now: a node that discovers a client late may drop its first response
            name: observer.node.create_client(Trigger, name)
            for name in (RESET, TRIP, END_TRIP, CLEAR_ERRORS)
        }
        self._reset_counts_at = 0.0

    def add(self, port: _PortT) -> _PortT:
        """Close this port with the stage."""
        self._exits.callback(port.close)
        return port

    def record(self, kind: Any, topic: str) -> Any:
        """Keep what comes on a topic that is transient local."""
        return self.observer.record(kind, topic, latched(), keep=_KEPT)

    def start(self, name: str, module: str, parameters: Any, arguments: Iterable[str]) -> None:
        """Start a node, or start it again, under this name in ``nodes``."""
        words = tuple(arguments)
        node = NodeProcess(module, parameters, arguments=words, patient=self.is_patient)
        self.nodes[name] = self._exits.enter_context(node)

    # What is seen.

    @property
    def values(self) -> Mapping[str, str]:
        """The fields of the mux's newest status; empty before the first."""
        status = self.status.last
        if status is not self._read:
            fields = () if status is None else status.values
            self._read, self._values = status, {each.key: each.value for each in fields}
        return self._values

    @property
    def message(self) -> str:
        """The words of the mux's newest status, for people."""
        return self.status.last.message if self.status.messages else 'not heard'

    def condition(self, label: str) -> str:
        """Return the mux's one word for one of its inputs, such as "operator 'fort'"."""
        return self.values.get(f'condition of {label}', 'silent')

    def mux_says(self, *states: str) -> bool:
        """Tell whether the newest state is one of these, such as ACTIVE; and fresh."""
        return bool(self._fresh(self.state, 0.1) and self.state.last.data in states)

    def estop(self, node: str, within: float = 0.2) -> bool | None:
        """Return the newest e-stop of this node; None if none came within so many seconds."""
        estop = self.estops[node]
        return bool(estop.last.data) if self._fresh(estop, within) else None

    def is_clear(self, node: str) -> bool:
        """Tell whether the newest e-stop of this node is false, and fresh."""
        return self.estop(node) is False

    @staticmethod
    def _fresh(record: Any, limit: float) -> bool:
        return bool(record.times) and time.monotonic() - record.times[-1] < limit

    def status_since(self, moment: float) -> bool:
        """Tell whether a status has come after ``moment``."""
        return bool(self.status.times) and self.status.times[-1] > moment

    def may_repeat_reset(self) -> bool:
        """Tell whether a reset would not count as the repetition of the last one."""
        return time.monotonic() > self._reset_counts_at

    def may_reset(self) -> bool:
        """Tell whether nothing is missing but a reset."""
        values = self.values
        ready = values.get('stops clear') == values.get('operators at rest') == 'true'
        fresh = self.mux_says('STOPPED') and self._fresh(self.status, 0.3)
        return ready and fresh and self.may_repeat_reset()

    def is_rested(self, operator: str) -> bool:
        """Tell whether the mux is READY, and this operator's deadman gets control now."""
        is_ready = self.values.get('state') == 'READY'
        return is_ready and self.condition(f"operator '{operator}'") == 'rested'

    # What is done.

    def wait(self, condition: Callable[[], T], what: Any, timeout: float = 10.0) -> T:
        """Spin until it is true and return it. :raises AssertionError: none in time."""
        return self.observer.wait_for(condition, timeout, what)

    def ask(self, name: str) -> Any:
        """Call a service that is there; return the future of its response."""
        return self._services[name].call_async(Trigger.Request())

    def offers(self, name: str) -> bool:
        """Tell whether a service is there."""
        return bool(self._services[name].service_is_ready())

    def call(self, name: str) -> Any:
        """Call a service; return its response."""
        self.wait(lambda: self.offers(name), f'service {name}', 15.0)
        future = self.ask(name)
        self.wait(future.done, f'response of {name}')
        return future.result()

    def reset(self) -> Any:
        """Call the mux's reset; return the response."""
        reply = self.call(RESET)
        early = 'nothing to reset' in reply.message or 'none counts until' in reply.message
        # From now on, not from the call: that may have waited for the mux.
        self._reset_counts_at = time.monotonic() + (_SILENCE if early else BETWEEN_RESETS)
        return reply

    def ready(self) -> None:
        """Reset, once nothing else is missing, and let FORT's operator rest for long enough."""
        self.wait(self.may_reset, 'nothing missing but a reset')
        reply = self.reset()
        assert reply.success, reply.message
        self.rested()

    def rested(self) -> None:
        """Wait until FORT's deadman gets control."""
        self.wait(lambda: self.is_rested('fort'), 'a rested operator')

    # What must hold.

    def holds_still(self, since: float, duration: float = 0.6) -> int:
        """Watch for ``duration`` s that no packet after ``since`` enables; return their number."""
        seen = since

        def still() -> bool:
            nonlocal seen
            packets = self.drive.packets(seen)
            seen = packets[-1].time if packets else seen
            return not any(packet.enables for packet in packets)

        self.observer.holds_for(still, duration, 'disable packets only')
        packets = self.wait(lambda: self.drive.packets(since), 'packets, which never end')
        assert not any(packet.enables for packet in packets), self.message
        return len(packets)

    def close(self) -> None:
        """End the nodes, and take all ports away."""
        self._exits.close()

    def __enter__(self: T) -> T:
        return self

    def __exit__(self, *error: Any) -> None:
        self._exits.__exit__(*error)
