# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The output waits for the drive to be enabled, or what was sent before came out as a step."""

from dataclasses import replace
from itertools import pairwise
import math

from hypothesis import given, strategies as st
import pytest

from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import Decision, EStopSource, MuxConfig, Operator, OperatorSample, State
from stage.safety_mux_bench import (
    assert_stopped,
    BACK,
    Bench,
    CONFIG,
    DRIVE,
    EVERY,
    HELD,
    OFF,
    TICK,
)

TIMEOUT = 0.25
WITH_DRIVE = replace(CONFIG, drives=('',), drive_timeout=TIMEOUT)
RATE = 10.0  # of the bench's joints, both ways, per second
ZERO = (0.0, 0.0)


class Outputs(list[Decision]):
    """Decisions, in order; each checked against the one before."""

    def __call__(self, decision: Decision) -> None:
        if self and decision.demand != ZERO:
            steps = zip(self[-1].demand, decision.demand, strict=True)
            assert all(abs(after - before) <= RATE * TICK + 1e-9 for before, after in steps)
        self.append(decision)

    @property
    def moved(self) -> bool:
        return any(decision.demand != ZERO for decision in self)


def pressed(drive: bool | None) -> Bench:
    """Return a bench whose operator has just pushed the stick, with a drive that says this."""
    bench = Bench(WITH_DRIVE).ready()
    bench.drive = drive
    bench.run(TIMEOUT + TICK)
    bench.samples['fort'] = DRIVE
    return bench


@pytest.mark.parametrize('delay', [0.02, 0.1, 0.5, 0.99])
def test_ramp_begins_at_rest_when_a_slow_drive_is_enabled(delay: float) -> None:
    bench, outputs = pressed(False), Outputs()
    bench.run(2 * EVERY, outputs)
    assert bench.decision.state is State.ACTIVE
    assert bench.decision.enable, 'a drive that is not asked never becomes enabled'
    bench.run(delay, outputs)
    assert not outputs.moved
    bench.drive = True
    bench.arbiter.drive_enabled('', True, bench.now)
    assert bench.run(TICK, outputs).demand == ZERO, 'the first output after it is at rest'
    bench.run(0.5, outputs)
    assert bench.decision.demand == (1.0, 0.5)


@pytest.mark.parametrize('says', [False, None])
def test_drive_that_is_not_known_to_be_enabled_gets_zero_and_status_says_so(
    says: bool | None,
) -> None:
    bench, outputs = pressed(says), Outputs()
    bench.run(2.0, outputs)
    assert not outputs.moved
    assert bench.decision.state is State.ACTIVE
    assert "operator 'fort' waits for the drive to be enabled" in bench.why()
    assert (says is None) == ('the drive is stale: last heard' in bench.why())
    assert (says is False) == ('it says that it is not' in bench.why())


def test_drive_that_never_says_anything_has_no_such_topic() -> None:
    bench = Bench(WITH_DRIVE)
    bench.drive = None
    bench.active()
    assert bench.arbiter.status(bench.now).conditions['the drive'] == 'silent'
    bench.arbiter.drive_enabled('', False, bench.now)  # it has one: from now on its word counts
    assert bench.tick().demand == ZERO
    assert bench.run(2 * TIMEOUT).demand == ZERO


def test_drive_that_was_never_heard_counts_once_its_topic_is_in_doubt() -> None:
    """A topic of two publishers is one, whatever of theirs was heard."""
    bench = Bench(WITH_DRIVE)
    bench.drive = None
    bench.active()
    bench.arbiter.set_invalid('drive', '', 'publishers', 'two live publishers')
    assert bench.tick().demand == ZERO
    assert 'waits for the drive to be enabled: the drive is invalid: two live' in bench.why()


def test_drive_that_drops_out_gets_zero_at_once_and_a_ramp_from_rest() -> None:
    bench = Bench(WITH_DRIVE).active()
    bench.drive = False
    bench.arbiter.drive_enabled('', False, bench.now)
    assert bench.tick().demand == ZERO
    assert bench.run(0.5).state is State.ACTIVE
    assert bench.arbiter.status(bench.now).conditions['the drive'] == 'not enabled'
    bench.drive, outputs = True, Outputs()
    bench.run(2 * EVERY, outputs)
    assert bench.arbiter.status(bench.now).conditions['the drive'] == 'enabled'
    assert outputs[0].demand == ZERO
    assert bench.run(0.5, outputs).demand == (1.0, 0.5)


def test_drop_out_between_two_ticks_is_not_missed() -> None:
    bench = Bench(WITH_DRIVE).active()
    assert bench.why() == ''
    for value in (False, True):
        bench.arbiter.drive_enabled('', value, bench.now)
    assert 'waits for the drive to be enabled: the drive was not enabled' in bench.why()
    assert bench.tick().demand == ZERO
    outputs = Outputs([bench.decision])
    assert bench.run(TICK, outputs).demand == ZERO
    assert bench.run(0.5, outputs).demand == (1.0, 0.5)


def test_gap_in_what_the_drive_says_is_a_drop_out() -> None:
    bench = Bench(replace(WITH_DRIVE, stall_limit=1.0, drive_timeout=0.15)).active()
    bench.now += 0.18  # not too long for anything else
    bench.send()
    assert bench.tick().state is State.ACTIVE
    assert bench.decision.demand == ZERO


def test_word_of_a_drive_is_stale_exactly_at_its_timeout() -> None:
    bench = Bench(WITH_DRIVE).active()
    bench.drive = None
    heard = bench.arbiter.status(bench.now).ages['the drive']
    ticks = math.floor((TIMEOUT - heard) / TICK - 1e-6)
    assert bench.run(ticks * TICK).demand == (1.0, 0.5)
    assert bench.run(2 * TICK).demand == ZERO


def test_two_live_publishers_are_no_word_of_a_drive() -> None:
    bench = Bench(WITH_DRIVE).active()
    bench.arbiter.set_invalid('drive', '', 'publishers', 'two live publishers')
    assert bench.run(0.5).demand == ZERO
    assert 'the drive is invalid: two live publishers' in bench.why()
    bench.arbiter.set_invalid('drive', '', 'publishers', None)
    assert bench.run(0.5).demand == (1.0, 0.5)


def test_drive_that_drops_out_on_a_ramp_ends_it() -> None:
    bench = Bench(WITH_DRIVE).active()
    bench.arbiter.estop_message('gate', True, bench.now)
    assert bench.tick().state is State.STOPPING
    bench.arbiter.drive_enabled('', False, bench.now)
    assert_stopped(bench.tick())


def test_stop_of_category_1_while_the_drive_is_awaited_has_nothing_to_ramp() -> None:
    bench = pressed(False)
    bench.run(0.2)
    bench.arbiter.estop_message('gate', True, bench.now)
    assert_stopped(bench.tick())


def test_takeover_while_the_drive_is_awaited_moves_nothing() -> None:
    bench, outputs = pressed(False), Outputs()
    bench.run(0.7, outputs)
    bench.samples['senior'] = BACK
    bench.run(0.2, outputs)
    assert (bench.decision.owner, outputs.moved) == ('senior', False)
    bench.drive = True
    bench.run(0.5, outputs)
    assert bench.decision.demand == (-1.0, -0.5)


def test_owner_overruled_while_the_drive_is_awaited_loses_control() -> None:
    bench = pressed(False)
    bench.run(0.2)
    bench.samples['senior'] = OFF
    assert bench.run(EVERY + TICK).state is State.READY


def test_restart_and_freeze_forget_what_the_drive_said() -> None:
    bench = Bench(WITH_DRIVE).active()
    bench.drive = None
    bench.now += 0.15  # longer than stall_limit
    assert_stopped(bench.tick())
    assert bench.arbiter.status(bench.now).conditions['the drive'] == 'silent'


def test_without_the_topic_the_ramp_waits_for_nothing() -> None:
    bench = Bench().ready()
    bench.samples['fort'] = HELD
    bench.run(0.1)
    bench.samples['fort'] = DRIVE
    assert bench.run(0.3).demand == (1.0, 0.5)
    assert bench.arbiter.status(bench.now).drives_enabled is None
    with pytest.raises(KeyError):
        bench.arbiter.drive_enabled('', True, bench.now)


TWO_DRIVES = replace(CONFIG, drives=('front', 'rear'), drive_timeout=TIMEOUT)


@pytest.mark.parametrize('name', TWO_DRIVES.drives)
def test_what_one_of_two_drives_loses_both_lose(name: str) -> None:
    bench = Bench(TWO_DRIVES).active()
    assert bench.decision.demand == (1.0, 0.5)
    for value in (False, True):
        bench.arbiter.drive_enabled(name, value, bench.now)
    assert f"waits for drive '{name}' to be enabled" in bench.why()
    assert bench.arbiter.status(bench.now).drives_enabled is True  # again
    bench.arbiter.drive_enabled(name, False, bench.now)
    status = bench.arbiter.status(bench.now)
    assert (status.drives_enabled, status.drives_ready) == (False, False)
    bench.arbiter.drive_enabled(name, True, bench.now)
    assert bench.tick().demand == ZERO
    assert bench.decision.state is State.ACTIVE
    outputs = Outputs([bench.decision])
    assert bench.run(TICK, outputs).demand == ZERO
    assert bench.run(0.5, outputs).demand == (1.0, 0.5)


def test_drive_with_a_name_that_was_never_heard_is_waited_for() -> None:
    bench = Bench(TWO_DRIVES)
    bench.drive = None
    bench.ready()
    bench.samples['fort'] = DRIVE
    assert bench.run(1.0).demand == ZERO
    assert bench.decision.state is State.ACTIVE
    assert "drive 'front' is silent: never heard, limit 250 ms: start its node" in bench.why()
    bench.arbiter.drive_enabled('front', True, bench.now)
    assert "waits for drive 'rear' to be enabled" in bench.why()


@pytest.mark.parametrize('value', [0.0, -1.0, math.nan, math.inf])
def test_timeout_that_is_none_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match='drive_timeout'):
        replace(CONFIG, drives=('',), drive_timeout=value)


LIMIT = JointLimit(magnitude=1.0, acceleration=5.0, deceleration=10.0)
SMALL = MuxConfig(
    joints=1,
    sources=(EStopSource('stop'),),
    operators=(Operator('fort', 1),),
    neutral_time=0.25,
    drives=('',),
    drive_timeout=0.1,
)


@given(
    st.lists(
        st.tuples(st.sampled_from([(), (True,), (False,), (False, True), (True, False)]),
                  st.sampled_from([0.0, 0.001, 0.01, 0.1])),
        max_size=60,
    )
)  # fmt: skip
def test_whatever_a_drive_says_it_starts_at_rest_and_never_steps_up(
    story: list[tuple[tuple[bool, ...], float]],
) -> None:
    arbiter, now = Arbiter(SMALL, JointLimiter([LIMIT]), 0.0), 0.0

    def hear(sample: OperatorSample) -> None:
        arbiter.estop_message('stop', False, now)
        arbiter.operator_sample('fort', sample, now)

    for _ in range(60):
        now += 0.01
        hear(REST_1)
        arbiter.tick(now)
    assert arbiter.reset(now).ok
    for _ in range(30):
        now += 0.01
        hear(REST_1)
        arbiter.tick(now)
    hear(DRIVE_1)
    arbiter.drive_enabled('', False, now)
    outputs = [(False, 0.0, arbiter.tick(now).demand[0])]
    heard, value = now, False
    for words, dt in story:
        now += dt
        hear(DRIVE_1)
        gap = bool(words) and not now < heard + 0.1
        for value in words:
            arbiter.drive_enabled('', value, now)
            heard = now
        ready = value and now < heard + 0.1 and False not in words and not gap
        outputs.append((ready, dt, arbiter.tick(now).demand[0]))
    for (was_ready, _, before), (ready, dt, after) in pairwise(outputs):
        assert after == 0.0 or (ready and was_ready), 'motion without a drive, or its first output'
        assert after - before <= LIMIT.acceleration * dt + 1e-9, 'a step'


REST_1 = OperatorSample(neutral=True, deadman=False, demand=(0.0,))
DRIVE_1 = OperatorSample(neutral=False, deadman=True, demand=(1.0,))
