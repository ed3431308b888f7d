# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a VM-110 is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.device import Device, Simulation


def _simulation(values: Mapping[str, Any]) -> Simulation:
    words = ['vm110']
    if values.get('bu_id'):
        words += ['--bu-id', str(values['bu_id'])]
    if values.get('crc', 'auto') != 'auto':
        words += ['--crc', values['crc']]
    return Simulation('multicast', tuple(words))


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
    decoders='vm110_bridge.decoders:DECODERS',
    simulators='vm110_bridge.simulator:SIMULATORS',
    simulation=_simulation,
)
