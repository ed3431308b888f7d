# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What not every machine has: an I/O box, speeds, axis buttons, soft ends, an SSC as remote."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from bridge_core import clock
from stage.rig import wait_for
from test.rugged_teleop.commission.rig import Fault, FEATURES_FILE, Trial, trial

BOX, VSC = '/io_bridge', '/fort_vsc_bridge'
pytestmark = [pytest.mark.proof, pytest.mark.waits(240.0)]
FAULTS = {
    'e-stop of the box that is wired to another input': Fault(
        'stop.site.estop',
        'expected: e-stop source site',
        instead=(('input 4 off', 'input 8 off'), ('input 5 on', 'input 9 on')),
        mended=(f'{BOX} input 8 off', f'{BOX} input 9 off'),
    ),
    'e-stop with a channel that does not open': Fault(
        'stop.site.estop',
        'expected: site clear',
        dead=('input 4 off',),
    ),
    'reset button that is not wired': Fault(
        'reset.button', 'expected: no reset while it is held', dead=('input 2 on',)
    ),
    'key switch without effect': Fault(
        'motion.limit.key.2', 'expected: 2 times as fast', dead=('input 3 on',)
    ),
    'speed level without effect': Fault(
        'motion.fort.speed.1', 'expected: 0.5 times as fast', dead=('button left_right 1',)
    ),
    'axis that needs no button': Fault(
        'motion.fort.axis.0',
        'motion was commanded without the button',
        instead=(('button left_down 1', 'button left_down 1; button right_right 1'),),
    ),
    'axis button that sticks': Fault(
        'motion.fort.axis.0',
        'expected: rest',
        dead=('button right_right 0',),
        mended=(f'{VSC} button right_right 0',),
    ),
    'second deadman button that sticks': Fault(
        'motion.fort.deadman.4',
        'expected: a stop',
        dead=('button right_down 0',),
        mended=(f'{VSC} button right_down 0',),
    ),
}
_READS = 3  # one that was under way before, and outputs between them
SSC = ('stop.ssc.off', 'operator.ssc.axis.1', 'motion.ssc.deadman', 'motion.ssc.off')


@pytest.fixture(scope='module')
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trial]:
    pytest.importorskip('pymodbus')
    with trial(tmp_path_factory.mktemp('features'), FEATURES_FILE) as made:
        yield made


@pytest.mark.parametrize('name', FAULTS)
def test_planted_fault_is_named(machine: Trial, name: str) -> None:
    fault = FAULTS[name]
    try:
        machine.plant(fault)
    finally:
        if fault.step == 'stop.site.estop':
            press_and_release(machine)


def press_and_release(machine: Trial) -> None:
    """Have both channels say pressed until that was read: it ends what their discrepancy began."""
    box = machine.simulated.ports[BOX]
    box.apply('input 4 off', 'input 5 on')
    then = clock.now()
    wait_for(lambda: len(box.received(then)) > _READS, 10.0, 'the box is read')
    box.apply('input 4 on', 'input 5 off')


@pytest.mark.parametrize('step', sorted({fault.step for fault in FAULTS.values()} | {*SSC}))
def test_same_step_passes_without_fault(machine: Trial, step: str) -> None:
    machine.passes(step)
