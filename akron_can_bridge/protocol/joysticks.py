# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Input messages: PGN 64982 and 64983, from joysticks at addresses 33 to 38 hex."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from akron_can_bridge.protocol.fields import axis, statuses
from akron_can_bridge.protocol.frames import BASIC_JOYSTICK_PGN, EXTENDED_JOYSTICK_PGN, Sendable
from akron_can_bridge.protocol.values import Axis, Status, UNAVAILABLE

JOYSTICK_PERIOD = 0.02  # Appendix B: what Akron Brass devices do; 100 ms is the most
JOYSTICK_TIMEOUT = 0.2  # Appendix B: the unit then clears that sender's input

# Oscillate on / set, its pause / resume, deploy, stow: a neutral stick does not end what they do.
AUTOMATIC_SWITCHES = frozenset((4, 7, 8, 9))
OSCILLATE_SWITCH = 4
PAUSE_SWITCH = 7
_OFF = Status.OFF


@dataclass(frozen=True, slots=True)
class BasicJoystick(Sendable):
    """
    PGN 64982: X turns, Y back elevates up (Appendix B).

    :param switches: 1 to 12: pattern stream, pattern fog, discharge on, oscillate on / set, flow
        high, flow low, oscillate pause / resume, deploy, stow, discharge off, CAFS dry, CAFS wet.
    :param detents: X, Y; ignored by Akron Brass devices.
    """

    PGN = BASIC_JOYSTICK_PGN
    PRIORITY = 3
    x: Annotated[Axis, axis(at=48)]
    y: Annotated[Axis, axis(at=32)]
    switches: Annotated[tuple[Status, ...], statuses(12, at=0)] = (_OFF,) * 12
    detents: Annotated[tuple[Status, ...], statuses(2, at=28)] = (_OFF,) * 2

    @property
    def automatic(self) -> bool:
        """It starts motion that goes on by itself."""
        return any(self.switches[number - 1] is Status.ON for number in AUTOMATIC_SWITCHES)

    @property
    def oscillates(self) -> bool:
        """It presses oscillate on / set, and asks for no other motion."""
        pressed = {n for n in AUTOMATIC_SWITCHES if self.switches[n - 1] is Status.ON}
        return pressed == {OSCILLATE_SWITCH} and self.x.value == 0 == self.y.value


@dataclass(frozen=True, slots=True)
class ExtendedJoystick(Sendable):
    """
    PGN 64983: grip X and Y are target angles, 100 % = 175 and 90 degrees (Appendix B).

    A neutral grip is a target too, of 0 degrees; who has no target leaves it UNAVAILABLE.

    :param switches: 13 to 16. :param detents: grip X, Y, theta.
    """

    PGN = EXTENDED_JOYSTICK_PGN
    PRIORITY = 3
    grip_x: Annotated[Axis, axis(at=48)] = UNAVAILABLE
    grip_y: Annotated[Axis, axis(at=32)] = UNAVAILABLE
    theta: Annotated[Axis, axis(at=16)] = UNAVAILABLE
    switches: Annotated[tuple[Status, ...], statuses(4, at=0)] = (_OFF,) * 4
    detents: Annotated[tuple[Status, ...], statuses(3, at=10)] = (_OFF,) * 3

    @property
    def automatic(self) -> bool:
        """It has a target to travel to; one that is broken may be one."""
        absent = Status.NOT_AVAILABLE
        return any(axis.fault is not absent for axis in (self.grip_x, self.grip_y))
