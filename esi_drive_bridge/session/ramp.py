# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How fast what goes out may change once the drive is enabled, whatever is asked for.

Commands do not wait for a drive that is still enabling: by the time it is enabled, the newest may
ask for full speed. So every enabling starts at rest, and goes on from there by a step a packet.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from esi_drive_bridge.axes import Axis
from esi_drive_bridge.protocol import Mode


class Ramp:
    """
    Follows commands, in counts, within the ``slew_limit`` of each axis.

    Of a torque or a velocity only the growth away from 0 is limited: slowing down must not wait.
    Neither grows while commands fall: whoever stops by a ramp may be far ahead of this one.
    A position is limited both ways. Velocities that grow take the same share of their way in a
    packet, so that a curve stays; torques do not, as one that grows may brake.

    :param max_dt: seconds, the longest step; what a late packet has missed is not made up for.
    """

    __slots__ = ('_at', '_limits', '_max_dt', '_modes', '_offered', '_values', 'begun', 'falls')

    def __init__(self, axes: Sequence[Axis], max_dt: float) -> None:
        self._limits = tuple(axis.slew_limit / abs(axis.si_per_count) for axis in axes)
        self._modes = tuple(axis.mode for axis in axes)
        self._max_dt = max_dt
        self.falls: tuple[bool, ...]  # of each axis, whether the newest command is below the last
        self.begin((0,) * len(axes))

    def begin(self, rest: Sequence[int]) -> None:
        """Start anew, at ``rest``."""
        self.begun = False  # a packet has gone out since
        self.falls = (False,) * len(rest)
        self.rest(rest)

    def rest(self, rest: Sequence[int]) -> None:
        """Let the next packet say ``rest``, whatever is asked for."""
        self._values: tuple[float, ...] = tuple(rest)
        self._at = math.inf  # of the last packet; infinite: none yet
        self._offered = self._values, self._at

    @property
    def counts(self) -> tuple[int, ...]:
        """What the last packet said."""
        return tuple(map(round, self._values))

    def step(self, goals: tuple[int, ...], now: float) -> tuple[int, ...]:
        """Return what a packet says on the way to ``goals``, if it goes ``now``; see ``sent``."""
        dt = min(max(now - self._at, 0.0), self._max_dt)
        values = goals if self._values == goals else self._nearer(goals, dt)  # most of the time
        self._offered = values, now
        return tuple(map(round, values))

    def sent(self) -> None:
        """Go on from what the newest step returned: it went out."""
        self._values, self._at = self._offered
        self.begun = True

    def _nearer(self, goals: tuple[int, ...], dt: float) -> tuple[float, ...]:
        mosts = [
            0.0 if not dt or (falls and mode is not Mode.POSITION) else limit * dt
            for limit, falls, mode in zip(self._limits, self.falls, self._modes, strict=True)
        ]
        starts = tuple(map(_start, self._values, goals, self._modes))
        shares = tuple(map(_share, starts, goals, mosts))
        together = zip(shares, self._modes, strict=True)
        least = min((share for share, mode in together if mode is Mode.VELOCITY), default=1.0)
        return tuple(
            goal - (1.0 - (least if mode is Mode.VELOCITY else share)) * (goal - start)
            for start, goal, share, mode in zip(starts, goals, shares, self._modes, strict=True)
        )


def _start(value: float, goal: float, mode: Mode) -> float:
    """Return from where the way to the goal is limited: nothing is, of what slows down."""
    if mode is Mode.POSITION:
        return value
    return math.copysign(min(abs(value), abs(goal)), goal) if value * goal > 0.0 else 0.0


def _share(start: float, goal: float, most: float) -> float:
    """Return what of its way an axis may go at once."""
    way = abs(goal - start)
    return most / way if most < way else 1.0
