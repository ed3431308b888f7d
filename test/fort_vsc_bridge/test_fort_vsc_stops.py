# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whose a stop of the VSC is: its own, or the echo of the one that our heartbeats ask for."""

from __future__ import annotations

import pytest

from fort_vsc_bridge.protocol import AutonomyMode, EStopBits, Heartbeat, Mode
from fort_vsc_bridge.session.stops import ECHO_DELAY, StopJudge

SOON = ECHO_DELAY / 2
TRANSITION = 2.0


@pytest.fixture
def judge() -> StopJudge:
    return StopJudge(TRANSITION)


def clear(judge: StopJudge, now: float) -> None:
    """Hear that the USER bit is clear."""
    heartbeat = Heartbeat(Mode.OPERATIONAL, AutonomyMode.USER_CONTROL, 0)
    judge.heard(heartbeat, now)
    assert not judge.judge(heartbeat, now).estop


def is_own(judge: StopJudge, now: float) -> bool:
    """Hear that it is set; tell whether that counts as the VSC's own stop."""
    heartbeat = Heartbeat(Mode.LOCAL, AutonomyMode.USER_CONTROL, EStopBits.USER)
    judge.heard(heartbeat, now)
    verdict = judge.judge(heartbeat, now)
    assert verdict.estop
    return verdict.own_estop


def test_echo_that_was_heard_once_ends_no_later_one_before_it_is_heard(judge: StopJudge) -> None:
    judge.asked('let go', 1.0)
    assert not is_own(judge, 1.1)
    judge.asked('', 2.0)
    clear(judge, 2.1)
    judge.asked('let go', 3.0)
    judge.asked('', 3.1)
    clear(judge, 3.2)  # the VSC has not taken the second one yet
    assert not is_own(judge, 3.1 + SOON)


def test_bit_that_stood_before_we_asked_is_ours_until_it_is_seen_clear(judge: StopJudge) -> None:
    assert is_own(judge, 1.0)
    judge.asked('let go', 2.0)
    assert not is_own(judge, 2.0 + SOON)
    judge.asked('', 3.0)
    assert not is_own(judge, 3.0 + 9 * ECHO_DELAY)
    clear(judge, 20.0)
    assert is_own(judge, 20.1)


def test_bit_that_was_seen_clear_is_ours_as_soon_as_we_ask(judge: StopJudge) -> None:
    assert is_own(judge, 1.0)
    clear(judge, 2.0)
    judge.asked('let go', 3.0)
    assert not is_own(judge, 3.1)


def test_echo_stays_ours_until_it_is_seen_clear(judge: StopJudge) -> None:
    judge.asked('let go', 1.0)
    assert not is_own(judge, 1.1)
    judge.asked('', 2.0)
    assert not is_own(judge, 2.0 + 9 * ECHO_DELAY)
    clear(judge, 20.0)
    assert is_own(judge, 20.1)


@pytest.mark.parametrize('texts', [('let go',), ('let go', 'press the button')])
def test_bit_after_an_echo_that_ended_is_its_own(judge: StopJudge, texts: tuple[str, ...]) -> None:
    judge.asked(texts[0], 1.0)
    assert not is_own(judge, 1.1)
    judge.asked(texts[-1], 1.2)
    judge.asked('', 2.0)
    clear(judge, 2.0 + SOON / 2)
    assert is_own(judge, 2.0 + SOON)


def test_echo_that_was_not_heard_yet_may_come_for_a_while(judge: StopJudge) -> None:
    for start in (1.0, 10.0):  # the second time, an earlier echo was heard
        judge.asked('let go', start)
        judge.asked('', start + 0.1)
        clear(judge, start + 0.1 + SOON / 2)
        assert not is_own(judge, start + 0.1 + SOON)
        clear(judge, start + 5.0)
        assert is_own(judge, start + 5.1)
        clear(judge, start + 5.2)


def test_echo_that_never_came_is_waited_for_no_longer(judge: StopJudge) -> None:
    judge.asked('let go', 1.0)
    judge.asked('', 1.1)
    clear(judge, 1.1 + ECHO_DELAY)
    assert is_own(judge, 1.2 + ECHO_DELAY)


def test_vsc_has_a_second_to_stop_from_when_it_was_asked(judge: StopJudge) -> None:
    """The VSC's page promises that second."""
    judge.asked('let go', 1.0)
    clear(judge, 2.0 - 1 / 64)
    assert not judge.awaits_stop
    clear(judge, 2.0)
    assert judge.awaits_stop
    judge.asked('let go', 2.0)
    assert judge.awaits_stop, 'asked on'
    judge.asked('', 2.0)
    assert not judge.awaits_stop
