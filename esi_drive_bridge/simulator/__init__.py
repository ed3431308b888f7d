# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device's side of the link: a drive, and what its motors move and stop."""

from argparse import ArgumentParser

from bridge_core.options import number_within
from bridge_core.simulation import help_text, Simulated
from esi_drive_bridge.simulator.drive import FAULTS, Simulator
from esi_drive_bridge.simulator.motor import Motor
from esi_drive_bridge.simulator.twin import as_measured


def _options(drive: ArgumentParser) -> None:
    rate = number_within(1.0, 1000.0)
    drive.add_argument('--axes', type=int, choices=(1, 2), default=2)
    drive.add_argument('--compact', action='store_true', help='short packets, for 1 axis')
    drive.add_argument('--status-rate', type=rate, default=100.0, help='Hz, 1 to 1000')


SIMULATORS = {
    'esi_drive': Simulated(
        make=lambda options: Simulator(
            axes=options.axes, compact=options.compact, status_rate=options.status_rate
        ),
        help=help_text(Simulator.commands, FAULT=FAULTS),
        options=_options,
        as_measured=as_measured,
    ),
}
