# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rules 1 to 3 and 8 to 12: what stops, what resets, what is said; and the configuration."""

from collections.abc import Callable
from dataclasses import replace
import itertools
import math
from typing import Any

import pytest

from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import Autonomy, Decision, EStopSource, Operator, OperatorSample, State
from stage.safety_mux_bench import (
    assert_stopped,
    BACK,
    Bench,
    CONFIG,
    DRIVE,
    EVERY,
    HALF,
    HELD,
    OFF,
    REST,
    TICK,
)

# Rule 1: an e-stop source is clear only if it is fresh, says false, and its QoS matches.


def test_source_never_seen_is_a_stop() -> None:
    bench = Bench()
    bench.estops['fort'] = None
    bench.run(2.0)
    assert "e-stop source 'fort' is silent: never heard, limit 250 ms" in bench.why()
    assert not bench.reset().ok


def test_stale_source_stops_after_its_timeout_and_not_before() -> None:
    bench = Bench().active()
    bench.estops['fort'] = None
    heard = bench.arbiter.status(bench.now).ages["e-stop source 'fort'"]
    assert bench.run(0.25 - heard - TICK).state is State.ACTIVE
    assert_stopped(bench.run(3 * TICK))
    assert "e-stop source 'fort' is stale: last heard" in bench.reason()


def test_true_stops_with_the_next_tick() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('fort', True, bench.now)
    assert_stopped(bench.tick())
    assert "e-stop source 'fort' demands a stop" in bench.reason()


def test_stop_that_came_and_went_between_ticks_is_not_missed() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.arbiter.estop_message('fort', False, bench.now)
    assert_stopped(bench.tick())


def test_gap_between_ticks_in_a_source_is_not_missed() -> None:
    bench = Bench(replace(CONFIG, stall_limit=1.0)).active()
    bench.now += 0.3
    bench.send()
    assert_stopped(bench.tick())
    assert 'was stale: last heard 3' in bench.reason()


@pytest.mark.parametrize('cause', ['publishers', 'qos'])
def test_source_that_node_finds_invalid_stops(cause: str) -> None:
    bench = Bench().active()
    bench.arbiter.set_invalid('e-stop source', 'fort', cause, 'best effort was offered')
    assert_stopped(bench.tick())
    bench.run(1.0)
    assert "e-stop source 'fort' is invalid: best effort was offered" in bench.why()
    assert not bench.reset().ok
    bench.samples['fort'] = REST
    bench.arbiter.set_invalid('e-stop source', 'fort', cause, None)
    bench.run(0.6)
    assert bench.reset().ok


@pytest.mark.parametrize('value', [True, None])
def test_when_owner_source_counts_only_for_its_operator(value: bool | None) -> None:
    bench = Bench()
    bench.estops['spare'] = value
    bench.active('fort')
    assert bench.run(0.5).state is State.ACTIVE


def test_when_owner_source_keeps_its_operator_from_acquiring() -> None:
    bench = Bench().ready()
    bench.estops['spare'] = True
    bench.run(0.1)
    assert "operator 'senior' cannot take control: e-stop source 'spare' demands" in bench.why()
    bench.samples['senior'] = DRIVE
    assert bench.run(0.5).state is State.READY


@pytest.mark.parametrize('driver', [None, 'fort', 'autonomy'])
@pytest.mark.parametrize('own_stop', ['pressed', 'silent', 'invalid'])
@pytest.mark.parametrize('rest', [0.0, 0.125, 0.25])  # s; neutral_time is 0.3
def test_own_stop_that_ends_gives_no_control_without_a_rest_after_it(
    driver: str | None, own_stop: str, rest: float
) -> None:
    bench = Bench()
    bench.estops['spare'] = {'pressed': True, 'silent': None}.get(own_stop, False)
    if own_stop == 'invalid':
        bench.arbiter.set_invalid('e-stop source', 'spare', 'a test', 'it is')
    bench.ready() if driver is None else bench.active(driver)
    bench.run(0.75)  # senior holds his deadman, and his device sends neutral all the same
    bench.arbiter.set_invalid('e-stop source', 'spare', 'a test', None)
    bench.estops['spare'] = False
    bench.next_message = bench.now
    bench.run(rest + TICK)
    bench.samples['senior'] = BACK
    bench.run(1.0, lambda decision: assert_never_owner(decision, 'senior'))
    assert bench.decision.state is State.READY
    bench.samples['senior'] = REST
    bench.run(0.4)
    bench.samples['senior'] = BACK
    assert bench.run(EVERY + TICK).owner == 'senior'


def assert_never_owner(decision: Decision, name: str) -> None:
    assert decision.owner != name


def test_operator_is_told_to_wait_only_once_his_own_stop_is_clear() -> None:
    bench = Bench().ready()
    bench.estops['spare'] = True
    bench.run(0.5)
    assert "operator 'senior' has" not in bench.why()
    bench.estops['spare'] = False
    bench.run(0.125)
    assert "operator 'senior' has been neutral for" in bench.why()


def test_when_owner_source_stops_its_owner() -> None:
    bench = Bench().active('senior')
    bench.arbiter.estop_message('spare', True, bench.now)
    assert_stopped(bench.tick())


def test_when_owner_source_stops_although_the_released_deadman_overtakes_it() -> None:
    bench = Bench().active('senior')
    bench.samples['senior'] = REST
    assert bench.run(0.1).state is State.READY
    bench.arbiter.estop_message('spare', True, bench.now)
    assert_stopped(bench.tick())


def test_when_owner_source_of_a_former_owner_does_not_count_after_its_timeout() -> None:
    bench = Bench().active('senior')
    bench.samples['senior'] = REST
    bench.run(0.3)
    bench.estops['spare'] = True
    assert bench.run(0.5).state is State.READY


def test_when_owner_source_of_a_former_owner_stops_although_another_drove_meanwhile() -> None:
    bench = Bench().active('senior')
    bench.samples['senior'] = REST
    bench.run(EVERY)
    bench.samples['fort'] = DRIVE
    assert bench.run(EVERY).owner == 'fort'
    bench.samples['fort'] = REST
    assert bench.run(EVERY).state is State.READY
    bench.arbiter.estop_message('spare', True, bench.now)
    assert_stopped(bench.tick())


def test_stop_of_the_owner_is_demanded_of_the_others_for_its_timeout() -> None:
    bench = Bench().active('senior')
    bench.estops['spare'] = True
    bench.arbiter.estop_message('spare', True, bench.now)
    assert bench.run(0.2).stop_demand['fort']
    assert not bench.run(0.2).stop_demand['fort']


# Rules 2 and 3: stop beats everything; reset is an edge.


def test_stop_in_the_tick_of_a_reset_ends_the_reset() -> None:
    bench = Bench()
    bench.run(0.6)
    assert bench.reset().ok
    bench.arbiter.estop_message('gate', True, bench.now)
    assert_stopped(bench.tick())


def test_reset_in_the_tick_of_a_stop_loses() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('fort', True, bench.now)
    assert not bench.reset().ok
    assert_stopped(bench.tick())


def test_reset_before_clear_time_is_refused_and_not_queued() -> None:
    bench = Bench().active()
    bench.samples['fort'] = REST
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.tick()
    bench.run(0.2)
    reply = bench.reset()
    assert not reply.ok
    assert 'of 500 ms' in reply.message
    assert_stopped(bench.run(2.0))
    assert bench.reset().ok


def test_blip_begins_clear_time_anew() -> None:
    bench = Bench()
    bench.run(0.45)
    bench.arbiter.estop_message('fort', True, bench.now)
    bench.arbiter.estop_message('fort', False, bench.now)
    bench.run(0.4)
    assert not bench.reset().ok


@pytest.mark.parametrize('sample', [OFF, HELD, HALF, DRIVE])
def test_reset_with_a_fresh_operator_not_at_neutral_is_refused(sample: OperatorSample) -> None:
    bench = Bench()
    bench.samples['senior'] = sample
    bench.run(1.0)
    reply = bench.reset()
    assert not reply.ok
    assert "operator 'senior' is not at neutral" in reply.message


def test_reset_with_an_operator_who_is_not_there_succeeds() -> None:
    bench = Bench()
    bench.samples['senior'] = None
    bench.run(1.0)
    assert bench.reset().ok


def test_reset_with_an_operator_whose_messages_make_no_sense_is_refused() -> None:
    bench = Bench()
    bench.samples['senior'] = replace(REST, demand=(0.0,))
    bench.run(1.0)
    assert not bench.reset().ok
    assert "operator 'senior' is invalid: it has a demand for 1 joints, not 2" in bench.why()


def test_held_or_repeated_reset_does_nothing() -> None:
    bench = Bench()
    bench.estops['fort'] = True
    bench.run(0.5)
    replies = []
    for step in range(40):
        if step == 10:
            bench.estops['fort'] = False
        bench.run(0.1)
        replies.append(bench.reset())
    assert not any(reply.ok for reply in replies)
    assert 'held or repeated' in replies[-1].message
    bench.run(0.6)
    assert bench.reset().ok


@pytest.mark.parametrize('period', [0.6, 1.0, 4.0])
def test_script_that_resets_for_ever_arms_once(period: float) -> None:
    bench = Bench()
    bench.run(0.6)
    accepted = []
    for stops in range(4):
        bench.estops['fort'] = True
        bench.run(0.2)
        bench.estops['fort'] = False
        for _ in range(round(20.0 / period)):
            bench.run(period)
            accepted += [stops] * bench.reset().ok
    assert accepted == [0]
    assert 'so none counts until there was none for 5000 ms' in bench.reset().message
    bench.run(4.9)
    assert 'resets have been called since before the stop' in bench.why()
    bench.run(0.2)
    assert 'resets have been called' not in bench.why()
    assert bench.reset().ok


def test_person_who_is_refused_resets_again_after_clear_time() -> None:
    bench = Bench().active()
    for _ in range(3):
        bench.samples['fort'] = REST
        bench.estops['fort'] = True
        bench.run(1.0)
        assert not bench.reset().ok
        bench.estops['fort'] = False
        bench.run(0.6)
        assert bench.reset().ok
        bench.run(0.1)


@pytest.mark.parametrize('arrange', [Bench.ready, Bench.active])
def test_reset_of_what_is_not_stopped_does_nothing(arrange: Callable[[Bench], Bench]) -> None:
    bench = arrange(Bench())
    before = bench.decision
    assert not bench.reset().ok
    assert bench.tick() == before


def test_restarted_mux_is_stopped() -> None:
    assert_stopped(Bench().decision)
    assert_stopped(Bench().run(5.0))


# Rule 8: time.


@pytest.mark.parametrize('gap', [0.11, 3600.0, -0.5, -3600.0])
def test_frozen_process_stops_and_forgets_what_it_heard(gap: float) -> None:
    bench = Bench().active()
    bench.now += gap
    bench.send()  # what waited in the queues arrives first
    assert_stopped(bench.tick())
    assert 'this process was frozen' in bench.reason()
    assert bench.arbiter.status(bench.now).ages["e-stop source 'fort'"] == math.inf
    assert not bench.reset().ok


def test_services_after_a_freeze_do_not_overtake_the_tick() -> None:
    bench = Bench().ready()
    bench.now += 1.0
    bench.send()
    assert not bench.arbiter.select_autonomy(True, bench.now).ok
    assert_stopped(bench.tick())


# Rule 9: malformed input.


@pytest.mark.parametrize('demand', [(1.0,), (1.0, 1.0, 1.0), (math.nan, 0.0), (0.0, math.inf)])
def test_senseless_demand_of_the_owner_stops(demand: tuple[float, ...]) -> None:
    bench = Bench().active()
    bench.arbiter.operator_sample('fort', replace(DRIVE, demand=demand), bench.now)
    assert_stopped(bench.tick())
    assert "operator 'fort' is invalid: it" in bench.reason()


def test_malformed_message_followed_by_a_good_one_still_stops() -> None:
    bench = Bench().active()
    bench.arbiter.malformed('operator', 'fort', 'it has 2 axes, 6 are needed', bench.now)
    bench.arbiter.operator_sample('fort', DRIVE, bench.now)
    assert_stopped(bench.tick())
    assert 'it has 2 axes, 6 are needed' in bench.reason()


def test_malformed_message_of_somebody_else_stops_nothing() -> None:
    bench = Bench().active()
    bench.arbiter.malformed('operator', 'senior', 'axis 1 is nan', bench.now)
    bench.arbiter.malformed('autonomy', 'autonomy', 'the twist is not finite', bench.now)
    assert bench.tick().state is State.ACTIVE


@pytest.mark.parametrize(('kind', 'owner'), [('operator', 'fort'), ('autonomy', 'autonomy')])
def test_second_publisher_of_the_owner_stops(kind: Any, owner: str) -> None:
    bench = Bench().active(owner)
    bench.arbiter.set_invalid(kind, owner, 'publishers', 'two publishers are alive')
    assert_stopped(bench.tick())
    assert 'two publishers are alive' in bench.reason()


# Rule 10: outputs, and stop category 1.


def test_category_1_ramps_to_zero_in_time_and_then_disables() -> None:
    bench = Bench(replace(CONFIG, stop_time=0.05)).active()
    seen: list[Decision] = []
    bench.arbiter.estop_message('gate', True, bench.now)
    bench.run(0.1, seen.append)
    ramp = [decision for decision in seen if decision.state is State.STOPPING]
    assert 0 < len(ramp) * TICK < 0.05
    assert all(decision.enable and not decision.estop for decision in ramp)
    values = [decision.demand[0] for decision in ramp]
    assert values == sorted(values, reverse=True)
    assert_stopped(seen[len(ramp)])
    assert "the ramp has ended, after: e-stop source 'gate'" in bench.reason()


def test_category_0_on_the_ramp_cuts() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('gate', True, bench.now)
    assert bench.tick().state is State.STOPPING
    bench.arbiter.estop_message('fort', True, bench.now)
    assert_stopped(bench.tick())


def test_category_0_beats_category_1_in_the_same_tick() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('gate', True, bench.now)
    bench.arbiter.estop_message('fort', True, bench.now)
    assert_stopped(bench.tick())


def test_release_on_the_ramp_cuts() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('gate', True, bench.now)
    bench.tick()
    bench.arbiter.operator_sample('fort', REST, bench.now)
    assert_stopped(bench.tick())
    assert "operator 'fort' released its deadman" in bench.reason()


def test_stop_taken_back_on_the_ramp_still_ends_stopped() -> None:
    bench = Bench().active()
    bench.arbiter.estop_message('gate', True, bench.now)
    bench.tick()
    bench.arbiter.estop_message('gate', False, bench.now)
    assert_stopped(bench.run(0.6))


def test_category_1_at_standstill_stops_at_once() -> None:
    bench = Bench().active()
    bench.samples['fort'] = HELD
    bench.run(0.3)
    bench.arbiter.estop_message('gate', True, bench.now)
    assert_stopped(bench.tick())
    assert bench.reason().startswith("e-stop source 'gate'"), 'there was a ramp'


def test_hold_stops_for_as_long_as_it_lasts() -> None:
    bench = Bench().active()
    bench.samples['fort'] = REST
    bench.arbiter.hold('the node is not active')
    assert_stopped(bench.run(1.0))
    assert 'the node is not active' in bench.reset().message
    bench.arbiter.hold(None)
    bench.run(0.6)
    assert bench.reset().ok


def test_trip_is_latched_until_a_reset() -> None:
    bench = Bench().active()
    bench.samples['fort'] = REST
    assert bench.arbiter.trip(bench.now).ok
    assert_stopped(bench.tick())
    decision = bench.run(2.0)
    assert_stopped(decision)
    assert all(decision.stop_demand.values())
    assert 'a trip is active until ~/end_trip is called, or a reset succeeds' in bench.why()
    bench.ready()
    assert not any(bench.tick().stop_demand.values())


def test_trip_that_is_ended_asks_no_device_to_stop_and_stays_latched() -> None:
    bench = Bench().active()
    bench.samples['fort'] = REST
    bench.arbiter.trip(bench.now)
    bench.run(0.49)
    assert bench.arbiter.end_trip(bench.now).message == 'not ended: a trip lasts 500 ms or longer'
    bench.run(2 * TICK)
    assert bench.arbiter.end_trip(bench.now).ok
    assert_stopped(bench.tick())
    assert not any(bench.decision.stop_demand.values())
    assert bench.arbiter.end_trip(bench.now) == (False, 'no trip is active')
    assert_stopped(bench.run(1.0))
    assert bench.reset().ok


def test_trip_that_follows_a_trip_lasts_as_long() -> None:
    bench = Bench().active()
    bench.arbiter.trip(bench.now)
    bench.run(1.0)
    bench.arbiter.trip(bench.now)
    assert not bench.arbiter.end_trip(bench.now).ok
    assert all(bench.run(0.4).stop_demand.values())


# Rule 12: the full answer.


def test_status_of_a_fresh_mux_names_everything() -> None:
    bench = Bench()
    why = bench.why()
    for words in (
        "e-stop source 'fort' is silent: never heard",
        "e-stop source 'gate' is silent: never heard",
        "operator 'fort' is silent: never heard",
        'autonomy is silent: never heard',
        'waiting for reset: call ~/reset',
    ):
        assert words in why


def test_status_follows_the_way_to_motion() -> None:
    bench = Bench()
    bench.run(0.3)
    assert 'all stops have been clear for' in bench.why()
    bench.run(0.4)
    bench.reset()
    bench.run(0.2)
    assert "operator 'fort' has been neutral for" in bench.why()
    bench.run(0.3)
    assert "press the deadman of 'fort' to take control" in bench.why()
    assert 'call ~/select_autonomy' in bench.why()
    bench.samples['fort'] = HELD
    bench.run(0.2)
    assert "operator 'fort' has control and asks for zero" in bench.why()
    bench.samples['fort'] = DRIVE
    bench.run(0.2)
    assert bench.why() == ''
    bench.arbiter.estop_message('gate', True, bench.now)
    bench.tick()
    assert 'stopping on a ramp' in bench.why()
    last = bench.arbiter.status(bench.now).last_transition
    assert (last.before, last.after) == (State.ACTIVE, State.STOPPING)


# Configuration.


@pytest.mark.parametrize('value', [0.0, -1.0, math.nan, math.inf])
def test_timeout_that_never_expires_is_refused(value: float) -> None:
    for make in (
        lambda: EStopSource('fort', timeout=value),
        lambda: Operator('fort', 1, timeout=value),
        lambda: Autonomy(timeout=value),
        lambda: replace(CONFIG, clear_time=value),
        lambda: replace(CONFIG, neutral_time=value),
        lambda: replace(CONFIG, stall_limit=value),
        lambda: replace(CONFIG, stop_time=value),
    ):
        with pytest.raises(ValueError, match='must be above 0 s and finite, not'):
            make()


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'sources': ()}, 'no e-stop source'),
        ({'sources': (EStopSource('a'), EStopSource('a'))}, 'e-stop sources must differ: a'),
        ({'operators': (Operator('a', 1), Operator('b', 1))}, 'priorities must differ: 1'),
        ({'operators': (Operator('a', 1), Operator('a', 2))}, 'operators must differ: a'),
        ({'operators': (), 'autonomy': None, 'sources': (EStopSource('a'),)}, 'nobody could'),
        ({'operators': (Operator('a', 1),)}, "belongs to operator 'senior'"),
        ({'sources': CONFIG.sources[2:]}, "no e-stop source would stop 'fort'"),
        ({'hold_time': -0.1}, 'hold_time'),
        ({'reset_silence': -0.1}, 'reset_silence'),
        ({'reset_silence': math.inf}, 'reset_silence'),
        ({'neutral_time': 0.24}, "timeout of operator 'fort' must be at most neutral_time"),
        ({'joints': 0}, 'joints'),
    ],
)
def test_contradicting_configuration_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(CONFIG, **changes)


def test_senseless_source_or_operator_is_refused() -> None:
    with pytest.raises(ValueError, match='name the operator'):
        EStopSource('a', counts='when_owner')
    with pytest.raises(ValueError, match='counts'):
        EStopSource('a', counts='sometimes')  # type: ignore[arg-type]
    with pytest.raises(ValueError, match='stop_category'):
        EStopSource('a', stop_category=2)
    with pytest.raises(ValueError, match='begins with a letter'):
        EStopSource('a/b')
    with pytest.raises(ValueError, match='cannot be named'):
        Operator('autonomy', 1)


def test_limits_for_other_joints_are_refused() -> None:
    with pytest.raises(ValueError, match='limits are for 1 joints, not 2'):
        Arbiter(CONFIG, JointLimiter([JointLimit(1.0, 1.0, 1.0)]), 0.0)


# What the status has in fields, so that nobody need read its sentences.


@pytest.mark.parametrize(
    ('break_it', 'condition'),
    [
        (lambda bench: bench.estops.update(fort=True), 'stop'),
        (lambda bench: bench.estops.update(fort=None), 'stale'),
        (
            lambda bench: bench.arbiter.set_invalid('e-stop source', 'fort', 'publishers', 'two'),
            'invalid',
        ),
    ],
)
def test_stop_names_its_cause_and_the_condition_of_its_source(
    break_it: Callable[[Bench], None], condition: str
) -> None:
    bench = Bench().active()
    break_it(bench)
    bench.run(0.4)
    status = bench.arbiter.status(bench.now)
    assert status.last_transition.causes == ("e-stop source 'fort'",)
    assert status.conditions["e-stop source 'fort'"] == condition
    assert status.conditions["e-stop source 'gate'"] == 'clear'
    assert not status.stops_clear


@pytest.mark.parametrize(
    ('stop', 'cause'),
    [
        (lambda bench: bench.samples.update(senior=None), "operator 'senior'"),
        (lambda bench: bench.arbiter.trip(bench.now), 'trip'),
        (lambda bench: bench.arbiter.hold('not active'), 'hold'),
        (lambda bench: setattr(bench, 'now', bench.now + 0.2), 'stall'),
    ],
)
def test_stop_that_is_no_sources_names_its_cause(
    stop: Callable[[Bench], None], cause: str
) -> None:
    bench = Bench().active('senior')
    stop(bench)
    bench.run(0.4)
    assert cause == bench.arbiter.status(bench.now).last_transition.causes[0]


def test_cause_of_a_ramp_outlasts_it() -> None:
    bench = Bench().active()
    bench.estops['gate'] = True
    bench.send()
    assert bench.tick().state is State.STOPPING
    assert not bench.arbiter.status(bench.now).stops_clear
    assert bench.run(0.6).state is State.STOPPED
    causes = bench.arbiter.status(bench.now).last_transition.causes
    assert causes == ("e-stop source 'gate'",)


@pytest.mark.parametrize(
    ('doing', 'condition'), [(OFF, 'in use'), (HELD, 'in use'), (REST, 'rested'), (None, 'stale')]
)
def test_condition_of_an_operator_says_what_it_does(
    doing: OperatorSample | None, condition: str
) -> None:
    bench = Bench().ready()
    bench.samples['fort'] = doing
    bench.run(0.4)
    assert bench.arbiter.status(bench.now).conditions["operator 'fort'"] == condition


def test_condition_of_autonomy_says_what_it_does() -> None:
    bench = Bench().ready()

    def condition(seconds: float) -> str:
        bench.run(seconds)
        return bench.arbiter.status(bench.now).conditions['autonomy']

    assert condition(0.4) == 'rested'
    bench.autonomy = (0.0, 1.0)
    assert condition(0.1) == 'in use'
    bench.autonomy = (0.0, 0.0)
    assert condition(0.1) == 'at rest'


def test_operator_at_rest_for_less_than_neutral_time_is_not_rested() -> None:
    bench = Bench().active()
    bench.samples['fort'] = REST
    bench.run(0.1)
    assert bench.arbiter.status(bench.now).conditions["operator 'fort'"] == 'at rest'


def test_fields_say_whether_a_reset_counts() -> None:
    bench = Bench()
    counted = []
    for stop, doing in 3 * tuple(itertools.product((True, False), (REST, HELD, None, REST))):
        bench.estops['fort'], bench.samples['fort'] = stop, doing
        bench.run(0.3)  # so that clear_time is over in the second that is clear
        status = bench.arbiter.status(bench.now)
        expected = status.stops_clear and status.operators_at_rest
        counted.append(status.state is State.STOPPED and expected)
        bench.arbiter.calls.last = None  # this one is not repeated
        assert bench.reset().ok is counted[-1]
    assert set(counted) == {True, False}
