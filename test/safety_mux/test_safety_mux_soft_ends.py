# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Soft ends: slower before them, no further, back free; whatever is asked for."""

import math

from hypothesis import given, strategies as st
import pytest

from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.soft_ends import EndedLimiter, SoftEnds

MOST, SLOWING = 2.0, 2.0
ENDS = SoftEnds(-1.0, 5.0, MOST**2 / SLOWING, MOST)
STEP, LATE = 0.01, 3  # s; messages by which a position is old


def limiter() -> EndedLimiter:
    limit = JointLimit(MOST, 100.0, SLOWING)
    return EndedLimiter(JointLimiter([limit, limit]), {1: ENDS}, ['wheel', 'mast'])


@pytest.mark.parametrize(
    ('speed', 'position', 'left'),
    [
        (2.0, 2.0, 2.0),
        (9.0, 2.0, 2.0),
        (2.0, 4.0, 1.0),
        (0.5, 4.0, 0.5),  # slow enough already
        (2.0, 5.0, 0.0),
        (2.0, 9.0, 0.0),
        (-2.0, 5.0, -2.0),  # back
        (-2.0, 9.0, -2.0),
        (-2.0, 0.0, -1.0),
        (-2.0, -1.0, 0.0),
        (2.0, -9.0, 2.0),
        (0.0, 5.0, 0.0),
    ],
)
def test_end_takes_what_goes_towards_it(speed: float, position: float, left: float) -> None:
    assert ENDS.limited(speed, position) == pytest.approx(left)
    assert math.copysign(1.0, ENDS.limited(speed, position)) == 1.0 or left < 0.0, 'no -0.0'


def test_joint_without_a_position_waits_and_others_do_not() -> None:
    ended = limiter()
    assert ended.step((1.0, 1.0), 0.1) == (1.0, 0.0)
    assert ended.words == []
    ended.hear([4.5])
    assert ended.step((1.0, 2.0), 0.1) == ended.output == (1.0, 0.5)
    assert ended.words == ["joint 'mast' is at 4.5 rad, near its end: 25 % of its speed"]
    ended.hear([5.0])
    ended.step((1.0, 1.0), 0.1)
    assert ended.words == ["joint 'mast' is at 5 rad, near its end: only back"]
    ended.step((1.0, -1.0), 0.1)
    assert ended.words == []


def test_ramp_and_reset_are_those_of_the_limiter() -> None:
    ended = limiter()
    ended.hear([4.5])
    ended.step((1.0, 2.0), 0.1)
    assert ended.ramp(0.1, 0.5) == pytest.approx((0.8, 0.3))
    ended.step((1.0, 2.0), 0.1)
    ended.reset()
    assert (ended.output, ended.words) == ((0.0, 0.0), [])


@pytest.mark.parametrize('target', [math.nan, math.inf, -math.inf])
def test_senseless_target_is_zero(target: float) -> None:
    ended = limiter()
    ended.hear([2.0])
    assert ended.step((1.0, target), 0.1) == (1.0, 0.0)


def test_speed_limit_counts_before_the_end_does() -> None:
    ended = limiter()
    ended.hear([4.0])
    assert ended.step((0.0, 2.0), 0.1, 0.5)[1] == pytest.approx(1.0)
    assert ended.words == [], 'it is slow enough by the limit'
    ended.hear([4.75])
    assert ended.step((0.0, 2.0), 1.0, 0.5)[1] == pytest.approx(0.8)  # on its way
    assert ended.step((0.0, 2.0), 1.0, 0.5)[1] == pytest.approx(0.6)
    for _ in range(9):
        ended.step((0.0, 2.0), 1.0, 0.5)
    assert ended.output[1] == pytest.approx(0.25)
    assert ended.step((0.0, 2.0), 0.1, 0.0)[1] == pytest.approx(0.05)


@given(
    st.floats(-1.0, 5.0),
    st.lists(st.tuples(st.floats(-5.0, 5.0), st.integers(1, 100)), max_size=20),
)
def test_nothing_drives_a_joint_beyond_its_ends(
    start: float, asked: list[tuple[float, int]]
) -> None:
    """By as much as it turns while a position is on its way, and one step of a decision."""
    ended, position = limiter(), start
    before = [start] * LATE
    for target, times in asked:
        for _ in range(times):
            ended.hear([before[0]])
            _, speed = ended.step((0.0, target), STEP)
            position += speed * STEP
            before = [*before[1:], position]
            margin = MOST * STEP * (LATE + 1)
            assert ENDS.least - margin <= position <= ENDS.most + margin


@pytest.mark.parametrize(
    ('given_values', 'words'),
    [
        ((1.0, 1.0, 1.0, 1.0), 'must be below'),
        ((1.0, math.inf, 1.0, 1.0), 'must be below'),
        ((math.nan, 1.0, 1.0, 1.0), 'must be below'),
        ((-math.inf, 1.0, 1.0, 1.0), 'must be below'),
        ((0.0, 1.0, 0.0, 1.0), 'slow_zone'),
        ((0.0, 1.0, math.inf, 1.0), 'slow_zone'),
    ],
)
def test_senseless_ends_are_refused(given_values: tuple[float, ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        SoftEnds(*given_values)
