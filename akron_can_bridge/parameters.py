# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the Akron bridge beside those that all bridges share."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Any

from akron_can_bridge.protocol import AXIS_USAGE, is_pin, JOYSTICK_ADDRESSES
from bridge_core.parameters import DEADBAND, Parameter, TOLERATE_FAULTY_AXES

CONTROLLERS = tuple(AXIS_USAGE)  # those that obey joysticks (Appendix B) and send type 83
UNIVERSAL, MINI_UNIVERSAL = 1032, 1033
UNIT_TYPES = (*CONTROLLERS, MINI_UNIVERSAL)
_FIRST, _LAST = JOYSTICK_ADDRESSES[0], JOYSTICK_ADDRESSES[-1]


class Cause(Enum):
    """What can make ``estop`` true; the values are those of the parameter ``estop_on``."""

    LINK = 'link'
    ENABLE = 'enable'
    MOTOR_FAULT = 'motor_fault'
    FOREIGN_JOYSTICK = 'foreign_joystick'
    MOTION = 'motion'


def _check_joystick(address: int) -> None:
    if address not in (0, *JOYSTICK_ADDRESSES):
        raise ValueError('allowed are 0x33 to 0x38, or 0')


def _check_pin(pin: str) -> None:
    if pin and not (is_pin(pin) and int(pin[:4]) in UNIT_TYPES):
        raise ValueError(
            "allowed are 15 characters such as '1032AE100801035' that begin with one of "
            f'{", ".join(map(str, UNIT_TYPES))}'
        )


def _check_type(number: int) -> None:
    if number not in (0, *UNIT_TYPES):
        raise ValueError(f'allowed are 0 and {", ".join(map(str, UNIT_TYPES))}')


def _check_allowed(addresses: Sequence[int]) -> None:
    for address in addresses:
        _check_joystick(address)


def _check_two(values: Sequence[Any]) -> None:
    if len(values) != 2:
        raise ValueError('allowed are two values: rotation, elevation')


def _check_names(names: Sequence[str]) -> None:
    _check_two(names)
    if not all(names) or len(set(names)) != len(names):
        raise ValueError('allowed are two different names')


def _check_estop_on(causes: Sequence[str]) -> None:
    if not causes:
        raise ValueError('allowed are one or more')


PARAMETERS = (
    Parameter(
        'interface',
        'socketcan',
        "python-can's kind of interface: socketcan, slcan, udp_multicast ...",
        section='the bus',
    ),
    Parameter(
        'channel',
        'can0',
        'can0, /dev/ttyACM0 for slcan, group:port for udp_multicast.',
    ),
    Parameter(
        'bitrate',
        0,
        'For slcan and the like; 0: as it is set. The unit has 250000.',
        unit='bit/s',
        minimum=0,
        maximum=1_000_000,
    ),
    Parameter(
        'source_address',
        _LAST,
        'Which joystick we are. A lower one overrides (Appendix B): at 0x38 a person at any other '
        'joystick overrides the computer.',
        minimum=_FIRST,
        maximum=_LAST,
        hex_digits=2,
    ),
    Parameter(
        'device_pin',
        '',
        "The unit's PIN, such as 1032AE100801035; set it where there are two units. Empty: the "
        'first unit of device_type.',
        check=_check_pin,
        section='the unit',
    ),
    Parameter(
        'device_type',
        1032,
        'First four digits of the PIN: 1032 (6032), 1033 (6033), 1040, 1042, 1052; 0: any monitor '
        'controller.',
        check=_check_type,
    ),
    Parameter(
        'unit_address',
        0,
        'Fixed address of a unit that does not announce itself; 0: it is found by its PIN.',
        minimum=0,
        maximum=0xFD,
    ),
    Parameter(
        'link_timeout',
        0.3,
        'Without a frame of the unit for this long the link is lost. Some come every 0.1 s; a '
        'change of address takes 0.35 s.',
        unit='s',
        minimum=0.15,
        maximum=5.0,
    ),
    Parameter(
        'answer_timeout',
        1.0,
        'When a poll or request without an answer is given up.',
        unit='s',
        minimum=0.2,
        maximum=10.0,
    ),
    Parameter(
        'vista_rate',
        0.0,
        'How often voltage and inputs of a 6032 are polled (Vista message 21); 0: never.',
        unit='Hz',
        minimum=0.0,
        maximum=10.0,
    ),
    Parameter(
        'estop_on',
        [cause.value for cause in Cause],
        'What makes ~/estop true; one or more. The others are warnings.',
        choices=tuple(cause.value for cause in Cause),
        check=_check_estop_on,
    ),
    Parameter(
        'command_timeout',
        0.15,
        'A ~/cmd_joy older than this is stale: neutral.',
        unit='s',
        minimum=0.04,
        maximum=2.0,
        section='driving it',
    ),
    Parameter(
        'estop_in_timeout',
        0.25,
        'An ~/estop_in older than this counts as true.',
        unit='s',
        minimum=0.04,
        maximum=2.0,
    ),
    Parameter(
        'coast_time',
        1.0,
        'How long the unit may go on moving once nobody asks it to; see motion in estop_on.',
        unit='s',
        minimum=0.1,
        maximum=10.0,
    ),
    Parameter(
        'button_switches',
        [0],
        'Switch, 1 to 16, that each button of ~/cmd_joy presses, in their order; 0: none.',
        minimum=0,
        maximum=16,
    ),
    Parameter(
        'automatic_motion',
        False,
        'Let ~/cmd_joy start what a neutral stick does not end: switches 4 and 7 to 9, Point Aim.',
    ),
    Parameter(
        'pause_on_stop',
        False,
        'Have a stop press switch 7 once for an oscillation that ~/cmd_joy began. Measure first: '
        'docs/devices/akron.md.',
    ),
    Parameter(
        'extended',
        False,
        'Also send PGN 64983: Point Aim targets from axes 2 to 4, switches 13 to 16.',
    ),
    Parameter(
        'soe_permissive',
        False,
        'Send A1, the permission to move in SOE mode, from a push of a stick until the next stop.',
    ),
    Parameter(
        'joy_source',
        0,
        'Address of the joystick that is published as ~/joy, 0x33 to 0x38; 0: none.',
        check=_check_joystick,
        section='other joysticks on the bus',
    ),
    Parameter(
        'allowed_joysticks',
        [0],
        'Joysticks that may send, each 0x33 to 0x38; [0]: none. Any other is foreign.',
        check=_check_allowed,
    ),
    DEADBAND,
    TOLERATE_FAULTY_AXES,
    Parameter(
        'joint_names',
        ['rotation', 'elevation'],
        "Joints of ~/joint_states, as in your robot's description.",
        check=_check_names,
        section='joint states',
    ),
    Parameter(
        'joint_inverted',
        [False, False],
        'One for each joint. Left and up are positive; true: right or down is.',
        check=_check_two,
    ),
)
