# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What goes out once the drive is enabled: from rest, and no faster than the axis allows."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

from hypothesis import example, given, strategies as st
import pytest

from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.session import Phase
from esi_drive_bridge.session.ramp import Ramp
from stage.esi_drive_rig import axes, fields, IDLE, is_disable, Rig, RUNNING, status, TICK

LIMIT = 1000.0  # counts a second: 10 a packet
STEP = 10


def values(frames: list[bytes]) -> list[int]:
    """Return what axis A is told by packets that all enable it."""
    assert all(fields(frame)[0][0] for frame in frames)
    return [fields(frame)[0][2] for frame in frames]


def step(ramp: Ramp, goals: tuple[int, ...], now: float) -> tuple[int, ...]:
    counts = ramp.step(goals, now)
    ramp.sent()
    return counts


@pytest.fixture
def rig() -> Rig:
    """Return a rig whose command asks for full speed all the time."""
    left, right = axes(Mode.VELOCITY, slew_limit=LIMIT)[0], axes(Mode.TORQUE, slew_limit=LIMIT)[1]
    result = Rig(axes=(left, right))
    result.command = (500.0, -500.0)
    return result


def enabling(rig: Rig) -> None:
    rig.status, rig.enable = IDLE, False
    rig.press()


def enabled(rig: Rig, packets: int = 1) -> list[bytes]:
    """Let the drive say that it is enabled; return the packets from then on."""
    rig.status = RUNNING
    frames = rig.tick(packets)
    assert rig.phase() is Phase.ENABLED
    return frames


def moving(rig: Rig) -> None:
    enabling(rig)
    frames = enabled(rig, 21)
    assert values(frames)[-1] == 200


# Enabling.


@pytest.mark.parametrize('ticks', [0, 1, 50, 98])
def test_packets_begin_at_rest_however_long_the_drive_takes(rig: Rig, ticks: int) -> None:
    enabling(rig)
    assert set(values(rig.tick(ticks))) <= {0}
    frames = enabled(rig, 60)
    assert values(frames) == [min(STEP * n, 500) for n in range(60)]
    assert [fields(frame)[1][2] for frame in frames] == [max(-STEP * n, -500) for n in range(60)]


def test_a_drive_that_was_enabled_all_the_time_begins_at_rest(rig: Rig) -> None:
    rig.stop_slowly()
    rig.tick(3)
    rig.enable = True
    assert values(rig.tick(5)[-5:]) == [0, 0, 10, 20, 30]


# Growing, and slowing down.


def test_a_position_begins_where_the_axis_stands_and_moves_both_ways() -> None:
    rig = Rig(axes=axes(Mode.POSITION, slew_limit=LIMIT))
    rig.status = status(feedback=(1000, -1000))
    rig.command = (1025.0, -2000.0)
    rig.press()
    rig.status = status(1, 1, feedback=(1003, -1000))
    assert values(rig.tick(5)) == [1003, 1013, 1023, 1025, 1025]
    assert fields(rig.frames[-1][1])[1][2] == -1040
    rig.command = (1000.0, -1000.0)
    assert values(rig.tick(5))[-4:] == [1015, 1005, 1000, 1000]


ANSWERS = st.tuples(st.booleans(), st.booleans(), st.integers(-99, 99), st.integers(-99, 99))


@given(story=st.lists(ANSWERS, min_size=1, max_size=20))
def test_rest_of_an_axis_follows_it_until_a_status_knew_it_enabled(
    story: list[tuple[bool, bool, int, int]],
) -> None:
    rig = Rig(axes=axes(Mode.POSITION, slew_limit=LIMIT))
    enabling(rig)
    was: tuple[bool, ...] = (False, False)
    before: tuple[int, ...] = (0, 0)
    for a, b, *place in story:
        rig.status = status(a, b, feedback=(place[0], place[1]))
        told = fields(rig.tick()[0])
        rests = zip(was, before, place, strict=True)
        want = tuple(value if enabled else stands for enabled, value, stands in rests)
        assert tuple(axis[2] for axis in told) == want
        if a and b:
            break
        was, before = (a, b), want


@pytest.mark.parametrize('second', [Mode.POSITION, Mode.TORQUE])
@pytest.mark.parametrize('state', [0, 1])
def test_position_waits_for_a_status_younger_than_the_edge(state: int, second: Mode) -> None:
    first = axes(Mode.POSITION, slew_limit=LIMIT)[0]
    rig = Rig(axes=(first, axes(second, slew_limit=LIMIT)[1]))
    rig.stop_slowly()
    rig.status = status(state, state)
    rig.tick(3)
    rig.status = None
    rig.tick(10)
    rig.enable = True
    assert all(map(is_disable, rig.tick(10)))
    assert rig.phase() is Phase.WAITING
    assert rig.session.inhibits(rig.now)[0] == 'wait for a status that says where the axis stands'
    rig.status = status(state, state, feedback=(2000, -2000))
    assert set(values(rig.tick(2))) == {2000}


def test_position_whose_place_stays_unknown_waits_no_longer_than_for_a_command() -> None:
    rig = Rig(axes=axes(Mode.POSITION), link_timeout=5.0)
    rig.tick(3)
    rig.status, rig.enable = None, True
    assert all(map(is_disable, rig.tick(9)))
    assert rig.phase() is Phase.WAITING
    rig.tick(3)
    assert rig.phase() is Phase.DISABLED
    assert 'wait for a status that says where the axis stands' in rig.session.inhibits(rig.now)[-1]
    rig.status = RUNNING
    assert all(map(is_disable, rig.tick(30)))


SINKS = 3  # counts a tick, while disabled
FOLLOWS = 5
SCENES = st.tuples(
    st.integers(1, 20),
    st.sampled_from(['', 'busy', 'no status']),
    st.sampled_from([True, True, False]),
    st.sampled_from([0.0, 300.0, -500.0]),
)


BUSY_PRESS = [
    *((2, '', False, 0.0), (20, '', True, 300.0)),
    *((1, 'busy', False, 300.0), (20, 'busy', True, 300.0), (3, '', True, 300.0)),
]


@given(story=st.lists(SCENES, max_size=20))
@example(story=BUSY_PRESS)
def test_position_goes_on_from_what_it_was_told_or_from_where_it_stands(
    story: list[tuple[int, str, bool, float]],
) -> None:
    rig = Rig(axes=axes(Mode.POSITION, slew_limit=LIMIT))
    place = told = 0
    enabled = False
    for ticks, fault, rig.enable, goal in story:
        rig.busy, rig.command = fault == 'busy', (goal, goal)
        for _ in range(ticks):
            now = status(int(enabled), int(enabled), feedback=(place, place))
            rig.status = None if fault == 'no status' else now
            for frame in rig.tick():
                was_enabled, (enabled, _, target) = enabled, fields(frame)[0]
                if enabled:
                    step = min(abs(target - at) for at in (place, told if was_enabled else place))
                    assert step <= STEP + 1 + SINKS
                    told = target
            place += max(-FOLLOWS, min(told - place, FOLLOWS)) if enabled else -SINKS


def test_what_is_held_back_is_said(rig: Rig) -> None:
    moving(rig)

    def said() -> Any:
        return rig.session.values(rig.now)['held back by slew_limit']

    assert said() == 'left at 200 of 500 rad/s, right at -200 of -500 A'
    rig.tick(40)
    assert said() == 'none'
    rig.do(lambda: rig.session.set_estop(True, rig.now))
    assert said() == 'none'


# The ramp alone.

GOALS = st.lists(
    st.tuples(st.integers(-32768, 32767), st.floats(0.0, 0.2)), min_size=1, max_size=40
)


@given(goals=GOALS, mode=st.sampled_from(Mode), rest=st.integers(-32768, 32767))
def test_no_step_is_greater_than_the_limit_allows(
    goals: list[tuple[int, float]], mode: Mode, rest: int
) -> None:
    now, rest = 100.0, rest if mode is Mode.POSITION else 0
    ramp = Ramp(axes(mode, slew_limit=LIMIT)[:1], TICK)
    ramp.begin((rest,))
    said = []
    for goal, pause in goals:
        said.append((now, step(ramp, (goal,), now)[0], goal))
        now += pause
    assert said[0][1] == rest
    for (before, was, _), (at, value, goal) in pairwise(said):
        most = LIMIT * min(at - before, TICK) + 1.0  # what rounding adds
        assert min(was, goal) <= value <= max(was, goal)
        if mode is Mode.POSITION:
            assert abs(value - was) <= most
        else:
            size = abs(was) if was * goal > 0 else 0
            assert min(size, abs(goal)) <= abs(value) <= size + most


@pytest.mark.parametrize('later', [0.0, -5.0])
def test_time_that_stands_or_runs_back_grows_nothing(later: float) -> None:
    ramp = Ramp(axes(Mode.VELOCITY, slew_limit=LIMIT)[:1], TICK)
    now = 100.0
    step(ramp, (500,), now)
    assert step(ramp, (500,), now + later) == (0,)


@pytest.mark.parametrize('mode', Mode)
@pytest.mark.parametrize('scale', [0.5, 4.0, -4.0])
def test_limit_is_in_units_of_the_joint(mode: Mode, scale: float) -> None:
    ramp = Ramp(axes(mode, scale, slew_limit=800.0)[:1], TICK)  # 8 a packet
    said = [step(ramp, (500,), 100.0 + TICK * n)[0] for n in range(4)]
    assert said == [round(8.0 * n / abs(scale)) for n in range(4)]


def test_a_goal_of_one_count_is_reached_in_parts_of_one() -> None:
    ramp = Ramp(axes(Mode.VELOCITY, slew_limit=30.0)[:1], TICK)  # 0.3 counts a packet
    said = [step(ramp, (1,), 100.0 + TICK * n)[0] for n in range(6)]
    assert said == [0, 0, 1, 1, 1, 1]


# Two axes.

COUNTS = st.integers(-32768, 32767)


@given(goals=st.tuples(COUNTS, COUNTS), scale=st.sampled_from([1.0, -0.25]))
def test_curve_from_rest_stays_that_curve_within_a_count(
    goals: tuple[int, int], scale: float
) -> None:
    left, right = axes(Mode.VELOCITY, scale, slew_limit=LIMIT * 100)
    ramp = Ramp((left, replace(right, slew_limit=LIMIT * 70)), TICK)
    most = max(map(abs, goals))
    said = [step(ramp, goals, 100.0 + TICK * n) for n in range(60)]
    for pair in said:
        share = max(map(abs, pair)) / most if most else 1.0
        for value, goal in zip(pair, goals, strict=True):
            assert abs(value - share * goal) <= 1.0
            assert value * goal >= 0
    assert said[-1] == goals


@given(story=st.lists(st.tuples(st.tuples(COUNTS, COUNTS), st.floats(0.0, 0.02)), min_size=1))
def test_velocity_beside_another_is_never_above_its_own_and_slows_down_at_once(
    story: list[tuple[tuple[int, int], float]],
) -> None:
    both, now = Ramp(axes(Mode.VELOCITY, slew_limit=LIMIT), TICK), 100.0
    was: tuple[int, ...] = (0, 0)
    for goals, pause in story:
        said = step(both, goals, now)
        for before, value, goal in zip(was, said, goals, strict=True):
            assert value * goal >= 0
            if before * goal >= 0 and abs(goal) <= abs(before):
                assert value == goal
            else:
                size = abs(before) if before * goal > 0 else 0
                assert abs(value) <= min(abs(goal), size + STEP + 1)
        was, now = said, now + pause


def test_velocity_beside_a_position_does_not_wait_for_it() -> None:
    pair = axes(Mode.VELOCITY, slew_limit=LIMIT)[0], axes(Mode.POSITION, slew_limit=LIMIT)[1]
    ramp = Ramp(pair, TICK)
    step(ramp, (20, 1000), 100.0)
    assert [step(ramp, (20, 1000), 100.0 + TICK * n) for n in (1, 2)] == [(10, 10), (20, 20)]


def test_nothing_grows_while_commands_fall() -> None:
    """A stop by a ramp of the mux that is far ahead of ours."""
    rig = Rig(axes=axes(Mode.VELOCITY, slew_limit=LIMIT))
    rig.press()
    rig.status = RUNNING
    rig.tick()
    rig.command = (100.0 * LIMIT, 0.0)
    sent = fields(rig.tick(20)[-1])[0][2]
    assert 0 < sent < 100.0 * LIMIT
    for share in (90.0, 80.0, 70.0):
        rig.command = (share * LIMIT, 0.0)
        assert fields(rig.tick()[-1])[0][2] <= sent + LIMIT * TICK  # the one before was earlier
    assert fields(rig.tick()[-1])[0][2] <= sent + LIMIT * TICK
    rig.command = (0.5 * sent, 0.0)
    rig.tick()
    assert fields(rig.tick()[-1])[0][2] == round(0.5 * sent)
    rig.command = (50.0 * LIMIT, 0.0)  # it rises, and so does what is sent
    assert fields(rig.tick(3)[-1])[0][2] > round(0.5 * sent)
