# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device's side of the link, for demos and tests; it shares no codec with the bridge."""

from argparse import ArgumentParser

from bridge_core.simulation import help_text, Simulated
from ssc_bridge.simulator.controller import BOOT_TIME, Simulator
from ssc_bridge.simulator.memory import build_frame, Memory, Settings, sums
from ssc_bridge.simulator.twin import as_measured


def _options(controller: ArgumentParser) -> None:
    controller.add_argument('--inputs', type=int, choices=range(1, 17), default=8, help='1 to 16')


SIMULATORS = {
    'ssc': Simulated(
        make=lambda options: Simulator(Settings(inputs=options.inputs)),
        help=help_text(Simulator.commands),
        options=_options,
        as_measured=as_measured,
    ),
}

__all__ = [
    'BOOT_TIME',
    'SIMULATORS',
    'Memory',
    'Settings',
    'Simulator',
    'build_frame',
    'sums',
]
