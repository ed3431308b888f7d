# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a VM-110 is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.device import Chain, Device, Hands, Simulation, Stick, Switch
from vm110_bridge.reasons import REASONS


def _simulation(values: Mapping[str, Any]) -> Simulation:
    words = ['vm110']
    if values.get('bu_id'):
        words += ['--bu-id', str(values['bu_id'])]
    if values.get('crc', 'auto') != 'auto':
        words += ['--crc', values['crc']]
    return Simulation('multicast', tuple(words))


_ARMED = ('arm 1',)

DEVICE = Device(
    name='vm110_bridge',
    node_class='Vm110Bridge',
    title='VM-110',
    marks=frozenset(('armed',)),
    page='docs/devices/vm110.md',
    launch=1,
    operator=True,
    publishes=('joy', 'armed', 'enabled'),
    ports={'vm110_interface_address': 'interface_address'},
    hands=Hands(
        estops={
            'remote': Switch(
                'the stop switch of the remote; release it, and arm the remote again',
                ('stop 1 on',),
                ('stop 1 off', *_ARMED),
            ),
        },
        off=Switch(
            'the remote (out of range and without a battery are the same on the wire); '
            'switch it on, and arm it again',
            ('radio 1 off',),
            ('radio 1 on', *_ARMED),
        ),
        pauses={
            'tilt': Switch(
                'tilt the remote; hold it upright again', ('tilt 1 on',), ('tilt 1 off',)
            ),
        },
        chain=Chain('the ES-Link relays', lambda seen: bool(seen['relays_closed']), silence=2.0),
        facts=('base unit (bu_id)', 'address of the base unit', 'CRC', 'VLAPs', 'armed RU'),
        states=('BU state', 'armed RU', 'C-Link'),
        ready=_ARMED,
        axes=tuple(Stick(f'stick 1 {number} {{}}') for number in range(1, 5)),
        buttons=(
            *(Stick(f'switch 1 {number} {{}}') for number in range(1, 9)),
            Stick('push 1 {}'),
        ),
    ),
    decoders='vm110_bridge.decoders:DECODERS',
    simulators='vm110_bridge.simulator:SIMULATORS',
    simulation=_simulation,
    reasons=REASONS,
)
