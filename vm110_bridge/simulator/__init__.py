# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device's side of the link, for demos and tests; it shares no codec with the bridge."""

from argparse import ArgumentParser

from bridge_core.options import whole_within
from bridge_core.simulation import help_text, Simulated
from vm110_bridge.simulator.base_unit import LOST, OUTPUT_TIMEOUT, Simulator, VRPI_PERIOD
from vm110_bridge.simulator.packets import build_packet, build_vrpi, crc32
from vm110_bridge.simulator.twin import as_measured


def _options(unit: ArgumentParser) -> None:
    unit.add_argument(
        '--bu-id', type=whole_within(1, 0xFFFF), default=7, help='of the base unit, 1 to 65535'
    )
    unit.add_argument('--crc', choices=('mpeg2', 'iso_hdlc'), default='mpeg2')


SIMULATORS = {
    'vm110': Simulated(
        make=lambda options: Simulator(options.bu_id, crc=options.crc),
        help=help_text(Simulator.commands, STATE=LOST),
        port='multicast',
        options=_options,
        as_measured=as_measured,
    ),
}

__all__ = [
    'OUTPUT_TIMEOUT',
    'SIMULATORS',
    'VRPI_PERIOD',
    'Simulator',
    'build_packet',
    'build_vrpi',
    'crc32',
]
