# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whole trials: each kind of step that there is passes on a sound simulated machine."""

from __future__ import annotations

import contextlib
from pathlib import Path
import re

import pytest

from rugged_teleop.commission.machine import Machine
from rugged_teleop.commission.main import read_machine
from rugged_teleop.commission.step import Record, Result
from rugged_teleop.commission.steps import steps_of
from stage.rig import ROOT
from test.rugged_teleop.commission.rig import (
    ACTUATORS_FILE,
    FEATURES_FILE,
    FILE,
    trial,
    VM110_FILE,
    WHEELS_FILE,
)
from test.rugged_teleop.commission.test_commission_actuators import MONITOR, WARM

PLAYED = (FILE, VM110_FILE, ACTUATORS_FILE, FEATURES_FILE)
CONFIG = ROOT / 'config'
GIVEN = (CONFIG / 'demo.yaml', CONFIG / 'spine.yaml', *(CONFIG / 'recipes').glob('*.yaml'))
MACHINES = 5  # among those files
NOT_PLAYED = {
    r'(stop|motion)\.\w+\.source': 'nobody simulates a topic of another package',
    r'end\.joint': 'no simulated drive says where a joint is; see test_commission_told.py',
}


def _kinds(machine: Machine) -> set[str]:
    """Return the names of steps, with devices in the place of their nodes, sources and joints."""
    names: dict[str, str] = {}
    for node in machine.bridges:
        assert node.device is not None
        sources = [machine.short(node), node.full.strip('/').replace('/', '.')]
        sources += [each for each in machine.operators if machine.remote_of(each) is node]
        names |= dict.fromkeys(sources, node.device.name)
        if node.hands.places is not None:
            names |= dict.fromkeys(node.joints, f'joint of {node.device.name}')
    names |= dict.fromkeys(machine.values['joints'], 'joint')
    ordered = sorted(names, key=len, reverse=True)
    known = re.compile(rf'(?<=\.)({"|".join(map(re.escape, ordered))})(?=\.|$)')
    found = (known.sub(lambda found: names[found[1]], step.name) for step in steps_of(machine))
    return {re.sub(r'\.\d+$', '', each) for each in found}


def test_every_kind_of_step_is_played_by_a_simulated_machine() -> None:
    played = set[str]().union(*(_kinds(read_machine(file)[0]) for file in PLAYED))
    missing: dict[str, str] = {}
    read = 0
    for file in GIVEN:
        with contextlib.suppress(ValueError):  # a part of a file
            machine, _ = read_machine(file)
            if all(map(machine.remote_of, machine.operators)):
                missing |= dict.fromkeys(_kinds(machine) - played, file.name)
                read += 1
    assert read >= MACHINES
    assert not [each for each in missing if not any(re.fullmatch(r, each) for r in NOT_PLAYED)]


def test_no_step_waits_for_what_a_machine_has_not() -> None:
    names = {step.name for step in steps_of(read_machine(ACTUATORS_FILE)[0])}  # without a drive
    assert not names & {'link.age', 'motion.link'}


@pytest.mark.proof  # each takes minutes
@pytest.mark.parametrize('file', PLAYED, ids=lambda file: file.stem)
def test_whole_trial_of_a_sound_machine_passes(file: Path, tmp_path: Path) -> None:
    folder = tmp_path / 'trial'
    folder.mkdir()
    done: dict[str, Record] = {}
    with trial(folder, file) as made:
        if MONITOR in made.simulated.ports:
            made.simulated.ports[MONITOR].apply(*WARM)
        steps = [*steps_of(made.machine)]
        for step in steps:
            if not step.problems:
                assert not made.engine.blocked(step, steps, done | _accepted(made.machine))
                done[step.name] = made.run(step.name)
    assert not [each for each in done.values() if each.result is not Result.PASSED]


@pytest.mark.proof
def test_two_drives_are_judged_together(tmp_path: Path) -> None:
    folder = tmp_path / 'trial'
    folder.mkdir()
    differs = r'(stop\.rear\.cable|link\.age|joint\.rear_left|motion\.(link|fort|rear)(\.\w+)?)'
    with trial(folder, WHEELS_FILE) as made:
        for name in made.steps:
            if re.fullmatch(differs, name):
                made.passes(name)


def _accepted(machine: Machine) -> dict[str, Record]:
    """Return what was found on paper, accepted."""
    found = [step for step in steps_of(machine) if step.problems]
    return {each.name: Record(each.name, each.title, Result.ACCEPTED, '') for each in found}
