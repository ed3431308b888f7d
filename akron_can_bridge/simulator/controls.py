# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Who asks a unit to move, and whom it obeys: Appendix B."""

from __future__ import annotations

from dataclasses import dataclass, field
import math

from akron_can_bridge.simulator.frames import read_deflection, read_switches, Stick

JOYSTICK_TIMEOUT = 0.2  # silence after which a source's input is cleared
ADDRESSES = tuple(range(0x33, 0x39))  # the first one has the highest priority
_IDLE = Stick(None, None, frozenset())


@dataclass(slots=True)
class Source:
    """One joystick on the bus, as last heard."""

    stick: Stick = _IDLE
    aim: tuple[int | None, int | None] = (None, None)  # target positions in 0.1 %
    heard: float = -math.inf
    frames: int = 0
    cleared: int = 0  # times that it fell silent while it asked for something

    def clear(self) -> None:
        """Forget what it asked for."""
        self.cleared += any(self.stick)
        self.stick, self.aim = _IDLE, (None, None)


@dataclass(slots=True)
class Controls:
    """
    All that may ask.

    :param switch_axes: axis (from 0) and direction that a switch moves.
    :param timeout: s of silence after which a source's input is cleared.
    """

    switch_axes: dict[int, tuple[int, int]]
    physical: dict[int, float] = field(default_factory=dict)  # switches on the unit, by axis
    sources: dict[int, Source] = field(default_factory=dict)
    timeout: float = JOYSTICK_TIMEOUT

    def take_basic(self, address: int, data: bytes, now: float) -> frozenset[int]:
        """Take PGN 64982. Return the switches that it newly turns on."""
        source = self._heard(address, now)
        before = source.stick.switches
        x, y = (read_deflection(*data[place : place + 2]) for place in (0, 2))
        source.stick = Stick(x, y, read_switches(data[5:8], 1))
        return source.stick.switches - before

    def take_extended(self, address: int, data: bytes, now: float) -> None:
        """Take PGN 64983."""
        x, y = (read_deflection(*data[place : place + 2]) for place in (0, 2))
        self._heard(address, now).aim = (x, y)

    def expire(self, now: float) -> None:
        """Clear the input of those who are silent."""
        for source in self.sources.values():
            if now - source.heard >= self.timeout:
                source.clear()

    def forget_sources(self) -> None:
        """Know of nobody, as after a restart."""
        self.sources.clear()

    def requests(self, axis: int) -> dict[str, float]:
        """Return who asks to move an axis (from 0), -1 to 1, the highest priority first."""
        asked = {'physical': self.physical.get(axis, 0.0)}
        for address in ADDRESSES:
            if address in self.sources:
                asked[f'{address:02X}'] = self._asked(self.sources[address].stick, axis)
        return {name: demand for name, demand in asked.items() if demand}

    def aim(self) -> tuple[float | None, float | None]:
        """Return the point/aim targets in degrees (100 % is 175 and 90 degrees)."""
        first = [self.sources[a].aim for a in ADDRESSES if a in self.sources]
        x = next((x for x, _ in first if x is not None), None)
        y = next((y for _, y in first if y is not None), None)
        return None if x is None else x * 0.175, None if y is None else y * 0.09

    def leader(self) -> Stick:
        """Return what the highest of those that are heard says."""
        heard = (self.sources[a].stick for a in ADDRESSES if a in self.sources)
        return next((stick for stick in heard if stick != _IDLE), _IDLE)

    def _asked(self, stick: Stick, axis: int) -> float:
        deflection = {0: stick.x, 1: None if stick.y is None else -stick.y}  # back is up
        demand = (deflection.get(axis) or 0) / 1000
        moved = (
            way for n, (a, way) in self.switch_axes.items() if n in stick.switches and a == axis
        )
        return demand or float(sum(moved))

    def _heard(self, address: int, now: float) -> Source:
        source = self.sources.setdefault(address, Source())
        source.heard = now
        source.frames += 1
        return source
