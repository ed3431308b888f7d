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

"""What an SSC is, to the tools."""

from __future__ import annotations

from bridge_core.device import Device, Simulation, Trial

DEVICE = Device(
    name='ssc_bridge',
    node_class='SscBridge',
    page='docs/devices/ssc.md',
    launch=3,
    actuator=True,
    polled=True,
    publishes=('joy',),
    wiring={'~/estop_in': 'safety_mux/estop'},
    ports={'ssc_port': 'port'},
    trials={
        'position': Trial(
            help='-1 to 1, of a servo on an SSC',
            names='servos',
            command='servo_command',
            field='position',
            limit=1.0,
            beside=('pulse_command',),
        ),
    },
    decoders='ssc_bridge.decoders:DECODERS',
    simulators='ssc_bridge.simulator:SIMULATORS',
    simulation=lambda _: Simulation('pty', ('ssc',)),
)
