# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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

    Of a torque or a velocity only the growth away from 0 is limited: slowing down must not wait. A
    position is limited both ways.

    :param max_dt: seconds, the longest step; what a late packet has missed is not made up for.
    """

    __slots__ = ('_at', '_axes', '_max_dt', '_values')

    def __init__(self, axes: Sequence[Axis], max_dt: float) -> None:
        self._axes = tuple(
            (
                axis.slew_limit / abs(axis.si_per_count),
                _move if axis.mode is Mode.POSITION else _grow,
            )
            for axis in axes
        )
        self._max_dt = max_dt
        self.begin((0,) * len(axes))

    def begin(self, rest: Sequence[int]) -> None:
        """Start anew: the next packet says ``rest``, whatever is asked for."""
        self._values: tuple[float, ...] = tuple(rest)
        self._at = math.inf  # of the last packet; infinite: none yet

    @property
    def counts(self) -> tuple[int, ...]:
        """What the last packet said."""
        return tuple(map(round, self._values))

    def step(self, goals: tuple[int, ...], now: float) -> tuple[int, ...]:
        """Return what a packet that goes ``now`` says on the way to ``goals``."""
        dt = min(max(now - self._at, 0.0), self._max_dt)
        self._at = now
        if self._values == goals:  # as most of the time
            return goals
        self._values = tuple(
            follow(value, goal, limit * dt if dt else 0.0)
            for (limit, follow), value, goal in zip(self._axes, self._values, goals, strict=True)
        )
        return self.counts


def _grow(value: float, goal: float, most: float) -> float:
    size = abs(value) if value * goal > 0.0 else 0.0
    return math.copysign(min(abs(goal), size + most), goal)


def _move(value: float, goal: float, most: float) -> float:
    return min(max(goal, value - most), value + most)
