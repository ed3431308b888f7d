# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rule 10: magnitude, rate, and a ramp with an end."""

from itertools import pairwise
import math

from hypothesis import given, strategies as st
import pytest

from safety_mux.limits import JointLimit, JointLimiter

LIMIT = JointLimit(magnitude=4.0, acceleration=2.0, deceleration=8.0)
EASED = JointLimit(magnitude=4.0, acceleration=2.0, deceleration=8.0, jerk=4.0)
WEAK = JointLimit(magnitude=4.0, acceleration=4.0, deceleration=1.0)  # its ramp has to be steeper
WHEEL = JointLimit(magnitude=10.0, acceleration=20.0, deceleration=40.0)
SLOW = JointLimit(magnitude=10.0, acceleration=5.0, deceleration=8.0)
FAST = JointLimit(10.0, 1e3, 1e3)
MAST, HALF = JointLimit(1.0, 1e3, 1e3, 'mast'), JointLimit(0.5, 100.0, 100.0, 'mast')
LIMITS = {
    'LIMIT': LIMIT,
    'EASED': EASED,
    'WEAK': WEAK,
    'WHEEL': WHEEL,
    'SLOW': SLOW,
    'FAST': FAST,
    'MAST': MAST,
    'HALF': HALF,
}
numbers = st.floats(allow_nan=True, allow_infinity=True)


def limiter(*limits: JointLimit, max_dt: float = 1.0) -> JointLimiter:
    return JointLimiter(limits or (LIMIT,), max_dt=max_dt)


# By the names of the limits above: steps 'TARGETS in DT: OUTPUTS', 'ramp in DT of STOP_TIME:
# OUTPUTS', 'halt JOINT: OUTPUTS', 'reset', in order.
STORIES = {
    'acceleration, then deceleration': """LIMIT; 4 in .5: 1; 4 in .5: 2; 4 in .5: 3; 4 in .5: 4;
        4 in .5: 4; 0 in .25: 2; 1.5 in .25: 1.5""",
    'a change of sign stops at zero first': 'LIMIT; -4 in 1: -2; 4 in 1: 0; 4 in 1: 2',
    'each group by its own': 'LIMIT HALF; 4 -4 in .5: 1 -.5',
    'beyond one joint the curve stays': """FAST FAST MAST FAST;
        12.5 17.5 -3 inf in 1: 7.142857142857143 10 -1 0""",
    'no number is zero': """LIMIT; 1 in 1: 1; nan in 1: 0; 1 in 1: 1; inf in 1: 0; 1 in 1: 1;
        -inf in 1: 0""",
    'time that does not pass changes nothing': """LIMIT; 1 in 1: 1; 4 in 0: 1; 4 in -1: 1;
        4 in -inf: 1; 4 in nan: 1; ramp in 0 of .5: 1; ramp in -1 of .5: 1;
        ramp in nan of .5: 1""",
    'a reset is zero at once and leaves no ramp': 'LIMIT; 4 in 1: 2; reset; 4 in .5: 1',
    'a halt is that of one joint, whose growth begins anew': """EASED EASED EASED;
        0 4 4 in .125: 0 .0625 .0625; 0 4 4 in .125: 0 .1875 .1875; halt 1: 0 0 .1875;
        0 4 4 in .125: 0 .0625 .375""",
    'a ramp is in time where the deceleration is not': """WEAK; 4 in 1: 4; ramp in .25 of 1: 3;
        ramp in .25 of 1: 2; ramp in .25 of 1: 1; ramp in .25 of 1: 0""",
    'a ramp ends sooner with the deceleration': """LIMIT; 2 in 1: 2; ramp in .125 of 1: 1;
        ramp in .125 of 1: 0""",
    'a late step still ends a ramp in time': """WEAK; -4 in 1: -4; ramp in .25 of 1: -3;
        ramp in inf of 1: 0""",
    'each ramp has slopes of its own': """WEAK; 4 in 1: 4; ramp in .25 of 1: 3; 0 in 1: 2;
        ramp in .25 of 1: 1.5""",
    'a ramp without time is zero at once': """WEAK; 4 in 1: 4; ramp in .01 of 0: 0; 4 in 1: 4;
        ramp in .01 of -1: 0""",
    'a stop in a curve is that of each joint': 'WHEEL WHEEL; 2 10 in 1: 2 10; 0 0 in .05: 0 8',
    'who brakes holds no other back': 'WHEEL WHEEL; 5 5 in 1: 5 5; -5 10 in .1: 1 7',
    'growth amid a curve takes the same share': """WHEEL SLOW; 4 0 in 1: 4 0;
        6 1 in .01: 4.1 .05""",
    'who has no number holds no other back': """WHEEL SLOW; inf 1 in .1: 0 .5; 4 .5 in 1: 4 .5;
        inf 1 in .01: 3.6 .55""",
    'without a jerk beside one it is as ever': """EASED LIMIT; 4 4 in .125: .0625 .25;
        4 4 in .125: .1875 .5; 4 4 in .125: .375 .75""",
    'the least of steps in no time is none': 'EASED; 5e-324 in 0: 0',
}


@pytest.mark.parametrize('name', STORIES)
def test_output_of_each_step(name: str) -> None:
    names, *steps = STORIES[name].split(';')
    limited = limiter(*(LIMITS[each] for each in names.split()))
    for step in steps:
        what, _, outputs = step.partition(':')
        words, _, times = what.strip().partition(' in ')
        dt, *of = [float(each) for each in times.split(' of ') if each] or [0.0]
        if words == 'reset':
            limited.reset()
        elif words.startswith('halt'):
            limited.halt(int(words.removeprefix('halt')))
        elif of:
            limited.ramp(dt, *of)
        else:
            limited.step([float(each) for each in words.split()], dt)
        expected = [float(each) for each in outputs.split()] or [0.0]
        assert limited.output == pytest.approx(expected, rel=1e-12), step


@pytest.mark.parametrize('dt', [10.0, 1e300, math.inf])
def test_late_step_does_not_jump(dt: float) -> None:
    assert limiter(max_dt=0.1).step((4.0,), dt) == (0.2,)
    assert JointLimiter([LIMIT]).step((4.0,), dt) == (0.2,)


def test_growth_from_a_demand_that_was_reached_begins_without_acceleration() -> None:
    limited = limiter(EASED)
    while limited.output != (1.0,):
        limited.step((1.0,), 0.125)
    assert limited.step((4.0,), 0.125) == (1.0625,)


def test_reduced_demand_is_not_beyond_the_limit_by_its_rounding() -> None:
    assert 6.3 / (6.3 / 5.9) > 5.9
    assert limiter(JointLimit(5.9, 1e3, 1e3)).step((6.3,), 1.0) == (5.9,)


@given(
    st.lists(
        st.tuples(st.floats(-1e9, 1e9), st.floats(1e-3, 1e3), st.sampled_from('ab')), min_size=1
    )
)
def test_every_group_keeps_its_proportion_and_reaches_a_limit(
    joints: list[tuple[float, float, str]],
) -> None:
    limits = [JointLimit(most, 1e15, 1e15, group) for _, most, group in joints]
    output = limiter(*limits).step([goal for goal, _, _ in joints], 1.0)
    for group in 'ab':
        values = [
            (value, goal, most)
            for value, (goal, most, name) in zip(output, joints, strict=True)
            if name == group
        ]
        factor = min([1.0, *(most / abs(goal) for _, goal, most in values if goal)])
        for value, goal, most in values:
            assert value == pytest.approx(goal * factor)
            assert abs(value) <= most


def test_no_zero_is_negative() -> None:
    """Who reads it as text, or divides by it, would take it for the other way."""
    limited = limiter()
    limited.step((-1.0,), 1.0)
    assert str(limited.ramp(0.125, 1.0)) == '(0.0,)'
    limited.step((-1.0,), 1.0)
    assert str(limited.step((-0.0,), 1.0)) == '(0.0,)'
    assert str(limiter(WHEEL, SLOW).step((-1.0, -1.0), 0.0)) == '(0.0, 0.0)'


# Joints together.

pairs = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))


def test_curve_from_rest_is_that_curve_from_the_first_step_on() -> None:
    limited = limiter(WHEEL, SLOW)
    story = [limited.step((10.0, -2.0), 0.01) for _ in range(60)]
    assert story[0] == pytest.approx((0.2, -0.04))
    assert all(right == pytest.approx(-0.2 * left) for left, right in story)
    assert story[-1] == (10.0, -2.0)


@given(st.floats(0.05, 20.0), st.floats(-20.0, 20.0), st.sampled_from([0.001, 0.01, 0.1]))
def test_from_rest_every_ratio_is_kept_and_the_goal_is_reached(
    left: float, right: float, dt: float
) -> None:
    limited = limiter(WHEEL, SLOW)
    time = max(min(left, 10.0) / 20.0, min(abs(right), 10.0) / 5.0)
    for _ in range(math.ceil(time / dt) + 1):
        values = limited.step((left, right), dt)
        assert values[0] * right == pytest.approx(values[1] * left)
    factor = min(1.0, 10.0 / max(left, abs(right)))
    assert values == pytest.approx((left * factor, right * factor))


@given(st.lists(st.tuples(pairs, st.sampled_from([0.0, 0.001, 0.01, 0.1]))))
def test_joint_beside_others_is_never_faster_than_alone_and_brakes_as_fast(
    story: list[tuple[tuple[float, float], float]],
) -> None:
    limited = limiter(WHEEL, SLOW)
    for target, dt in story:
        was = limited.output
        alone = []
        for n, limit in enumerate((WHEEL, SLOW)):
            single = limiter(JointLimit(10.0, limit.acceleration, limit.deceleration))
            single._values = (was[n],)
            factor = min(1.0, 10.0 / max(map(abs, (*target, 1e-9))))
            alone.append(single.step((target[n] * factor,), dt)[0])
        for before, value, most in zip(was, limited.step(target, dt), alone, strict=True):
            assert abs(value) <= abs(most) + 1e-9
            assert value * most >= 0.0
            if abs(most) <= abs(before):
                assert value == pytest.approx(most), 'braking waits for nobody'


@pytest.mark.parametrize(
    'slow',
    [
        JointLimit(10.0, 5.0, 8.0, 'mast'),
        JointLimit(10.0, 5.0, 8.0, together=False),
        JointLimit(10.0, 5.0, 8.0, jerk=1e9),
    ],
)
def test_joint_of_another_group_a_torque_and_one_with_a_jerk_grow_by_themselves(
    slow: JointLimit,
) -> None:
    assert limiter(WHEEL, slow).step((10.0, 10.0), 0.1) == pytest.approx((2.0, 0.5))


# Jerk.

jerks = st.floats(0.5, 1e4)
steps_of = st.floats(0.005, 0.1)


def test_jerk_lets_the_acceleration_rise_and_fall() -> None:
    limited = limiter(EASED)
    values = [0.0]
    while values[-1] < 4.0 and len(values) < 100:
        values.append(*limited.step((4.0,), 0.125))
    rates = [8.0 * (after - before) for before, after in pairwise(values)]
    assert rates[:5] == [0.5, 1.0, 1.5, 2.0, 2.0]
    assert rates[-4:] == sorted(rates[-4:], reverse=True)
    assert 0.0 < rates[-1] <= 0.5
    assert 2.3 < 0.125 * len(rates) < 2.7, 'the time of the profile, 4 / 2 + 2 / 4 s, about'


@given(jerks, steps_of, st.floats(0.01, 4.0), st.floats(0.1, 10.0))
def test_eased_joint_keeps_to_its_jerk_and_arrives_in_time(
    jerk: float, dt: float, goal: float, acceleration: float
) -> None:
    limited = limiter(JointLimit(4.0, acceleration, 8.0, jerk=jerk))
    value = rate = 0.0
    # Of the two: rise, plateau and fall, or rise and fall alone; and the steps they come in.
    time = max(goal / acceleration + acceleration / jerk, 2.0 * math.sqrt(goal / jerk))
    for _ in range(math.ceil(1.2 * time / dt) + 6):
        before, value = value, limited.step((goal,), dt)[0]
        was, rate = rate, (value - before) / dt
        assert before <= value <= goal, 'away from the goal, or beyond it'
        assert rate <= acceleration * (1.0 + 1e-9)
        assert abs(rate - was) <= jerk * dt * (1.0 + 1e-9) + 1e-9 / dt
    assert value == goal


@given(jerks, st.lists(st.tuples(numbers, st.sampled_from([0.0, 1e-320, 0.001, 0.01, 0.1]))))
def test_eased_joint_never_overshoots_and_its_stop_is_no_later(
    jerk: float, story: list[tuple[float, float]]
) -> None:
    limit = JointLimit(4.0, 2.0, 8.0, jerk=jerk)
    limited = limiter(limit)
    for target, dt in story:
        was = limited.output[0]
        (value,) = limited.step((target,), dt)
        goal = math.copysign(min(abs(target), 4.0), target) if math.isfinite(target) else 0.0
        least, most = sorted((was, goal if was * goal >= 0.0 else 0.0))
        assert least <= value <= most
        if abs(value) > abs(was):
            assert abs(value) - abs(was) <= min(2.0 * dt, jerk * 0.1 * len(story) * dt) + 1e-9
    plain = limiter(JointLimit(4.0, 1e9, 8.0))
    plain.step(limited.output, 1.0)
    assert plain.output == limited.output
    assert limited.step((0.0,), 0.01) == plain.step((0.0,), 0.01)
    assert limited.ramp(0.01, 0.2) == plain.ramp(0.01, 0.2)


def test_growth_after_a_stop_begins_without_acceleration() -> None:
    limited = limiter(EASED)
    for end in (
        limited.reset,
        lambda: limited.ramp(10.0, 0.5),
        lambda: limited.step((0.0,), 1.0),
        lambda: limited.step((-4.0,), 1.0),
        lambda: limited.step((math.inf,), 1.0),
    ):
        for _ in range(4):
            limited.step((4.0,), 0.25)
        end()
        assert limited.output == (0.0,)
        assert limited.step((4.0,), 0.125) == (0.0625,)


def test_wrong_number_of_joints_is_refused() -> None:
    with pytest.raises(ValueError, match='2 targets for 1 joints'):
        limiter().step((1.0, 1.0), 0.1)


@given(st.lists(st.tuples(numbers, numbers)))
def test_whatever_comes_the_limits_hold(steps: list[tuple[float, float]]) -> None:
    limited = limiter(max_dt=0.1)
    for target, dt in steps:
        was = limited.output[0]
        (value,) = limited.step((target,), dt)
        grows = abs(value) > abs(was)
        assert abs(value) <= LIMIT.magnitude
        assert was * value >= 0.0
        rate = LIMIT.acceleration if grows else LIMIT.deceleration
        assert abs(value - was) <= rate * 0.1 + 1e-9


@given(
    st.floats(-4.0, 4.0),
    st.lists(st.floats(0.001, 0.1), min_size=1),
    st.floats(0.01, 2.0),
)
def test_every_ramp_falls_and_ends(start: float, steps: list[float], stop_time: float) -> None:
    limited = limiter(JointLimit(4.0, 100.0, 0.5))
    limited.step((start,), 1.0)
    before, passed = limited.output[0], 0.0
    for dt in steps:
        (value,) = limited.ramp(dt, stop_time)
        passed += dt
        assert abs(value) < abs(before) or value == 0.0
        assert value * start >= 0.0
        if passed >= stop_time * (1.0 + 1e-9):
            assert abs(value) <= 1e-9
        before = value


@given(
    st.lists(
        st.tuples(
            st.floats(-3.0, 3.0), st.floats(0.0, 1.0), st.sampled_from([0.0, 0.001, 0.01, 0.1])
        )
    )
)
def test_output_is_below_the_limit_or_on_its_way_there(
    story: list[tuple[float, float, float]],
) -> None:
    limiter = JointLimiter([JointLimit(2.0, 5.0, 10.0)])
    for target, scale, dt in story:
        before = abs(limiter.output[0])
        (value,) = limiter.step((target,), dt, scale)
        assert abs(value) <= max(2.0 * scale, before - 10.0 * dt) + 1e-9
