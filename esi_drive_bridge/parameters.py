# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the ESI drive bridge beside those that all bridges share."""

from bridge_core.parameters import Parameter
from esi_drive_bridge.protocol import MAX_COMMAND_RATE

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
        'SerialBaud of HiDS: 115200, 230400 or 1000000 (manual 4.5.2).',
        unit='bit/s',
        minimum=9600,
        maximum=4_000_000,
    ),
    Parameter(
        'joint_names',
        ['left', 'right'],
        'Joints of motor A and B, as the mux names them; one for a single-axis drive. The lists '
        'below have one element for all axes, or one an axis.',
        section='the axes',
    ),
    Parameter(
        'single_axis_layout',
        'padded',
        'Packets of a single-axis drive: padded to the dual lengths, or compact. Try the other if '
        'no status is understood.',
        choices=('padded', 'compact'),
    ),
    Parameter(
        'axes_enable',
        'together',
        'together: a fault of one axis stops both. each: every axis by itself, by ~/axis_a/enable '
        'or ~/axis_b/enable besides ~/enable.',
        choices=('together', 'each'),
        fixed=True,
    ),
    Parameter(
        'mode',
        ['velocity'],
        'Command mode, as configured in HiDS.',
        choices=('torque', 'velocity', 'position'),
    ),
    Parameter(
        'command_current_scale',
        [0.001],
        "HiDS's CommandCurrentScale; 0.001 reaches ±32.767 A.",
        unit='A/count',
        minimum=_SMALLEST,
        maximum=1e3,
        section='scales: as in HiDS, or the motor turns at another speed than was asked for',
    ),
    Parameter(
        'command_velocity_scale',
        [1.0],
        "HiDS's CommandVelocityScale; 1.0 reaches ±32767 rpm.",
        unit='rpm/count',
        minimum=_SMALLEST,
        maximum=1e3,
    ),
    Parameter(
        'command_position_scale',
        [0.000191753],
        "HiDS's CommandPositionScale; 0.000191753 reaches ±2π rad.",
        unit='rad/count',
        minimum=_SMALLEST,
        maximum=1e3,
    ),
    Parameter(
        'gear_ratio',
        [1.0],
        'Turns of the motor for one of the joint.',
        minimum=1e-6,
        maximum=1e6,
    ),
    Parameter(
        'torque_constant',
        [0.0],
        "Of the motor; 0: effort is the motor's current in A instead.",
        unit='N·m/A',
        minimum=0.0,
        maximum=1e3,
    ),
    Parameter(
        'inverted',
        [False],
        'The joint turns against its motor.',
    ),
    Parameter(
        'slew_limit',
        [20.0],
        'Greatest growth of what is sent, from rest at each enabling; towards 0 it goes at once. '
        'In torque mode N·m/s, or A/s with torque_constant 0; in position mode rad/s, both ways. '
        "As the mux's acceleration, or more.",
        unit='rad/s², N·m/s or rad/s',
        above=0.0,
        maximum=1e6,
        section='limits',
    ),
    Parameter(
        'command_rate',
        100.0,
        'How often a command packet is sent. The drive looks 1000 times a second.',
        unit='Hz',
        minimum=1.0,
        maximum=MAX_COMMAND_RATE,
        section='rates',
    ),
    Parameter(
        'status_rate',
        500.0,
        'How often the drive sends its status; for a warning when the line is too slow.',
        unit='Hz',
        minimum=1.0,
        maximum=1000.0,
    ),
    Parameter(
        'joint_state_rate',
        100.0,
        'About how often ~/joint_states is published; a ninth more at most.',
        unit='Hz',
        minimum=1.0,
        maximum=1000.0,
    ),
    Parameter(
        'joint_state_fields',
        'measured',
        'Fields of ~/joint_states. all: NaN where nothing is measured, as the topic based '
        'hardware of ros2_control needs them.',
        choices=('measured', 'all'),
    ),
    Parameter(
        'command_timeout',
        0.1,
        'A ~/command, ~/enable or ~/estop_in older than this disables the drive.',
        unit='s',
        minimum=0.02,
        maximum=2.0,
        section='timeouts',
    ),
    Parameter(
        'link_timeout',
        0.25,
        'Without a status for this long, ~/estop is true and the drive is disabled.',
        unit='s',
        minimum=0.02,
        maximum=5.0,
    ),
    Parameter(
        'enable_timeout',
        1.0,
        'Within which the drive must report enabled, or it is disabled; and disabled, or it is a '
        'stop.',
        unit='s',
        minimum=0.05,
        maximum=10.0,
    ),
    Parameter(
        'clear_timeout',
        1.0,
        'Within which the drive must clear its errors when asked.',
        unit='s',
        minimum=0.05,
        maximum=10.0,
    ),
)
