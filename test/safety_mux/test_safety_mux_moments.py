# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stops, trips and takeovers at the very moment of a limit, and what is said of them."""

from dataclasses import replace
import math

import pytest

from safety_mux.owners import Run
from safety_mux.protocol import EStopSource, Feedback, Operator, State
from stage import safety_mux_bench
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
)

TICK = 1 / 128  # s; sums of it are exact


@pytest.fixture(autouse=True)
def exact_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have times that can be equal."""
    monkeypatch.setattr(safety_mux_bench, 'TICK', TICK)


# Trips, and devices whose stops are their echo.

CHAINED = replace(
    CONFIG,
    sources=(
        EStopSource('fort', own_topic=True),
        EStopSource('vm110', own_topic=True),
        EStopSource('spare', counts='when_owner', operator='senior'),
    ),
)


class Chained(Bench):
    """A bench of which two sources say what they demand by themselves: nothing."""

    def __init__(self, stall_limit: float = 0.1) -> None:
        self.pressed = False  # of fort
        super().__init__(replace(CHAINED, stall_limit=stall_limit))

    def send(self) -> None:
        self.arbiter.own_estop_message('fort', self.pressed, self.now)
        self.arbiter.own_estop_message('vm110', False, self.now)
        super().send()

    def trip(self) -> None:
        """Trip, and have the devices stop for it; one that does not count stops as well."""
        self.arbiter.trip(self.now)
        self.tick()
        self.estops = {'fort': True, 'vm110': True, 'spare': True}

    @property
    def tripped(self) -> bool:
        return self.arbiter.status(self.now).tripped


@pytest.mark.parametrize(('wait', 'ends'), [(0.5 - TICK, False), (0.5, True)])
def test_refused_reset_ends_a_trip_of_which_only_the_echo_is_left(wait: float, ends: bool) -> None:
    bench = Chained()
    bench.ready()
    bench.trip()
    bench.run(wait)
    reply = bench.reset()
    assert not reply.ok
    said = reply.message.startswith('not reset: the trip is ended; call ~/reset again')
    assert said == ends
    assert bench.tripped != ends


@pytest.mark.parametrize('what', ['button', 'stick', 'hold', 'freeze'])
def test_refused_reset_ends_no_trip_while_anything_else_prevents_it(what: str) -> None:
    bench = Chained()
    bench.ready()
    bench.trip()
    bench.pressed = what == 'button'
    if what == 'stick':
        bench.samples['fort'] = OFF
    if what == 'hold':
        bench.arbiter.hold('a test')
    bench.run(1.0)
    if what == 'freeze':
        bench.now += 0.15
    assert not bench.reset().ok
    assert bench.tripped


def test_reset_before_the_tick_of_a_trip_does_not_end_it() -> None:
    bench = Chained(stall_limit=1.0)
    bench.estops['fort'] = True
    bench.run(1.0)
    bench.arbiter.trip(bench.now)
    bench.now += 0.625
    bench.send()
    assert not bench.reset().ok
    assert bench.tripped


def test_reset_that_is_refused_without_a_trip_speaks_of_none() -> None:
    bench = Bench()
    bench.estops['fort'] = True
    bench.run(1.0)
    assert 'trip' not in bench.reset().message
    assert not bench.arbiter.status(bench.now).tripped


@pytest.mark.parametrize(('wait', 'ends'), [(0.5 - TICK, False), (0.5, True)])
def test_trip_is_ended_from_clear_time_on(wait: float, ends: bool) -> None:
    bench = Bench().ready()
    bench.arbiter.trip(bench.now)
    bench.run(wait)
    assert bench.arbiter.end_trip(bench.now).ok == ends


# Stops.


def test_status_keeps_the_first_stop_but_for_a_trip_or_a_freeze() -> None:
    bench = Bench().active()
    bench.estops['fort'] = True
    bench.run(0.5)
    assert "'fort' demands" in bench.reason()
    bench.estops['gate'] = True
    bench.run(0.5)
    assert "'gate'" not in bench.reason()
    bench.arbiter.trip(bench.now, 'a test')
    bench.tick()
    assert 'a test' in bench.reason()
    bench.run(0.5)
    bench.now += 0.15
    bench.tick()
    assert 'frozen' in bench.reason()


@pytest.mark.parametrize(('gap', 'state'), [(0.125, State.ACTIVE), (0.125 + TICK, State.STOPPED)])
def test_gap_of_stall_limit_is_no_freeze(gap: float, state: State) -> None:
    bench = Bench(replace(CONFIG, stall_limit=0.125)).active()
    bench.now += gap
    bench.send()
    assert bench.tick().state is state


def test_stop_of_category_1_without_an_owner_has_nothing_to_ramp() -> None:
    bench = Bench().ready()
    bench.arbiter.estop_message('gate', True, bench.now)
    assert_stopped(bench.tick())
    assert bench.reason().endswith('; nobody had control')


def test_ramp_of_joints_that_run_on_ends_at_stop_time() -> None:
    feedback = Feedback(('left', 'right'), timeout=10.0, overspeed_time=10.0)
    bench = Bench(replace(CONFIG, feedback=feedback))
    bench.arbiter.measured((0.0, 0.0), bench.now)
    bench.active()
    bench.arbiter.measured((1.0, 0.5), bench.now)
    bench.arbiter.estop_message('gate', True, bench.now)
    assert bench.tick().state is State.STOPPING
    assert bench.run(0.5 - TICK).state is State.STOPPING
    assert_stopped(bench.run(TICK))


def test_ramp_of_which_rounding_leaves_a_trace_ends_in_time() -> None:
    bench = Bench(replace(CONFIG, stop_time=5 * TICK)).active()  # 1.0 less five times 0.2
    bench.arbiter.estop_message('gate', True, bench.now)
    assert bench.tick().state is State.STOPPING
    assert 0.0 < 1.0 - 0.2 - 0.2 - 0.2 - 0.2 - 0.2 < 1e-15
    assert_stopped(bench.run(5 * TICK))


def test_release_on_a_ramp_whose_stop_is_over_cuts() -> None:
    bench = Bench().active()
    for value in (True, False):
        bench.arbiter.estop_message('gate', value, bench.now)
        assert bench.tick().state is State.STOPPING
    bench.arbiter.operator_sample('fort', REST, bench.now)
    assert_stopped(bench.tick())
    assert "released its deadman on the ramp of: e-stop source 'gate'" in bench.reason()


@pytest.mark.parametrize(('wait', 'stops'), [(0.25 - TICK, True), (0.25, False)])
def test_source_of_a_former_owner_counts_for_its_timeout(wait: float, stops: bool) -> None:
    bench = Bench().active('senior')
    bench.samples['senior'] = REST
    bench.send()
    assert bench.tick().state is State.READY
    bench.run(wait)
    bench.arbiter.estop_message('spare', True, bench.now)
    assert bench.tick().estop is stops


def test_source_that_counts_always_is_named_once_whosever_it_is() -> None:
    sources = (EStopSource('fort', operator='fort'), EStopSource('gate', operator='senior'))
    bench = Bench(replace(CONFIG, sources=sources))
    bench.estops['fort'] = True
    bench.run(1.0)
    assert bench.why().count("'fort' demands a stop") == 1


@pytest.mark.parametrize('ask', ['reset', 'select'])
def test_joints_are_judged_as_they_are_when_somebody_asks(ask: str) -> None:
    """Not as they were in the tick before."""
    feedback = Feedback(('left', 'right'), timeout=10.0, overspeed_time=10.0)
    bench = Bench(replace(CONFIG, feedback=feedback, clear_time=0.125))
    bench.arbiter.measured((0.0, 0.0), bench.now)
    bench.active()
    bench.arbiter.measured((1.0, 0.5), bench.now)
    bench.samples['fort'] = REST
    if ask == 'reset':
        bench.arbiter.estop_message('fort', True, bench.now)
        bench.arbiter.estop_message('fort', False, bench.now)
        bench.arbiter.operator_sample('fort', REST, bench.now)
        bench.tick()
    else:
        bench.send()
        bench.tick()
    bench.run(0.5 - TICK)
    bench.now += TICK
    reply = bench.reset() if ask == 'reset' else bench.arbiter.select_autonomy(True, bench.now)
    assert 'the joints do not stand 500 ms after control' in reply.message


def test_rest_from_before_a_stop_does_not_count_in_it() -> None:
    bench = Bench().ready()
    assert bench.arbiter.status(bench.now).conditions["operator 'fort'"] == 'rested'
    bench.arbiter.estop_message('gate', True, bench.now)
    bench.tick()
    assert bench.arbiter.status(bench.now).conditions["operator 'fort'"] == 'at rest'


# Who has control.


@pytest.mark.parametrize(('wait', 'owner'), [(0.5 - TICK, 'fort'), (0.5, 'senior')])
def test_takeover_from_hold_time_on(wait: float, owner: str) -> None:
    bench = Bench().ready()
    bench.samples['fort'] = DRIVE
    bench.send()
    assert bench.tick().owner == 'fort'
    bench.run(wait)
    bench.arbiter.operator_sample('senior', BACK, bench.now)
    assert bench.tick().owner == owner


@pytest.mark.parametrize(('wait', 'owner'), [(0.3125 - TICK, None), (0.3125, 'fort')])
def test_deadman_counts_from_neutral_time_on(wait: float, owner: str | None) -> None:
    bench = Bench(replace(CONFIG, neutral_time=0.3125))
    bench.run(1.0)
    assert bench.reset().ok
    bench.tick()
    bench.samples['fort'] = None
    for pause in (0.0, 0.2 - 0.2 % TICK, 0.0):
        bench.run(pause)
        bench.arbiter.operator_sample('fort', REST, bench.now)
    bench.run(wait - (0.2 - 0.2 % TICK))
    bench.arbiter.operator_sample('fort', REST, bench.now)
    bench.arbiter.operator_sample('fort', HELD, bench.now)
    assert bench.tick().owner == owner


@pytest.mark.parametrize(('later', 'length'), [(0.75 - TICK, 0.75 - TICK), (0.75, 0.0)])
def test_rest_is_broken_by_a_silence_of_neutral_time(later: float, length: float) -> None:
    rest = Run(0.5)
    for now in (0.0, 0.25, later):
        rest.extend(now)
    assert rest.length == length


def test_hold_time_keeps_nobody_from_what_is_free() -> None:
    bench = Bench().ready()
    bench.arbiter.operator_sample('fort', DRIVE, bench.now)
    assert bench.tick().owner == 'fort'
    assert bench.reason() == "operator 'fort' took control"
    bench.arbiter.operator_sample('fort', REST, bench.now)
    assert bench.tick().state is State.READY
    bench.arbiter.operator_sample('senior', DRIVE, bench.now)
    assert bench.tick().owner == 'senior'


def test_who_takes_over_is_named() -> None:
    bench = Bench().active()
    bench.samples['senior'] = DRIVE
    bench.run(0.125)
    assert bench.reason() == "operator 'senior' took over"


def test_deadman_half_pressed_and_let_go_of_again_begins_a_new_rest() -> None:
    bench = Bench().ready()
    for doing in (HALF, REST):
        bench.samples['fort'] = doing
        bench.run(0.125)
    bench.samples['fort'] = HALF
    bench.run(0.0625)
    assert "operator 'fort' has not been neutral since" in bench.why()
    bench.samples['fort'] = DRIVE
    assert bench.run(0.5).state is State.READY


def test_press_before_a_message_that_makes_no_sense_does_not_count() -> None:
    bench = Bench().ready()
    bench.arbiter.operator_sample('fort', DRIVE, bench.now)
    bench.arbiter.malformed('operator', 'fort', 'a test', bench.now)
    bench.arbiter.operator_sample('fort', DRIVE, bench.now)
    assert bench.tick().state is State.READY


def test_press_that_was_refused_does_not_count_when_the_stick_moves_later() -> None:
    bench = Bench().ready()
    bench.estops['spare'] = True
    bench.run(0.125)
    bench.samples['senior'] = HELD
    bench.run(0.125)
    bench.estops['spare'] = False
    bench.run(0.125)
    bench.samples['senior'] = DRIVE
    assert bench.run(0.5).state is State.READY


def test_stick_that_was_off_neutral_before_a_freeze_counts_anew_after_it() -> None:
    bench = Bench().ready()
    bench.samples['senior'] = OFF
    bench.run(0.125)
    bench.samples['senior'] = None
    bench.now += 0.15
    bench.tick()
    assert bench.arbiter.status(bench.now).ages["operator 'senior'"] == math.inf
    bench.active()
    bench.samples['senior'] = OFF
    assert bench.run(0.5).state is State.READY


def test_others_follow_the_owner_only_while_what_he_asks_for_counts() -> None:
    bench = Bench().ready()
    assert bench.decision.follows is None
    bench.samples['fort'] = DRIVE
    assert bench.run(0.5).follows == 'fort'
    bench.samples['senior'] = OFF
    bench.send()
    assert (bench.tick().owner, bench.decision.follows) == ('fort', None)
    bench = Bench().active()
    bench.arbiter.estop_message('gate', True, bench.now)
    assert (bench.tick().owner, bench.decision.follows) == ('fort', None)


# What is said.


def test_what_is_missing_for_a_reset_is_said_and_nothing_else() -> None:
    bench = Bench()
    assert bench.reason() == 'the mux has started'
    bench.estops['fort'] = True
    bench.run(1.0)
    assert bench.why().splitlines() == [
        'stopped 1000 ms ago: the mux has started',
        "e-stop source 'fort' demands a stop: see /diagnostics of its node",
        'waiting for reset: call ~/reset',
    ]
    bench.estops['fort'] = False
    bench.run(0.25)
    assert bench.why().splitlines()[0].startswith('stopped 1250 ms ago')
    assert bench.why().splitlines()[1].startswith('all stops have been clear for ')
    bench.run(1.0)
    assert bench.reset().message == 'reset: READY; nothing moves until somebody takes control'
    assert bench.arbiter.status(bench.now).stops_clear


def test_reset_in_the_moment_in_which_a_stop_ends_is_too_early() -> None:
    """No tick has seen all clear yet, so none of ``clear_time`` is over."""
    bench = Bench()
    bench.estops['fort'] = True
    bench.run(1.0)
    bench.arbiter.estop_message('fort', False, bench.now)
    assert not bench.arbiter.status(bench.now).stops_clear
    assert bench.reset().message == 'not reset: all stops have been clear for 0 ms of 500 ms'


def test_reason_of_a_stop_is_said_where_it_is_not_all_there_any_more() -> None:
    bench = Bench().ready()
    for name in ('fort', 'gate'):
        bench.arbiter.estop_message(name, True, bench.now)
    bench.tick()

    def first_line(*stopped: str) -> str:
        bench.estops = {name: name in stopped for name in bench.estops}
        bench.run(0.125)
        return bench.why().splitlines()[0]

    assert first_line('fort', 'gate').endswith(' ago')
    assert "'fort' demands a stop" in first_line('gate')
    assert "'fort' demands a stop" in first_line()
    bench = Bench().ready()
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.tick()
    assert first_line('fort', 'gate').endswith(' ago')
    assert "'fort' demands a stop" in first_line('gate')


def test_why_an_owner_stands_still_is_said_and_nothing_while_he_moves() -> None:
    bench = Bench().active()
    bench.samples['fort'] = replace(DRIVE, demand=(1.0, 0.0))
    bench.run(0.25)
    assert bench.why() == ''
    bench.samples['senior'] = HELD
    bench.send()
    bench.tick()
    assert "'senior' takes control: the output passes through zero first" in bench.why()
    bench.run(0.25)
    assert bench.why() == "operator 'senior' has control and asks for zero"


def test_own_topic_that_is_silent_is_named() -> None:
    bench = Bench(replace(CONFIG, sources=(EStopSource('fort', own_topic=True),)))
    bench.run(1.0)
    assert "own e-stop of e-stop source 'fort': never heard" in bench.why()
    bench.arbiter.own_estop_message('fort', False, bench.now)
    assert 'own e-stop' not in bench.why()
    bench = Bench(replace(CONFIG, operators=(Operator('fort', 1),), sources=CONFIG.sources[:2]))
    bench.estops['fort'] = None
    bench.run(1.0)
    assert 'own e-stop' not in bench.why()


def test_owner_that_is_overruled_is_told_by_whom() -> None:
    bench = Bench().active()
    bench.samples['senior'] = OFF
    bench.send()
    bench.tick()
    why = "operator 'fort' is losing control: operator 'senior' moved its sticks"
    assert bench.why() == why


def test_press_that_did_not_count_is_told_with_all_that_was_missing() -> None:
    bench = Bench().active()
    bench.estops['spare'] = True
    bench.run(0.125)
    bench.samples['senior'] = DRIVE
    bench.run(0.5)
    assert "before it could count; e-stop source 'spare' demands a stop" in bench.reason()
    assert 'hold' not in bench.reason()


def test_press_in_the_moment_of_its_own_stop_is_told_with_that_stop() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('spare', True, bench.now)
    bench.arbiter.operator_sample('senior', DRIVE, bench.now)
    bench.tick()
    assert "which did not count: e-stop source 'spare' demands a stop" in bench.why()
