# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What holds at the edge: at equal times, in the very next call, and after what was wrong."""

from dataclasses import replace
import math

import pytest

from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import AUTONOMY, EStopSource, Reply, SpeedLimit, State
from stage import safety_mux_bench
from stage.safety_mux_bench import assert_stopped, Bench, CONFIG, DRIVE, OFF, REST

TICK = 1 / 128  # s; sums of it are exact


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    """Give a bench with times that can be equal."""
    monkeypatch.setattr(safety_mux_bench, 'TICK', TICK)
    return Bench()


# Resets.


@pytest.mark.parametrize(('wait', 'counts'), [(0.5 - TICK, False), (0.5, True)])
def test_reset_counts_from_clear_time_after_a_refused_one(
    bench: Bench, wait: float, counts: bool
) -> None:
    bench.samples['fort'] = OFF
    bench.run(1.0)
    assert not bench.reset().ok
    bench.samples['fort'] = REST
    bench.run(wait)
    assert bench.reset().ok == counts


@pytest.mark.parametrize(('wait', 'counts'), [(0.5 - TICK, False), (0.5, True)])
def test_reset_counts_from_clear_time_after_the_last_stop(
    bench: Bench, wait: float, counts: bool
) -> None:
    bench.run(1.0)
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.tick()
    bench.send()
    bench.run(TICK)  # the first tick without a stop
    bench.run(wait)
    assert bench.reset().ok == counts


@pytest.mark.parametrize(('wait', 'counts'), [(5.0 - TICK, False), (5.0, True)])
def test_reset_counts_from_reset_silence_after_one_in_vain(
    bench: Bench, wait: float, counts: bool
) -> None:
    bench.ready()
    assert not bench.reset().ok
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.run(wait)
    assert bench.decision.state is State.STOPPED
    assert bench.reset().ok == counts


LATE = 'it may have waited'


def test_late_reset_resets_nothing_and_is_no_reset_in_vain(bench: Bench) -> None:
    bench.run(1.0)
    assert bench.arbiter.reset(bench.now, LATE) == Reply(False, f'not reset: {LATE}')
    assert bench.reset().ok


def test_late_reset_in_ready_is_one_in_vain(bench: Bench) -> None:
    bench.ready()
    assert not bench.arbiter.reset(bench.now, LATE).ok
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.run(1.0)
    assert 'resets have been called since before the stop' in bench.reset().message


def test_late_reset_keeps_a_line_of_resets_in_vain_going(bench: Bench) -> None:
    bench.ready()
    assert not bench.reset().ok
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.run(5.0)  # the one of now would count
    assert not bench.arbiter.reset(bench.now, LATE).ok
    bench.run(1.0)
    assert 'resets have been called since before the stop' in bench.reset().message


def test_reset_that_is_refused_for_something_else_ends_a_line_of_resets_in_vain(
    bench: Bench,
) -> None:
    bench.ready()
    assert not bench.reset().ok
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.samples['fort'] = OFF
    bench.run(5.0)
    assert 'not at neutral' in bench.reset().message
    bench.samples['fort'] = REST
    bench.run(0.5)
    assert bench.reset().ok


def test_clear_since_is_the_first_tick_without_a_stop(bench: Bench) -> None:
    bench.run(1.0)
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.tick()
    assert bench.arbiter.clear_since == -math.inf
    bench.send()
    bench.run(TICK)
    clear = bench.now
    bench.run(0.25)
    assert bench.arbiter.clear_since == clear


def test_what_one_arbiter_alone_has_is_taken_over_by_none(bench: Bench) -> None:
    limited = replace(CONFIG, drives=('',), speed_limits=(SpeedLimit('zone'),))
    other = Bench(limited)
    for one, before in ((other, bench), (bench, other)):
        one.arbiter.continue_from(before.arbiter, one.now)
    assert other.ready().decision.state is State.READY


def test_first_call_of_all_may_be_a_reset_and_is_in_vain() -> None:
    arbiter = Bench().arbiter
    assert not arbiter.reset(0.0).ok


# What has not been heard, and what was heard first.


@pytest.mark.parametrize(('wait', 'counts'), [(0.5 - TICK, False), (0.5, True)])
def test_clear_time_begins_in_the_tick_of_the_first_messages(
    bench: Bench, wait: float, counts: bool
) -> None:
    bench.run(TICK)
    bench.run(wait)
    assert bench.reset().ok == counts


TWO = replace(
    CONFIG, sources=(EStopSource('fort', own_topic=True), EStopSource('vm110', own_topic=True))
)


def sources_clear(arbiter: Arbiter, now: float, *, own: bool = True, main: bool = True) -> None:
    """Have all say that they are clear; of fort, only these topics."""
    for name in ('fort', 'vm110'):
        if main or name != 'fort':
            arbiter.estop_message(name, False, now)
        if own or name != 'fort':
            arbiter.own_estop_message(name, False, now)


def test_no_device_is_asked_to_stop_once_all_were_heard() -> None:
    bench = Bench(TWO)
    arbiter = Arbiter(TWO, JointLimiter([JointLimit(1.0, 1.0, 1.0)] * 2), 0.0)
    sources_clear(arbiter, 0.0)
    assert not any(arbiter.tick(0.0).stop_demand.values())
    assert all(bench.decision.stop_demand.values())


def test_own_topic_of_a_source_that_does_not_count_is_no_stop_of_others() -> None:
    spare = EStopSource('spare', counts='when_owner', operator='senior', own_topic=True)
    bench = Bench(replace(CONFIG, sources=(EStopSource('fort'), spare)))
    bench.estops['spare'] = bench.samples['senior'] = None  # switched off while nobody uses it
    bench.ready()
    assert not any(bench.decision.stop_demand.values())
    assert 'asked to stop' not in bench.why()


@pytest.mark.parametrize('silent', ['own', 'main'])
def test_source_of_which_a_topic_is_silent_may_demand_a_stop_by_itself(silent: str) -> None:
    bench = Bench(TWO)
    for now in (0.0, 0.1, 0.2, 0.3):
        said = {silent: now == 0.0}
        sources_clear(bench.arbiter, now, **said)
        demand = bench.arbiter.tick(now).stop_demand
        assert demand == {'fort': False, 'vm110': now >= 0.25}


def test_what_a_source_said_of_itself_before_a_freeze_does_not_count() -> None:
    bench = Bench(TWO)
    sources_clear(bench.arbiter, 0.0)
    assert not any(bench.arbiter.tick(0.0).stop_demand.values())
    bench.arbiter.tick(0.15)  # more than stall_limit, less than any timeout
    sources_clear(bench.arbiter, 0.15, own=False)
    assert bench.arbiter.tick(0.15).stop_demand == {'fort': False, 'vm110': True}


# Autonomy.


@pytest.mark.parametrize('how', ['malformed', 'not finite', 'two publishers'])
def test_autonomy_collects_no_rest_while_it_is_invalid(bench: Bench, how: str) -> None:
    bench.run(1.0)
    assert bench.reset().ok
    bench.tick()
    bench.run(0.2)
    arbiter, now = bench.arbiter, bench.now
    if how == 'malformed':
        arbiter.malformed('autonomy', 'autonomy', 'a test', now)
    elif how == 'not finite':
        arbiter.autonomy_command((0.0, math.nan), now)
    else:
        arbiter.set_invalid('autonomy', AUTONOMY, 'publishers', 'a test')
        bench.run(0.5)
        assert 'a test' in arbiter.select_autonomy(True, bench.now).message
        arbiter.set_invalid('autonomy', AUTONOMY, 'publishers', None)
    bench.run(0.2)
    reply = arbiter.select_autonomy(True, bench.now)
    assert not reply.ok
    assert 'has asked for zero for' in reply.message
    bench.run(0.3)
    assert arbiter.select_autonomy(True, bench.now).ok


@pytest.mark.parametrize('asked', [None, math.inf, -1e300, 1.001e6], ids=str)
def test_senseless_command_of_autonomy_that_drives_stops(asked: float | None) -> None:
    bench = Bench().active('autonomy')
    if asked is None:
        bench.arbiter.malformed('autonomy', 'autonomy', 'a test', bench.now)
    else:
        bench.arbiter.autonomy_command((0.0, asked), bench.now)
        assert (
            f'autonomy is invalid: its demand is {"not" if asked > 1e9 else "beyond"}'
            in bench.why()
        )
    bench.send()  # a good one follows at once
    assert_stopped(bench.tick())


def test_autonomy_is_not_selected_in_the_tick_of_the_reset(bench: Bench) -> None:
    bench.run(2.0)
    assert bench.reset().ok
    assert not bench.arbiter.select_autonomy(True, bench.now).ok
    bench.run(1.0)
    assert bench.arbiter.select_autonomy(True, bench.now).ok


@pytest.mark.parametrize('how', ['deselected', 'taken over'])
def test_zero_that_autonomy_asked_for_in_control_is_no_rest(bench: Bench, how: str) -> None:
    bench.ready()
    assert bench.arbiter.select_autonomy(True, bench.now).ok
    bench.run(1.0)  # with commands of zero
    if how == 'deselected':
        assert bench.arbiter.select_autonomy(False, bench.now).ok
    else:
        bench.arbiter.operator_sample('fort', DRIVE, bench.now)
        assert bench.tick().owner == 'fort'
        bench.arbiter.operator_sample('fort', REST, bench.now)
    assert bench.tick().state is State.READY
    assert 'has asked for zero for' in bench.arbiter.select_autonomy(True, bench.now).message


# What was wrong, and is over.


@pytest.mark.parametrize('name', ['fort', 'senior'])
def test_fault_of_an_operator_that_is_over_stops_nobody_later(bench: Bench, name: str) -> None:
    bench.run(0.5)
    bench.arbiter.malformed('operator', name, 'a test', bench.now)
    bench.run(1.0)
    bench.active(name)
    bench.run(1.0)
    assert bench.decision.owner == name


def test_what_a_source_demanded_by_itself_is_demanded_of_the_others_once() -> None:
    """Even if it came and went between two ticks."""
    sources = (EStopSource('fort', own_topic=True), EStopSource('vm110', own_topic=True))
    bench = Bench(replace(CONFIG, sources=sources))

    def own(value: bool) -> None:
        for source in sources:
            bench.arbiter.own_estop_message(source.name, value, bench.now)

    bench.run(0.1)
    own(False)
    assert not any(bench.tick().stop_demand.values())
    bench.arbiter.own_estop_message('fort', True, bench.now)
    bench.arbiter.own_estop_message('fort', False, bench.now)
    assert bench.tick().stop_demand == {'fort': False, 'vm110': True}
    assert not any(bench.tick().stop_demand.values())


def test_words_of_a_sources_diagnostics_are_passed_on_while_they_are_given(bench: Bench) -> None:
    bench.estops['fort'] = True
    bench.run(0.5)
    bench.arbiter.explain('e-stop source', 'fort', 'pull the button')
    assert "e-stop source 'fort' demands a stop: pull the button" in bench.why()
    bench.arbiter.explain('e-stop source', 'fort', '')
    assert 'demands a stop: see /diagnostics' in bench.why()


def test_deadman_that_is_held_all_along_gets_control_once(bench: Bench) -> None:
    bench.active()
    bench.samples['fort'] = DRIVE
    bench.run(0.5)
    assert bench.decision.owner == 'fort'
    bench.samples['fort'] = REST
    bench.run(0.1)
    bench.samples['fort'] = DRIVE
    bench.run(1.0)
    assert bench.decision.state is State.READY
