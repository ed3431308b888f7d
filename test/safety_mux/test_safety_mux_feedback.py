# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measured speeds at the very limits, and in any order."""

import math

from hypothesis import given, strategies as st
import pytest

from safety_mux.feedback import FeedbackInput
from safety_mux.settings import Feedback

speeds = st.sampled_from([0.0, 0.05, 0.3, 0.7, 3.0])
steps = st.tuples(
    st.sampled_from([0.0, 0.01, 0.1, 0.3]), st.none() | speeds, speeds, st.booleans()
)


@given(st.lists(steps, max_size=40))
def test_a_fault_has_its_time_and_lasts_until_the_joints_stand(
    story: list[tuple[float, float | None, float, bool]],
) -> None:
    feedback, now = FeedbackInput(Feedback(('left',), 0.25, 0.1, 0.5, 0.2), 0.5), 10.0
    heard, speed, told, at_zero = -math.inf, math.inf, math.inf, False
    for dt, measured, commanded, ends in story:
        now += dt
        if measured is not None:
            feedback.measured((measured,), now)
            heard, speed, at_zero = now, measured, True
        if ends:
            feedback.told_to_stand(now)
            if told == math.inf:  # told again meanwhile they have no more time
                told, speed = now, math.inf  # what was measured before says nothing of it
        had = feedback.fault
        feedback.judge((commanded,), now)
        fresh = now < heard + 0.25
        at_zero &= not commanded
        if fresh and at_zero and speed <= 0.1:
            assert feedback.fault is None
            told = math.inf
            continue
        assert not (had and feedback.fault is None), 'it ended in motion'
        if feedback.fault and not had:
            late = now - told >= 0.5
            assert late or (fresh and speed > commanded + 0.5), 'no reason'
        if now - told >= 0.5:
            assert feedback.fault, 'not seen to stand'
            told = math.inf


# At the limits themselves. Sums of these times are exact.


@pytest.fixture
def feedback() -> FeedbackInput:
    config = Feedback(
        ('left', 'right'), standstill=0.125, overspeed_tolerance=0.5, overspeed_time=0.25
    )
    return FeedbackInput(config, stop_time=0.5)


def test_joints_stand_up_to_standstill_while_they_are_heard(feedback: FeedbackInput) -> None:
    feedback.measured((0.125, -0.125), 0.0)
    assert (feedback.use, feedback.standing(0.0)) == ('standing', True)
    assert not feedback.standing(0.25)
    assert feedback.left(0.25).startswith('the feedback is stale')
    feedback.told_to_stand(0.0)
    assert feedback.left(0.0) == 'not measured since'
    assert feedback.left(0.25).startswith('the feedback is stale')
    feedback.measured((0.0, -0.126), 0.25)
    assert (feedback.use, feedback.standing(0.25)) == ('moving', False)


@pytest.mark.parametrize('commanded', [(0.0, 0.25), (0.25, 0.0)])
def test_joints_that_are_commanded_do_not_stand_however_slow_they_were(
    feedback: FeedbackInput, commanded: tuple[float, float]
) -> None:
    feedback.measured((0.125, 0.0), 0.0)
    feedback.judge((0.0, 0.0), 0.0)
    assert (feedback.standing(0.0), feedback.left(0.0)) == (True, 'left at 0.1 rad/s')
    feedback.judge(commanded, 0.0)
    assert (feedback.standing(0.0), feedback.left(0.0)) == (False, 'not measured since')
    feedback.measured((0.125, 0.0), 0.125)
    feedback.judge((0.0, 0.0), 0.125)
    assert feedback.standing(0.125)


def test_joint_that_stood_meanwhile_has_its_overspeed_time_anew(feedback: FeedbackInput) -> None:
    for now, speed in ((0.0, 1.0), (0.125, 0.0), (0.25, 1.0)):
        feedback.measured((speed, 0.0), now)
        feedback.judge((0.0, 0.0), now)
    assert feedback.fault is None


def test_joints_are_awaited_for_stop_time(feedback: FeedbackInput) -> None:
    feedback.told_to_stand(0.0)
    for now in (0.0, 0.25, 0.5 - 1 / 64):
        feedback.judge((0.0, 0.0), now)
        assert (feedback.fault, feedback.awaited) == (None, True)
    feedback.judge((0.0, 0.0), 0.5)
    assert feedback.fault is not None
    assert not feedback.awaited, 'now it is a fault'


@pytest.mark.parametrize(
    ('asked', 'slow', 'fast'),
    [(1.0, 1.5, 1.53), (1.0, -0.5, -0.53), (0.0, 0.625, 0.64), (0.0, -0.625, -0.64)],
)
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_joint_is_too_fast_beyond_the_tolerance(
    feedback: FeedbackInput, asked: float, slow: float, fast: float, sign: float
) -> None:
    for speed in (slow, fast):
        for now in (0.0, 0.25):
            assert feedback.fault is None
            feedback.measured((0.0, sign * speed), now)
            feedback.judge((0.0, sign * asked), now)
    assert feedback.fault is not None


@pytest.mark.parametrize('pause', ['slow', 'standing', 'silent'])
def test_joint_is_too_fast_for_overspeed_time_without_a_pause(
    feedback: FeedbackInput, pause: str
) -> None:
    def judge(speed: float, now: float) -> bool:
        feedback.measured((speed, 0.0), now)
        feedback.judge((0.25, 0.0), now)
        return feedback.fault is not None

    start = 0.25
    assert not judge(1.0, 0.0)
    if pause == 'silent':
        feedback.judge((0.25, 0.0), start)
    else:
        judge({'slow': 0.25, 'standing': 0.0}[pause], start)
    assert not judge(1.0, start)
    assert not judge(1.0, start + 0.25 - 1 / 64)
    assert judge(1.0, start + 0.25)


def test_clock_that_runs_backwards_gives_a_fast_joint_no_more_time(
    feedback: FeedbackInput,
) -> None:
    for now in (10.0, 9.0):
        feedback.measured((1.0, 0.0), now)
        feedback.judge((0.0, 0.0), now)
    assert feedback.fault is not None
