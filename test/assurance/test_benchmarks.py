# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks' own tools: devices in C, rows and what got worse, what a campaign accepts."""

from collections.abc import Iterator
from dataclasses import replace
import math
from pathlib import Path
import shutil
from typing import Any

import pytest

from assurance import campaign
from assurance.benchmarks import results
from assurance.benchmarks.__main__ import GROUPS
from assurance.benchmarks.rig import (
    build,
    figures,
    ONCE,
    Rig,
    running,
    UnavailableError,
)
from assurance.campaign import Fault, Trial
from rugged_teleop.reference import with_table
from stage.rig import wait_for

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ('cc', 'gcc', 'clang'))), reason='needs a C compiler'
)


# The devices.


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with Rig(tmp_path) as rig:
        yield rig


@needs_compiler
def test_stop_is_timed_and_its_packet_kept(rig: Rig) -> None:
    with running('-m', 'assurance.benchmarks.bare', 'floor', str(rig.vsc), str(rig.drive)):
        rig.say('estop 0')
        wait_for(rig.enabled, 10.0, 'enable')
        took = rig.fire('estop')
        assert took is not None
        packets = rig.packets(0.0)
        assert packets[0].enables
        assert not packets[-1].enables
        times = [packet.at for packet in packets]
        assert times == sorted(times)


@needs_compiler
def test_stop_that_nobody_carries_out_is_no_time(rig: Rig) -> None:
    assert rig.fire('estop', timeout=0.2) is None
    assert not rig.moves()


def test_without_a_compiler_the_benchmark_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('PATH', '')
    build.cache_clear()
    with pytest.raises(UnavailableError, match='no C compiler'):
        build()


# Figures.


def test_figures_are_quantiles_of_all_values() -> None:
    found = figures([number / 1000 for number in range(1000, 0, -1)])
    assert found == {'p50': 0.501, 'p90': 0.901, 'p99': 0.991, 'max': 1.0, 'n': 1000}
    assert figures([]) == {'n': 0}


# Rows.


# Some need motion with time-outs as delivered, which other tests beside them would end; and cores
# that are kept busy would be those of all other tests.
@needs_compiler
@pytest.mark.proof
@pytest.mark.waits(300)
@pytest.mark.parametrize('group', GROUPS)
def test_group_measures(group: str) -> None:
    """Once, small: what is measured has to work, and no figure is asserted."""
    found = GROUPS[group](ONCE)
    assert results.rows(found)
    assert all(math.isfinite(value) for each in found.values() for value in each.values())


def row_of(p50: float, bare: float, n: int = 200) -> results.Row:
    measured = {
        'three estop': {'p50': p50, 'p99': 2 * p50, 'n': n, 'lost': 1},
        'bare estop': {'p50': bare, 'p99': bare, 'n': 200},
    }
    return next(row for row in results.rows(measured) if row.anchor)


def test_row_compares_with_the_anchor_of_its_run() -> None:
    row = row_of(0.003, 0.002)
    assert row.figures == {'p50': 3.0, 'p99': 6.0}
    assert row.ratio == {'p50': 1.5, 'p99': 3.0}
    assert (row.n, row.lost, row.is_met()) == (200, 1, False)
    assert row_of(0.001, 0.002).is_met()


def test_row_whose_anchor_was_not_measured_is_left_out() -> None:
    assert results.rows({'three estop': {'p50': 1.0, 'n': 1}}) == []


@pytest.mark.parametrize(
    ('now', 'worse'),
    [
        (row_of(0.030, 0.020), []),  # a ratio, and no time
        (row_of(0.003 * 1.2, 0.002), []),
        (row_of(0.003 * 1.3, 0.002), ['p50', 'p99']),
        (row_of(0.030, 0.002, n=20), ['p50']),  # a p99 of few values is not compared
    ],
)
def test_worse_is_a_ratio_of_enough_values(now: results.Row, worse: list[str]) -> None:
    told = results.worse([row_of(0.003, 0.002)], [now])
    assert len(told) == len(worse)
    assert all(name in text for name, text in zip(worse, told, strict=True))


def test_count_that_was_reached_and_is_not_is_worse() -> None:
    name = 'three in motion, load, rt'
    before, now = (results.rows({name: {'stops': stops, 'n': 10}}) for stops in (0, 1))
    assert results.worse(before, before) == []
    assert len(results.worse(before, now)) == 1


def test_rows_measured_anew_replace_theirs_only() -> None:
    old, new = row_of(0.003, 0.002), row_of(0.004, 0.002)
    other = replace(old, name='another')
    assert results.merged([other, old], [new]) == [new, other]


def test_table_of_the_page_is_that_of_the_results() -> None:
    found: dict[str, Any] = results.load()
    page = results.PAGE.read_text(encoding='utf-8')
    assert found['rows'], 'run make bench'
    table = results.table(found['machine'], found['rows'])
    assert with_table(page, table, results.BEGIN, results.END) == page, 'run make bench'


# What a campaign accepts.

GOOD = Trial(stopped=0.01, last='mmSSS', gap=0.011, told=0.05, back=True)
FAULTS = {
    kind: Fault(kind, kind, lambda subject: None) for kind in ('dead', 'hung', 'wire', 'quiet')
}


@pytest.mark.parametrize('fault', FAULTS.values(), ids=FAULTS)
def test_trial_that_shows_what_it_should_holds(fault: Fault) -> None:
    assert campaign.holds(GOOD, fault, 0.01)


@pytest.mark.parametrize(
    ('kind', 'change'),
    [
        ('dead', {'stopped': 0.03}),
        ('dead', {'stopped': None}),
        ('dead', {'last': 'mmSSm'}),
        ('dead', {'left': 1}),
        ('hung', {'stopped': 0.12}),
        ('hung', {'gap': 0.05}),
        ('quiet', {'gap': 0.05}),
        ('wire', {'told': 0.11}),
        ('wire', {'told': None}),
        ('wire', {'left': 1}),
        *((kind, {'moved': 1}) for kind in FAULTS),
        *((kind, {'back': False}) for kind in FAULTS),
    ],
)
def test_trial_that_lacks_one_thing_does_not(kind: str, change: dict[str, Any]) -> None:
    assert not campaign.holds(replace(GOOD, **change), FAULTS[kind], 0.01)


def test_row_tells_the_worst() -> None:
    trials = [GOOD, replace(GOOD, stopped=0.04)]
    cells = campaign.row('drive', FAULTS['hung'], trials).split(' | ')
    assert cells[3] == '40'
    assert '| never |' in campaign.row('drive', FAULTS['hung'], [replace(GOOD, stopped=None)])
