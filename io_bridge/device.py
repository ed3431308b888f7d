# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a box of inputs and outputs is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.device import Device, Simulation
from io_bridge.reasons import REASONS


def _simulation(values: Mapping[str, Any]) -> Simulation:
    words = ('io', '--unit', str(values.get('unit', 1)))
    return Simulation('pty', words, {'transport': 'rtu'})


DEVICE = Device(
    name='io_bridge',
    node_class='IoBridge',
    title='I/O box',
    marks=frozenset(('reset_button', 'speed_limit')),
    page='docs/devices/io.md',
    launch=2,
    polled=True,
    answers=True,
    publishes=('reset_button', 'speed_limit'),
    reasons=REASONS,
    ports={'io_port': 'port'},
    decoders='io_bridge.decoders:DECODERS',
    simulators='io_bridge.simulator:SIMULATORS',
    simulation=_simulation,
)
