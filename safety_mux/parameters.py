# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mux's parameters.

Some parameters are lists of names, such as ``joints`` and ``operators``. Each name adds parameters
of its own, such as ``operator.<name>.topic``. Topics are relative to the mux's namespace unless
they begin with a slash.
"""

from collections.abc import Mapping
import json
import re
from typing import Any

from bridge_core.parameters import (
    check_topic,
    names_of,
    Parameter,
    ParameterError,
    proofs,
    with_named,
)
from bridge_core.share import shared
from safety_mux.parameters_of_each import ESTOP, JOINT, OPERATOR, seconds, SPEED_LIMIT

# Their defaults are of a wheel, in rad/s: in another unit they would be other motion.
_OF_WHEELS = re.compile(r'joint\..+\.(max|acceleration|deceleration)|operator\..+\.scale')
_GEOMETRY = re.compile(r'autonomy\.wheel_(separation|radius)')
_DECIDES = ('interface', 'output', 'autonomy.topic', 'autonomy.type')  # whether they count

# The machine of which no parameter has to be given: one remote and one drive.
DEFAULTS: dict[str, Any] = json.loads(
    shared('config/default_machine.json').read_text(encoding='utf-8')
)

GENERAL = (
    Parameter(
        'rate',
        100.0,
        "How often the mux decides, and commands in motion; several times in the drive's "
        'command_timeout.',
        unit='Hz',
        minimum=20.0,
        maximum=500.0,
        fixed=True,
        section='what goes out',
    ),
    Parameter(
        'heartbeat_rate',
        33.0,
        'How often ~/estop and ~/enable are repeated, and commands at rest; at most at rate, '
        "three times in the drive's command_timeout.",
        unit='Hz',
        minimum=20.0,
        maximum=500.0,
        fixed=True,
    ),
    Parameter(
        'output',
        'joints',
        'joints: ~/command, for drives. Else ~/cmd_vel: joints is [linear, angular], m/s forward '
        'and rad/s to the left, or [linear, lateral, angular], lateral m/s to the left; mixing '
        'none; limits and scale have no default.',
        choices=('joints', 'twist', 'twist_stamped'),
        fixed=True,
    ),
    Parameter(
        'frame_id',
        'base_link',
        'frame_id of ~/cmd_vel, where output is twist_stamped.',
        fixed=True,
    ),
    Parameter(
        'interface',
        'velocity',
        'The field of ~/command: velocity (rad/s) or effort (N·m). Limits and scale have no '
        'default for effort.',
        choices=('velocity', 'effort'),
        fixed=True,
    ),
    Parameter(
        'status_rate',
        10.0,
        'How often ~/status is repeated.',
        unit='Hz',
        minimum=1.0,
        maximum=100.0,
        fixed=True,
    ),
    Parameter(
        'drive_enabled_topic',
        DEFAULTS['drive_enabled_topic'],
        'Where the drive says that it is enabled (std_msgs/Bool, repeated). Once heard, the '
        'command is 0 while it does not say so. Empty: none.',
        check=check_topic,
        fixed=True,
    ),
    seconds(
        'drive_enabled_timeout',
        0.25,
        'A drive silent for longer counts as not enabled. Three of its periods or more.',
    ),
    *proofs('the node', 'its topic', 0.25, prefix='drive_enabled_'),
    seconds(
        'clear_time',
        0.5,
        'How long all stops must have been clear before a reset. Three periods of rate or more.',
        section='times',
    ),
    seconds(
        'neutral_time',
        0.3,
        'How long an operator must send neutral before the deadman counts. Three periods of rate '
        'or more; no operator has a longer timeout.',
    ),
    seconds(
        'hold_time',
        0.5,
        'After a change of owner no operator takes over from another for this long.',
        minimum=0.0,
    ),
    seconds(
        'stall_limit',
        0.1,
        'After a longer gap between two decisions the mux stops and forgets what it heard. Longer '
        'than a period of rate and 10 ms.',
        minimum=0.02,
        maximum=1.0,
    ),
    seconds(
        'stop_time',
        0.5,
        'A stop of category 1 disables after this time. With feedback, joints that do not stand '
        'by then are a stop of all devices.',
    ),
    seconds(
        'reset_silence',
        5.0,
        'After a reset with nothing to reset, none counts until there was none for this long.',
        minimum=0.0,
        maximum=60.0,
    ),
    Parameter(
        'reset_topic',
        '',
        'A reset button: std_msgs/Bool, true while it is pressed, at 10 Hz or more. Empty: none.',
        check=check_topic,
        fixed=True,
        section='the reset button',
    ),
    Parameter(
        'joints',
        ['left', 'right'],
        'Joints in ~/command, in this order, as the drive names them.',
        section='the joints',
    ),
    Parameter(
        'feedback.topic',
        '',
        'Where the joints are measured (sensor_msgs/JointState with the velocity of all joints). '
        'Empty: nowhere. A proven drive tells its age, too: see drive_enabled_age_limit.',
        check=check_topic,
        section='what the joints really do',
    ),
    seconds(
        'feedback.timeout',
        0.25,
        'Feedback silent for longer is a stop while somebody has control.',
    ),
    Parameter(
        'feedback.standstill',
        0.2,
        'A joint that is not faster stands. More than the noise of what is measured.',
        unit='rad/s',
        above=0.0,
        maximum=1e6,
    ),
    Parameter(
        'feedback.overspeed_tolerance',
        2.0,
        'A joint faster than commanded by more than this, for overspeed_time, is a stop. More '
        'than it lags behind a ramp.',
        unit='rad/s',
        above=0.0,
        maximum=1e6,
    ),
    seconds('feedback.overspeed_time', 0.5, 'See overspeed_tolerance.'),
    Parameter(
        'estop_sources',
        DEFAULTS['estop_sources'],
        'Names of the e-stop sources; one or more.',
        section='who can stop the machine',
    ),
    Parameter(
        'speed_limits',
        [''],
        'Names of speed limits. The least scales all joints.',
        section='how fast, at this moment',
    ),
    Parameter(
        'operators',
        DEFAULTS['operators'],
        "Names of the operators; [''] for none, if there is autonomy.",
        section='who can drive',
    ),
    Parameter(
        'autonomy.topic',
        '',
        'Empty: no autonomy.',
        check=check_topic,
        fixed=True,
        section='autonomy, below every operator',
    ),
    Parameter(
        'autonomy.type',
        'Twist',
        'A twist needs two joints, left and right; a JointState names all joints.',
        choices=('Twist', 'TwistStamped', 'JointState'),
        fixed=True,
    ),
    seconds('autonomy.timeout', 0.25, 'Autonomy silent for longer while it drives: stop.'),
    Parameter(
        'autonomy.wheel_separation',
        0.5,
        'Between left and right wheels. Needed for Twist and output joints.',
        unit='m',
        above=0.0,
        maximum=100.0,
    ),
    Parameter(
        'autonomy.wheel_radius',
        0.1,
        'Needed for Twist and output joints.',
        unit='m',
        above=0.0,
        maximum=10.0,
    ),
    Parameter(
        'commissioning.report',
        '',
        'report.json of rugged_teleop commission. ~/status says whether the parameters are those '
        'that were tried.',
        fixed=True,
        section='what was tried on the machine',
    ),
    Parameter(
        'commissioning.required',
        False,
        'Refuse to start unless commissioning.report counts.',
        fixed=True,
    ),
    Parameter(
        'commissioning.stop_time',
        0.0,
        'The trial fails where a joint stands later after a stop. 0: not given; stop_time counts.',
        unit='s',
        minimum=0.0,
        maximum=60.0,
    ),
    Parameter(
        'commissioning.stop_angle',
        0.0,
        'The trial fails where a joint turns on further after a stop. 0: not given.',
        unit='rad',
        minimum=0.0,
        maximum=1e6,
    ),
)


def enabled_topic(drive: str) -> str:
    """Return the parameter that has its topic. :param drive: an e-stop source; '': the one."""
    return f'estop.{drive}.enabled_topic' if drive else 'drive_enabled_topic'


def telling_drives(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the drives that say that they are enabled, as ``enabled_topic`` takes them."""
    names = ('', *names_of(values, 'estop_sources'))
    return tuple(name for name in names if values[enabled_topic(name)])


def parameter_table(given: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return all parameters, including those of the names in the given or default lists."""
    groups = (
        ('joints', 'joint', JOINT),
        ('estop_sources', 'estop', ESTOP),
        ('speed_limits', 'speed_limit', SPEED_LIMIT),
        ('operators', 'operator', OPERATOR),
    )
    defaults = dict(DEFAULTS)
    for own in [name for name in DEFAULTS if name.endswith('.own_topic')]:
        topic = own.replace('own_topic', 'topic')
        if str(given.get(topic, DEFAULTS[topic])).lstrip('/') != DEFAULTS[topic]:
            del defaults[own]  # it is of another node
    table = with_named(GENERAL, groups, given, defaults)
    _refuse_defaults({each.name: each for each in table}, given)
    return table


def _refuse_defaults(table: Mapping[str, Parameter], given: Mapping[str, Any]) -> None:
    """:raises ParameterError: a default would move a vehicle by a number that nobody chose."""
    decide = {name: table[name] for name in _DECIDES}
    values = {name: each.validate(given.get(name, each.default)) for name, each in decide.items()}
    why, needed = '', _OF_WHEELS
    if values['interface'] == 'effort':
        why = "with interface 'effort', in N·m"
    elif values['output'] != 'joints':
        if 'joint.linear.max' in table:  # else its joints are refused
            why = f"with output '{values['output']}', in m/s and rad/s of the vehicle"
    elif values['autonomy.topic'] and values['autonomy.type'] != 'JointState':
        why, needed = f'for a {values["autonomy.type"]} on autonomy.topic', _GEOMETRY
    missing = [name for name in table if needed.fullmatch(name) and name not in given]
    if why and missing:
        raise ParameterError(
            f'parameter {missing[0]}: there is no default {why}; give {", ".join(missing)}'
        )
