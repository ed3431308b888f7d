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

"""The device's side of the link, for demos and tests; it shares no codec with the bridge."""

from argparse import ArgumentParser

from bridge_core.simulation import help_text, Simulated
from ssc_bridge.simulator.controller import BOOT_TIME, CONFIG_TIME, Simulator
from ssc_bridge.simulator.memory import build_frame, Memory, Settings, sums


def _options(controller: ArgumentParser) -> None:
    controller.add_argument('--inputs', type=int, choices=range(1, 17), default=8, help='1 to 16')


SIMULATORS = {
    'ssc': Simulated(
        make=lambda options: Simulator(Settings(inputs=options.inputs)),
        help=help_text(Simulator.commands),
        options=_options,
    ),
}

__all__ = [
    'BOOT_TIME',
    'CONFIG_TIME',
    'SIMULATORS',
    'Memory',
    'Settings',
    'Simulator',
    'build_frame',
    'sums',
]
