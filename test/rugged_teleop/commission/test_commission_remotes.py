# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What can be wrong with remotes, links and hardware chains, planted one after the other."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from test.rugged_teleop.commission.rig import Fault, FILE, mostly_proof, Trial, trial, VM110_FILE

pytestmark = [pytest.mark.waits(120.0)]
VSC, VM110 = 'fort_vsc_bridge', 'vm110_bridge'
WELDED = 'the meter shows closed: the stop does not open it'
FAULTS = {
    VSC: {
        'Master Enable relay that welds': Fault('chain.fort.remote', WELDED, welded=(f'/{VSC}',)),
        'Master Enable that needs this computer': Fault(
            'chain.fort.alone.wired', WELDED, dead=('estop vsc on',)
        ),
        'receiver that hides at rest that its remote is off': Fault(
            'stop.fort.off', 'expected: e-stop source fort', dead=('radio off',)
        ),
        'deadman whose slip nobody sees': Fault(
            'motion.fort.slip',
            'expected: a stop',
            dead=('button left_down 0',),
            mended=(f'/{VSC} button left_down 0',),
        ),
        'pause that leaves the sticks alive': Fault(
            'motion.fort.pause', 'expected: a stop', dead=('mode pause',)
        ),
        'second computer that is late': Fault('link.age', 'look at the network', late=True),
    },
    VM110: {
        'dead stop switch': Fault(
            'stop.vm110.remote', 'expected: e-stop source vm110', dead=('stop 1 on',)
        ),
        'VM-110 that holds what it heard last': Fault(
            'motion.vm110.off', 'expected: a stop', dead=('radio 1 off',)
        ),
        'tilt sensor that is dead': Fault(
            'motion.vm110.tilt', 'expected: a stop', dead=('tilt 1 on',)
        ),
        'ES-Link relays that weld': Fault('chain.vm110.ended', WELDED, welded=(f'/{VM110}',)),
    },
}
ROWS = [(node, name) for node, faults in FAULTS.items() for name in faults]
STEPS = sorted(
    {(node, fault.step) for node, faults in FAULTS.items() for fault in faults.values()}
)
KEPT = ('second computer that is late', 'link.age')


@pytest.fixture(scope='module', params=(VSC, VM110))
def node(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope='module')
def machine(node: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trial]:
    file, relayed = {VSC: (FILE, VSC), VM110: (VM110_FILE, '')}[node]
    with trial(tmp_path_factory.mktemp('remotes'), file, relayed) as made:
        yield made


@pytest.mark.parametrize(
    ('node', 'name'), mostly_proof(ROWS, *KEPT), indirect=['node'], scope='module'
)
def test_planted_fault_is_named(machine: Trial, node: str, name: str) -> None:
    machine.plant(FAULTS[node][name])


@pytest.mark.parametrize(
    ('node', 'step'), mostly_proof(STEPS, *KEPT), indirect=['node'], scope='module'
)
def test_same_step_passes_without_fault(machine: Trial, node: str, step: str) -> None:
    machine.passes(step)
