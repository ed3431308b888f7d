# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an ESI drive is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.device import Device, Hands, Simulation, Trial
from esi_drive_bridge.reasons import REASONS


def _simulation(values: Mapping[str, Any]) -> Simulation:
    joints = values.get('joint_names', ['left', 'right'])
    compact = values.get('single_axis_layout') == 'compact'
    words = ['esi_drive', '--axes', str(len(joints))]
    return Simulation('pty', (*words, *(('--compact',) if compact else ())))


def _trial(mode: str, field: str, text: str) -> Trial:
    return Trial(
        help=f'{text}, of a drive where its mode is {mode}',
        names='joint_names',
        command='command',
        field=field,
        mode=mode,
        is_measured=True,
    )


def _turned(values: Mapping[str, Any], seen: Mapping[str, Any]) -> dict[str, float]:
    joints = list(values['joint_names'])
    gears = list(values['gear_ratio']) * (len(joints) if len(values['gear_ratio']) == 1 else 1)
    motors = zip(joints, gears, seen['position_rad'], strict=True)
    return {joint: float(motor) / gear for joint, gear, motor in motors}


DEVICE = Device(
    name='esi_drive_bridge',
    node_class='EsiDriveBridge',
    title='ESI drive',
    marks=frozenset(('enabled', 'joint_states')),
    page='docs/devices/esi_drive.md',
    launch=4,
    actuator=True,
    drive=True,
    publishes=(
        *('enabled', 'joint_states'),
        *(f'axis_{axis}/{name}' for axis in 'ab' for name in ('estop', 'enabled')),  # if apart
    ),
    wiring={
        '~/command': 'safety_mux/command',
        '~/enable': 'safety_mux/enable',
        '~/estop_in': 'safety_mux/estop',
    },
    ports={'esi_drive_port': 'port'},
    trials={
        'speed': _trial('velocity', 'velocity', 'rad/s'),
        'effort': _trial('torque', 'effort', 'N·m, or A with torque_constant 0'),
    },
    hands=Hands(turned=_turned),
    decoders='esi_drive_bridge.decoders:DECODERS',
    simulators='esi_drive_bridge.simulator:SIMULATORS',
    simulation=_simulation,
    reasons=REASONS,
)
