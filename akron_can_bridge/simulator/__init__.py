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

"""Units and joysticks for demos and tests; they share no codec with the bridge."""

from argparse import ArgumentParser, ArgumentTypeError

from akron_can_bridge.protocol import is_pin
from akron_can_bridge.simulator.controls import JOYSTICK_TIMEOUT
from akron_can_bridge.simulator.joystick import JoystickSimulator
from akron_can_bridge.simulator.motion import PERMISSIVE_TIMEOUT
from akron_can_bridge.simulator.unit import BOOT_TIME, Simulator, STATUS_PERIOD
from bridge_core.options import whole_within
from bridge_core.simulation import help_text, Simulated


def _pin(text: str) -> str:
    if not text or is_pin(text):
        return text
    raise ArgumentTypeError(f'{text} is no device PIN such as 1032AE100801035')


def _unit_options(unit: ArgumentParser) -> None:
    add, address = unit.add_argument, whole_within(0, 0xFD, base=16)
    add('--type', type=int, default=1032, help='device type, 1032: a 6032')
    add('--pin', type=_pin, default='', help='empty: one of that type')
    add('--address', type=address, default=0x80, help='first address, hex')
    add('--no-feedback', action='store_true', help='has no position feedback')


def _joystick_options(joystick: ArgumentParser) -> None:
    address = whole_within(0, 0xFD, base=16)
    joystick.add_argument('--address', type=address, default=0x33, help='33 to 38, hex')
    joystick.add_argument('--extended', action='store_true', help='sends 64983 too')


SIMULATORS = {
    'akron': Simulated(
        make=lambda options: Simulator(
            options.type,
            pin=options.pin,
            address=options.address,
            feedback=not options.no_feedback,
        ),
        help=help_text(Simulator.commands),
        port='can',
        options=_unit_options,
    ),
    'akron_joystick': Simulated(
        make=lambda options: JoystickSimulator(options.address, extended=options.extended),
        help=help_text(JoystickSimulator.commands),
        port='can',
        options=_joystick_options,
    ),
}

__all__ = [
    'BOOT_TIME',
    'JOYSTICK_TIMEOUT',
    'PERMISSIVE_TIMEOUT',
    'SIMULATORS',
    'STATUS_PERIOD',
    'JoystickSimulator',
    'Simulator',
]
