# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Units and joysticks for demos and tests; they share no codec with the bridge."""

from argparse import ArgumentParser, ArgumentTypeError

from akron_can_bridge.protocol import is_pin
from akron_can_bridge.simulator.controls import JOYSTICK_TIMEOUT
from akron_can_bridge.simulator.joystick import JoystickSimulator
from akron_can_bridge.simulator.motion import PERMISSIVE_TIMEOUT
from akron_can_bridge.simulator.twin import as_measured
from akron_can_bridge.simulator.unit import BOOT_TIME, Simulator
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
        as_measured=as_measured,
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
    'JoystickSimulator',
    'Simulator',
]
