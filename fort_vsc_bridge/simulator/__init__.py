# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device's side of the link: a VSC and its remote, on each of the three wires."""

from bridge_core.simulation import help_text, Simulated
from fort_vsc_bridge.protocol.values import AXIS_NAMES, BUTTON_NAMES
from fort_vsc_bridge.simulator.can import CanSimulator
from fort_vsc_bridge.simulator.hid import HidSimulator
from fort_vsc_bridge.simulator.serial import build_frame, build_sentence, Simulator
from fort_vsc_bridge.simulator.twin import as_measured
from fort_vsc_bridge.simulator.vsc import BOOT_TIME, HOST_TIMEOUT

_STICKS = {'AXIS': AXIS_NAMES, 'BUTTON': BUTTON_NAMES}

SIMULATORS = {
    'fort_vsc': Simulated(
        make=lambda _: Simulator(),
        help=help_text(Simulator.commands, **_STICKS),
        as_measured=as_measured,
    ),
    'fort_vsc_can': Simulated(
        make=lambda _: CanSimulator(),
        help=help_text(CanSimulator.commands, **_STICKS),
        port='can',
        as_measured=as_measured,
    ),
    'fort_vsc_hid': Simulated(
        make=lambda _: HidSimulator(),
        help=help_text(HidSimulator.commands, **_STICKS),
        as_measured=as_measured,
    ),
}

__all__ = [
    'BOOT_TIME',
    'HOST_TIMEOUT',
    'SIMULATORS',
    'CanSimulator',
    'HidSimulator',
    'Simulator',
    'build_frame',
    'build_sentence',
]
