# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an Akron unit is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.device import Device, Simulation, Trial


def _simulation(values: Mapping[str, Any]) -> Simulation:
    pin = values.get('device_pin', '')
    kind = pin[:4] or str(values.get('device_type') or 1032)
    address = values.get('unit_address') or 0x80
    words = ['akron', '--type', kind, '--address', f'{address:x}']
    return Simulation('can', (*words, *(('--pin', pin) if pin else ())))


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
        ),
    },
    decoders='akron_can_bridge.decoders:DECODERS',
    simulators='akron_can_bridge.simulator:SIMULATORS',
    simulation=_simulation,
)
