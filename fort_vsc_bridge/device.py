# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a VSC is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.device import Device, Simulation


def _simulation(values: Mapping[str, Any]) -> Simulation:
    transport = values.get('transport', 'serial')
    if transport == 'can':
        return Simulation('can', ('fort_vsc_can',))
    if transport == 'hid':  # a stand-in that is no hidraw device
        return Simulation('pty', ('fort_vsc_hid',), {'hid.devices': ['none']})
    return Simulation('pty', ('fort_vsc',))


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
    decoders='fort_vsc_bridge.decoders:DECODERS',
    simulators='fort_vsc_bridge.simulator:SIMULATORS',
    simulation=_simulation,
)
