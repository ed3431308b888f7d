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
Motion that the unit reports although nobody asks for it.

A neutral joystick ends manual motion only (manual, Appendix B). Oscillating, deploying, stowing
and Point Aim go on by themselves; docs/devices/akron.md lists what ends each.
"""

from __future__ import annotations

import math

from akron_can_bridge.protocol import PositionLimit, RotationSoftLimits
from akron_can_bridge.session.unit import Unit

_STEP_DEG = 0.5  # less is noise of the sensors
STEP_TIME = 0.5  # seconds in which a unit that moves makes such a step
_LOST = 30.0  # seconds for which an angle that is missing may change


class Motion:
    """
    Whether the unit moves, by the angles of type 01; type 81 says whether it oscillates.

    :param unit: whose broadcasts are looked at.
    """

    def __init__(self, unit: Unit) -> None:
        self.began_at = -math.inf
        self.runs_since = -math.inf  # when the last step but one came, if it moves
        self._unit = unit
        self._stepped_at = -math.inf
        self._heard_at = -math.inf  # all angles that it has
        self._still_since = math.inf  # they have been heard all along since, without a step
        self._measured: dict[int, float] = {}  # when each place last had an angle
        self._degrees: list[float | None] = [None, None]  # at the last step of each

    def take(self, message: PositionLimit, now: float) -> None:
        """Take a type 01. One step is no motion yet: zeroing looks like that."""
        angles = [position.degrees for position in (message.rotation, message.elevation)]
        self._measured |= {n: now for n, degrees in enumerate(angles) if degrees is not None}
        if all(at == now or now >= at + _LOST for at in self._measured.values()):
            if now >= self._heard_at + STEP_TIME:
                self._still_since = now
            self._heard_at = now
        for place, degrees in enumerate(angles):
            before = self._degrees[place]
            if degrees is None:
                self._degrees[place] = None
            elif before is None:
                self._degrees[place], self._still_since = degrees, now
            elif abs(degrees - before) >= _STEP_DEG:
                self._degrees[place] = degrees
                if now >= self.ends_at:
                    self.began_at = now
                elif now > self._stepped_at:
                    self.runs_since = self._stepped_at
                self._stepped_at = self._still_since = now

    @property
    def ends_at(self) -> float:
        """When the unit counts as standing if it does not move further."""
        return self._stepped_at + STEP_TIME

    def moving(self, now: float) -> bool:
        """Tell whether its angles change."""
        return self.began_at < self._stepped_at and now < self.ends_at

    def stands(self, now: float) -> bool:
        """Tell whether it is heard to stand: one that is not heard may do anything."""
        heard = now < self._heard_at + STEP_TIME
        return heard and self._heard_at - self._still_since >= STEP_TIME

    def arrived(self, since: float, now: float) -> bool:
        """Tell whether it has moved since then, and stands."""
        return since < self._stepped_at and self.stands(now)

    def oscillates(self, now: float) -> bool:
        """Tell whether it says so, be it paused or not."""
        limits = self._unit.broadcast(RotationSoftLimits, now)
        return limits is not None and limits.oscillating

    def may_oscillate(self, now: float) -> bool:
        """Tell whether it does not say that it does not."""
        return self._unit.broadcast(RotationSoftLimits, now) is None or self.oscillates(now)

    def describe(self, now: float) -> str:
        """Say what it does; empty: nothing that it reports."""
        if self.oscillates(now):
            return 'oscillates'
        return 'moves' if self.moving(now) else ''

    def forget(self) -> None:
        """Forget what was reported."""
        self.began_at = self._stepped_at = self.runs_since = self._heard_at = -math.inf
        self._degrees = [None, None]
