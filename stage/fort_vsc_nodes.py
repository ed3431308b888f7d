# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VSC's node as a process, with a simulated VSC on each of its three transports."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import BatteryState, Joy, NavSatFix
from std_msgs.msg import Bool, Int8, String

from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.simulator import CanSimulator, HidSimulator, Simulator
from rugged_teleop.canbuses import CanBusDevice, frames, pack, unpack
from stage.can_rig import CanBus
from stage.devices import Device, Exchangeable
from stage.node_bench import BridgeBench, LINK, started
from stage.rig import latched, Observer

NAME = 'fort_vsc_bridge'


class Station(Exchangeable, CanBusDevice):
    """A simulated VSC on a CAN bus, which may be kept from sending some of its frames."""

    def __init__(self, bus: CanBus, simulator: CanSimulator) -> None:
        self._muted: set[int] = set()  # identifiers
        self._added: set[bytes] = set()  # which is sent all the same
        super().__init__(simulator, bus.channel, interface=bus.interface)

    def exchange(self, simulator: CanSimulator) -> None:
        """Put another VSC on the bus, with nothing muted or on record."""
        super().exchange(simulator)
        self.mute()

    def mute(self, *identifiers: int) -> None:
        """Keep these back, and none else."""
        self.call(lambda *_: setattr(self, '_muted', set(identifiers)))

    def look(self, what: Callable[[CanSimulator], Any]) -> Any:
        """Return something about the simulator, undisturbed."""
        return self.call(lambda device, _: what(device))  # type: ignore[arg-type]

    def send(self, identifier: int, data: bytes) -> float:
        """Send a frame that the simulator knows nothing of; return the moment."""

        def add(_: Any, now: float) -> float:
            packed = pack(CanFrame(identifier, data))
            self._added.add(packed)
            self._lines['out'].put(packed, now)
            return now

        return self.call(add)

    def _write_port(self, data: bytes) -> int:
        frame = unpack(data)
        if frame is not None and frame.identifier in self._muted and data not in self._added:
            return len(data)
        return super()._write_port(data)

    @property
    def heard(self) -> list[CanFrame]:
        """What the node has sent."""
        return frames(self.received())


class NodeBench(BridgeBench):
    """One bridge; ``vsc`` is what it is joined to, None for nothing."""

    def __init__(
        self, vsc: Any, where: dict[str, Any], observer: Observer, *, patient: bool = True
    ) -> None:
        self.vsc = vsc
        super().__init__(observer, *started(NAME, parameters=where, patient=patient))
        self.own_estop = self.record(Bool, 'own_estop', latched())
        self.joy = self.record(Joy, 'joy', 50)
        self.mode = self.record(String, 'mode', latched())
        self.autonomy = self.record(String, 'autonomy_mode', latched())
        self.strength = self.record(Int8, 'radio_strength', latched())
        self.battery = self.record(BatteryState, 'battery', latched())
        self.device = self.record(DiagnosticStatus, 'device', latched())
        self.fix = self.record(NavSatFix, 'fix')
        self.nmea = self.record(String, 'nmea')
        self.user_values = self.record(KeyValue, 'user_values')

    def start_anew(self) -> None:
        """Have a fresh VSC with an operational remote, and hear that it is well."""
        self.vsc.exchange(type(self.vsc.simulator)())
        since = self.vsc.apply('mode operational')
        self.wait_says(self.mode, 'Operational')
        self.wait_says(self.estop, False)
        self.wait(lambda: list(self.joy.since(since)), 'sticks')

    @staticmethod
    def says(record: Any, value: Any) -> bool:
        return record.last is not None and record.last.data == value

    def wait_says(self, record: Any, value: Any) -> None:
        """Wait until the newest message of a topic is this."""
        self.wait(lambda: self.says(record, value), f'{value!r}')

    def axes(self) -> list[float]:
        return [] if self.joy.last is None else list(self.joy.last.axes)

    def wait_deflected(self) -> None:
        """Have the left stick forward, and hear of it."""
        self.vsc.apply('stick left_y 1')
        self.wait(lambda: self.axes()[1:2] == [1.0], 'full deflection')

    def wait_neutral(self) -> None:
        self.wait(lambda: not any(self.axes()) and not any(self.joy.last.buttons), 'neutral')

    def level(self, part: str) -> Any:
        """Return the level of a part's newest diagnostic."""
        status = self.diagnostics.status(part)
        return None if status is None else status.level

    def count(self, key: str, part: str = LINK) -> int:
        return int(self.diagnostics.value(part, key) or 0)

    def ask(self, kind: Any, topic: str, *messages: Any) -> float:
        """Publish once each, when the node listens; return the moment before."""
        publisher = self.observer.publisher(kind, f'{self.name}/{topic}')
        since = time.monotonic()
        for message in messages:
            publisher.publish(message)
        return since

    def heard(self, since: float = 0.0) -> bytes:
        """Return the bytes that the node has sent since a moment."""
        return b''.join(chunk.data for chunk in self.vsc.received(since))

    def close(self) -> None:
        super().close()
        if self.vsc is not None:
            self.vsc.close()


def serial_bench(
    folder: Path, observer: Observer, *, patient: bool = True, **parameters: Any
) -> NodeBench:
    vsc = Device(folder / 'vsc', Simulator())
    given = {'port': vsc.path, 'link_timeout': 1.0, **parameters}  # longer than busy machines hold
    return NodeBench(vsc, given, observer, patient=patient)


def can_bench(bus: CanBus, observer: Observer, **parameters: Any) -> NodeBench:
    where = {'transport': 'can', 'interface': bus.interface, 'channel': bus.channel}
    return NodeBench(Station(bus, CanSimulator()), {**where, **parameters}, observer)


def hid_bench(folder: Path, observer: Observer, **parameters: Any) -> NodeBench:
    vsc = Device(folder / 'hidraw', HidSimulator())
    where = {'transport': 'hid', 'port': str(vsc.path), 'hid.devices': ['none']}
    return NodeBench(vsc, {**where, **parameters}, observer)
