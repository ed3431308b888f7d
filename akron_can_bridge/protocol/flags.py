# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The messages' single bits, one flag each, and their names in words."""

from __future__ import annotations

from enum import IntFlag


class Output(IntFlag):
    """Digital outputs of type 83, bytes 2 and 3; the riser command bits are a number beside."""

    ENABLE = 1 << 15  # input asserted: motion is allowed
    ACTIVE = 1 << 14  # not stowed
    STOWED = 1 << 13
    POINT_AIM_MODE_ACTIVE = 1 << 12
    SOE_MODE_ACTIVE = 1 << 11  # the permissive A1 is required for motion
    AUX_AGENT_DISPENSE = 1 << 7
    DISCHARGE = 1 << 6
    HIGH_FLOW = 1 << 5
    HANDHELD_LED = 1 << 4
    REMOTE_MODE = 1 << 3
    NOT_IN_EXCLUSION_ZONE = 1 << 2
    POINT_AIM_LED = 1 << 1
    PANEL_LED = 1 << 0


class MiniOutput(IntFlag):
    """Digital outputs of type 84 (6033 Mini Universal), bytes 2 and 3."""

    DEVICE_ACTIVE = 1 << 15
    DEVICE_FAULTED = 1 << 14
    RISER_EXTENDED = 1 << 1
    RISER_RETRACTED = 1 << 0


class Input(IntFlag):
    """Digital inputs of type 85 (6039 CAN I/O module), byte 2."""

    STOW = 1 << 2
    DEPLOY = 1 << 1
    ALLOWED_IN_COLLISION_ZONE = 1 << 0


class Permission(IntFlag):
    """Directions that type A1 permits, byte 3."""

    DOWN = 1 << 3
    UP = 1 << 2
    LEFT = 1 << 1
    RIGHT = 1 << 0


class Fault(IntFlag):
    """Fault bits of type 02, bytes 2 (top) to 5."""

    S12_PROCESSOR_OR_CODE = 1 << 31
    CAN_OUTPUT_OVERRUN = 1 << 30
    SCI_OUTPUT_OVERRUN = 1 << 29
    EXTERNAL_EEPROM = 1 << 23
    INTERNAL_FUSE_BLOWN = 1 << 21
    PCODE_SYNTAX_ERROR = 1 << 16
    XGATE_PROCESSOR_OR_CODE = 1 << 15
    CAN_INPUT_OVERRUN = 1 << 14
    SCI_INPUT_OVERRUN = 1 << 13
    DIGITAL_OUTPUT_3 = 1 << 8
    DIGITAL_OUTPUT_2 = 1 << 7
    DIGITAL_OUTPUT_1 = 1 << 6
    MOTOR_AXIS_5 = 1 << 5
    MOTOR_AXIS_4 = 1 << 4
    MOTOR_AXIS_3 = 1 << 3
    MOTOR_AXIS_2 = 1 << 2
    MOTOR_AXIS_1 = 1 << 1
    INTERNAL_EEPROM = 1 << 0


class Vista(IntFlag):
    """The single bits of type 21, counted from the last bit of byte 8."""

    K1_RELAY_RESET = 1 << 45
    K1_RELAY_SET = 1 << 44
    DIGITAL_OUTPUT_3 = 1 << 43
    DIGITAL_OUTPUT_2 = 1 << 42
    DIGITAL_OUTPUT_1 = 1 << 41
    DIGITAL_INPUT_5L = 1 << 40
    DIGITAL_INPUT_5H = 1 << 39
    DIGITAL_INPUT_4L = 1 << 38
    DIGITAL_INPUT_4H = 1 << 37
    DIGITAL_INPUT_3L = 1 << 36
    DIGITAL_INPUT_3H = 1 << 35
    DIGITAL_INPUT_2L = 1 << 34
    DIGITAL_INPUT_2H = 1 << 33
    DIGITAL_INPUT_1 = 1 << 32
    JOYSTICK_SWITCH_10 = 1 << 17
    JOYSTICK_SWITCH_3 = 1 << 16
    JOYSTICK_SWITCH_2 = 1 << 5
    JOYSTICK_SWITCH_1 = 1 << 4
    JOYSTICK_Y_FORWARD = 1 << 3
    JOYSTICK_Y_BACK = 1 << 2
    JOYSTICK_X_LEFT = 1 << 1
    JOYSTICK_X_RIGHT = 1 << 0


# Words of flags that are not spelt small.
_SPELT = {
    'PCODE': 'pCode',
    **{word: word for word in ('CAN', 'EEPROM', 'K1', 'LED', 'S12', 'SCI', 'SOE', 'XGATE')},
    **{word: word for word in ('2H', '2L', '3H', '3L', '4H', '4L', '5H', '5L', 'X', 'Y')},
}


def _in_words(flag: IntFlag) -> str:
    return ' '.join(_SPELT.get(word, word.lower()) for word in str(flag.name).split('_'))


FLAG_NAMES: dict[type[IntFlag], dict[IntFlag, str]] = {
    kind: {flag: _in_words(flag) for flag in kind}
    for kind in (Output, MiniOutput, Input, Permission, Fault, Vista)
}


def flag_names(flags: IntFlag) -> list[str]:
    """Name in words what is set, the highest bit first."""
    return [word for flag, word in FLAG_NAMES[type(flags)].items() if flag in flags]
