"""The parameters of the ESI drive bridge beside those that all bridges share."""

from collections.abc import Mapping
from typing import Any

from bridge_core.parameters import Parameter
from esi_drive_bridge.convert import Axis
from esi_drive_bridge.convert import DEFAULT_SCALES
from esi_drive_bridge.protocol import Layout
from esi_drive_bridge.protocol import MAX_COMMAND_RATE
from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.session import Settings

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
        minimum=1200,
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
        'command_current_scale',
        [DEFAULT_SCALES[Mode.TORQUE]],
        f"HiDS's CommandCurrentScale; 0.001 reaches ±32.767 A. {_EACH}",
        unit='A/count',
        minimum=_SMALLEST,
        maximum=1e3,
        section='scales: as in HiDS, or the motor turns at another speed than was asked for',
    ),
    Parameter(
        'command_velocity_scale',
        [DEFAULT_SCALES[Mode.VELOCITY]],
        f"HiDS's CommandVelocityScale; 1.0 reaches ±32767 rpm. {_EACH}",
        unit='rpm/count',
        minimum=_SMALLEST,
        maximum=1e3,
    ),
    Parameter(
        'command_position_scale',
        [DEFAULT_SCALES[Mode.POSITION]],
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
        1000.0,
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
        'As in all bridges; here the shorter of this and status_timeout counts.',
        unit='s',
        minimum=0.02,
        maximum=5.0,
    ),
    Parameter(
        'status_timeout',
        0.25,
        'Without a status packet for this long, ~/estop is true and the drive is disabled.',
        unit='s',
        minimum=0.02,
        maximum=5.0,
    ),
    Parameter(
        'enable_timeout',
        1.0,
        'How long the drive may take to report itself enabled; a brake may have to open.',
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
_SCALES = {
    Mode.TORQUE: 'command_current_scale',
    Mode.VELOCITY: 'command_velocity_scale',
    Mode.POSITION: 'command_position_scale',
}


def axes(values: Mapping[str, Any]) -> tuple[Axis, ...]:
    """Return what joins each axis to its joint. :raises ValueError: lists that do not fit."""
    joints = values['joint_names']
    if len(joints) not in (1, 2) or len(set(joints)) < len(joints):
        raise ValueError(f'joint_names = {joints}: one or two different names are needed')

    def spread(name: str) -> list[Any]:
        given = values[name]
        if len(given) not in (1, len(joints)):
            raise ValueError(f'{name} = {given}: 1 or {len(joints)} elements are needed')
        return list(given) * (len(joints) if len(given) == 1 else 1)

    modes = [Mode[name.upper()] for name in spread('mode')]
    return tuple(
        Axis(joint, mode, spread(_SCALES[mode])[index], *rest)
        for index, (joint, mode, *rest) in enumerate(
            zip(
                joints,
                modes,
                spread('gear_ratio'),
                spread('torque_constant'),
                spread('inverted'),
                strict=True,
            )
        )
    )


def settings(values: Mapping[str, Any]) -> Settings:
    """Return what the session needs to know. :raises ValueError: what cannot be."""
    joined = axes(values)
    layout = Layout.DUAL if len(joined) == 2 else Layout(values['single_axis_layout'])
    return Settings(
        layout=layout,
        modes=tuple(axis.mode for axis in joined),
        si_per_count=tuple(axis.si_per_count for axis in joined),
        status_timeout=min(values['link_timeout'], values['status_timeout']),
        **{
            name: values[name]
            for name in (
                'command_rate',
                'command_timeout',
                'enable_timeout',
                'clear_timeout',
                'baud',
                'status_rate',
            )
        },
    )
