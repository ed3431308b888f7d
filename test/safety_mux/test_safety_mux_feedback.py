# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measured speeds: zero is when the joints stand, and motion that nobody asked for is a stop."""

from collections.abc import Callable
from dataclasses import replace
import math

from hypothesis import given, strategies as st
import pytest

from safety_mux.feedback import FeedbackInput
from safety_mux.protocol import Decision, Feedback, MuxConfig, OperatorSample, State
from stage.safety_mux_bench import (
    assert_stopped,
    BACK,
    Bench,
    CONFIG,
    DRIVE,
    HELD,
    OFF,
    REST,
    TICK,
)

FEEDBACK = Feedback(('left', 'right'), standstill=0.1, overspeed_tolerance=0.5, overspeed_time=0.2)
WITH_FEEDBACK = replace(CONFIG, feedback=FEEDBACK)
STOP_TIME = CONFIG.stop_time
EVERYONE = {'fort': True, 'gate': True, 'spare': True}
NOBODY = dict.fromkeys(EVERYONE, False)
PROMPT = 100.0  # rad/s a second


class Machine(Bench):
    """A bench whose joints follow the command at ``rate``, and say so; at 0 they run on."""

    def __init__(self, config: MuxConfig = WITH_FEEDBACK) -> None:
        self.speeds = (0.0, 0.0)
        self.rate = PROMPT
        self.reports = True
        super().__init__(config)

    def run(self, seconds: float, check: Callable[[Decision], None] | None = None) -> Decision:
        for _ in range(round(seconds / TICK)):
            most = self.rate * TICK
            pairs = zip(self.speeds, self.decision.demand, strict=True)
            self.speeds = tuple(v + min(max(goal - v, -most), most) for v, goal in pairs)  # type: ignore[assignment]
            if self.reports:
                self.arbiter.measured(self.speeds, self.now)
            super().run(TICK, check)
        return self.decision

    def stands(self) -> bool:
        return max(map(abs, self.speeds)) <= FEEDBACK.standstill


# Zero is reached when the joints stand.


@pytest.mark.parametrize('former', ['fort', 'autonomy'])
def test_takeover_waits_for_the_joints_to_stand(former: str) -> None:
    bench = Machine().active(former)
    assert isinstance(bench, Machine)
    bench.rate = 4.0
    bench.samples['senior'] = BACK
    stood = False

    def check(decision: Decision) -> None:
        nonlocal stood
        stood |= decision.owner == 'senior' and bench.stands()
        if decision.owner == 'senior':
            assert stood or min(decision.demand) >= 0.0, 'the other way before standstill'

    bench.run(0.2, check)
    assert bench.decision.demand == (0.0, 0.0)
    assert 'passes through zero first; waiting for standstill, left at 0.' in bench.why()
    bench.run(0.5, check)
    assert bench.decision.demand == (-1.0, -0.5)


def test_overruled_owner_loses_control_when_the_joints_stand() -> None:
    bench = Machine()
    bench.active()
    bench.rate = 4.0
    bench.samples['senior'] = OFF
    bench.run(0.15)
    assert (bench.decision.state, bench.decision.demand) == (State.ACTIVE, (0.0, 0.0))
    assert 'moved its sticks; waiting for standstill, left at 0.' in bench.why()
    bench.run(0.2, lambda decision: _ready_only_at_rest(bench, decision))
    assert bench.decision.state is State.READY


def _ready_only_at_rest(bench: Machine, decision: Decision) -> None:
    assert decision.state is State.ACTIVE or bench.stands()


def test_stop_of_category_1_ends_when_the_joints_stand() -> None:
    bench = Machine()
    bench.active()
    bench.rate = 4.0
    bench.arbiter.estop_message('gate', True, bench.now)
    assert bench.tick().state is State.STOPPING
    assert 'stopping on a ramp: ' in bench.why()
    assert '; ramping, left at 1.0 rad/s' in bench.why()
    bench.run(0.15)
    assert (bench.decision.state, bench.decision.demand) == (State.STOPPING, (0.0, 0.0))
    assert bench.decision.enable, 'a drive that is disabled does not brake'
    assert '; waiting for standstill, left at 0.' in bench.why()
    bench.run(0.15)
    assert_stopped(bench.decision)
    assert bench.stands()
    assert 'the ramp has ended, after: ' in bench.reason()


def test_what_is_left_is_said_of_a_ramp_of_one_joint_and_of_nothing_at_rest() -> None:
    bench = Machine()
    bench.ready()
    assert 'standstill' not in bench.why()
    bench.samples['fort'] = replace(DRIVE, demand=(1.0, 0.0))
    bench.run(0.3)
    bench.arbiter.estop_message('gate', True, bench.now)
    bench.tick()
    assert bench.why().endswith('; ramping, left at 1.0 rad/s')


def test_stop_of_category_1_disables_after_stop_time_whatever_the_joints_do() -> None:
    slow = replace(FEEDBACK, overspeed_time=5.0)
    bench = Machine(replace(CONFIG, feedback=slow))
    bench.active()
    bench.rate = 0.0
    bench.arbiter.estop_message('gate', True, bench.now)
    bench.tick()
    assert bench.run(STOP_TIME - TICK).state is State.STOPPING
    bench.run(2 * TICK)
    assert_stopped(bench.decision)
    assert 'the ramp has ended, left at 1.0 rad/s, after: ' in bench.reason()


def test_drive_that_drops_out_ends_a_ramp_whatever_the_joints_do() -> None:
    bench = Machine(replace(WITH_FEEDBACK, drives=('',)))
    bench.active()
    bench.rate = 0.0
    bench.arbiter.estop_message('gate', True, bench.now)
    assert bench.tick().state is State.STOPPING
    bench.arbiter.drive_enabled('', False, bench.now)
    assert_stopped(bench.tick())


def test_stop_of_category_1_while_the_joints_run_on_at_zero_command_is_no_cut() -> None:
    bench = Machine()
    bench.active()
    bench.rate = 4.0
    bench.samples['senior'] = BACK  # which brings the command to 0
    bench.run(0.15)
    bench.arbiter.estop_message('gate', True, bench.now)
    assert bench.tick().state is State.STOPPING


# Motion that nobody asked for.


def test_deadman_that_is_pressed_again_and_again_gives_no_more_time_to_stand() -> None:
    bench = Machine(replace(WITH_FEEDBACK, stop_time=1.0))
    bench.active()
    bench.rate = 0.0
    owners = []
    for _ in range(3):
        bench.samples['fort'] = REST
        bench.run(0.45)
        bench.samples['fort'] = HELD
        bench.run(0.15)
        owners.append(bench.decision.owner)
    assert owners[0] == 'fort'
    assert_stopped(bench.decision)
    assert bench.decision.stop_demand == EVERYONE


def test_joints_that_creep_on_as_an_overruled_owner_ends_are_one_whatever_the_drive_says() -> None:
    bench = Machine(replace(WITH_FEEDBACK, drives=('',)))
    bench.active()
    bench.rate, bench.speeds = 0.0, (0.55, 0.55)
    bench.samples['senior'] = OFF
    bench.drive = False  # it has disabled itself, and nothing brakes
    bench.run(1.0)
    assert_stopped(bench.decision)
    assert bench.decision.stop_demand == EVERYONE


@pytest.mark.parametrize('sample', [OFF, HELD], ids=['overruled', 'taken over'])
def test_joints_that_creep_on_at_zero_command_are_a_stop_after_stop_time(
    sample: OperatorSample,
) -> None:
    bench = Machine()
    bench.active()
    bench.rate, bench.speeds = 0.0, (0.55, 0.55)  # no overspeed
    bench.samples['senior'] = sample
    bench.run(0.1 + STOP_TIME)
    assert bench.decision.state is State.ACTIVE
    bench.run(0.2)
    assert_stopped(bench.decision)
    assert bench.decision.stop_demand == EVERYONE


@pytest.mark.parametrize('enabled', [True, False], ids=['asks for zero', 'drive is disabled'])
def test_joints_that_creep_while_their_owner_keeps_control_are_none(enabled: bool) -> None:
    bench = Machine(replace(WITH_FEEDBACK, drives=('',)))
    bench.active()
    bench.rate, bench.speeds = 0.0, (0.55, 0.55)
    bench.drive = enabled
    bench.samples['fort'] = HELD
    bench.run(2.0 * STOP_TIME)
    assert (bench.decision.state, bench.decision.demand) == (State.ACTIVE, (0.0, 0.0))


def test_machine_that_does_not_stop_when_told_stops_all_devices() -> None:
    bench = Machine()
    bench.active()
    bench.rate = 0.0
    bench.samples['fort'] = REST
    bench.run(0.1)
    assert bench.decision.state is State.READY
    assert 'waiting for standstill: left at 1.0 rad/s' in bench.why()
    assert bench.run(STOP_TIME - 0.1).state is State.READY
    assert bench.decision.stop_demand == NOBODY
    bench.run(0.1)
    assert_stopped(bench.decision)
    assert bench.decision.stop_demand == EVERYONE
    assert 'the joints do not stand 500 ms after control: left at 1.0 rad/s' in bench.reason()
    assert bench.arbiter.status(bench.now).last_transition.causes == ('motion',)
    bench.run(1.0)
    assert not bench.reset().ok
    bench.rate = PROMPT
    bench.run(1.0)
    assert bench.decision.stop_demand == NOBODY, 'the demand ends when the joints stand'
    assert bench.reset().ok


def test_refused_reset_ends_no_trip_while_the_joints_run_on() -> None:
    fort, *others = WITH_FEEDBACK.sources
    bench = Machine(replace(WITH_FEEDBACK, sources=(replace(fort, own_topic=True), *others)))
    bench.active()
    bench.rate = 0.0
    bench.arbiter.trip(bench.now)
    bench.samples['fort'] = REST
    bench.estops['fort'] = True  # the echo of the trip

    def reset() -> str:
        bench.arbiter.own_estop_message('fort', False, bench.now)
        bench.run(TICK)
        return bench.reset().message

    bench.run(1.0)
    message = reset()
    assert 'the joints do not stand' in message
    assert 'the trip is ended' not in message
    bench.rate = PROMPT
    bench.run(1.0)
    assert bench.decision.stop_demand == EVERYONE, 'nobody has ended the trip'
    assert 'the trip is ended' in reset()


def test_machine_that_stands_in_time_is_no_stop() -> None:
    bench = Machine()
    bench.active()
    bench.rate = 2.5
    bench.samples['fort'] = REST
    assert bench.run(1.0).state is State.READY


@pytest.mark.parametrize('known', [True, False])
def test_machine_that_is_not_seen_to_stand_after_a_stop_stops_all_devices(known: bool) -> None:
    bench = Machine()
    bench.active()
    bench.rate, bench.reports = 0.0, known
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.tick()
    bench.run(STOP_TIME - 2 * TICK)
    assert bench.decision.stop_demand['fort'] is False
    bench.run(3 * TICK)
    assert bench.decision.stop_demand == EVERYONE
    assert 'the joints do not stand 500 ms after control: ' in bench.why()
    assert ('the feedback is stale' in bench.why()) is not known
    bench.rate, bench.reports = PROMPT, True
    bench.run(0.1)
    assert bench.decision.stop_demand == NOBODY


def test_joint_that_is_faster_than_commanded_stops_after_overspeed_time() -> None:
    bench = Machine()
    bench.active()
    bench.rate, bench.speeds = 0.0, (1.0, 1.1)  # of the right, half was asked
    bench.run(FEEDBACK.overspeed_time)
    assert bench.decision.state is State.ACTIVE
    bench.run(2 * TICK)
    assert_stopped(bench.decision)
    assert "joint 'right' runs at 1.1 rad/s, asked for 0.5" in bench.reason()


def test_joint_that_turns_the_other_way_is_faster_than_commanded() -> None:
    bench = Machine()
    bench.active()
    bench.rate, bench.speeds = 0.0, (1.0, -0.6)
    assert_stopped(bench.run(FEEDBACK.overspeed_time + 2 * TICK))


def test_joint_that_is_too_fast_for_an_instant_is_none() -> None:
    bench = Machine()
    bench.active()
    bench.rate = 0.0
    for _ in range(5):
        bench.speeds = (2.0, 0.5)
        bench.run(FEEDBACK.overspeed_time - TICK)
        bench.speeds = (1.0, 0.5)
        bench.run(TICK)
    assert bench.decision.state is State.ACTIVE


def test_joint_that_lags_behind_a_ramp_is_none() -> None:
    bench = Machine()
    bench.active()
    bench.rate = 5.0
    bench.samples['fort'] = replace(DRIVE, demand=(-1.0, -0.5))
    assert bench.run(1.0).demand == (-1.0, -0.5)


@pytest.mark.parametrize(('speed', 'stops'), [(0.59, False), (0.61, True)])
def test_joint_that_moves_by_itself_while_nobody_has_control(speed: float, stops: bool) -> None:
    bench = Machine()
    bench.ready()
    bench.rate, bench.speeds = 0.0, (0.0, -speed)
    bench.run(FEEDBACK.overspeed_time)
    assert bench.decision.state is State.READY
    bench.run(1.0)
    assert bench.decision.estop is stops
    assert (bench.decision.stop_demand == EVERYONE) is stops
    if stops:
        assert "joint 'right' runs at -0.6 rad/s, asked for 0.0" in bench.reason()


def test_joint_that_creeps_is_no_stop_where_nobody_had_control() -> None:
    bench = Machine()
    bench.rate, bench.speeds = 0.0, (0.3, 0.0)
    bench.ready()
    assert bench.run(2.0 * STOP_TIME).state is State.READY


def test_joint_that_moves_by_itself_when_the_mux_starts_prevents_a_reset() -> None:
    bench = Machine()
    bench.rate, bench.speeds = 0.0, (3.0, 0.0)
    bench.run(1.0)
    assert not bench.reset().ok
    assert "joint 'left' runs at 3.0 rad/s, asked for 0.0" in bench.why()


# Feedback that is lost.


def test_silence_of_feedback_in_motion_stops() -> None:
    bench = Machine()
    bench.active()
    bench.reports = False
    assert bench.run(FEEDBACK.timeout - 2 * TICK).state is State.ACTIVE
    assert_stopped(bench.run(3 * TICK))
    assert 'the feedback is stale: last heard 25' in bench.reason()


@pytest.mark.parametrize('speeds', [(math.nan, 0.0), (0.0, math.inf), (0.0,), ()])
def test_feedback_without_a_number_for_each_joint_stops(speeds: tuple[float, ...]) -> None:
    bench = Machine()
    bench.active()
    bench.arbiter.measured(speeds, bench.now)
    bench.arbiter.measured((1.0, 0.5), bench.now)
    assert_stopped(bench.tick())
    assert 'the feedback is invalid: ' in bench.reason()


def test_feedback_lost_on_a_ramp_cuts_it() -> None:
    bench = Machine()
    bench.active()
    bench.arbiter.estop_message('gate', True, bench.now)
    assert bench.tick().state is State.STOPPING
    bench.arbiter.malformed('feedback', 'feedback', "joint 'left' is not there", bench.now)
    assert_stopped(bench.tick())


def test_nobody_gets_control_without_feedback() -> None:
    bench = Machine()
    bench.ready()
    bench.reports = False
    bench.run(0.4)
    assert bench.decision.state is State.READY
    assert 'the feedback is stale' in bench.why()
    reply = bench.arbiter.select_autonomy(True, bench.now)
    assert (reply.ok, 'the feedback is stale' in reply.message) == (False, True)
    bench.samples['fort'] = DRIVE
    assert bench.run(1.0).state is State.READY
    bench.reports = True
    assert bench.run(1.0).state is State.READY, 'that press is over'


def test_missing_feedback_does_not_prevent_a_reset() -> None:
    bench = Machine()
    bench.reports = False
    bench.run(1.0)
    assert bench.reset().ok


def test_two_live_publishers_of_feedback_are_none() -> None:
    bench = Machine()
    bench.active()
    bench.arbiter.set_invalid('feedback', 'feedback', 'publishers', 'two live publishers')
    assert_stopped(bench.tick())


@pytest.mark.parametrize('jump', [3600.0, -3600.0])
def test_clock_that_jumps_before_standstill_was_seen_stops_all_devices(jump: float) -> None:
    bench = Machine()
    bench.active()
    bench.samples['fort'] = REST
    bench.rate = 0.0
    bench.run(0.1)
    bench.now += jump
    assert bench.tick().stop_demand == EVERYONE


def test_without_feedback_nothing_is_awaited() -> None:
    bench = Bench().active()
    bench.samples['senior'] = BACK
    assert bench.run(0.3).demand == (-1.0, -0.5)
    with pytest.raises(KeyError):
        bench.arbiter.measured((0.0, 0.0), bench.now)


@pytest.mark.parametrize('value', [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize(
    'name', ['timeout', 'standstill', 'overspeed_tolerance', 'overspeed_time']
)
def test_feedback_that_judges_nothing_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        Feedback(('left', 'right'), **{name: value})
    with pytest.raises(ValueError, match='feedback is of 1 joints'):
        replace(CONFIG, feedback=Feedback(('left',)))


@pytest.mark.parametrize('timeout', [0.25, 2.0])  # s; shorter than stop_time, and longer
def test_standstill_that_was_measured_before_the_end_of_control_is_none(timeout: float) -> None:
    bench = Machine(replace(WITH_FEEDBACK, feedback=replace(FEEDBACK, timeout=timeout)))
    bench.rate = 0.0
    bench.ready()
    bench.samples['fort'] = DRIVE
    bench.run(0.0625)
    bench.reports = False
    bench.run(0.1)
    assert any(bench.decision.demand), 'it drives, and was last measured at rest'
    bench.samples['fort'] = REST
    bench.run(0.0625)
    assert bench.decision.state is State.READY
    assert 'waiting for standstill: not measured since' in bench.why()
    bench.run(STOP_TIME)
    assert bench.decision.stop_demand == EVERYONE
    assert 'the joints do not stand 500 ms after control: ' in bench.why()
    bench.reports = True
    bench.run(0.1)
    assert bench.decision.stop_demand == NOBODY


def driving_since_it_was_measured_at_rest() -> Machine:
    bench = Machine(replace(WITH_FEEDBACK, feedback=replace(FEEDBACK, timeout=1.0)))
    bench.rate = 0.0
    bench.ready()
    assert bench.arbiter.select_autonomy(True, bench.now).ok
    bench.run(0.1)
    bench.reports = False
    bench.autonomy = (1.0, 0.5)
    bench.run(0.2)
    assert bench.decision.demand == (1.0, 0.5)
    return bench


def test_takeover_waits_for_a_standstill_that_was_measured_since_the_command_is_zero() -> None:
    bench = driving_since_it_was_measured_at_rest()
    bench.samples['senior'] = BACK
    bench.run(0.3)
    assert (bench.decision.owner, bench.decision.demand) == ('senior', (0.0, 0.0))
    assert 'waiting for standstill, not measured since' in bench.why()
    bench.reports = True
    bench.run(0.2)
    assert bench.decision.demand == (-1.0, -0.5)


def test_ramp_of_category_1_ends_at_a_standstill_that_was_measured_since() -> None:
    bench = driving_since_it_was_measured_at_rest()
    bench.estops['gate'] = True
    bench.run(0.3)
    assert (bench.decision.state, bench.decision.demand) == (State.STOPPING, (0.0, 0.0))
    assert 'waiting for standstill, not measured since' in bench.why()
    bench.reports = True
    bench.run(0.1)
    assert bench.decision.state is State.STOPPED


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
