# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Motion that the unit reports although nobody asks for it.

A neutral joystick ends manual motion only (manual, Appendix B). Oscillating, deploying, stowing
and Point Aim go on by themselves; docs/devices/akron.md lists what ends each.
"""

from __future__ import annotations

import math

from akron_can_bridge.protocol import PositionLimit, RotationSoftLimits
from akron_can_bridge.session.drive import Drive
from akron_can_bridge.session.joysticks import Joysticks
from akron_can_bridge.session.unit import Unit

_STEP_DEG = 0.5  # less is noise of the sensors
_STEP_TIME = 0.5  # seconds in which a unit that moves makes such a step


class Motion:
    """
    Whether the unit moves, by the angles of type 01; type 81 says whether it oscillates.

    :param unit: whose broadcasts are looked at.
    """

    def __init__(self, unit: Unit) -> None:
        self.began_at = -math.inf
        self._unit = unit
        self._stepped_at = -math.inf
        self._degrees: list[float | None] = [None, None]  # at the last step of each

    def hear_angles(self, message: PositionLimit, now: float) -> None:
        """Take a type 01. One step is no motion yet: zeroing looks like that."""
        angles = [position.degrees for position in (message.rotation, message.elevation)]
        for place, degrees in enumerate(angles):
            before = self._degrees[place]
            if degrees is None:
                self._degrees[place] = None
            elif before is None:
                self._degrees[place] = degrees
            elif abs(degrees - before) >= _STEP_DEG:
                self._degrees[place] = degrees
                if now >= self.ends_at:
                    self.began_at = now
                self._stepped_at = now

    @property
    def ends_at(self) -> float:
        """When the unit counts as standing if it does not move further."""
        return self._stepped_at + _STEP_TIME

    def moving(self, now: float) -> bool:
        """Tell whether its angles change."""
        return self.began_at < self._stepped_at and now < self.ends_at

    def oscillates(self, now: float) -> bool:
        """Tell whether it says so, be it paused or not."""
        limits = self._unit.broadcast(RotationSoftLimits, now)
        return limits is not None and limits.oscillating

    def describe(self, now: float) -> str:
        """Say what it does; empty: nothing that it reports."""
        if self.oscillates(now):
            return 'oscillates'
        return 'moves' if self.moving(now) else ''

    def forget_angles(self) -> None:
        """Forget what was reported."""
        self.began_at = self._stepped_at = -math.inf
        self._degrees = [None, None]


class Demand:
    """
    Who asks the unit to move: our command, or an allowed joystick.

    What goes on by itself is asked for until a stop takes it back, and every stop withholds the
    SOE permission.
    """

    def __init__(self, drive: Drive, joysticks: Joysticks) -> None:
        self.withheld = True  # no SOE permission until a stick is pushed: motion would go on
        self._is_held = True  # the stick of the command has not been let go since
        self._automatic = False  # somebody asked for motion that goes on by itself
        self._automatic_until = -math.inf  # when a stop took that back
        self._drive, self._joysticks = drive, joysticks

    @property
    def asked_until(self) -> float:
        """Until when the unit was asked to move; infinite: it is."""
        if self._drive.pushes or self._automatic:
            return math.inf
        return max(self._automatic_until, self._drive.asked_until, self._joysticks.asked_until)

    def follow(self, now: float, *, stopped: bool) -> None:
        """Note who asks. :param stopped: motion is forbidden; that ends what can be ended."""
        drive, joysticks = self._drive, self._joysticks
        self._automatic |= drive.automatic or joysticks.automatic_asked
        joysticks.automatic_asked = False
        self._is_held &= drive.pushes
        if stopped:
            self.withhold()
            if self._automatic:
                self._automatic, self._automatic_until = False, now
        elif (drive.pushes and not self._is_held) or joysticks.pushes(now):
            self.withheld = False

    def withhold(self) -> None:
        """Give no permission before a stick was let go, and is pushed."""
        self.withheld = self._is_held = True
        self._joysticks.stop()


class Oscillation:
    """
    An oscillation that our command began, as type 81 tells it.

    It is ours if "oscillating" follows "not oscillating" within ``patience`` of our command. Where
    anything else may explain it, or may have paused it since, it is to be forgotten: the switch
    that pauses it resumes one that is paused.

    :param patience: seconds that the unit may take to say that it oscillates, or is paused.
    """

    def __init__(self, patience: float) -> None:
        self.is_ours = False
        self.is_doubted = False  # type 81 said "oscillating" on after a press: it tells no pause
        self._patience = patience
        self._stood = False  # as type 81 said last
        self._asked_until = -math.inf
        self._pressed_at = math.inf

    def ask(self, now: float) -> None:
        """Note that our command asks for it now."""
        self._asked_until = now + self._patience

    def hear_limits(self, message: RotationSoftLimits, now: float) -> None:
        """Take a type 81."""
        runs = bool(message.oscillating)
        self.is_doubted |= runs and now >= self._pressed_at + self._patience
        if not runs:
            self._pressed_at = math.inf
        begins = self._stood and now < self._asked_until
        self.is_ours = runs and (self.is_ours or begins) and not self.is_doubted
        self._stood = not runs

    def press(self, now: float) -> None:
        """Note that it is paused now; once for each that began."""
        self.is_ours, self._pressed_at = False, now

    def disown(self) -> None:
        """Have the present one be somebody else's."""
        self.is_ours = self._stood = False
        self._asked_until, self._pressed_at = -math.inf, math.inf
