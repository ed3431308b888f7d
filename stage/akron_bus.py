# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bus without a port or a clock: devices that hear each other, a host, and a unit's bench."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any, NamedTuple, Protocol

from akron_can_bridge.simulator import Simulator
from bridge_core.j1939 import CanFrame

# Joystick frames by hand: 1000 is 3E8 hex, low two bits 00, so FA in the high byte.
REST = '0100010000000000'
RIGHT, LEFT = '10FA010000000000', '04FA010000000000'
FORWARD, BACK = '010010FA00000000', '010004FA00000000'
HALF_RIGHT = '107D010000000000'
STICK = '0CFDD633'


class Device(Protocol):
    """What every simulator is."""

    def receive(self, frame: CanFrame, now: float) -> None: ...
    def poll(self, now: float) -> list[CanFrame]: ...
    def deadline(self) -> float: ...


class Heard(NamedTuple):
    at: float
    sender: Device | None  # None: the host
    frame: CanFrame


class Host:
    """Whoever else is on the bus. :param period: seconds between two rounds of its frames."""

    def __init__(self, period: float = 0.02) -> None:
        self.period = period
        self.repeats: tuple[CanFrame, ...] = ()
        self._due = -math.inf

    def receive(self, frame: CanFrame, now: float) -> None:
        del frame, now

    def poll(self, now: float) -> list[CanFrame]:
        if not self.repeats or now < self._due:
            return []
        self._due = now + self.period
        return list(self.repeats)

    def deadline(self) -> float:
        return self._due if self.repeats else math.inf


class Bus:
    """Every frame reaches all devices but its sender, at once."""

    def __init__(self, *devices: Device, now: float = 50.0) -> None:
        self.host = Host()
        self.devices: list[Device] = [*devices, self.host]
        self.now = now
        self.heard: list[Heard] = []  # since the last run began

    def run(self, seconds: float) -> Bus:
        """Poll every device at its deadline."""
        end, self.heard = self.now + seconds, []
        for _ in range(round(2000 + 4000 * seconds)):
            for device in self.devices:
                for frame in device.poll(self.now):
                    self._deliver(device, frame)
            due = max(self.now, min(device.deadline() for device in self.devices))
            if self.now >= end and due > end:
                return self
            self.now = min(due, end)
        raise AssertionError('a device spins')

    def say(self, identifier: str, data: str) -> Bus:
        """Send one frame, in hexadecimal."""
        self._deliver(self.host, CanFrame(int(identifier, 16), bytes.fromhex(data)))
        return self

    def repeat(self, *frames: tuple[str, str]) -> Bus:
        """Send these frames every 20 ms from now on; none: fall silent."""
        self.host.repeats = tuple(CanFrame(int(i, 16), bytes.fromhex(d)) for i, d in frames)
        return self

    def of(self, identifier: str, start: str = '') -> list[str]:
        """Return the data of what was heard with this identifier, in hexadecimal."""
        return [heard.frame.data.hex().upper() for heard in self._others(identifier, start)]

    def times(self, identifier: str, start: str = '') -> list[float]:
        """Return when those were heard."""
        return [heard.at for heard in self._others(identifier, start)]

    def _others(self, identifier: str, start: str) -> list[Heard]:
        wanted, head = int(identifier, 16), bytes.fromhex(start)
        heard = [each for each in self.heard if each.frame.identifier == wanted and each.sender]
        return [each for each in heard if each.frame.data.startswith(head)]

    def _deliver(self, sender: Device, frame: CanFrame) -> None:
        self.heard.append(Heard(self.now, None if sender is self.host else sender, frame))
        for device in self.devices:
            if device is not sender:
                device.receive(frame, self.now)


class Bench(Bus):
    """A unit that has its address."""

    def __init__(
        self, *lines: str, others: Sequence[Device] = (), boots: float = 0.5, **options: Any
    ) -> None:
        self.unit = Simulator(**options)
        super().__init__(self.unit, *others)
        self.run(boots)
        self.apply(*lines)

    def apply(self, *lines: str) -> Bench:
        for line in lines:
            self.unit.apply(line)
        return self

    def stick(self, *data: str, source: int = 0x33) -> Bench:
        """Have a joystick send this every 20 ms; nothing: have it fall silent."""
        self.repeat(*((f'0CFDD6{source:02X}', text) for text in data))
        return self

    def moved(self, seconds: float, axis: int = 0) -> float:
        """Return by how many degrees it turns to the right meanwhile; axis 1: up."""
        before = self.unit.motion.degrees(axis)
        self.run(seconds)
        return self.unit.motion.degrees(axis) - before

    @property
    def described(self) -> dict[str, Any]:
        return self.unit.describe()
