# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Soft ends: slower before them, no further, back free; whatever is asked for."""

from collections.abc import Callable
import contextlib
import math

from hypothesis import given, settings, strategies as st
import pytest

from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import MalformedInput, State
from safety_mux.soft_ends import EndedLimiter, SoftEnds
from stage.fed_mux import LIMIT, StepMux
from stage.mux_talkers import sticks

MOST, SLOWING = 2.0, 2.0
ENDS = SoftEnds(-1.0, 5.0, MOST**2 / SLOWING, MOST)
STEP, LATE = 0.01, 3  # s; messages by which a position is old


def limiter(way: float = 1.0) -> EndedLimiter:
    """Return a limiter. :param way: -1: its mast turns the other way round."""
    limit = JointLimit(MOST, 100.0, SLOWING)
    least, most = sorted((way * ENDS.least, way * ENDS.most))
    ends = SoftEnds(least, most, ENDS.slow_zone, MOST)
    return EndedLimiter(JointLimiter([limit, limit]), {1: ends}, ['wheel', 'mast'])


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


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_demand_beyond_the_limit_is_reduced_with_its_group_and_no_end_is_blamed(
    sign: float,
) -> None:
    ended = limiter(sign)
    ended.hear([sign * 2.0])
    assert ended.step((2.0, sign * 4.0), 0.1) == (1.0, sign * 2.0)
    assert ended.words == []
    ended.reset()
    ended.hear([sign * 4.0])
    assert ended.step((2.0, sign * 4.0), 0.1) == (2.0, sign)
    assert '50 % of its speed' in ended.words[0]


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('dt', [math.nan, math.inf, -math.inf, -1.0])
def test_senseless_time_takes_no_joint_from_its_end(dt: float, sign: float) -> None:
    ended = limiter(sign)
    ended.hear([sign * 5.0])
    ended.step((0.0, sign), dt)
    assert ended.step((0.0, sign), 0.1) == (0.0, 0.0)


def test_ramp_and_reset_are_those_of_the_limiter() -> None:
    ended = limiter()
    ended.hear([4.5])
    ended.step((1.0, 2.0), 0.1)
    assert ended.ramp(0.1, 0.5) == pytest.approx((0.8, 0.3))
    ended.step((1.0, 2.0), 0.1)
    ended.reset()
    assert (ended.output, ended.words) == ((0.0, 0.0), [])


def test_no_end_takes_nothing() -> None:
    ended = EndedLimiter(JointLimiter([JointLimit(MOST, 100.0, SLOWING)]), {}, ['wheel'])
    assert ended.step((2.0,), 0.1, 0.5) == (1.0,)
    assert ended.words == []


@pytest.mark.parametrize('target', [math.nan, math.inf, -math.inf])
def test_senseless_target_is_zero(target: float) -> None:
    ended = limiter()
    ended.hear([4.5])
    assert ended.step((1.0, target), 0.1) == (1.0, 0.0)
    assert ended.words == []


def test_speed_limit_counts_before_the_end_does() -> None:
    ended = limiter()
    ended.hear([4.0])
    assert ended.step((0.0, 2.0), 0.1, 0.5)[1] == pytest.approx(1.0)
    assert ended.words == [], 'it is slow enough by the limit'
    ended.hear([4.75])
    assert ended.step((0.0, 2.0), 0.1, 0.5)[1] == pytest.approx(0.8)  # on its way
    for _ in range(9):
        ended.trust()
        ended.step((0.0, 2.0), 0.1, 0.5)
    assert ended.output[1] == pytest.approx(0.25)
    assert ended.step((0.0, 2.0), 0.1, 0.0)[1] == pytest.approx(0.05)


def at_speed(speed: float, position: float, way: float = 1.0) -> EndedLimiter:
    """Return a limiter with the mast in motion there."""
    ended = limiter(way)
    ended.hear([position])
    assert ended.step((0.0, speed), 0.1)[1] == speed
    ended.hear([position])
    return ended


@pytest.mark.parametrize('way', [1.0, -1.0])
def test_joint_that_is_not_heard_counts_as_moved_and_is_not_freed_by_the_way_back(
    way: float,
) -> None:
    ended = at_speed(way * 2.0, way * 2.0, way)

    def after(steps: int, target: float) -> float:
        for _ in range(steps):
            ended.step((0.0, way * target), 0.1)
        return way * ended.output[1]

    assert 1.0 < after(9, 2.0) < 1.7, 'as if it were at 3.6 rad by now'
    assert after(90, 2.0) == pytest.approx(0.0, abs=1e-3), 'as if it were at the end'
    assert after(20, -1.0) == pytest.approx(-1.0)
    assert after(20, 2.0) == pytest.approx(0.0, abs=1e-3), 'it may not have gone back'


@pytest.mark.parametrize('starts', [1, 50])
def test_position_that_stays_the_same_lets_a_joint_go_no_further_than_its_way(starts: int) -> None:
    ended, position = limiter(), 2.0
    ended.hear([2.0])
    for n in range(5000):
        if n % (5000 // starts) == 0:
            ended.reset()  # he lets go of his deadman, and presses it again
        position += ended.step((1.0, MOST), STEP)[1] * STEP
        ended.hear([2.0])
        assert position <= ENDS.most + 1e-9
    assert position > 4.9
    (words,) = ended.words
    assert "'mast' is at 2 to 5 rad, near its end: " in words
    ended.trust()  # he resets: maybe it stood all the time
    assert ended.step((1.0, MOST), STEP)[1] > 0.0


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('ramps', [True, False])
def test_output_beyond_an_end_is_zero_at_once_and_back_is_not(sign: float, ramps: bool) -> None:
    end = 5.0 if sign > 0.0 else -1.0

    def on(ended: EndedLimiter) -> float:
        if ramps:
            return ended.ramp(0.01, 0.5)[1]
        return ended.step((1.0, sign * 2.0), 0.01)[1]

    outwards, back = at_speed(sign * 0.5, end - sign * 0.6), at_speed(-sign, end - sign * 0.6)
    for ended in (outwards, back):
        ended.step((1.0, ended.output[1]), 0.01)
        ended.hear([end + sign * 0.01])
        (wheel, _), mast = ended.output, on(ended)
        assert mast == 0.0 if ended is outwards else mast * sign < -0.9
        assert ended.output[0] > 0.5 * wheel, 'others go on'


@pytest.mark.parametrize('share', [0.3, 1.0, 1.1])
def test_joint_that_moves_by_a_share_of_what_it_is_told_reaches_its_ends(share: float) -> None:
    ended, position = limiter(), 2.0
    for target, end in ((2.0, 5.0), (-2.0, -1.0), (0.2, 5.0)):
        for _ in range(12000):
            ended.hear([position])
            position += share * ended.step((0.0, target), STEP)[1] * STEP
        assert position == pytest.approx(end, abs=0.01)


def test_place_is_a_range_once_it_may_be_far_from_where_it_was_heard() -> None:
    ended = limiter()
    ended.hear([3.5])
    for steps, where in ((80, 'is at 3.5 rad'), (40, 'is at 3.5 to 4.5')):
        for _ in range(steps):
            ended.step((0.0, 2.0), STEP)
        assert where in ended.words[0]


FAULTS: dict[str, Callable[[float], float]] = {
    'sign': lambda p: -p,
    'wrap': lambda p: math.remainder(p, 3.0),
    'degrees': math.degrees,
    'jump in': lambda p: p - 3.5 if p > 4.0 else p,
    'jump out': lambda p: p + 3.5 if p > 4.0 else p,
    'turns the other way in the zone': lambda p: 8.0 - p if p > 4.0 else p,
    'goes further than it says': lambda p: 1.4 + (p - 1.4) / math.tau,
    'sticks, but for its noise': lambda p: min(p, 1.5) + 1e-3 * math.sin(1e3 * p),
}


@pytest.mark.parametrize('way', [1.0, -1.0])
@pytest.mark.parametrize('fault', FAULTS)
@pytest.mark.parametrize(
    ('speed', 'start'), [(0.1, 1.4), (0.7, -1.0), (0.7, 0.0), (2.0, -1.0), (2.0, 1.4)]
)
def test_joint_does_not_go_far_beyond_an_end_on_positions_that_go_wrong(
    way: float, fault: str, speed: float, start: float
) -> None:
    """By half a zone at most, until it is noticed; the same the other way round."""
    ended, position, seen = limiter(way), start, FAULTS[fault]
    with contextlib.suppress(MalformedInput):
        for _ in range(round(9.0 / speed / STEP)):
            ended.hear([way * seen(position)])
            position += way * ended.step((0.0, way * speed), STEP)[1] * STEP
            assert position <= ENDS.most + ENDS.slow_zone / 2.0 + MOST * STEP
        return
    ended.step((0.0, way), STEP)
    ended.hear([way * seen(position)])  # that is where it begins again


@pytest.mark.parametrize('fault', ['sign', 'turns the other way in the zone'])
@pytest.mark.parametrize('lets_go', [True, False])
def test_joint_that_goes_wrong_goes_no_further_by_small_steps(fault: str, lets_go: bool) -> None:
    """:param lets_go: of the deadman after each, else of the stick."""
    ended, position = limiter(), 0.0
    with contextlib.suppress(MalformedInput):
        for n in range(6000):
            ended.hear([FAULTS[fault](position)])
            if lets_go and n % 60 == 20:
                ended.reset()
            position += ended.step((0.0, 0.7 * (n % 60 < 20)), STEP)[1] * STEP
            assert position <= ENDS.most + ENDS.slow_zone / 2.0


@pytest.mark.parametrize('way', [1.0, -1.0])
@pytest.mark.parametrize(
    ('steps', 'astray'),  # each: rad/s told for 0.1 s, rad that it went
    [
        ([(0.1, 1.01)], False),
        ([(0.1, 1.02)], True),
        ([(1.0, 1.11)], False),
        ([(1.0, 1.13)], True),
        ([(0.1, -0.99)], False),
        ([(0.1, -1.01)], True),
        ([(0.1, 0.51), (0.1, 0.51)], False),
        ([(0.1, 0.4), (0.1, 0.4), (0.1, 0.4)], True),
        ([(0.1, -0.4), (0.1, -0.4), (0.1, -0.4)], True),
        ([(0.1, -0.4), (0.1, 0.9), (0.1, 0.2)], True),
        ([(0.1, 0.9), (0.1, -0.5), (0.1, 0.5)], False),
        ([(0.1, 0.9), (0.1, -0.5), (0.1, 0.7)], True),
        ([(0.1, 0.9), (0.0, 0.0), (0.1, 0.9)], True),
        ([(0.1, 0.9), (0.0, -3.0), (0.1, 0.1)], False),  # turned by hand
    ],
)
def test_joint_goes_astray_half_a_zone_beyond_what_it_was_told(
    steps: list[tuple[float, float]], astray: bool, way: float
) -> None:
    ended, position = limiter(way), way * 2.0

    def go(told: float, moved: float) -> None:
        nonlocal position
        ended.step((0.0, way * told), 0.1)
        position += way * moved
        ended.hear([position])

    ended.hear([position])
    for step in steps[:-1]:
        go(*step)
    with pytest.raises(MalformedInput, match="'mast'") if astray else contextlib.nullcontext():
        go(*steps[-1])
    go(0.1, math.copysign(0.3, steps[-1][1]) if astray else 0.0)  # that is where it begins again


def test_positions_between_two_steps_hide_no_fault() -> None:
    ended, position = limiter(), 0.0
    with contextlib.suppress(MalformedInput):
        for n in range(20 * 600):
            ended.hear([-position])
            if n % 20 == 0:
                ended.step((0.0, 1.0), STEP)
            position += ended.output[1] * STEP / 20
            assert position < ENDS.most


def test_joint_that_was_turned_by_hand_at_rest_is_no_fault() -> None:
    ended = at_speed(1.0, 2.0)
    for position in (2.0, 4.5, -1.0, 3.0):
        ended.reset()
        ended.hear([position])
    for _ in range(20):
        ended.step((0.0, 1.0), STEP)
        ended.hear([3.0])


@pytest.mark.parametrize('late', [0, 10])
@settings(max_examples=20)
@given(st.lists(st.tuples(st.floats(-2.0, 2.0), st.integers(1, 100)), max_size=9))
def test_joint_that_obeys_late_and_too_fast_or_is_turned_by_hand_is_no_fault(
    late: int, asked: list[tuple[float, int]]
) -> None:
    """:param late: steps until it does what it is told."""
    ended, position = limiter(), 2.0
    commands = [0.0] * (1 + late)
    for target, times in [*asked, (0.0, 200)]:
        for _ in range(times):
            ended.hear([position])
            commands = [*commands[1:], ended.step((0.0, target), STEP)[1]]
            position += 1.1 * commands[0] * STEP
    ended.hear([position])
    ended.step((0.0, 0.0), STEP)
    ended.hear([position + 3.0])


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


def test_ends_without_a_way_between_them_are_refused() -> None:
    with pytest.raises(ValueError, match='must be below'):
        SoftEnds(1.0, 1.0, 1.0, 1.0)


def test_owner_who_drives_into_an_end_does_not_wait_for_zero(step_mux: StepMux) -> None:
    stepped = step_mux()
    assert stepped.reset().ok
    stepped.run(LIMIT + 0.1)
    stepped.joy = sticks(0.5, deadman=True)
    assert stepped.run(0.2) is State.ACTIVE
    limits = [JointLimit(MOST, 100.0, SLOWING)] * 2
    stepped.arbiter.limiter = EndedLimiter(JointLimiter(limits), {0: ENDS, 1: ENDS}, 'lr')
    stepped.arbiter.limiter.hear([ENDS.most] * 2)
    stepped.run(0.2)
    values = stepped.values()
    assert values['code'] == 'mux.limit.end'
    assert values['inhibit 1'].endswith('near its end: only back')
