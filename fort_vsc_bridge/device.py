# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a VSC is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.device import Chain, Device, Hands, Simulation, Stick, Switch
from fort_vsc_bridge.reasons import REASONS


def _simulation(values: Mapping[str, Any]) -> Simulation:
    transport = values.get('transport', 'serial')
    if transport == 'can':
        return Simulation('can', ('fort_vsc_can',))
    if transport == 'hid':  # a stand-in that is no hidraw device
        return Simulation('pty', ('fort_vsc_hid',), {'hid.devices': ['none']})
    return Simulation('pty', ('fort_vsc',))


_STICKS = {'left_x': -1.0, 'left_y': 1.0, 'left_z': 1.0}  # by the device's sign
_PAD = ('down', 'right', 'up', 'left')
_ACKNOWLEDGED = ('ack', 'mode operational')

DEVICE = Device(
    name='fort_vsc_bridge',
    node_class='FortVscBridge',
    title='FORT VSC',
    marks=frozenset(('radio_strength',)),
    page='docs/devices/fort_vsc.md',
    operator=True,
    probe=False,  # a heartbeat could take back the stop that a node has left in it
    publishes=('joy',),
    ports={'fort_vsc_port': 'port', 'fort_vsc_channel': 'channel'},
    hands=Hands(
        estops={
            'remote': Switch(
                'the e-stop of the remote; release it, and acknowledge there',
                ('estop remote on',),
                ('estop remote off', *_ACKNOWLEDGED),
            ),
            'wired': Switch(
                'the e-stop that is wired to the VSC; release it, and acknowledge on the remote',
                ('estop vsc on',),
                ('estop vsc off', *_ACKNOWLEDGED),
            ),
        },
        off=Switch(
            'the remote (out of range and without a battery are the same on the wire); '
            'switch it on, and acknowledge there',
            ('radio off',),
            ('radio on', *_ACKNOWLEDGED),
        ),
        pauses={
            name: Switch(
                f'bring the remote into {mode} mode; bring it into Operational mode again',
                (f'mode {name}',),
                ('mode operational',),
            )
            for name, mode in {'pause': 'Pause', 'menu': 'Menu'}.items()
        },
        chain=Chain('the Master Enable outputs', lambda seen: bool(seen['master_enable'])),
        facts=('serial number', 'firmware'),
        states=('mode', 'e-stop indication'),
        ready=_ACKNOWLEDGED,
        axes=tuple(
            Stick(f'stick {name.replace("left", side)} {{}}', full)
            for side in ('left', 'right')
            for name, full in _STICKS.items()
        ),
        buttons=tuple(
            Stick(f'button {side}_{button} {{}}') for side in ('left', 'right') for button in _PAD
        ),
    ),
    decoders='fort_vsc_bridge.decoders:DECODERS',
    simulators='fort_vsc_bridge.simulator:SIMULATORS',
    simulation=_simulation,
    reasons=REASONS,
)
