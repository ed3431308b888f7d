# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Speed limits of the moment: the least scales all joints, and silence never raises it."""

from dataclasses import replace
import math

from hypothesis import given, strategies as st
import pytest

from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import Decision, SpeedLimit, State
from stage.safety_mux_bench import assert_stopped, Bench, CONFIG, DRIVE, EVERY, TICK

LIMITED = replace(CONFIG, speed_limits=(SpeedLimit('zone', lowest=0.2), SpeedLimit('key')))
RATE = 10.0  # of the bench's joints, both ways, per second
TIMEOUT = 0.25


def limited(zone: float | None = 1.0, key: float | None = 1.0) -> Bench:
    """Return a bench in motion, of which both limits have been heard."""
    bench = Bench(LIMITED)
    bench.limits = {'zone': 1.0, 'key': 1.0}
    bench.active()
    bench.limits = {'zone': zone, 'key': key}
    return bench


def ramps(decision: Decision, before: list[Decision]) -> None:
    if before:
        steps = zip(before[-1].demand, decision.demand, strict=True)
        assert all(abs(after - was) <= RATE * TICK + 1e-9 for was, after in steps)
    before.append(decision)


def test_slow_zone_is_ramped_into_keeps_the_curve_and_is_left() -> None:
    bench, story = limited(0.25), []  # type: tuple[Bench, list[Decision]]
    bench.run(0.5, lambda decision: ramps(decision, story))
    assert bench.decision.demand == pytest.approx((0.25, 0.125))
    assert bench.decision.state is State.ACTIVE
    status = bench.arbiter.status(bench.now)
    assert status.slowed == ("speed limit 'zone' allows 25 %",)
    assert status.conditions["speed limit 'zone'"] == '25 %'
    bench.limits['zone'] = 1.0
    bench.run(0.5, lambda decision: ramps(decision, story))
    assert bench.decision.demand == (1.0, 0.5)
    assert not bench.arbiter.status(bench.now).slowed


@pytest.mark.parametrize(('zone', 'key'), [(0.3, 0.7), (0.7, 0.3), (0.3, 0.3)])
def test_least_of_all_limits_counts(zone: float, key: float) -> None:
    assert limited(zone, key).run(0.5).demand == pytest.approx((0.3, 0.15))


def test_demand_beyond_the_maximum_is_reduced_before_it_is_scaled() -> None:
    bench = limited(0.5)
    bench.samples['fort'] = replace(DRIVE, demand=(4.0, -2.0))
    assert bench.run(0.5).demand == pytest.approx((0.5, -0.25))


@pytest.mark.parametrize('value', [math.nan, math.inf, -0.01, 1.01, None])
def test_limit_that_is_silent_or_makes_no_sense_is_its_lowest(value: float | None) -> None:
    bench = limited(value)
    assert bench.run(0.5).demand == pytest.approx((0.2, 0.1))
    (words,) = bench.arbiter.status(bench.now).slowed
    assert words.startswith("speed limit 'zone' allows 20 %: speed limit 'zone' is ")


def test_limit_never_heard_is_its_lowest() -> None:
    bench = Bench(LIMITED)
    bench.limits = {'zone': None, 'key': 1.0}
    bench.ready()
    bench.samples['fort'] = DRIVE
    assert bench.run(0.5).demand == pytest.approx((0.2, 0.1))


def test_limit_is_stale_exactly_at_its_timeout() -> None:
    bench = limited(None)
    heard = bench.arbiter.status(bench.now).ages["speed limit 'zone'"]
    assert bench.run(math.floor((TIMEOUT - heard) / TICK - 1e-6) * TICK).demand == (1.0, 0.5)
    assert bench.run(2 * TICK).demand < (1.0, 0.5)


@pytest.mark.parametrize('then', [None, math.nan])
def test_silence_never_raises_a_limit(then: float | None) -> None:
    bench = limited(0.1)
    bench.run(0.5)
    bench.limits['zone'] = then
    assert bench.run(1.0).demand == pytest.approx((0.1, 0.05))


@pytest.mark.parametrize('name', ['zone', 'key'])
def test_limit_of_nothing_holds_the_joints_and_says_so(name: str) -> None:
    bench = limited()
    bench.limits[name] = 0.0
    assert bench.run(0.5).demand == (0.0, 0.0)
    assert bench.decision.state is State.ACTIVE
    assert bench.why() == f"speed limit '{name}' allows 0 %"


def test_limit_makes_no_sense_from_its_message_on() -> None:
    bench = limited()
    bench.arbiter.speed_limit('zone', math.nan, bench.now)
    assert "speed limit 'zone' is invalid: it is nan" in bench.arbiter.status(bench.now).slowed[0]


def test_two_live_publishers_of_a_limit_are_none() -> None:
    bench = limited()
    bench.arbiter.set_invalid('speed limit', 'zone', 'publishers', 'two live publishers')
    assert bench.run(0.5).demand == pytest.approx((0.2, 0.1))


def test_limit_is_no_stop_and_delays_none() -> None:
    bench = limited(0.5)
    bench.run(0.5)
    bench.arbiter.estop_message('gate', True, bench.now)
    assert bench.tick().state is State.STOPPING
    bench.limits['zone'] = 1.0
    bench.run(EVERY)
    assert_stopped(bench.run(EVERY))


@pytest.mark.parametrize('value', [-0.1, 1.1, math.nan])
def test_lowest_that_is_no_share_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="lowest of speed limit 'zone'"):
        SpeedLimit('zone', lowest=value)
    with pytest.raises(ValueError, match='speed limits must differ'):
        replace(CONFIG, speed_limits=(SpeedLimit('zone'), SpeedLimit('zone')))


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
