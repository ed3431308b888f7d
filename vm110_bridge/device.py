# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
    page='docs/devices/vm110.md',
    launch=1,
    operator=True,
    publishes=('joy', 'armed', 'enabled'),
    ports={'vm110_interface_address': 'interface_address'},
    decoders='vm110_bridge.decoders:DECODERS',
    simulators='vm110_bridge.simulator:SIMULATORS',
    simulation=_simulation,
)
