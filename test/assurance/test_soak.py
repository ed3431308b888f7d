# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The soak's judgement, on made-up facts: pacing, growth, wrong decisions and false stops."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math
import os
import signal
import time

import pytest

from assurance.benchmarks.rig import children, title
from assurance.pauses import lost, Pause, Pauses
from assurance.soak import growth, Held, moved, Pace, PERIODS, rested, Result
from stage.rig import holds_for, wait_for


def no_pause(begin: float, end: float) -> float:
    return 0.0


def good(*, busy: bool = False) -> Result:
    """Return what a sound run would show."""
    result = Result(busy, seconds=60.0, reactions={'e-stop': [0.01, 0.02]})
    for pace in result.paces.values():
        pace.add((n * pace.period for n in range(100)), no_pause)
    result.held = {'the stack': [Held(90.0, 20, 30)] * 8}
    return result


def drift(result: Result) -> None:
    result.paces["the SSC's pulses"].add((n * 0.0225 for n in range(10_000)), no_pause)


def come_late(result: Result) -> None:
    result.paces["the VSC's host heartbeats"].add((0.0, 0.11, 0.12, 0.15), no_pause)


def come_never(result: Result) -> None:
    result.paces["the VM-110's VRPO"] = Pace(*PERIODS["the VM-110's VRPO"])


def grow(*more: float) -> Callable[[Result], None]:
    def spoil(result: Result) -> None:
        result.held['the stack'][-2:] = [
            Held(90.0 + more[0], 20 + int(more[1]), 30 + int(more[2]))
        ] * 2

    return spoil


def stop_by_itself(result: Result) -> None:
    result.false["e-stop source 'fort' stale: "] = 2


def lose_the_way(result: Result) -> None:
    result.lost.append('READY')


@pytest.mark.parametrize(
    ('spoil', 'word'),
    [
        (drift, 'drift by 2.4'),
        (come_late, 'late 1 times, 110 ms'),
        (come_never, 'VRPO drift'),
        (grow(2.5, 0, 0), 'grows: 2.5 MB'),
        (grow(0, 1, 0), '1 threads'),
        (grow(0, 0, 1), '1 descriptors'),
        (stop_by_itself, "2 false stops: e-stop source 'fort' stale"),
        (lose_the_way, 'not back in motion'),
    ],
)
def test_fault_is_named_and_with_busy_cores_shown_only(
    spoil: Callable[[Result], None], word: str
) -> None:
    result, busy = good(), good(busy=True)
    assert not result.failures()
    for each in (result, busy):
        spoil(each)
    (failure,) = result.failures()
    assert word in failure
    assert not busy.failures()


def test_stop_by_a_pause_is_shown_only() -> None:
    result = good()
    result.paused["e-stop source 'fort' stale: "] = 2
    assert not result.failures()
    assert "by a pause, 2 times: e-stop source 'fort' stale" in result.table()


def test_wrong_decision_fails_on_any_machine() -> None:
    for result in (good(), good(busy=True)):
        result.wrong.append('~/trip: the drive moves')
        assert result.failures() == ['wrong: ~/trip: the drive moves']


@pytest.mark.parametrize(
    ('frames', 'rest'),
    [
        ([(0.9, True), (1.1, True), (1.2, False), (1.3, True)], 1.2),
        (
            [(0.9, True), (0.95, False), (1.1, False), (1.2, True), (1.24, False), (1.26, False)],
            1.26,
        ),
        ([(1.1, False), (1.3, False)], 1.3),
        ([(0.9, True), (1.1, True)], 1.0),
        ([], 1.25),
    ],
    ids=['moving', 'at rest before', 'silent before', 'never at rest', 'silent'],
)
def test_rest_in_a_stop_is_the_first_frame_that_shows_it(
    frames: list[tuple[float, bool]], rest: float
) -> None:
    assert rested(frames, 1.0) == rest


def test_only_what_moves_after_a_stop_is_wrong() -> None:
    frames = [(0.9, True), (1.0, False), (1.5, False)]
    assert moved('the drive', frames, 1.0) == []
    assert moved('the drive', [*frames, (1.7, True), (1.8, True)], 1.0) == [
        'the drive moves 0.70 s after it was stopped'
    ]


@pytest.mark.parametrize(
    ('late', 'stretches', 'counts'),
    [
        (0.2, [(1.0, 1.1, 1.2), (60.0, 60.1)], (3, 0, 0)),
        (0.5, [(1.0, 1.3, 1.9)], (2, 2, 1)),
    ],
    ids=['between stretches of motion', 'over two periods, and late'],
)
def test_gaps_between_frames_are_counted(
    late: float, stretches: list[tuple[float, ...]], counts: tuple[int, ...]
) -> None:
    pace = Pace(0.1, late)
    assert pace.drift == math.inf
    for times in stretches:
        pace.add(times, no_pause)
    assert (pace.gaps, pace.over, pace.late) == counts


def test_late_frame_is_the_machines_if_its_pause_is_what_made_it_late() -> None:
    pace = Pace(0.1, 0.2)
    pauses = [Pause(1.05, 1.2), Pause(2.15, 2.2)]
    pace.add((1.0, 1.3), partial(lost, pauses))
    pace.add((2.0, 2.3), partial(lost, pauses))
    assert (pace.gaps, pace.over, pace.paused, pace.late) == (2, 2, 1, 1)


def test_of_a_pause_counts_what_is_within_the_time() -> None:
    pauses = [Pause(1.0, 1.2), Pause(1.4, 1.7), Pause(2.0, 2.1)]
    assert lost(pauses, 1.1, 1.5) == pytest.approx(0.2)
    assert lost(pauses, 1.2, 1.4) == 0.0


def test_pulse_that_gets_no_time_tells_of_a_pause() -> None:
    others = {*children(os.getpid())}
    begin = time.monotonic()
    with Pauses() as pauses:
        pulse, *_ = {*children(os.getpid())} - others

        def is_told() -> bool:
            os.kill(pulse, signal.SIGSTOP)
            holds_for(lambda: True, 0.05)
            os.kill(pulse, signal.SIGCONT)
            return pauses.between(begin, time.monotonic()) > 0.04

        wait_for(is_told)
    assert title(pulse) == ''


def test_growth_is_between_first_and_last_and_no_single_peak() -> None:
    samples = [Held(10.0, 2, 5)] * 4 + [Held(90.0, 9, 9)] + [Held(10.5, 2, 6)] * 4
    assert growth(samples) == Held(0.5, 0, 1)
    assert growth(samples[:1]) == Held(0.0, 0, 0)
