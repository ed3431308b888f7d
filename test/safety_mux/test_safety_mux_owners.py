# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rules 4 to 7: who gets control, and how it ends."""

from dataclasses import replace
from itertools import pairwise
import math

import pytest

from safety_mux.owners import AutonomyInput
from safety_mux.protocol import Autonomy, Decision, Operator, OperatorSample, State
from stage.safety_mux_bench import (
    assert_stopped,
    BACK,
    Bench,
    CONFIG,
    DRIVE,
    HALF,
    HELD,
    OFF,
    REST,
    TICK,
)

# Rule 4: a reset never moves anything; motion needs a new acquire.


def test_reset_alone_moves_nothing() -> None:
    def still(decision: Decision) -> None:
        assert not decision.enable
        assert decision.demand == (0.0, 0.0)

    bench = Bench()
    bench.run(0.6)
    assert bench.reset().ok
    assert bench.run(5.0, still).state is State.READY


@pytest.mark.parametrize('gap', [0.3, 0.26, 0.25, 0.1])
def test_two_samples_are_no_rest_however_far_apart(gap: float) -> None:
    bench = Bench(replace(CONFIG, neutral_time=0.25))
    bench.run(0.6)
    assert bench.reset().ok
    for doing, pause in ((REST, gap), (REST, 0.01), (DRIVE, 0.01)):
        bench.samples['fort'] = None
        bench.arbiter.operator_sample('fort', doing, bench.now)
        assert bench.run(pause).state is State.READY


def test_deadman_pressed_before_neutral_time_is_forgotten() -> None:
    bench = Bench()
    bench.run(0.6)
    assert bench.reset().ok
    bench.run(0.2)
    bench.samples['fort'] = DRIVE
    assert bench.run(2.0).state is State.READY
    assert "operator 'fort' held its deadman before it could count: release it" in bench.why()


def test_silence_is_not_neutral() -> None:
    bench = Bench()
    bench.samples['fort'] = None
    bench.ready()
    bench.run(2.0)
    bench.arbiter.operator_sample('fort', REST, bench.now)
    bench.run(0.2)  # within the timeout, but not one more sample
    bench.samples['fort'] = DRIVE
    assert bench.run(0.5).state is State.READY


def test_stick_off_neutral_before_the_deadman_begins_neutral_time_anew() -> None:
    bench = Bench().ready()
    bench.samples['fort'] = OFF
    bench.run(0.1)
    assert "operator 'fort' has not been neutral" in bench.why()
    bench.samples['fort'] = DRIVE
    assert bench.run(1.0).state is State.READY


def test_deadman_of_two_buttons_pressed_one_after_the_other_counts() -> None:
    bench = Bench().ready()
    bench.samples['fort'] = HALF
    bench.run(0.1)
    bench.samples['fort'] = DRIVE
    assert bench.run(0.1).state is State.ACTIVE


def test_half_a_deadman_is_no_rest() -> None:
    bench = Bench().ready()
    bench.samples['fort'] = OFF
    bench.run(0.1)
    bench.samples['fort'] = HALF
    bench.run(2.0)
    bench.samples['fort'] = REST
    bench.run(0.1)
    bench.samples['fort'] = DRIVE
    assert bench.run(0.5).state is State.READY


def test_operator_found_invalid_while_resting_begins_anew() -> None:
    bench = Bench().ready()
    bench.arbiter.set_invalid('operator', 'fort', 'publishers', 'two publishers are alive')
    bench.run(1.0)
    bench.arbiter.set_invalid('operator', 'fort', 'publishers', None)
    bench.samples['fort'] = DRIVE
    assert bench.run(0.5).state is State.READY


# Rule 5: what was asked before a stop is forgotten.


def test_deadman_held_through_stop_and_reset_moves_nothing() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.tick()
    bench.run(1.0)
    assert not bench.reset().ok  # the operator is not at neutral
    bench.samples['fort'] = None  # so he holds it and falls silent
    bench.run(1.0)
    assert bench.reset().ok
    bench.samples['fort'] = DRIVE
    assert bench.run(2.0).state is State.READY


def test_first_output_after_a_stop_is_zero_and_ramps_from_there() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('fort', True, bench.now)
    assert_stopped(bench.tick())
    bench.samples['fort'] = REST
    bench.ready()
    seen: list[Decision] = []
    bench.samples['fort'] = DRIVE
    bench.run(0.2, seen.append)
    active = [decision.demand[0] for decision in seen if decision.enable]
    assert active[0] == 0.0
    assert active[1] == pytest.approx(10.0 * TICK)


def test_autonomy_is_not_selected_any_more_after_a_stop() -> None:
    bench = Bench().active('autonomy')
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.tick()
    bench.ready()
    assert bench.run(1.0).state is State.READY


# Rule 6: a lost owner stops the machine.


@pytest.mark.parametrize('owner', ['fort', 'senior', 'autonomy'])
def test_silent_owner_stops_and_hands_over_to_nobody(owner: str) -> None:
    bench = Bench().active(owner)
    if owner == 'autonomy':
        bench.autonomy = None
    else:
        bench.samples[owner] = None
    assert_stopped(bench.run(0.4))
    assert 'the owner was lost' in bench.reason()


def test_owner_with_a_gap_between_ticks_is_lost() -> None:
    bench = Bench(replace(CONFIG, stall_limit=1.0, operators=(Operator('fort', 1, 0.1),),
                          sources=CONFIG.sources[:2])).active()  # fmt: skip
    bench.now += 0.2
    bench.send()
    assert_stopped(bench.tick())
    assert 'the owner was lost' in bench.reason()


def test_release_is_zero_and_disabled_at_once_and_hands_over_to_nobody() -> None:
    bench = Bench().active()
    bench.arbiter.operator_sample('fort', REST, bench.now)
    bench.arbiter.operator_sample('fort', DRIVE, bench.now)  # pressed again in the same tick
    decision = bench.tick()
    assert decision.state is State.READY
    assert not decision.enable
    assert decision.demand == (0.0, 0.0)
    assert bench.run(1.0).owner is None


# Rule 7: takeover.


def test_takeover_passes_through_zero_under_the_rate_limit() -> None:
    bench = Bench().active()
    values = [bench.decision.demand[0]]
    bench.samples['senior'] = BACK
    bench.run(0.5, lambda decision: values.append(decision.demand[0]))
    assert bench.decision.owner == 'senior'
    assert values[-1] == -1.0
    assert 0.0 in values
    steps = [abs(after - before) for before, after in pairwise(values)]
    assert max(steps) <= 10.0 * TICK + 1e-9


def test_takeover_with_the_same_demand_still_reaches_zero() -> None:
    bench = Bench().active()
    values: list[float] = []
    bench.samples['senior'] = DRIVE
    bench.run(0.5, lambda decision: values.append(decision.demand[0]))
    assert 0.0 in values
    assert values[-1] == 1.0


def test_releasing_a_takeover_does_not_hand_back() -> None:
    bench = Bench().active()
    bench.samples['senior'] = DRIVE
    bench.run(0.7)
    bench.samples['senior'] = REST
    assert bench.run(1.0).state is State.READY  # fort still holds its deadman


def test_lower_operator_does_not_take_over() -> None:
    bench = Bench().active('senior')
    bench.samples['fort'] = DRIVE
    assert bench.run(1.0).owner == 'senior'


def test_higher_operator_that_comes_back_with_its_deadman_pressed_ends_control() -> None:
    """Whether it was pressed anew nobody saw; nobody drives on against it."""
    bench = Bench().ready()
    bench.samples['senior'] = DRIVE
    bench.run(0.1)
    bench.samples['senior'] = None
    bench.run(1.0)
    bench.ready()
    bench.samples['fort'] = DRIVE
    assert bench.run(0.7).owner == 'fort'
    bench.samples['senior'] = DRIVE
    assert bench.run(0.5).state is State.READY
    assert not any(bench.decision.demand)


@pytest.mark.parametrize('again', [DRIVE, HELD])
def test_deadman_of_a_higher_operator_after_malformed_messages_ends_control(
    again: OperatorSample,
) -> None:
    bench = Bench().ready()
    for doing in (OFF, again, None):  # without effect
        bench.samples['senior'] = doing
        bench.run(0.1)

    def malformed(decision: Decision) -> None:
        bench.arbiter.malformed('operator', 'senior', 'axis 2 is 1.06', bench.now)

    bench.run(0.5, malformed)
    bench.samples['fort'] = DRIVE
    assert bench.run(0.7, malformed).owner == 'fort'
    bench.samples['senior'] = again
    assert bench.run(0.5).state is State.READY
    assert "operator 'senior' pressed its deadman before it could count" in bench.reason()


def test_stick_that_is_off_neutral_amid_malformed_messages_ends_no_control() -> None:
    bench = Bench().ready()
    bench.samples['senior'] = OFF
    bench.run(0.5)
    bench.samples['fort'] = DRIVE
    bench.run(0.7)
    bench.arbiter.malformed('operator', 'senior', 'axis 2 is 1.06', bench.now)
    assert bench.run(0.5).owner == 'fort'


def test_no_takeover_within_hold_time() -> None:
    bench = Bench().ready()
    bench.samples['fort'] = DRIVE
    bench.run(0.2)
    bench.samples['senior'] = DRIVE
    assert bench.run(2.0).state is State.READY  # the early edge is forgotten, not queued
    assert 'less than 500 ms after a change of owner' in bench.reason()
    bench.samples['senior'] = REST
    bench.run(0.5)
    bench.samples['senior'] = DRIVE
    assert bench.run(0.1).owner == 'senior'


def test_stick_that_follows_a_press_which_did_not_count_takes_nothing() -> None:
    bench = Bench().ready()
    bench.samples['fort'] = DRIVE
    bench.run(0.2)
    bench.samples['senior'] = HELD  # within hold_time
    bench.run(2.0)
    bench.samples['senior'] = DRIVE
    assert bench.run(1.0).state is State.READY
    assert not any(bench.decision.demand)


@pytest.mark.parametrize('owner', ['fort', 'autonomy'])
@pytest.mark.parametrize(
    ('doing', 'why'),
    [
        (OFF, "operator 'senior' moved its sticks"),
        (HELD, "operator 'senior' pressed its deadman, which did not count"),
        (DRIVE, "operator 'senior' pressed its deadman, which did not count"),
    ],
    ids=['stick', 'deadman', 'both'],
)
def test_higher_operator_without_effect_ends_control_on_a_ramp(
    owner: str, doing: OperatorSample, why: str
) -> None:
    bench = Bench().active(owner)
    bench.arbiter.set_invalid('e-stop source', 'spare', 'test', 'it is')  # of senior
    bench.samples['senior'] = doing
    bench.arbiter.operator_sample('senior', doing, bench.now)
    demands = [1.0]
    bench.run(0.06, lambda decision: demands.append(decision.demand[0]))
    assert all(0.0 < later < earlier for earlier, later in pairwise(demands))
    assert bench.decision.owner == owner
    assert f'is losing control: {why}' in bench.why()
    decision = bench.run(0.2)
    assert (decision.state, decision.enable, decision.demand) == (State.READY, False, (0.0, 0.0))
    assert why in bench.reason()
    assert bench.run(2.0).state is State.READY  # the lower deadman, held on, does not count


def test_deadman_pressed_after_the_stick_ends_control() -> None:
    bench = Bench().ready()
    bench.samples['senior'] = OFF  # and stays so: no reason to lock out who takes control now
    bench.run(0.5)
    bench.samples['fort'] = DRIVE
    assert bench.run(1.0).owner == 'fort'
    bench.samples['senior'] = DRIVE
    assert bench.run(0.5).state is State.READY
    assert "operator 'senior' pressed its deadman before it could count" in bench.reason()
    assert "operator 'senior' held its deadman before it could count: release it" in bench.why()


def test_lower_operator_ends_nobodys_control() -> None:
    bench = Bench().active('senior')
    for doing in (OFF, HELD, REST, DRIVE):
        bench.samples['fort'] = doing
        assert bench.run(0.5).owner == 'senior'


@pytest.mark.parametrize('doing', [OFF, DRIVE])
def test_blip_between_two_ticks_ends_control(doing: OperatorSample) -> None:
    bench = Bench().active()
    bench.arbiter.operator_sample('senior', doing, bench.now)
    bench.arbiter.operator_sample('senior', REST, bench.now)
    assert bench.run(0.3).state is State.READY


@pytest.mark.parametrize('doing', [OFF, DRIVE])
def test_act_in_the_tick_of_the_selection_leaves_autonomy_no_control(
    doing: OperatorSample,
) -> None:
    bench = Bench().ready()
    assert bench.arbiter.select_autonomy(True, bench.now).ok
    bench.arbiter.operator_sample('fort', doing, bench.now)
    assert bench.tick().state is State.READY
    assert not bench.decision.enable


def test_takeover_that_counts_wins_over_the_ramp() -> None:
    bench = Bench().active('autonomy')
    bench.arbiter.operator_sample('senior', OFF, bench.now)
    bench.run(0.01)
    bench.samples['fort'] = DRIVE
    assert bench.run(0.05).owner == 'fort'
    assert bench.run(1.0).demand == (1.0, 0.5)


def test_operator_with_two_publishers_gets_no_control_but_ends_it() -> None:
    bench = Bench().active()
    bench.arbiter.set_invalid('operator', 'senior', 'publishers', 'two are live')
    assert bench.run(1.0).owner == 'fort'
    bench.samples['senior'] = DRIVE
    assert bench.run(1.0).state is State.READY


def test_half_a_deadman_ends_no_control() -> None:
    bench = Bench().active()
    bench.samples['senior'] = HALF
    assert bench.run(1.0).owner == 'fort'
    bench.samples['senior'] = DRIVE
    assert bench.run(0.1).owner == 'senior'


def test_stop_on_the_ramp_of_a_lost_control_latches() -> None:
    for source, state in (('fort', State.STOPPED), ('gate', State.STOPPING)):
        bench = Bench().active()
        bench.arbiter.operator_sample('senior', OFF, bench.now)
        assert bench.run(0.03).owner == 'fort'
        bench.arbiter.estop_message(source, True, bench.now)
        assert bench.tick().state is state
        assert bench.run(1.0).state is State.STOPPED


def test_person_takes_over_from_autonomy_at_once() -> None:
    bench = Bench().ready()
    assert bench.arbiter.select_autonomy(True, bench.now).ok
    bench.run(0.05)
    bench.samples['fort'] = DRIVE
    assert bench.run(0.1).owner == 'fort'
    bench.samples['fort'] = REST
    assert bench.run(1.0).owner is None, 'a release never hands over to autonomy'


# Autonomy.


def test_autonomy_needs_commands_of_zero_first() -> None:
    bench = Bench().ready()
    bench.autonomy = (1.0, 0.0)
    bench.run(0.2)
    reply = bench.arbiter.select_autonomy(True, bench.now)
    assert not reply.ok
    assert 'autonomy has asked for zero for 0 ms of 300 ms' in reply.message


@pytest.mark.parametrize('silent', [True, False])
def test_autonomy_silent_or_senseless_cannot_be_selected(silent: bool) -> None:
    bench = Bench().ready()
    bench.autonomy = None if silent else (math.nan, 0.0)
    bench.run(0.5)
    assert not bench.arbiter.select_autonomy(True, bench.now).ok


@pytest.mark.parametrize(('gap', 'rested'), [(4.0, False), (0.26, False), (0.2, True)])
def test_silence_of_autonomy_within_its_timeout_is_no_rest(gap: float, rested: bool) -> None:
    bench = Bench(replace(CONFIG, neutral_time=0.25, autonomy=Autonomy(timeout=5.0)))
    bench.autonomy = None
    bench.ready()
    for pause in (gap, gap, 0.0):
        bench.arbiter.autonomy_command((0.0, 0.0), bench.now)
        bench.run(pause)
    assert bench.arbiter.select_autonomy(True, bench.now).ok is rested


def test_autonomy_that_rested_and_fell_silent_is_not_selected() -> None:
    """It may hang, and go on with a demand when it wakes up."""
    bench = Bench(replace(CONFIG, neutral_time=0.25, autonomy=Autonomy(timeout=5.0))).ready()
    bench.autonomy = None
    bench.run(0.26)
    reply = bench.arbiter.select_autonomy(True, bench.now)
    assert not reply.ok
    assert 'silence is no rest' in reply.message
    assert 'silence is no rest' in bench.why()
    bench.arbiter.autonomy_command((0.0, 0.0), bench.now)
    bench.run(0.1)
    assert not bench.arbiter.select_autonomy(True, bench.now).ok


def test_rest_of_autonomy_ends_with_silence_as_long() -> None:
    autonomy = AutonomyInput(Autonomy(timeout=5.0), neutral_time=0.25)
    for now in (0.0, 0.125, 0.25):
        autonomy.command((0.0, 0.0), now)
    assert autonomy.rests(0.4375)
    assert not autonomy.rests(0.5)


def test_autonomy_is_not_selected_while_stopped_and_not_queued() -> None:
    bench = Bench()
    bench.run(0.6)
    assert not bench.arbiter.select_autonomy(True, bench.now).ok
    bench.ready()
    assert bench.run(1.0).state is State.READY


def test_autonomy_is_not_selected_while_a_deadman_is_held() -> None:
    bench = Bench().ready()
    bench.samples['fort'] = OFF
    bench.run(0.1)
    bench.samples['fort'] = HELD
    bench.run(0.1)
    assert not bench.arbiter.select_autonomy(True, bench.now).ok


def test_autonomy_that_has_control_is_not_selected_again() -> None:
    bench = Bench().active('autonomy')
    bench.autonomy = (0.0, 0.0)
    bench.run(0.5)
    assert not bench.arbiter.select_autonomy(True, bench.now).ok


def test_stop_and_deselect_in_one_tick_leave_no_ramp() -> None:
    bench = Bench().active('autonomy')
    bench.arbiter.estop_message('gate', True, bench.now)
    bench.arbiter.select_autonomy(False, bench.now)
    assert_stopped(bench.tick())
    assert 'autonomy was deselected' in bench.reason()


def test_deselected_autonomy_is_zero_at_once() -> None:
    bench = Bench().active('autonomy')
    assert bench.arbiter.select_autonomy(False, bench.now).ok
    decision = bench.tick()
    assert (decision.state, decision.demand) == (State.READY, (0.0, 0.0))


def test_without_autonomy_there_is_nothing_to_select() -> None:
    bench = Bench(replace(CONFIG, autonomy=None)).ready()
    assert not bench.arbiter.select_autonomy(True, bench.now).ok
    with pytest.raises(KeyError):
        bench.arbiter.autonomy_command((0.0, 0.0), bench.now)
