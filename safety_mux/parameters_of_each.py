# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mux's parameters of each joint, e-stop source, speed limit and operator."""

from typing import Any

from bridge_core.parameters import check_topic, Parameter, proofs
from safety_mux.protocol import MOST_OF_A_JOINT

_EACH = 'One for all, or one an axis.'


def seconds(name: str, default: float, description: str, **limits: Any) -> Parameter:
    """Return the parameter of a time: above 0 s, unless a minimum is given, and up to 10 s."""
    lower = {} if 'minimum' in limits else {'above': 0.0}
    limits = {**lower, 'maximum': 10.0, **limits}
    return Parameter(name, default, description, unit='s', **limits)


JOINT = (
    Parameter(
        'max',
        10.0,
        'Greatest absolute value. A demand beyond it reduces all joints of the group alike.',
        'rad/s or N·m',
        above=0.0,
        maximum=MOST_OF_A_JOINT,
    ),
    Parameter(
        'acceleration',
        20.0,
        'Greatest change away from 0; the default takes 0.5 s to max.',
        'rad/s² or N·m/s',
        above=0.0,
        maximum=1e6,
    ),
    Parameter(
        'deceleration',
        40.0,
        'Greatest change towards 0; by default faster than away from it.',
        'rad/s² or N·m/s',
        above=0.0,
        maximum=1e6,
    ),
    Parameter(
        'jerk',
        0.0,
        'Greatest change of the acceleration, away from 0 only. 0: no limit.',
        'rad/s³ or N·m/s²',
        minimum=0.0,
        maximum=1e9,
    ),
    Parameter(
        'group',
        '',
        'Joints with the same word are reduced and grow together, so that a curve stays; a mast '
        'needs another word.',
    ),
    Parameter(
        'position_min',
        0.0,
        'Soft end, by the position in feedback.topic: no further, back is free. As position_max: '
        'no ends.',
        'rad',
        minimum=-MOST_OF_A_JOINT,
        maximum=MOST_OF_A_JOINT,
    ),
    Parameter(
        'position_max',
        0.0,
        'The other soft end.',
        'rad',
        minimum=-MOST_OF_A_JOINT,
        maximum=MOST_OF_A_JOINT,
    ),
    Parameter(
        'slow_zone',
        0.0,
        'How long before an end the speed begins to fall in proportion to what is left; at least '
        'max² / deceleration.',
        'rad',
        minimum=0.0,
        maximum=MOST_OF_A_JOINT,
    ),
)

ESTOP = (
    Parameter(
        'topic', '', 'Topic of the stop: std_msgs/Bool, true = stop. Needed.', check=check_topic
    ),
    Parameter(
        'enabled_topic',
        '',
        'As drive_enabled_topic, which is empty then, for each of several drives. All joints wait '
        'for all.',
        check=check_topic,
    ),
    Parameter(
        'own_topic',
        '',
        'What the source demands by itself, without the echo of our own stop. Empty: as topic; '
        'the default where topic is of another node.',
        check=check_topic,
    ),
    seconds(
        'timeout', 0.25, 'A source silent for longer is a stop. Three of its periods or more.'
    ),
    Parameter(
        'counts',
        'always',
        'when_owner: only while its operator has control, or asks for it.',
        choices=('always', 'when_owner'),
    ),
    Parameter('operator', '', 'Its operator; needed for when_owner.'),
    Parameter(
        'stop_category',
        0,
        '0 disables at once; 1 ramps to 0 first, within stop_time.',
        minimum=0,
        maximum=1,
    ),
    *proofs('the node', 'its topic', 0.25),
)

SPEED_LIMIT = (
    Parameter(
        'topic',
        '',
        'std_msgs/Float64, 0 to 1, repeated. Needed.',
        check=check_topic,
    ),
    seconds('timeout', 0.25, 'A limit silent for longer is at its lowest.'),
    Parameter(
        'lowest',
        0.0,
        'What it is at most while silent or senseless. 0 holds the joints.',
        minimum=0.0,
        maximum=1.0,
    ),
)

OPERATOR = (
    Parameter('topic', '', 'Topic of the sticks: sensor_msgs/Joy. Needed.', check=check_topic),
    Parameter(
        'priority',
        10,
        'The higher takes over by its deadman; no two may be alike.',
        minimum=0,
        maximum=1000,
    ),
    seconds('timeout', 0.25, 'An owner silent for longer is lost: stop. At most neutral_time.'),
    Parameter(
        'mixing',
        'none',
        'none: one axis a joint. tank: axes left, right. arcade: axes forward, turn.',
        choices=('none', 'tank', 'arcade'),
    ),
    Parameter(
        'axis',
        [0],
        "Index in Joy of each axis of mixing: see the remote's page.",
        minimum=0,
        maximum=255,
    ),
    Parameter(
        'scale',
        [1.0],
        f'Joint value at full deflection, not 0, at most max of its joint. {_EACH}',
        'rad/s or N·m',
    ),
    Parameter('inverted', [False], f'Turns the sign round. {_EACH}'),
    Parameter(
        'deadband',
        [0.05],
        f'Deflection that still is neutral; the rest of the way is stretched. {_EACH}',
        minimum=0.0,
        maximum=0.99,
    ),
    Parameter(
        'expo',
        [0.0],
        f'0 is straight, 1 cubic: finer near the middle. {_EACH}',
        minimum=0.0,
        maximum=1.0,
    ),
    Parameter(
        'deadman_buttons',
        [0],
        "Indices in Joy of the buttons that must all be held to move: see the remote's page.",
        minimum=0,
        maximum=255,
    ),
    Parameter(
        'pressed_at',
        1,
        'Least value of a held button; switches with raw values need more than 1.',
        minimum=1,
    ),
    Parameter(
        'speed_levels',
        [1.0],
        'Factors of scale, by the value of speed_button: the first for 0 (released), the next '
        'for 1. Any other value has the least.',
        above=0.0,
        maximum=1.0,
    ),
    Parameter(
        'speed_button',
        -1,
        'Index in Joy of the button or switch that chooses among speed_levels. -1: none.',
        minimum=-1,
        maximum=255,
    ),
    Parameter(
        'axis_buttons',
        [-1],
        f'Index in Joy of a button without which the axis counts as let go. -1: none. {_EACH}',
        minimum=-1,
        maximum=255,
    ),
    Parameter(
        'buttons',
        [''],
        "Such as 'horn=4': ~/button/horn (std_msgs/Bool) is true while he has control and holds "
        'button 4 of Joy, pressed since then. A Joy without it is malformed.',
    ),
    Parameter(
        'gated_joy',
        False,
        'Publish ~/joy/<name>: his Joy while he has control, else a neutral one. An axis whose '
        'button of axis_buttons is not held is 0.',
    ),
    Parameter(
        'require_moving_stamps',
        False,
        'A stamp that is not set, or stays the same for timeout, loses the operator. False: the '
        'latter is a warning.',
    ),
    *proofs('the node', 'its topic', 0.5),
)
