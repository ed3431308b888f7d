# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an Akron unit is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from akron_can_bridge.reasons import REASONS
from bridge_core.device import Device, Hands, Places, Simulation, Switch, Trial


def _simulation(values: Mapping[str, Any]) -> Simulation:
    pin = values.get('device_pin', '')
    kind = pin[:4] or str(values.get('device_type') or 1032)
    address = values.get('unit_address') or 0x80
    words = ['akron', '--type', kind, '--address', f'{address:x}']
    return Simulation('can', (*words, *(('--pin', pin) if pin else ())))


def _places(values: Mapping[str, Any], message: Any) -> dict[str, float]:
    signs = [-1.0 if inverted else 1.0 for inverted in values['joint_inverted']]
    named = zip(message.name, message.position, signs, strict=True)
    return {name: sign * place for name, place, sign in named}


def _turned(values: Mapping[str, Any], seen: Mapping[str, Any]) -> dict[str, float]:
    degrees = -seen['rotation_deg'], seen['elevation_deg']  # left and up are positive
    return dict(zip(values['joint_names'], map(math.radians, degrees), strict=True))


DEVICE = Device(
    name='akron_can_bridge',
    node_class='AkronCanBridge',
    title='Fire monitor',
    marks=frozenset(('limits', 'joint_states')),
    page='docs/devices/akron.md',
    launch=2,
    actuator=True,
    publishes=('joint_states', 'joy'),
    wiring={'~/estop_in': 'safety_mux/estop'},
    ports={'akron_channel': 'channel'},
    trials={
        'stick': Trial(
            help='-1 to 1, left or up positive, of a fire monitor',
            names='joint_names',
            command='cmd_joy',
            field='axes',
            limit=1.0,
            signs=(1, -1),  # back is up
        ),
    },
    hands=Hands(
        turned=_turned,
        places=Places('joint_states', 'JointState', _places),
        timeouts=('command_timeout', 'estop_in_timeout'),
        obeys=('neutral because', 'commands go out'),
        automatic={
            'oscillation': Switch(
                'its oscillation by its own controls; end it there',
                ('oscillate on',),
                ('oscillate off',),
            ),
            'stowing': Switch('stowing by its own controls; end it there', ('stow',), ()),
        },
    ),
    decoders='akron_can_bridge.decoders:DECODERS',
    simulators='akron_can_bridge.simulator:SIMULATORS',
    simulation=_simulation,
    reasons=REASONS,
)
