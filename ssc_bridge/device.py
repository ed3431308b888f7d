# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an SSC is, to the tools."""

from __future__ import annotations

from bridge_core.device import Device, Simulation, Trial

DEVICE = Device(
    name='ssc_bridge',
    node_class='SscBridge',
    title='SSC',
    marks=frozenset(('pulse_outputs',)),
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
