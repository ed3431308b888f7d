# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whose an external link error of the VM-110 is: its own, or that of VRPO which were withheld."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from vm110_bridge.protocol import BuState, LinkStatus, PeriodicInput, RuState
from vm110_bridge.session.stops import ECHO_DELAY, LEAST_SILENCE, OBEY_TIME, StopJudge

START, STEP = 100.0, 0.0625  # s; a step is exact in binary
ARMED = PeriodicInput(
    bu_state=BuState.ARMED,
    eg_link=LinkStatus.OPERATIONAL,
    ec_link=LinkStatus.OPERATIONAL,
    armed_ru=5,
    ru_state=RuState.ENABLED,
)
ERROR = PeriodicInput(
    bu_state=BuState.EXTERNAL_LINK_ERROR,
    eg_link=LinkStatus.NO_LINK,
    ec_link=LinkStatus.OPERATIONAL,
)


@pytest.fixture
def judge() -> StopJudge:
    """Judge a base unit in motion that has just got a VRPO, long after the first."""
    result = StopJudge(START)
    for count in range(11):
        result.output_sent(START + count)
    result.take(ARMED, START + 10.0)
    assert not result.verdict().estop
    return result


NOW = START + 10.0


def is_own(judge: StopJudge, now: float) -> bool:
    """Hear of the error; tell whether it counts as the unit's own stop."""
    judge.take(ERROR, now)
    assert judge.verdict().estop
    return judge.verdict().own_estop


def says(judge: StopJudge) -> str:
    return '; '.join(judge.verdict().reasons)


@pytest.mark.parametrize(
    ('seconds', 'own'), [(LEAST_SILENCE, False), (LEAST_SILENCE - STEP, True)]
)
def test_error_is_ours_once_output_was_withheld_for_long(
    judge: StopJudge, seconds: float, own: bool
) -> None:
    judge.hold(True, NOW)
    assert is_own(judge, NOW + seconds) == own


@pytest.mark.parametrize(('seconds', 'own'), [(ECHO_DELAY - STEP, False), (ECHO_DELAY, True)])
@pytest.mark.parametrize('again', [False, True])
def test_error_is_ours_for_a_moment_after_the_hold(
    judge: StopJudge, seconds: float, own: bool, again: bool
) -> None:
    judge.hold(True, NOW)
    judge.hold(False, NOW + LEAST_SILENCE)
    if again:  # what repeats that nothing is held
        judge.hold(False, NOW + LEAST_SILENCE + STEP)
    judge.output_sent(NOW + LEAST_SILENCE)
    assert is_own(judge, NOW + LEAST_SILENCE + seconds) == own


def test_unit_that_stays_armed_without_output_does_not_obey(judge: StopJudge) -> None:
    def disobeys(vrpi: PeriodicInput, seconds: float) -> bool:
        judge.take(vrpi, NOW + seconds)
        return judge.is_disobeyed

    assert not disobeys(ARMED, OBEY_TIME)  # nothing is asked of it
    judge.hold(True, NOW + OBEY_TIME)  # VRPO went out last at NOW
    assert judge.is_disobeyed
    judge.output_sent(NOW + OBEY_TIME)
    assert not disobeys(ARMED, 2.0 * OBEY_TIME - STEP)  # nor is it known while it is silent
    assert disobeys(ARMED, 2.0 * OBEY_TIME)
    # It watches its output while it is armed.
    assert not disobeys(replace(ARMED, bu_state=BuState.DISARMED), 2.0 * OBEY_TIME)
    assert not disobeys(ARMED, 2.0 * OBEY_TIME)
    assert not disobeys(ARMED, 3.0 * OBEY_TIME - STEP)
    assert disobeys(ARMED, 3.0 * OBEY_TIME)
    judge.hold(False, NOW + 3.0 * OBEY_TIME)
    assert not judge.is_disobeyed


def test_short_hold_explains_no_error(judge: StopJudge) -> None:
    judge.hold(True, NOW)
    judge.hold(False, NOW + 0.5)
    assert is_own(judge, NOW + 0.5 + STEP)


def test_error_without_a_hold_is_its_own() -> None:
    judge = StopJudge(START)
    assert judge.verdict().own_estop  # nothing was heard yet
    assert is_own(judge, START + 10.0)


def resumed(judge: StopJudge) -> float:
    """Let the VRPO flow again after they were missing; return when."""
    judge.output_sent(NOW + LEAST_SILENCE)
    return NOW + LEAST_SILENCE


@pytest.mark.parametrize(
    ('moment', 'missed'),
    [
        (lambda judge: NOW + LEAST_SILENCE, True),
        (lambda judge: NOW + LEAST_SILENCE - STEP, False),
        (lambda judge: resumed(judge) + ECHO_DELAY - STEP, True),
        (lambda judge: resumed(judge) + ECHO_DELAY, False),
    ],
)
def test_error_after_output_was_missing_says_so(
    judge: StopJudge, moment: Callable[[StopJudge], float], missed: bool
) -> None:
    assert is_own(judge, moment(judge))
    assert ('VRPO were missing' in says(judge)) == missed
    assert ('EG-Link No link, EC-Link Operational' in says(judge)) == (not missed)


def test_missing_output_does_not_explain_a_fault_of_the_link_itself(judge: StopJudge) -> None:
    judge.take(replace(ERROR, eg_link=LinkStatus.INTERFACE_ERROR), NOW + 10.0)
    assert 'VRPO were missing' not in says(judge)


@pytest.mark.parametrize('is_started', [True, False])
def test_overtaken_error_is_its_own_where_no_error_stands(
    judge: StopJudge, is_started: bool
) -> None:
    if is_started:
        judge.hold(True, NOW)
        assert not is_own(judge, NOW + LEAST_SILENCE)
        judge.take(ARMED, NOW + 2.0)
    else:
        judge = StopJudge(START)
        judge.take(ARMED, START)
    judge.take_late(ERROR)
    assert judge.verdict().own_estop
    assert 'VRPO were missing' not in says(judge)


def test_overtaken_stop_is_its_own_amid_an_error_of_ours(judge: StopJudge) -> None:
    judge.hold(True, NOW)
    assert not is_own(judge, NOW + LEAST_SILENCE)
    judge.take_late(replace(ERROR, bu_state=BuState.STOPPED))
    assert judge.verdict().own_estop
