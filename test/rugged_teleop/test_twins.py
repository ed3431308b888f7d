# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What simulators are told by a report, and that they do it then; without nodes."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest

from akron_can_bridge.simulator import Simulator as Monitor
from bridge_core.j1939 import CanFrame
from bridge_core.simulation import Report
from fort_vsc_bridge.simulator import HOST_TIMEOUT, Simulator as Vsc
from rugged_teleop.simulate import DEVICES, parser
from ssc_bridge.simulator import build_frame, Simulator as Ssc
from vm110_bridge.protocol import BuState
from vm110_bridge.simulator import Simulator as Vm110

SERVOS = {'servos': ['pan', 'tilt']} | {
    f'servo.{name}.{key}': value
    for name, values in {
        'pan': {'channel': 1, 'failsafe': 'release', 'failsafe_us': 1500},
        'tilt': {'channel': 2, 'failsafe': 'pulse', 'failsafe_us': 1300},
    }.items()
    for key, value in values.items()
}
MUX = {
    'estop_sources': ['fort', 'left'],
    'estop.fort.topic': 'fort_vsc_bridge/estop',
    'estop.left.topic': '/truck/vm110_bridge/estop',
}
SSC, MONITOR, VSC, VM110 = (
    *('/ssc_bridge', '/akron_can_bridge', '/fort_vsc_bridge'),
    '/truck/vm110_bridge',
)
JOINTS = {'joint_names': ['turn', 'lift']}
STOP = {'speed': math.radians(4.0), 'time': 1.0, 'angle': 0.2}
TURN = f'{MONITOR}: turn'
# Kind, node, its parameters, facts of one step, lines.
TOLD: dict[str, tuple[str, str, dict[str, Any], dict[str, Any], list[str]]] = {
    'SSC with failsafes': (
        *('ssc', SSC, SERVOS),
        {
            f'{SSC}: pan is limp without a pulse': True,
            f'{SSC}: servos without it are': 'at their failsafe',
        },
        ['keep off', 'alone 1 0', 'alone 2 1300'],
    ),
    'SSC that stays': (
        *('ssc', SSC, SERVOS),
        {
            f'{SSC}: pan is limp without a pulse': False,
            f'{SSC}: servos without it are': 'where they were',
        },
        ['keep on', 'alone 1 stays', 'alone 2 stays'],
    ),
    'monitor that coasts': (
        *('akron', MONITOR, JOINTS),
        {
            f'{TURN} ends, told +1': math.radians(100.0),
            f'{TURN} ends, told -1': math.radians(-30.0),
            f'{TURN} at full push (rad/s)': math.radians(12.0),
            f'{TURN} coasts, told to rest (rad)': math.radians(2.0),
            f'{MONITOR}: goes on without it (degrees)': 6.0,
            f'{MONITOR}: a stop ends its stowing': False,
        },
        [
            *('limit left -100.0', 'limit right 30.0', 'speed rotation 12.00'),
            *('slowing rotation 4.00', 'timeout 1.000', 'soe off'),
        ],
    ),
    'monitor that stands at once': (
        *('akron', MONITOR, JOINTS),
        {
            f'{TURN} coasts, told to rest (rad)': 0.01,
            f'{MONITOR}: a stop ends its stowing': True,
        },
        ['soe on'],
    ),
    'VSC with bits of its own': (
        *('fort_vsc', VSC, {}),
        {
            'fort, remote: e-stop indication': '0x00000002',
            'fort, off: e-stop indication': '0x00000010',
            'fort, wired: e-stop indication': 'actuated',  # by HID
            'fort.ended: the Master Enable outputs': 'open',
            'left.ended: the ES-Link relays': 'closed',
        },
        ['bits remote 2', 'lost stop', 'bits lost 10', 'watchdog on'],
    ),
    'VSC that falls silent': (
        *('fort_vsc', VSC, {}),
        {'fort, off: e-stop indication': 'unknown'},
        ['lost silent'],
    ),
    'VM-110': (
        *('vm110', VM110, {}),
        {
            'left: VLAPs': '3',
            'left, off: BU state': 'External link error',
            'left.ended: the ES-Link relays': 'closed',
        },
        ['vlaps 3', 'lost external_link_error', 'timeout 60'],
    ),
    'VM-110 that falls silent': (
        *('vm110', VM110, {}),
        {
            'left: VLAPs': 'not told',
            'left, off: BU state': 'Not heard',
            'left.ended: the ES-Link relays': 'open',
        },
        ['lost silent'],
    ),
}


@pytest.mark.parametrize('name', TOLD)
def test_simulator_obeys_what_a_report_has(name: str) -> None:
    kind, node, values, facts, lines = TOLD[name]
    step = {'name': 'motion.a', 'measured': [], 'stopping': {'turn': STOP}, 'facts': facts}
    told = {'parameters': {'/safety_mux': MUX, node: values}, 'steps': [step]}
    as_measured = DEVICES[kind].as_measured
    assert as_measured is not None
    assert as_measured(Report(told, node)) == lines
    words = ['--port', '5825'] if kind != 'akron' else []
    simulator = DEVICES[kind].make(parser().parse_args([kind, *words]))
    for line in lines:
        simulator.apply(line)


def test_servos_go_by_themselves_once_the_host_is_silent() -> None:
    ssc = Ssc()
    ssc.apply('alone 1 0')
    ssc.poll(1.0)
    ssc.receive(build_frame(20, struct.pack('>H', 1700) * ssc.settings.outputs), 1.1)
    for now, pulses in ((1.1, [1700, 1700]), (2.0, [1700, 1700]), (2.11, [0, 1700])):
        ssc.poll(now)
        assert ssc.describe()['outputs_us'][:2] == pulses


def test_monitor_coasts_from_its_speed_and_goes_on_for_its_timeout() -> None:
    unit = Monitor()
    for line in ('speed rotation 10', 'slowing rotation 10', 'timeout 1'):
        unit.apply(line)
    unit.poll(0.0)
    unit.receive(CanFrame(0x0CFDD633, bytes.fromhex('10FA010000000000')), 1.0)
    unit.poll(2.0)
    before = unit.describe()['rotation_deg']
    unit.poll(2.9)
    unit.poll(3.8)
    assert unit.describe()['rotation_deg'] - before == pytest.approx(5.0, abs=0.2)
    assert not unit.describe()['moving']


def test_vsc_says_what_it_is_told_to() -> None:
    vsc = Vsc()
    vsc.poll(2.0)
    for line in ('bits lost 10', 'bits remote 2', 'watchdog on', 'estop remote on', 'radio off'):
        vsc.apply(line)
    assert vsc.estop_bits == 0x12
    vsc.poll(2.1 + HOST_TIMEOUT)
    assert vsc.estop_bits == 0x52
    assert vsc.poll(3.0)
    vsc.apply('lost silent')
    assert not vsc.poll(4.0)
    vsc.apply('radio on')
    assert vsc.poll(5.0)


@pytest.mark.parametrize(
    ('lost', 'state', 'speaks'),
    [('stopped', BuState.STOPPED, True), ('silent', BuState.BLOCKED, False)],
)
def test_base_unit_that_loses_its_remote_is_as_it_is_told(
    lost: str, state: BuState, speaks: bool
) -> None:
    unit = Vm110()
    unit.poll(1.0)
    for line in (f'lost {lost}', 'timeout 9', 'arm 1', 'radio 1 off'):
        unit.apply(line)
    unit.poll(5.0)
    assert unit.state is state
    assert bool(unit.poll(5.2)) is speaks
    unit.apply('radio 1 on')
    unit.apply('arm 1')
    assert unit.relays_closed
    unit.poll(10.5)
    assert not unit.relays_closed
