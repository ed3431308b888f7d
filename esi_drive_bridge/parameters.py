"""The parameters of the ESI drive bridge beside those that all bridges share."""

from bridge_core.parameters import Parameter
from esi_drive_bridge.protocol import MAX_COMMAND_RATE

_EACH = 'One for all axes, or one an axis.'
_SMALLEST = 1e-9

PARAMETERS = (
    Parameter(
        'port', '/dev/esi_drive', 'Device file, or socket://host:port, or rfc2217://host:port.'
    ),
    Parameter(
        'baud',
        115200,
        "The drive's SerialBaud: 115200, 230400 or 1000000 (manual 4.5.2).",
        unit='bit/s',
        minimum=1200,
        maximum=4_000_000,
    ),
    Parameter(
        'joint_names',
        ['left', 'right'],
        'Joints of motor A and motor B; one name for a single-axis drive.',
    ),
    Parameter(
        'single_axis_layout',
        'padded',
        'Packets of a single-axis drive: padded to the dual lengths, or compact. The manual '
        'leaves it open; try the other if no status is understood.',
        choices=('padded', 'compact'),
    ),
    Parameter(
        'mode',
        ['velocity'],
        f'Command mode, as configured in HiDS. {_EACH}',
        choices=('torque', 'velocity', 'position'),
    ),
    Parameter(
        'command_rate',
        100.0,
        'How often a command packet is sent, whatever else happens.',
        unit='Hz',
        minimum=1.0,
        maximum=float(MAX_COMMAND_RATE),
    ),
    Parameter(
        'command_timeout',
        0.1,
        'A ~/command, ~/enable or ~/estop_in older than this disables the drive.',
        unit='s',
        minimum=0.02,
        maximum=2.0,
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
        'How long the drive may take to report itself enabled.',
        unit='s',
        minimum=0.05,
        maximum=10.0,
    ),
    Parameter(
        'clear_timeout',
        1.0,
        'How long the drive may take to clear its errors.',
        unit='s',
        minimum=0.05,
        maximum=10.0,
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
        'How often ~/joint_states is published at most.',
        unit='Hz',
        minimum=1.0,
        maximum=1000.0,
    ),
    Parameter(
        'command_current_scale',
        [0.001],
        f"HiDS's CommandCurrentScale (manual 4.2.3). {_EACH}",
        unit='A a count',
        minimum=_SMALLEST,
        maximum=1e3,
    ),
    Parameter(
        'command_velocity_scale',
        [1.0],
        f"HiDS's CommandVelocityScale (4.2.4). {_EACH}",
        unit='rpm a count',
        minimum=_SMALLEST,
        maximum=1e3,
    ),
    Parameter(
        'command_position_scale',
        [0.000191753],
        f"HiDS's CommandPositionScale (4.2.5). {_EACH}",
        unit='rad a count',
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
        f'Of the motor; 0: effort is the current in A instead. {_EACH}',
        unit='N·m/A',
        minimum=0.0,
        maximum=1e3,
    ),
    Parameter('inverted', [False], f'The joint turns against its motor. {_EACH}'),
)
