# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Servos and monitors: planted faults; on any machine, that nothing moves too early."""

from __future__ import annotations

from collections.abc import Iterator
import itertools
import math

import pytest

from rugged_teleop.commission import looks_actuators
from rugged_teleop.commission.engine import Engine
from rugged_teleop.commission.machine import Machine
from rugged_teleop.commission.main import read_machine
from rugged_teleop.commission.step import Act, Record, Result, Step
from rugged_teleop.commission.steps import steps_of
from stage.rig import ROOT
from test.rugged_teleop.commission.rig import (
    ACTUATORS_FILE,
    Fault,
    FEATURES_FILE,
    FILE,
    heard_as,
    mostly_proof,
    Trial,
    trial,
    VM110_FILE,
)
from test.rugged_teleop.commission.test_commission import Paper

SSC, MONITOR = '/ssc_bridge', '/akron_can_bridge'
MACHINES = (
    *(FILE, ACTUATORS_FILE, VM110_FILE, FEATURES_FILE, ROOT / 'config' / 'demo.yaml'),
    *(ROOT / 'config' / 'recipes' / f'{name}.yaml' for name in ('fire_truck', 'four_wheels')),
)


NOT_PASSED = (Result.FAILED, Result.SKIPPED, Result.ACCEPTED, Result.NOT_RUN)


# Nothing moves before its stops were seen to work


@pytest.fixture(scope='module', params=MACHINES, ids=lambda file: file.stem)
def machine(request: pytest.FixtureRequest) -> Machine:
    return read_machine(request.param)[0]


def _acts(step: Step) -> Iterator[Act]:
    for phase in step.phases:
        yield from phase.acts


def test_what_moves_says_so_and_waits_for_every_stop(machine: Machine) -> None:
    steps = steps_of(machine)
    stops = [step.name for step in steps if step.stops]
    passed = {name: Record(name, name, Result.PASSED, '') for name in stops}
    engine = Engine(Paper(), Paper(), lambda: 'now')
    for step in steps:
        commands = [act.command for act in _acts(step) if act.command is not None]
        harmed = any({'kill', 'freeze'}.intersection(act.lines) for act in _acts(step))
        assert step.moves or not (commands or step.joint or harmed), step.name
        assert not (step.moves and step.stops)
        for name, result in itertools.product(stops, NOT_PASSED):
            missing = {**passed, name: Record(name, name, result, '')}
            assert (name in engine.blocked(step, steps, missing)) is step.moves
        assert not engine.blocked(step, steps, passed)
    first = next(number for number, step in enumerate(steps) if step.moves)
    assert not any(step.stops for step in steps[first:])


def test_every_actuator_has_to_hear_the_mux_first(machine: Machine) -> None:
    (hear,) = [step for step in steps_of(machine) if step.name == 'stop.actuators']
    expected = ' '.join(phase.expected for phase in hear.phases)
    actuators = [each for each in machine.bridges if each.device and each.device.actuator]
    moving = {each.full for each in actuators if each.hands.places is None or each.joints}
    assert moving
    assert {each.full for each in actuators if each.full in expected} == moving


def test_every_command_of_the_trial_ends(machine: Machine) -> None:
    for step in steps_of(machine):
        told = {act.command.node for act in _acts(step) if act.command}
        ended = {act.command.node for act in step.undo if act.command and not act.command.shares}
        assert told == ended, step.name


# What is looked for


@pytest.mark.parametrize(
    ('places', 'ok', 'says'),
    [
        ((0.0, 0.5, 1.0, 1.0, 1.0), True, 'has ends'),
        ((math.nan, 0.5, 1.0, 1.0, 1.0), True, 'has ends'),
        ((0.0, -0.5, -1.0, -1.0, -1.0), False, 'pan goes the wrong way'),
        ((0.0, 0.8, 1.2, 1.2, 1.2), False, 'beyond its limits'),
        ((0.0, 0.5, 1.0, 1.0, 0.9), None, ''),
        ((0.0, 0.0, 0.0, 0.0, 0.0), None, ''),
    ],
)
def test_end_of_a_joint_is_seen(places: tuple[float, ...], ok: bool | None, says: str) -> None:
    times = (1.0, 1.3, 1.6, 1.9, 2.2)
    heard = heard_as(*(('places /n', at, {'pan': x}) for at, x in zip(times, places, strict=True)))
    seen = looks_actuators.at_end('/n', 'pan', 1, 1.02)(heard, {'since': 1.1}, 2.2)
    assert (seen and seen.ok) is ok
    assert says in (seen.text if seen else '')


def test_joint_that_turns_round_late_does_not_go_the_wrong_way() -> None:
    heard = heard_as(*(('places /n', 1.0 + 0.3 * n, {'pan': -0.1 * n}) for n in range(3)))
    look = looks_actuators.at_end('/n', 'pan', 1, 1.02)
    assert look(heard, {'since': 1.1}, 1.6) is None
    assert look(heard, {'since': 1.1}, 2.2) is not None


@pytest.mark.parametrize(
    ('said', 'ok'), [('e-stop input is true', True), ('there are none', False)]
)
def test_actuator_that_does_not_hear_the_stop_is_seen(said: str, ok: bool) -> None:
    heard = heard_as(('device /n', 2.0, {'commands not obeyed because': said}))
    assert bool(looks_actuators.told_to_stop('/n')(heard, {'since': 1.0}, 2.1)) is ok


# Planted faults

FAULTS = {
    'exchanged servo channels': Fault(
        'joint.pan',
        'tilt moved in the place of pan',
        wheels=(('pan', 'tilt', 1.0), ('tilt', 'pan', 1.0)),
    ),
    'servo that goes the wrong way': Fault(
        'joint.tilt', 'tilt moved the wrong way', wheels=(('tilt', 'tilt', -1.0),)
    ),
    'monitor that turns the wrong way': Fault(
        'joint.rotation', 'rotation moved the wrong way', wheels=(('rotation', 'rotation', -1.0),)
    ),
    'servo that holds its last when commands end': Fault(
        'motion.ssc_bridge.ends',
        'pan stays at 0.20 without commands',
        device=(f'{SSC} keep on',),
        mended=(f'{SSC} keep off',),
    ),
    'monitor that goes on oscillating': Fault(
        'motion.akron_can_bridge.oscillation',
        'rotation of /akron_can_bridge goes on moving',
        device=(f'{MONITOR} soe off',),
        mended=(f'{MONITOR} oscillate off', f'{MONITOR} position 1 0', f'{MONITOR} soe on'),
    ),
}
SOUND = (
    *('motion.ssc_bridge.killed', 'motion.ssc_bridge.wire', 'motion.akron_can_bridge.mux_frozen'),
    *(fault.step for fault in FAULTS.values() if fault.step != 'joint.rotation'),
)
WARM = ('limit left -20', 'limit right 20', 'soe on')


@pytest.fixture(scope='module')
def tried(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trial]:
    with trial(tmp_path_factory.mktemp('commission'), ACTUATORS_FILE) as made:
        made.simulated.ports[MONITOR].apply(*WARM)
        yield made


@pytest.mark.waits(300.0)
@pytest.mark.parametrize(
    'name',
    mostly_proof([(name,) for name in FAULTS], 'servo that holds its last when commands end'),
)
def test_planted_fault_is_named(tried: Trial, name: str) -> None:
    tried.plant(FAULTS[name])


@pytest.mark.waits(300.0)
@pytest.mark.parametrize(
    'step', mostly_proof([(step,) for step in SOUND], 'motion.ssc_bridge.ends')
)
def test_same_step_passes_without_fault(tried: Trial, step: str) -> None:
    tried.passes(step)


@pytest.mark.proof
@pytest.mark.waits(300.0)
@pytest.mark.parametrize('degrees', [-20, 20])  # see WARM
def test_joint_that_begins_at_one_of_its_ends_passes(tried: Trial, degrees: int) -> None:
    tried.simulated.ports[MONITOR].apply(f'position 1 {degrees}')
    tried.passes('joint.rotation')
