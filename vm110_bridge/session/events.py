# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session reports, in the order in which it happened; stops are the base's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bridge_core.session import Level
from vm110_bridge.protocol import AXIS_NAMES, BUTTON_NAMES


@dataclass(frozen=True, slots=True)
class ArmedChanged:
    """
    Whether a remote is armed, and whether its movements are allowed.

    :param armed: the BU is armed against an RU that is not stopped. :param enabled: and its
        sticks count.
    """

    armed: bool
    enabled: bool


@dataclass(frozen=True, slots=True)
class Sticks:
    """
    What the operator asks for.

    :param axes: 4 in the order of AXIS_NAMES, -1000 to 1000, signs as the device sends them.
    :param buttons: 9 in the order of BUTTON_NAMES: the raw switch values (of ``led_switches``
        without their LED), then 0 or 1.
    :param enabled: the sticks count; if not, all is neutral.
    :param faulty: joysticks that cannot be where they say they are. They are 0; without
        ``tolerate_faulty_axes`` all is neutral then.
    """

    axes: tuple[int, ...] = (0,) * len(AXIS_NAMES)
    buttons: tuple[int, ...] = (0,) * len(BUTTON_NAMES)
    enabled: bool = False
    faulty: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Remote:
    """The armed RU: its ID, its battery (% as it came), whether it is in its docking station."""

    ru: int
    battery_percent: int
    docked: bool


@dataclass(frozen=True, slots=True)
class RemoteState:
    """What is known of the armed remote; None: none is armed any more."""

    status: Remote | None


@dataclass(frozen=True, slots=True)
class DeviceState:
    """
    What base unit and remote say of themselves, controls apart.

    :param problems: what is wrong, and what to do. :param good: in words, where nothing is.
    :param values: in the manual's words.
    """

    problems: tuple[tuple[Level, str], ...]
    good: str
    values: dict[str, Any]


@dataclass(frozen=True, slots=True)
class EncoderTurned:
    """The encoder, unwrapped: counts since the first remote was enabled, any whole number."""

    position: int


@dataclass(frozen=True, slots=True)
class Command:
    """
    A command of the RU's application, to be published; ``command_published`` must follow.

    :param data: 16 bytes.
    """

    command_id: int
    data: bytes


@dataclass(frozen=True, slots=True)
class CommandResult:
    """What became of a command to the RU's application. :param outcome: in words."""

    command_id: int
    outcome: str


Event = ArmedChanged | Sticks | RemoteState | DeviceState | EncoderTurned | Command | CommandResult
