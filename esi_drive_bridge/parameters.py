# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the ESI drive bridge beside those that all bridges share."""

from bridge_core.parameters import Parameter
from esi_drive_bridge.protocol import MAX_COMMAND_RATE

_EACH = 'One for all axes, or one an axis.'
_SMALLEST = 1e-9

PARAMETERS = (
    Parameter(
        'port',
        '/dev/esi_drive',
        'Device file, or socket://host:port, or rfc2217://host:port.',
        section='the port',
    ),
    Parameter(
        'baud',
        115200,
        "The drive's SerialBaud in HiDS: 115200, 230400 or 1000000 (manual 4.5.2). 115200 does "
        'not carry 1000 dual status packets a second.',
        unit='bit/s',
        minimum=9600,
        maximum=4_000_000,
    ),
    Parameter(
        'joint_names',
        ['left', 'right'],
        'Joints of motor A and motor B, as the mux names them; one name for a single-axis drive.',
        section='the axes',
    ),
    Parameter(
        'single_axis_layout',
        'padded',
        'Packets of a single-axis drive: padded to the dual lengths, or compact, which is refused '
        'with two joint_names. The manual leaves it open; try the other if no status is '
        'understood.',
        choices=('padded', 'compact'),
    ),
    Parameter(
        'axes_enable',
        'together',
        'together: both axes are enabled, stopped and cleared as one, and a fault of one stops '
        'both. each: every axis by itself, by its own ~/axis_a/enable or ~/axis_b/enable besides '
        '~/enable; what the axes share still stops both.',
        choices=('together', 'each'),
        fixed=True,
    ),
    Parameter(
        'mode',
        ['velocity'],
        f'Command mode, as configured in HiDS. {_EACH}',
        choices=('torque', 'velocity', 'position'),
    ),
    Parameter(
        'command_current_scale',
        [0.001],
        f"HiDS's CommandCurrentScale; 0.001 reaches ±32.767 A. {_EACH}",
        unit='A/count',
        minimum=_SMALLEST,
        maximum=1e3,
        section='scales: as in HiDS, or the motor turns at another speed than was asked for',
    ),
    Parameter(
        'command_velocity_scale',
        [1.0],
        f"HiDS's CommandVelocityScale; 1.0 reaches ±32767 rpm. {_EACH}",
        unit='rpm/count',
        minimum=_SMALLEST,
        maximum=1e3,
    ),
    Parameter(
        'command_position_scale',
        [0.000191753],
        f"HiDS's CommandPositionScale; 0.000191753 reaches ±2π rad. {_EACH}",
        unit='rad/count',
        minimum=_SMALLEST,
        maximum=1e3,
    ),
    Parameter(
        'gear_ratio',
        [1.0],
        f'Turns of the motor for one of the joint. {_EACH}',
        minimum=1e-6,
        maximum=1e6,
    ),
    Parameter(
        'torque_constant',
        [0.0],
        f"Of the motor; 0: effort is the motor's current in A instead. {_EACH}",
        unit='N·m/A',
        minimum=0.0,
        maximum=1e3,
    ),
    Parameter(
        'inverted',
        [False],
        f'The joint turns against its motor, as on one of the two sides of a vehicle. {_EACH}',
    ),
    Parameter(
        'slew_limit',
        [20.0],
        'Greatest growth of what is sent, from rest at each enabling; towards 0 it goes at once. '
        'In torque mode N·m/s, or A/s with torque_constant 0; in position mode rad/s, both ways. '
        f"As the mux's acceleration, or more. {_EACH}",
        unit='rad/s², N·m/s or rad/s',
        above=0.0,
        maximum=1e6,
        section='limits',
    ),
    Parameter(
        'command_rate',
        100.0,
        'How often a command packet is sent, whatever else happens. The drive looks 1000 times a '
        'second.',
        unit='Hz',
        minimum=1.0,
        maximum=float(MAX_COMMAND_RATE),
        section='rates',
    ),
    Parameter(
        'status_rate',
        500.0,
        'How often the drive sends its status; only to warn when the line is too slow for it.',
        unit='Hz',
        minimum=1.0,
        maximum=1000.0,
    ),
    Parameter(
        'joint_state_rate',
        100.0,
        'About how often ~/joint_states is published: a ninth more at most, so that none is left '
        'out where the drive sends at this rate.',
        unit='Hz',
        minimum=1.0,
        maximum=1000.0,
    ),
    Parameter(
        'joint_state_fields',
        'measured',
        'What ~/joint_states has. all: position, velocity and effort, NaN where nothing is '
        'measured, for who reads position without looking, such as the topic based hardware of '
        'ros2_control.',
        choices=('measured', 'all'),
    ),
    Parameter(
        'command_timeout',
        0.1,
        'A ~/command, ~/enable or ~/estop_in older than this disables the drive. The default is '
        'ten periods of the mux.',
        unit='s',
        minimum=0.02,
        maximum=2.0,
        section='timeouts',
    ),
    Parameter(
        'link_timeout',
        0.25,
        'Without a status packet for this long, ~/estop is true and the drive is disabled.',
        unit='s',
        minimum=0.02,
        maximum=5.0,
    ),
    Parameter(
        'enable_timeout',
        1.0,
        'How long the drive may take to report itself enabled (a brake may have to open): '
        'longer disables. And disabled: longer is a stop.',
        unit='s',
        minimum=0.05,
        maximum=10.0,
    ),
    Parameter(
        'clear_timeout',
        1.0,
        'How long the drive may take to clear its errors when asked.',
        unit='s',
        minimum=0.05,
        maximum=10.0,
    ),
)
