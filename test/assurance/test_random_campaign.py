# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The random campaign: what it draws, how it judges packets, and a few trials on the stack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
import subprocess
import sys
from typing import Any

import pytest

from assurance.machine import Machine, Setting
from assurance.random_campaign import Campaign, growth, judge, moved, table, Trial
from assurance.random_devices import Fault, UNIT_RADIO
from assurance.random_faults import CABLE, drawn, HUNG, kinds_of
from stage.devices import Packet
from stage.rig import Observer, ROOT

MANY = 1500  # trials in which all kinds come
PERIOD = 0.01  # s between packets
FAULT = Fault('a kind', lambda machine: None, bound=0.1)
CAUSE, RELEASED, PRESSED = 10.0, 11.0, 12.0


def packets(*enabling: tuple[float, float]) -> list[Packet]:
    """Return packets from before the cause to 13 s, which enable in these spans of time."""
    times = [9.9 + n * PERIOD for n in range(310)]
    return [Packet(at, (int(any(a <= at < b for a, b in enabling)),) * 2, (0, 0)) for at in times]


def judged(sent: Sequence[Packet], fault: Fault = FAULT, waited: float = 0.0) -> Trial:
    trial = Trial(0, fault.kind, '', fault.lasts, waited=waited)
    judge(trial, fault, sent, CAUSE, RELEASED, [PRESSED])
    return trial


AGAIN = (12.1, 20.0)  # behind the new press


@pytest.mark.parametrize(
    ('enabling', 'changes', 'waited', 'found'),
    [
        ([(0.0, 10.05), AGAIN], {}, 0.0, ''),
        ([(0.0, 10.15), AGAIN], {}, 0.0, 'late'),
        ([(0.0, 10.15), AGAIN], {}, 0.06, ''),  # the machine took that time
        ([(0.0, 12.0)], {}, 5.0, 'never'),
        ([(0.0, 11.25), AGAIN], {}, 5.0, 'late'),  # let go at 11: a machine takes a second at most
        ([(0.0, 10.05), (10.5, 10.52)], {}, 0.0, '2 packets enable after a stop'),
        ([(0.0, 10.5)], {'hears': False, 'bound': 0.02}, 0.0, 'late'),
        ([(0.0, 11.05), AGAIN], {'bound': None}, 0.0, ''),  # it is judged by letting go
        ([(0.0, 11.5)], {'bound': None}, 0.0, 'let go'),
    ],
)
def test_packets_of_a_trial_are_judged(
    enabling: list[tuple[float, float]], changes: dict[str, Any], waited: float, found: str
) -> None:
    trial = judged(packets(*enabling), replace(FAULT, **changes), waited)
    assert found in ' '.join(trial.findings)
    assert bool(found) == bool(trial.findings)


def test_times_of_a_trial_count_from_the_cause_or_from_letting_go() -> None:
    assert judged(packets((0.0, 10.05), AGAIN)).stopped == pytest.approx(0.05, abs=PERIOD)
    trial = judged(packets((0.0, 11.05), AGAIN), replace(FAULT, bound=None))
    assert trial.stopped is None
    assert trial.let_go == pytest.approx(0.05, abs=PERIOD)


def test_drive_that_hears_nothing_is_judged_by_what_it_heard_last() -> None:
    silent = [packet for packet in packets((0.0, 10.01)) if packet.time < 10.01]
    assert not judged(silent, replace(FAULT, hears=False, bound=0.02)).findings


def test_trial_of_a_seed_is_always_the_same_and_all_kinds_come() -> None:
    def texts(seed: int, setting: Setting) -> list[str]:
        found = (drawn(seed, number, setting) for number in range(MANY))
        return [f'{f.kind} {f.detail} {f.lasts} {f.bound} {moment}' for f, moment in found]

    for setting in (Setting(), Setting(stack=True), Setting(all_devices=False)):
        assert texts(1, setting) == texts(1, setting) != texts(2, setting)
        kinds = {drawn(1, number, setting)[0].kind for number in range(MANY)}
        assert kinds == set(kinds_of(setting))


@pytest.mark.parametrize(
    ('kind', 'bound'), [('safety_mux: SIGSTOP', HUNG), ('VM-110: radio lost', UNIT_RADIO)]
)
def test_stop_is_due_only_if_the_fault_lasts_for_longer_than_the_bound(
    kind: str, bound: float
) -> None:
    patient = Setting(patience=3.0)
    found = [fault for n in range(MANY) if (fault := drawn(1, n, patient)[0]).kind == kind]
    due = {fault.lasts > 3.0 * bound: fault.bound for fault in found}
    assert due == {True: 3.0 * bound, False: None}


def test_halted_wire_needs_no_stop_where_a_busy_machine_may_halt_it() -> None:
    for patience in (1.0, 3.0):
        found = (drawn(1, number, Setting(patience=patience))[0] for number in range(MANY))
        bounds = {f.bound for f in found if f.kind.startswith('wire') and 'STOP' in f.kind}
        assert (bounds == {None}) is (patience > 1.0)


def test_actuator_beside_the_drive_that_moves_in_a_stop_is_a_finding() -> None:
    told = [(at, True) for at in (10.0, 10.1, 12.1)] + [(11.0, False)]
    assert not moved({'a servo': told}, 10.2, PRESSED)
    assert moved({'a servo': told}, 10.05, PRESSED) == ['a servo moves 1 times in a stop']


def test_table_counts_what_the_machine_excuses_and_what_nothing_does() -> None:
    trials = [
        asdict(Trial(n, 'a kind', '', 0.5, bound=0.1, stopped=at, findings=found))
        for n, (at, found) in enumerate([(0.05, []), (0.15, []), (0.3, ['late'])])
    ]
    (row,) = [line for line in table(trials).splitlines() if line.startswith('| a kind')]
    assert row == '| a kind | 3 | 2 | 100 | 150 | 300 | 300 | 2 | 1 | 0 |'


def test_growth_is_told_of_processes_that_lived_for_long() -> None:
    uses = [{'mux': (7, 70.0 + n, 9, 20), 'vsc': (100 + n, 60.0, 9, 20)} for n in range(30)]
    trials = [asdict(Trial(n, '', '', 0.5, use=use)) for n, use in enumerate(uses)]
    assert growth(trials) == {('mux', 7): (30, 19.0, 0, 0)}
    # Another process may get its number.
    for trial in trials[5:]:
        trial['use'] = {'drive': trial['use']['mux']}
    assert growth(trials) == {('drive', 7): (25, 14.0, 0, 0)}


@pytest.mark.proof
def test_stack_stands_a_few_random_faults(tmp_path: Path, observer: Observer) -> None:
    setting = Setting(stack=True, patience=3.0)
    kinds = [
        *('VSC: stalled', 'drive: drops out', 'drive: unplugged'),
        *('SSC: unplugged', 'Akron: foreign joystick', 'wire of ssc_bridge: SIGKILL'),
    ]
    numbers = {drawn(1, number, setting)[0].kind: number for number in range(MANY)}
    with Machine(tmp_path, observer, setting) as machine:
        campaign = Campaign(machine, seed=1)
        assert [campaign.trial(numbers[kind]).findings for kind in kinds] == [[]] * len(kinds)


@pytest.mark.proof
def test_cut_cable_between_two_hosts_stops_the_drive() -> None:
    setting = Setting(patience=3.0, two_hosts=True)
    numbers = [n for n in range(MANY) if drawn(1, n, setting)[0].kind == CABLE]
    for number in numbers[:2]:
        words = f'-m assurance.campaign random --two-hosts --patience 3 --first {number} -n 1'
        command = [sys.executable, *words.split()]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
        if 'skipped' in done.stderr:
            pytest.skip(done.stderr)
        assert not done.returncode, done.stdout + done.stderr
