# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What can be wrong with a machine, planted one after the other: the trial names each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from bridge_core.simulation import Report
from esi_drive_bridge.simulator.twin import as_measured
from rugged_teleop.commission import folder
from rugged_teleop.commission.main import nodes_of
from rugged_teleop.commission.step import Record, Result
from rugged_teleop.recordings import Parameters, read, Said
from test.rugged_teleop.commission.rig import DRIVE, Fault, mostly_proof, PATIENCE, Trial, trial
from test.rugged_teleop.commission.test_commission_folder import HEAD, VALIDATOR

pytestmark = [pytest.mark.waits(240.0)]
VSC = '/fort_vsc_bridge'


# From 1.6 rad/s the joints turn 0.75 rad for each of PATIENCE, by which the limit, 1 rad, is
# multiplied; with half of the torque 1.5.
LOAD = ('inertia * 0.01', 'friction * 0', 'winding * 0')
FULL = (*LOAD, f'brake * {0.17 / PATIENCE} 0')
HALF = (*LOAD, f'brake * {0.085 / PATIENCE} 0')
LATE = (*LOAD, f'brake * 1 {0.8 * PATIENCE}')
DELIVERED = ('inertia * 0.002', 'friction * 0.0005', 'winding * 0.0245', 'brake * 0 0')


def _drive(*lines: str) -> tuple[str, ...]:
    return tuple(f'{DRIVE} {line}' for line in lines)


FAULTS = {
    'dead e-stop button on the remote': Fault(
        'stop.fort.remote',
        'expected: e-stop source fort',
        dead=('estop remote on',),
        expected='e-stop source',
    ),
    'dead wired e-stop': Fault(
        'stop.fort.wired',
        'expected: e-stop source fort',
        dead=('estop vsc on',),
        expected='e-stop source',
    ),
    'e-stop that stays pressed': Fault(
        'stop.fort.remote',
        'fort demands a stop',
        dead=('estop remote off',),
        expected='fort clear',
        mended=(f'{VSC} estop remote off', f'{VSC} ack', f'{VSC} mode operational'),
    ),
    'stuck deadman': Fault(
        'operator.fort.rest',
        "fort's button 0 is pressed",
        expected='the mux READY',
        device=(f'{VSC} button left_down 1',),
        mended=(f'{VSC} button left_down 0',),
    ),
    'dead deadman': Fault(
        'operator.fort.deadman.0',
        'expected: button 0 pressed',
        dead=('button left_down 1',),
        expected='button 0',
    ),
    'deadman that sticks': Fault(
        'operator.fort.deadman.0',
        'button 0 is pressed',
        expected='released',
        dead=('button left_down 0',),
        mended=(f'{VSC} button left_down 0',),
    ),
    'deadman that sticks in the daily check': Fault(
        'deadman.fort.0',
        'button 0 is pressed',
        expected='its end',
        dead=('button left_down 0',),
        mended=(f'{VSC} button left_down 0',),
    ),
    'stick with the wrong sign': Fault(
        'operator.fort.axis.1',
        'its sign is wrong',
        instead=(('stick left_y 1', 'stick left_y -1'), ('stick left_y -1', 'stick left_y 1')),
    ),
    'exchanged sticks': Fault(
        'operator.fort.axis.1',
        'axis 0 moved in the place of axis 1',
        instead=(('stick left_y 1', 'stick left_x 1'), ('stick left_y 0', 'stick left_x 0')),
    ),
    'stick that does not reach its end': Fault(
        'operator.fort.axis.1',
        'axis 1 was at 0.7',
        expected='axis 1 at',
        instead=(('stick left_y 1', 'stick left_y 0.7'),),
    ),
    'stick that does not come back': Fault(
        'operator.fort.axis.0',
        'axis 0 was at',
        expected='axes at 0',
        instead=(('stick left_x 0', 'stick left_x 0.1'),),
        mended=(f'{VSC} stick left_x 0',),
    ),
    'deadman that sticks in motion': Fault(
        'motion.fort.deadman',
        'expected: a stop',
        dead=('button left_down 0',),
        mended=(f'{VSC} button left_down 0',),
    ),
    'receiver that holds': Fault(
        'motion.fort.off', 'expected: a stop', dead=('radio off',), expected='a stop'
    ),
    'brake that does not hold': Fault(
        'motion.fort.remote',
        'STOPPED: ',
        device=_drive('slope 300'),
        mended=_drive('slope 0'),
        expected='the mux READY',
    ),
    'brake at half torque': Fault(
        'motion.fort.remote', ' turned meanwhile', device=_drive(*HALF), mended=_drive(*DELIVERED)
    ),
    'brake that is late': Fault(
        'motion.fort.remote', ' turned meanwhile', device=_drive(*LATE), mended=_drive(*DELIVERED)
    ),
    'drive that goes on when its commands end': Fault(
        'motion.drive.cable',
        'turned without commands',
        device=(f'{DRIVE} timeout {0.8 * PATIENCE}',),
        mended=(f'{DRIVE} timeout 0.7',),
    ),
    'drive that stays enabled': Fault(
        'motion.fort.deadman',
        'drive demands a stop',
        expected='the mux READY',
        device=(f'{DRIVE} stuck * on',),
        mended=(f'{DRIVE} stuck * off',),
    ),
    'exchanged wheels': Fault(
        'joint.left',
        'right turned in the place of left',
        wheels=(('left', 'right', 1.0), ('right', 'left', 1.0)),
    ),
    'wheel that turns the wrong way': Fault(
        'joint.left', 'turned the wrong way', wheels=(('left', 'left', -1.0),)
    ),
    'limit left at its default': Fault(
        'what.limits', 'joint.left.max is the default', missing='joint.left.max'
    ),
    'scale of two': Fault(
        'joint.left', 'times as far as it says', wheels=(('left', 'left', 2.0),)
    ),
    'node of a drive whose death is not noticed': Fault(
        'motion.drive.killed', 'expected: the mux STOPPED', dead=('kill',)
    ),
    'drive that starts again by itself': Fault(
        'motion.drive.cable',
        'the drive starts again by itself',
        instead=(('plug', 'plug; stuck * on'),),
        mended=(f'{DRIVE} stuck * off',),
    ),
}
SOUND = {'motion.drive.wire', 'motion.drive.mux_killed', 'motion.fort.killed'}

KEPT = (
    *('dead e-stop button on the remote', 'exchanged wheels'),
    'drive that goes on when its commands end',
)


@pytest.fixture(scope='module')
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trial]:
    with trial(tmp_path_factory.mktemp('commission')) as made:
        starts = (made.run('operator.fort.rest').result for _ in range(3))
        assert Result.PASSED in starts, 'it does not get READY'
        yield made


@pytest.mark.parametrize('name', mostly_proof([(name,) for name in FAULTS], *KEPT))
def test_planted_fault_is_named(machine: Trial, name: str) -> None:
    machine.plant(FAULTS[name])


@pytest.mark.parametrize(
    'step',
    mostly_proof(
        [(step,) for step in sorted(SOUND | {fault.step for fault in FAULTS.values()})],
        'motion.drive.mux_killed',
    ),
)
def test_same_step_passes_without_fault(machine: Trial, step: str) -> None:
    machine.passes(step)


@pytest.mark.proof
def test_brake_of_full_torque_passes(machine: Trial) -> None:
    machine.apply(_drive(*FULL))
    record = machine.run('motion.fort.remote')
    machine.apply(_drive(*DELIVERED))
    assert record.result is Result.PASSED, record


@pytest.mark.proof
def test_what_the_drive_does_without_us_is_a_fact(machine: Trial) -> None:
    facts = machine.passes('motion.drive.cable').facts
    assert 0.3 < float(facts[f'{DRIVE}: goes on without commands (s)']) < 3.0
    assert facts[f'{DRIVE}: starts again by itself'] is False
    assert facts[f'{DRIVE}: keeps its error until it is cleared'] is False


def test_stop_is_measured_and_recorded(machine: Trial) -> None:
    record = machine.passes('motion.fort.wired')
    assert {*record.stopping} == {'left', 'right'}
    assert all(each['speed'] > 0.0 and each['angle'] > 0.0 for each in record.stopping.values())
    assert 'joints left' in record.series
    assert {*record.events} == {'cause', 'disabled', 'standstill'}
    report = _report(machine, record)
    VALIDATOR.validate(report)
    folder.write(machine.folder, report, b'')
    with (machine.folder / record.piece).open('rb') as file:
        said = [*read(file)]
    assert {each.node for each in said if isinstance(each, Parameters)} == {*report['parameters']}
    told = [each for each in said if isinstance(each, Said)]
    states = [each.message.data for each in told if each.topic == '/safety_mux/state']
    assert ('ACTIVE' in states, states[-1]) == (True, 'STOPPED')
    assert {f'{DRIVE}/raw/sent', f'{VSC}/raw/received'} <= {each.topic for each in told}


def _report(machine: Trial, *records: Record) -> dict[str, Any]:
    parameters = nodes_of(machine.machine)
    steps = [machine.steps[each.name] for each in records]
    return folder.report_of(
        {**HEAD, 'parameters': parameters}, steps, {each.name: each for each in records}
    )


TWIN = ('joint.left', 'motion.drive.cable', 'motion.fort.wired')
NEAR = 0.3  # s or rad; busy machines are late. By itself it agrees within 0.1.


def _passed(machine: Trial) -> dict[str, Any]:
    records = [machine.run(name) for name in TWIN]
    assert not [each for each in records if each.result is not Result.PASSED]
    return _report(machine, *records)


@pytest.mark.proof  # it compares times, and a busy machine has other ones
def test_drive_as_its_report_has_it_is_measured_as_before(machine: Trial) -> None:
    """What is measured here differs from a drive as delivered by more than NEAR."""
    lines = (*LOAD, 'brake * 0.2 0.2', 'enabling 0.6', 'timeout 1.1')
    machine.apply(_drive(*lines))
    before = _passed(machine)
    machine.apply(_drive(*DELIVERED, 'enabling 0.02', 'timeout 0.7'))
    machine.apply(_drive(*as_measured(Report(before, DRIVE))))
    after = _passed(machine)
    machine.apply(_drive(*DELIVERED, 'enabling 0.02', 'timeout 0.7'))
    for name in ('time', 'angle'):
        was, now = (each['stopping']['left'][0][name] for each in (before, after))
        assert now == pytest.approx(was, abs=NEAR)
    for name in ('to enabled', 'turned without commands'):
        was, now = (
            next(m['value'] for s in each['steps'] for m in s['measured'] if m['name'] == name)
            for each in (before, after)
        )
        assert now == pytest.approx(was, abs=NEAR)
