# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""States as the packets carry them: manual section 4.1.1 to 4.1.5."""

from __future__ import annotations

from enum import IntEnum


class BuState(IntEnum):
    """Section 4.1.1; the ES-Link relays are open while it is below 0x10."""

    INITIAL = 0x00
    STOPPED = 0x01
    EXTERNAL_LINK_ERROR = 0x02
    BLOCKED = 0x03
    FAILED = 0x04
    DISARMED = 0x10
    ARMED = 0x11


RELAYS_CLOSED = 0x10  # the least BU state with closed ES-Link relays


class LinkStatus(IntEnum):
    """Section 4.1.2."""

    UNUSED = 0
    OPERATIONAL = 1
    NO_LINK = 2
    LINK_ERROR = 3
    INTERFACE_ERROR = 4
    DATA_ERROR = 5
    PASSIVE = 6


class RuState(IntEnum):
    """Section 4.1.3."""

    INITIAL = 0
    DISARMED = 1
    ARMED = 2  # but movements are disabled
    ENABLED = 3
    STOPPED = 4


class Disabled(IntEnum):
    """Section 4.1, 'RU Disabled': why movements are."""

    ENABLED = 0
    TILTING = 1
    INACTIVITY = 2


BU_STATES: dict[int, BuState] = {int(state): state for state in BuState}
LINK_STATUSES: dict[int, LinkStatus] = {int(status): status for status in LinkStatus}
RU_STATES: dict[int, RuState] = {int(state): state for state in RuState}
DISABLED: dict[int, Disabled] = {int(reason): reason for reason in Disabled}

AXIS_NAMES = ('joystick_1', 'joystick_2', 'joystick_3', 'joystick_4')
SWITCH_NAMES = tuple(f'switch_{number}' for number in range(1, 9))
BUTTON_NAMES = (*SWITCH_NAMES, 'encoder_switch')
MAX_POSITION = 1000  # of a joystick (4.1.4)
MAX_PERCENT = 100


def state_name(state: IntEnum | int | None) -> str:
    """
    Return a state in the manual's words, such as 'External link error' or 'Unknown (0x33)'.

    None, where nothing is known, is 'None'.
    """
    if state is None:
        return 'None'
    if isinstance(state, IntEnum):
        return state.name.replace('_', ' ').capitalize()
    return f'Unknown (0x{state:02X})'
