# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A wire step by step, by a clock of the test's: its port, its session, its pace and its words."""

from collections.abc import Callable, Iterator
import errno
import itertools
import math
import traceback
from typing import Any

import pytest

from bridge_core.report import Report
from bridge_core.session import Level, Verdict
from bridge_core.transports.tap import Chunk, Tap, tap_pair
from stage.link_rig import fails, fault, PACE
from stage.wire_rig import WireBench


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[WireBench]:
    bench = WireBench(monkeypatch)
    yield bench
    bench.close()


def gaps(moments: list[float]) -> list[float]:
    """Return the time between two moments, each."""
    return [round(b - a, 6) for a, b in itertools.pairwise(moments)]


# Opening, losing, opening again.


def test_port_is_tried_in_the_step_that_activates_and_used_in_the_next(bench: WireBench) -> None:
    bench.step()
    bench.log()
    assert bench.wire.left_safe
    bench.activate()
    bench.step()
    assert bench.tried_at == [bench.now]
    bench.step()
    assert bench.log() == ['ok port opened', 'sent hello', 'event opened']
    assert bench.session.calls == ['opened', 'poll']
    status = bench.wire.status
    assert (status.is_open, status.error, status.opens) == (True, '', 1)
    assert bench.ends == [(1, '')]
    assert bench.daemons == {True}  # one that blocks at its open keeps no process alive
    assert not bench.port.calls['close']


def stays_absent(bench: WireBench) -> None:
    fails(bench.port, 'open', 'no such port')
    bench.activate()
    bench.go_on(2.0)


def stays_absent_by_default(bench: WireBench) -> None:
    bench.use()
    fails(bench.port, 'open', 'no such port')
    bench.activate()
    bench.go_on(5.0)


def is_activated_anew(bench: WireBench) -> None:
    stays_absent(bench)
    bench.tried_at.clear()
    bench.activate()
    bench.go_on(0.25)


def gets_no_thread(bench: WireBench) -> None:
    bench.expects_fault = bench.no_threads = True
    bench.activate()
    bench.go_on(2.0)


def is_lost_before_it_is_healthy(bench: WireBench, word: bytes = b'') -> None:
    bench.open()
    for _ in range(3):
        if word:
            bench.hear(word)
        bench.lose()
        while not bench.wire.status.is_open:
            bench.step()


def is_lost_again_and_again(bench: WireBench) -> None:
    is_lost_before_it_is_healthy(bench, b'x')


@pytest.mark.parametrize(
    ('happens', 'pauses'),
    [
        (stays_absent, [0.1, 0.2, 0.4, 0.4, 0.4]),
        (stays_absent_by_default, [0.1, 0.2, 0.4, 0.8, 1.0, 1.0]),
        (is_activated_anew, [0.0, 0.1]),  # the one before it for its farewell
        (gets_no_thread, [0.1, 0.2, 0.4, 0.4]),
        (is_lost_before_it_is_healthy, [0.1, 0.2, 0.4]),
        (is_lost_again_and_again, [0.1, 0.1, 0.1]),
    ],
)
def test_port_is_tried_after_pauses_that_grow_until_the_link_is_healthy(
    bench: WireBench, happens: Callable[[WireBench], None], pauses: list[float]
) -> None:
    happens(bench)
    assert gaps(bench.tried_at)[: len(pauses)] == pauses
    bench.no_threads = False
    bench.port.faults.clear()
    bench.go_on(1.1)
    assert bench.wire.status.is_open


def test_reason_of_an_absent_port_is_told_once_and_another_one_again(bench: WireBench) -> None:
    stays_absent(bench)
    assert bench.wire.status.error == 'no such port'
    assert not bench.port.calls['send']
    fails(bench.port, 'open', 'busy')
    bench.go_on(1.0)
    assert [line for line in bench.log() if 'bad' in line] == ['bad no such port', 'bad busy']
    assert bench.session.calls == []  # a port that was never open closes none


def test_driver_that_throws_anything_is_a_port_that_did_not_open(bench: WireBench) -> None:
    bench.port.faults['open'] = RuntimeError('driver fault')
    bench.activate()
    bench.go_on(0.15)
    assert len(bench.tried_at) == 2
    error = bench.wire.status.error
    assert error.startswith('cannot open port: Traceback')
    assert 'driver fault' in error


def test_lost_port_is_a_stop_at_once_each_time_and_is_opened_again(bench: WireBench) -> None:
    bench.run()
    for opens in (2, 3):
        bench.log()
        bench.lose()
        assert bench.log() == ['bad port: unplugged', 'stop True', 'event closed']
        assert bench.port.calls['close'] == opens - 1
        bench.go_on(0.25)
        assert bench.log()[:2] == ['ok port opened', 'sent hello']
        assert bench.wire.status.opens == opens
        bench.hear(b'x')


def test_port_that_takes_no_first_frame_is_lost(bench: WireBench) -> None:
    fails(bench.port, 'send', 'cannot write')
    bench.activate()
    bench.step()
    bench.step()
    assert bench.wire.status.error == 'cannot write'
    assert not bench.wire.status.is_open
    assert not bench.port.is_open
    assert bench.session.calls[-1] == 'closed'


def test_fault_while_a_port_opens_neither_closes_it_nor_opens_it_twice(bench: WireBench) -> None:
    bench.expects_fault = True
    bench.begin_opening()
    bench.do(fault)
    bench.go_on(1.0)
    assert len(bench.tried_at) == 1
    assert not bench.port.calls['close']
    assert 'farewell' not in bench.session.calls
    bench.open_ports()
    bench.step()
    assert bench.wire.status.is_open
    bench.blocks = False
    bench.lose()
    assert not bench.port.is_open
    bench.go_on(0.5)
    assert bench.wire.status.is_open


def test_port_whose_open_ends_is_used_at_once(bench: WireBench) -> None:
    bench.begin_opening()
    bench.step()
    opened_at = bench.now
    bench.during_wait = bench.open_ports
    bench.step()
    assert bench.now == opened_at
    assert bench.wire.status.is_open


@pytest.mark.parametrize('at_once', [False, True])
def test_port_of_an_earlier_activation_is_closed_at_last(bench: WireBench, at_once: bool) -> None:
    old, new = bench.port, bench.make_port('new port')
    bench.begin_opening()
    bench.port = new
    bench.activate()
    bench.step()
    assert len(bench.opening) == 2
    if not at_once:
        bench.opening.pop(0)()
        bench.step()
        assert not old.is_open
        assert not bench.wire.status.is_open
    bench.open_ports()
    bench.step()
    assert not old.is_open
    assert old.sent == []
    assert new.is_open
    assert bench.wire.status.is_open
    assert 'interrupted' not in bench.session.calls  # to wait for the old one is no freeze


# Freezes.


def test_input_of_a_freeze_is_discarded_without_a_wait_and_is_a_stop(bench: WireBench) -> None:
    bench.run()
    bench.port.say(b'old')
    bench.late = 1.0
    bench.step()
    then = bench.now
    assert bench.waits[-1] == 0.0
    assert bench.log() == ['stop True']
    assert b'old' not in bench.session.received
    assert bench.session.calls[-2:] == ['interrupted', 'poll']
    assert 'held up for 1.0 s' in bench.session.verdict.reasons[0]
    bench.step()
    assert bench.now - then <= PACE + 0.001
    bench.hear(b'new')
    assert bench.session.received == b'xnew'
    assert bench.owner.told[-1] is False


def test_port_whose_driver_may_keep_input_of_a_freeze_is_opened_anew(bench: WireBench) -> None:
    bench.run()
    bench.port.is_pumped = True
    bench.port.say(b'old')
    bench.late = 1.0
    bench.step()
    assert not bench.port.is_open
    *farewell, lost, stop, closed = bench.log()
    assert farewell == ['sent bye 1', 'sent bye 2']
    assert lost.startswith('bad this node was held up for 1.0 s')
    assert (stop, closed) == ('stop True', 'event closed')
    bench.go_on(0.3)
    assert bench.wire.status.is_open
    bench.hear(b'new')
    assert bench.session.received == b'xnew'


@pytest.mark.parametrize(('late', 'stops'), [(0.2, False), (0.2001, True), (0.15, False)])
def test_freeze_counts_from_a_fifth_of_a_second(
    bench: WireBench, late: float, stops: bool
) -> None:
    bench.owner.next = 0.0625  # so that the sum with the time of the freeze has no rounding
    bench.run()
    bench.step()
    assert bench.now < 0.0625
    bench.late = late
    bench.step()
    assert bench.owner.told[-1] is stops


@pytest.mark.parametrize(('late', 'sent'), [(0.1875, True), (0.25, False)])
def test_freeze_amid_a_step_counts_and_what_was_made_before_it_is_not_sent(
    bench: WireBench, late: float, sent: bool
) -> None:
    bench.run()
    bench.session.wanted = [b'move']

    def freeze(now: float) -> None:
        bench.now += late
        bench.port.say(b'old')

    dropped = bench.wire.status.dropped
    bench.do(freeze)
    bench.step()
    assert (b'move' in bench.port.sent) is sent
    assert ((b'move', bench.now - late) in bench.session.told_sent) is sent
    assert (bench.wire.status.dropped == dropped) is sent
    bench.step()
    assert (b'old' in bench.session.received) is sent
    assert bench.owner.told[-1] is not sent


def test_freeze_while_the_port_opens_makes_what_came_old_news(bench: WireBench) -> None:
    bench.begin_opening()
    bench.open_ports()
    bench.port.say(b'old')
    bench.late = 1.0
    bench.step()
    bench.step()
    assert bench.session.received == b''
    assert 'interrupted' in bench.session.calls
    bench.hear(b'new')
    assert bench.session.received == b'new'


def test_port_that_is_lost_in_a_freeze_is_lost_in_the_step_after_it(bench: WireBench) -> None:
    bench.run()
    bench.port.unplug()
    bench.late = 1.0
    bench.step()
    assert bench.log() == ['bad port: unplugged', 'stop True', 'event closed']
    assert not bench.port.is_open


def test_flood_without_an_end_cannot_keep_the_stop_of_a_freeze_waiting(bench: WireBench) -> None:
    bench.run()
    before = bench.port.calls['receive']

    def flood() -> None:
        if bench.wire.status.is_open and bench.late == 0.0:
            bench.port.say(b'more')

    bench.during_wait = flood
    bench.late = 1.0
    bench.waits.clear()
    bench.port.say(b'more')
    bench.step()
    assert bench.port.calls['receive'] - before == 1000
    assert bench.owner.told[-1] is True


# Requests.


def test_fault_of_a_request_closes_the_port_and_keeps_the_others(bench: WireBench) -> None:
    bench.expects_fault = True
    bench.run()
    done: list[float] = []
    bench.do(fault)
    bench.do(done.append)
    bench.step()
    log = bench.log()
    assert 'ZeroDivisionError' in log[2]
    assert log[3:] == ['stop True', 'event closed']
    assert done
    assert not bench.port.is_open


def test_stop_and_release_of_one_step_still_put_the_stop_on_the_wire(bench: WireBench) -> None:
    bench.run()
    bench.do(lambda now: setattr(bench.session, 'stop', True), stop=True)
    bench.do(lambda now: setattr(bench.session, 'stop', False))
    bench.step()
    assert b'stop' in bench.port.sent


@pytest.mark.parametrize(
    ('age', 'given', 'refused'),
    [
        (0.25, {'limit': 0.25}, False),
        (0.2501, {'limit': 0.25}, True),
        (9.0, {'limit': 0.25}, True),
        (9.0, {'limit': 0.25, 'stop': True}, False),
        (0.19, {}, False),
        (0.21, {}, True),
    ],
)
def test_request_that_waited_for_longer_than_its_limit_counts_only_as_a_stop(
    bench: WireBench, age: float, given: dict[str, Any], refused: bool
) -> None:
    bench.open()
    bench.now = 10.0
    bench.wire._stepped_at = 10.0
    done: list[float] = []
    number = bench.do(done.append, at=10.0 - age, key='drive', **given)
    bench.step()
    assert bool(done) is not refused
    text = f'it waited for {age * 1e3:.0f} ms, as this node was held up'
    assert bench.owner.refused == [(number, 'drive', text)] * refused


def test_refused_request_still_has_the_session_say_what_it_wants(bench: WireBench) -> None:
    bench.run()

    def refuse(now: float) -> None:
        bench.session.wanted.append(b'stop')
        raise ValueError('too many')

    number = bench.do(refuse, key='count')
    bench.step()
    assert bench.port.sent[-1] == b'stop'
    assert bench.owner.refused == [(number, 'count', 'too many')]
    assert bench.wire.status.is_open


def test_request_that_waits_for_the_device_needs_an_open_port(bench: WireBench) -> None:
    stays_absent(bench)
    done: list[float] = []
    number = bench.do(done.append, waits=True, key='reset')
    bench.step()
    assert bench.owner.refused == [(number, 'reset', 'no such port')]
    bench.do(done.append)
    bench.step()
    assert len(done) == 1
    del bench.port.faults['open']
    bench.go_on(0.5)
    bench.do(done.append, waits=True)
    bench.step()
    assert len(done) == 2
    assert len(bench.owner.refused) == 1


@pytest.mark.parametrize('rests', [False, True])
def test_request_to_a_wire_that_is_not_active_is_refused(bench: WireBench, rests: bool) -> None:
    if rests:
        bench.open(resting=True)
        assert bench.resting.calls == ['opened', 'poll']
    number = bench.do(fault, key='drive')
    bench.step()
    assert bench.owner.refused == [(number, 'drive', 'the node is not active')]
    assert bench.session.calls == []
    bench.open()
    done: list[float] = []
    bench.do(done.append)
    bench.step()
    assert done


@pytest.mark.parametrize(
    ('error', 'told'),
    [(ValueError('contradiction'), 'contradiction'), (ZeroDivisionError(), 'it failed')],
)
def test_activation_that_fails_is_told_and_one_that_contradicts_leaves_what_runs(
    bench: WireBench, error: Exception, told: str
) -> None:
    bench.run()
    bench.expects_fault = not isinstance(error, ValueError)

    def refuse() -> None:
        raise error

    bench.on_make = refuse
    bench.activate()
    bench.step()
    assert bench.ends[-1] == (2, told)
    assert bench.wire.status.is_open is not bench.expects_fault
    assert bench.port.calls['close'] == bench.expects_fault


# What was lost on the way to the owner.


def nothing(bench: WireBench) -> None: ...


def device_falls_silent(bench: WireBench) -> None:
    bench.session.verdict = Verdict.stop(link_up=False)


def deactivate_twice(bench: WireBench) -> None:
    bench.deactivate()
    bench.deactivate()


@pytest.mark.parametrize(
    ('happens', 'reason', 'closed'),
    [
        (nothing, 'something was lost', False),
        (device_falls_silent, 'something was lost', False),
        (WireBench.lose, 'port: unplugged', True),
        (WireBench.deactivate, 'the node is not active', True),
        (deactivate_twice, 'the node is not active', True),
    ],
)
def test_owner_that_lost_something_gets_a_stop_once_and_what_came_with_it(
    bench: WireBench, happens: Callable[[WireBench], None], reason: str, closed: bool
) -> None:
    bench.run()
    happens(bench)
    bench.owner.stop = False  # as if it had not taken a stop
    bench.owner.told.append(False)
    bench.log()
    bench.owner.verdicts.clear()
    bench.wire.interrupt('something was lost', bench.now)
    assert bench.log() == ['stop True', *['event closed'] * closed]
    (verdict,) = bench.owner.verdicts
    assert verdict == Verdict.stop(link_up=False)
    assert verdict.reasons == (reason,)
    assert ('interrupted' in bench.session.calls) is not closed


# Both directions.


def test_frame_of_a_stop_goes_out_before_the_owner_is_told(bench: WireBench) -> None:
    bench.run()
    bench.do(lambda now: setattr(bench.session, 'stop', True), stop=True)
    bench.do(lambda now: bench.session.interrupted('why', now), stop=True)
    bench.step()
    assert bench.log() == ['sent stop', 'sent stop', 'stop True']


def test_frames_that_go_out_are_told_and_a_busy_line_is_tried_again(bench: WireBench) -> None:
    bench.open()
    bench.session.told_sent.clear()
    bench.session.due = 0.0  # at once, as ever while a frame waits
    bench.port.busy = 2
    bench.do(lambda now: bench.session.wanted.extend([b'a', b'b', b'c']))
    bench.step()
    then = bench.now
    assert bench.port.sent == [b'hello', b'c']
    assert bench.session.told_sent == [(b'c', then)]
    assert (bench.wire.status.sent, bench.wire.status.dropped) == (2, 2)
    bench.session.wanted = [b'a']
    bench.step()
    assert bench.now - then == pytest.approx(0.001)
    assert bench.session.told_sent == [(b'c', then), (b'a', bench.now)]


@pytest.mark.parametrize(
    ('stops', 'log'),
    [
        (False, ['bad cannot write', 'stop True', 'event closed']),
        (True, ['stop True', 'bad cannot write', 'event closed']),  # its session has told it
    ],
)
def test_port_lost_at_a_write_is_a_stop(bench: WireBench, stops: bool, log: list[str]) -> None:
    bench.run()
    fails(bench.port, 'send', 'cannot write')
    bench.session.stop = stops
    if stops:
        bench.do(lambda now: bench.session.interrupted('why', now), stop=True)
    else:
        bench.do(lambda now: bench.session.wanted.append(b'a'))
    bench.step()
    assert bench.log() == log


def test_session_is_polled_when_it_is_due_and_not_before(bench: WireBench) -> None:
    bench.open()
    bench.session.calls.clear()
    bench.go_on(1.0)
    assert bench.session.calls == []
    bench.owner.next = 100.0
    bench.step()
    bench.session.due = due = bench.now + 0.03
    bench.step()
    assert bench.session.calls == ['poll']
    assert bench.now == pytest.approx(due)


@pytest.mark.parametrize(  # s
    ('may_wait', 'due', 'read'),
    [
        (True, 0.0078125, 0.0078125),
        (True, 0.0625, 0.0),
        (False, 0.0009765625, 0.0009765625),
        (False, 0.0078125, 0.0),
    ],
)
def test_what_comes_is_read_when_the_session_is_due_if_that_is_soon_enough(
    bench: WireBench, may_wait: bool, due: float, read: float
) -> None:
    bench.run()
    bench.session.may_wait = lambda: may_wait  # type: ignore[method-assign]
    begin, bench.session.due = bench.now, bench.now + due
    bench.port.say(b'y')
    while not bench.session.received.endswith(b'y'):
        bench.step()
    assert bench.now - begin == read


def test_who_is_always_due_cannot_take_the_processor(bench: WireBench) -> None:
    bench.open()
    bench.session.due = 0.0
    bench.session.calls.clear()
    bench.go_on(0.1)
    assert 150 <= bench.session.calls.count('poll') <= 201
    bench.owner.next = 0.0
    bench.step()
    bench.owner.paced.clear()
    bench.go_on(0.1)
    assert 150 <= len(bench.owner.paced) <= 202


def test_stop_is_paced_as_its_owner_wants_it(bench: WireBench) -> None:
    bench.run()
    bench.go_on(0.2)
    assert max(gaps(bench.owner.paced[-10:])) <= PACE + 1e-9
    bench.owner.next = 1e9
    bench.step()
    bench.waits.clear()
    bench.go_on(1.0)
    assert len(bench.waits) <= 12  # for the levels of the report


def test_tap_sees_both_directions_and_what_was_dropped_not(bench: WireBench) -> None:
    ours, theirs = tap_pair()
    tap = Tap(theirs.fileno())
    theirs.close()
    ours.setblocking(False)
    bench.use(tap=tap)
    bench.open()
    bench.now = 3.0
    bench.wire._stepped_at = 3.0
    bench.port.busy = 1
    bench.do(lambda now: bench.session.wanted.extend([b'dropped', b'sent']))
    bench.step()
    bench.hear(b'heard')
    bench.deactivate()
    bench.requests.end()
    bench.wire.run()
    chunks: list[Chunk] = []
    while data := ours.recv(4096):
        chunks.append(Chunk.from_bytes(data))
    ours.close()
    assert [(chunk.sent, chunk.data) for chunk in chunks] == [
        *((True, b'hello'), (True, b'sent'), (False, b'heard')),
        *((True, b'bye 1'), (True, b'bye 2')),
    ]
    assert [chunk.at for chunk in chunks[1:]] == [3.0] * 4


# The report.


def level(report: Report) -> Level:
    return report.link.level


def test_report_comes_each_second(bench: WireBench) -> None:
    bench.run()
    bench.go_on(1.0)
    before = len(bench.owner.reported)
    bench.go_on(5.0)
    pauses = gaps(bench.owner.reported[before:])
    assert len(pauses) in (3, 4)
    assert 0.999 <= min(pauses) <= max(pauses) <= 1.11
    assert bench.port.calls['counts'] <= len(bench.owner.reports)


def test_report_of_a_wire_that_is_not_active_or_rests_says_so(bench: WireBench) -> None:
    bench.step()
    assert bench.owner.reports[-1].link[:3] == (Level.WARN, 'the node is not active', {})
    assert bench.port.calls['counts'] == 0
    bench.open(resting=True)
    bench.hear(b'x')
    bench.go_on(2.0)
    assert bench.owner.reports[-1].link[:3] == (Level.WARN, 'the node is not active', {})
    bench.run()
    bench.go_on(0.2)
    assert level(bench.owner.reports[-1]) is Level.OK


def test_report_does_not_hurry_for_an_event_that_is_no_stop(bench: WireBench) -> None:
    bench.run()
    bench.go_on(0.05)
    look_at = bench.wire._reporter.look_at
    bench.hear(b'y')
    assert bench.wire._reporter.look_at == look_at


def is_lost_without_words(bench: WireBench) -> None:
    fails(bench.port, 'receive', '')
    bench.hear(b'x')


def is_activated(bench: WireBench) -> None:
    bench.activate()
    bench.step()


@pytest.mark.parametrize(
    ('happens', 'within', 'told'),
    [
        (nothing, 0.5, []),
        (WireBench.lose, 0.0, ['port: unplugged']),
        (is_lost_without_words, 0.0, ['']),
        (device_falls_silent, 0.12, ['']),  # nobody says so: it is looked at
        (is_activated, 0.0, ['not opened yet']),
    ],
)
def test_level_that_changes_is_reported_within_a_tenth_of_a_second_and_once(
    bench: WireBench, happens: Callable[[WireBench], None], within: float, told: list[str]
) -> None:
    bench.run()
    bench.go_on(0.3)
    before = len(bench.owner.reports)
    happens(bench)
    bench.go_on(within)
    links = [report.link for report in bench.owner.reports[before:]]
    assert [link[:2] for link in links] == [(Level.ERROR, text) for text in told]


def test_damage_of_this_session_is_reported(bench: WireBench) -> None:
    bench.run()
    bench.go_on(2.5)
    counters = bench.session.counters
    counters.frames, counters.checksum_errors = 10, 10
    bench.go_on(2.5)
    link = bench.owner.reports[-1].link
    assert link.level is Level.WARN
    assert '50%' in link.message


# Leaving.

FAREWELL = [b'hello', b'bye 1', b'bye 2']


def test_deactivation_says_farewell_then_stops_then_closes(bench: WireBench) -> None:
    bench.run()
    then = bench.now
    bench.deactivate()
    assert bench.now == then
    assert bench.log() == ['sent bye 1', 'sent bye 2', 'stop True', 'event closed']
    assert bench.owner.verdicts[-2].reasons == ('the node is not active',)
    assert [frame for frame, _ in bench.session.told_sent][-2:] == [b'bye 1', b'bye 2']
    assert not bench.port.is_open
    assert bench.ends[-1] == (2, '')
    status = bench.wire.status
    assert (status.is_open, status.error) == (False, 'the node is not active')
    bench.go_on(1.0)
    assert len(bench.tried_at) == 1
    assert bench.session.calls.count('closed') == 1


def test_deactivation_waits_for_no_port_of_an_earlier_activation(bench: WireBench) -> None:
    bench.begin_opening()
    bench.step()
    bench.go_on(0.1)
    bench.port = bench.make_port('new port')
    then = bench.now
    bench.activate()
    bench.deactivate()
    assert bench.now == pytest.approx(then + 0.25)  # for the first of them, and once
    bench.deactivate()
    assert bench.ends[1:] == [(2, ''), (3, ''), (4, '')]


@pytest.mark.parametrize('next_pace', [None, 0.0])
def test_deactivation_waits_shortly_for_a_port_that_opens_and_shows_that_it_does_not_hang(
    bench: WireBench, next_pace: float | None
) -> None:
    bench.begin_opening()
    bench.step()
    then = bench.now
    bench.log()
    bench.owner.next = next_pace
    bench.owner.paced.clear()
    bench.deactivate()
    assert bench.now == pytest.approx(then + 0.25)
    assert bench.ends[-1] == (2, '')
    assert bench.log() == ['bad no farewell: port was still being opened']
    *waiting, _ = bench.owner.paced
    assert waiting[-1] - waiting[0] >= 0.2
    often = gaps(waiting)
    assert max(often) == pytest.approx(PACE) if next_pace is None else min(often) == 0.0005
    bench.open_ports()
    bench.step()
    assert not bench.port.is_open
    assert bench.session.calls == []


def test_deactivation_is_one_whoever_fails_while_it_waits(bench: WireBench) -> None:
    def fail(now: float) -> None:
        if bench.now < then + 0.2:  # not in the step itself
            raise RuntimeError('fault in pace')

    bench.begin_opening()
    bench.step()
    then = bench.now
    bench.owner.on_pace = fail
    bench.deactivate()
    assert bench.ends[-1] == (2, '')
    assert 'no farewell: port was still being opened' in bench.log()[-1]


@pytest.mark.parametrize('deactivated', [False, True])
@pytest.mark.parametrize(('opens', 'said'), [(0.0, True), (2.5, True), (9.0, False)])
def test_port_that_is_being_opened_has_its_time_for_the_farewell(
    bench: WireBench, opens: float, said: bool, deactivated: bool
) -> None:
    bench.use(patience=3.0)
    bench.begin_opening()
    then = bench.now
    bench.during_wait = lambda: bench.open_ports() if bench.now > then + opens else None
    if deactivated:
        bench.deactivate()
    else:
        bench.requests.end()
        bench.wire.run()
    assert (bench.port.sent == FAREWELL) is said
    assert bench.wire.left_safe is said
    assert ('bad no farewell: port was still being opened' in bench.log()) is not said
    assert bench.now - then <= 3.5
    bench.open_ports()
    if deactivated:
        bench.step()
    assert not bench.port.is_open
    assert bench.port.calls['close'] == 1


def test_deactivation_behind_an_activation_opens_the_port_for_it(bench: WireBench) -> None:
    """The device may be moving: so it is where a wire died that nobody had deactivated."""
    bench.activate()
    bench.deactivate()
    assert bench.port.sent == FAREWELL
    assert not bench.port.is_open
    assert bench.ends == [(1, ''), (2, '')]
    bench.go_on(1.0)
    assert len(bench.tried_at) == 1


def test_deactivation_tries_a_lost_port_again_for_the_farewell(bench: WireBench) -> None:
    """Its device may be back, and hold what it was told last."""
    bench.run()
    fails(bench.port, 'open', 'no such port')
    bench.lose()
    bench.go_on(0.5)
    bench.port.faults.clear()
    bench.port.sent.clear()
    bench.deactivate()
    assert bench.port.sent == FAREWELL
    assert bench.wire.left_safe
    assert not bench.port.is_open


@pytest.mark.parametrize(
    ('busy', 'seconds', 'sent', 'said'),
    [
        (5, 0.005, ['sent bye 1', 'sent bye 2'], []),
        (101, 0.1, ['sent bye 2'], ['bad no farewell: port takes nothing']),
        (10**9, 0.1, [], ['bad no farewell: port takes nothing']),
        (-1, 0.0, [], ['bad no farewell: unplugged']),  # it is lost
    ],
)
def test_farewell_waits_for_a_busy_line_for_a_tenth_of_a_second(
    bench: WireBench, busy: int, seconds: float, sent: list[str], said: list[str]
) -> None:
    bench.run()
    bench.session.told_sent.clear()
    bench.port.busy = busy
    if busy < 0:
        fails(bench.port, 'send', 'unplugged')
    then = bench.now
    bench.deactivate()
    assert bench.now - then == pytest.approx(seconds, abs=2e-3)
    assert bench.log() == [*sent, *said, 'stop True', 'event closed']
    assert [f'sent {frame.decode()}' for frame, _ in bench.session.told_sent] == sent
    assert bench.wire.left_safe == (not said)
    assert not bench.port.is_open
    assert bench.ends[-1] == (2, '')


def test_farewell_waits_for_its_turn_a_quarter_of_a_second_and_then_goes(
    bench: WireBench,
) -> None:
    bench.run()
    bench.owner.paced.clear()
    bench.session.leaves = math.inf
    then = bench.now
    bench.deactivate()
    assert bench.now - then == pytest.approx(0.25)
    assert bench.log() == ['stop True', 'sent bye 1', 'sent bye 2', 'event closed']
    assert bench.owner.verdicts[-3].reasons == ('the node is not active',)
    assert max(gaps(bench.owner.paced)) == pytest.approx(PACE)
    assert bench.wire.left_safe


def test_turn_of_a_farewell_comes_with_what_is_heard_which_ends_no_stop(
    bench: WireBench,
) -> None:
    def hear() -> None:
        bench.session.verdict = Verdict.stop()  # the answer ends it
        bench.port.say(b'answer')
        bench.session.leaves = bench.now + 0.01
        bench.during_wait = lambda: None

    bench.run()
    bench.session.leaves = math.inf
    bench.during_wait = lambda: hear() if bench.now > then + 0.1 else None
    then = bench.now
    bench.deactivate()
    assert bench.log()[:4] == ['stop True', 'event heard', 'sent bye 1', 'sent bye 2']
    assert bench.now - then == pytest.approx(0.13)


def test_owner_that_lost_something_closes_no_session_before_its_farewell(
    bench: WireBench,
) -> None:
    bench.run()
    bench.session.leaves = math.inf
    bench.owner.on_pace = lambda now: bench.wire.interrupt('something was lost', now)
    bench.deactivate()
    assert bench.session.calls.index('farewell') < bench.session.calls.index('closed')


@pytest.mark.parametrize('unplugged', [False, True])
def test_farewell_is_said_whatever_fails_while_it_waits_for_its_turn(
    bench: WireBench, unplugged: bool
) -> None:
    bench.run()
    bench.session.leaves = math.inf
    if unplugged:
        bench.port.unplug()
    else:
        bench.port.say(b'answer')
        bench.session.faults.add('receive')
    bench.deactivate()
    assert bench.log() == ['stop True', 'sent bye 1', 'sent bye 2', 'event closed']


def test_farewell_to_a_lost_port_is_told_and_still_stops_and_closes(bench: WireBench) -> None:
    bench.run()
    bench.session.told_sent.clear()
    fails(bench.port, 'send', 'unplugged')
    bench.deactivate()
    assert bench.log() == ['bad no farewell: unplugged', 'stop True', 'event closed']
    assert bench.session.told_sent == []
    assert not bench.port.is_open
    assert bench.ends[-1] == (2, '')


@pytest.mark.parametrize('name', ['farewell', 'closed'])
def test_fault_while_leaving_closes_and_never_opens_again(bench: WireBench, name: str) -> None:
    bench.expects_fault = True
    bench.run()
    bench.session.faults.add(name)
    bench.deactivate()
    assert bench.owner.told[-1] or name == 'closed'  # then these words are the stop
    assert 'bad internal error' in str(bench.owner.log)
    assert not bench.port.is_open
    assert bench.ends[-1] == (2, 'it failed')
    bench.go_on(1.0)
    assert len(bench.tried_at) == 1


def test_new_activation_leaves_the_port_of_the_last_one_with_a_farewell(bench: WireBench) -> None:
    bench.run()
    old, bench.port = bench.port, bench.make_port('new port')
    bench.activate()
    bench.step()
    assert not old.is_open
    assert bench.log() == ['sent bye 1', 'sent bye 2', 'stop True', 'event closed']
    bench.step()
    assert bench.wire.status.is_open
    assert (bench.wire.status.opens, bench.wire.status.sent) == (1, 1)


@pytest.mark.parametrize('up_for', [0.0, 1e6])
def test_end_of_requests_is_that_of_the_wire_with_farewell(
    bench: WireBench, up_for: float
) -> None:
    """However long the computer was up as it began."""
    bench.now = up_for
    bench.activate()
    bench.owner.on_pace = lambda now: bench.requests.end() if now > up_for + 0.3 else None
    bench.wire.run()
    assert 0.3 < bench.now - up_for < 0.3 + 2 * PACE
    assert bench.port.sent == FAREWELL
    assert bench.session.calls[-2:] == ['farewell', 'closed']
    assert not bench.port.is_open
    assert bench.wire._opener.fileno() == bench.wire._opener._wake.fileno() == -1
    assert 'interrupted' not in bench.session.calls
    assert not any('internal error' in line for line in bench.owner.log)


def test_port_that_opens_just_behind_the_wait_for_it_is_closed(
    bench: WireBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.begin_opening()
    deactivate = bench.wire._deactivate

    def deactivate_then_open(now: float) -> None:
        deactivate(now)
        bench.open_ports()

    monkeypatch.setattr(bench.wire, '_deactivate', deactivate_then_open)
    bench.requests.end()
    bench.wire.run()
    assert not bench.port.is_open
    assert bench.port.calls['close'] == 1


# Faults of ours.


@pytest.mark.parametrize('farewell_fails', [False, True])
def test_fault_says_farewell_stops_backs_off_ends(bench: WireBench, farewell_fails: bool) -> None:
    bench.expects_fault = True
    bench.run()
    bench.owner.faults.add('pace')
    if farewell_fails:
        bench.session.faults.add('farewell')
    bench.step()
    log = bench.log()
    if not farewell_fails:
        assert [log.pop(0), log.pop(0)] == ['sent bye 1', 'sent bye 2']
    assert log[0].startswith('bad internal error: Traceback')
    assert log[1:] == ['stop True', 'event closed']
    assert not bench.port.is_open
    bench.owner.paced.clear()
    bench.waits.clear()
    bench.go_on(1.0)
    assert 8 <= len(bench.owner.paced) <= 25
    assert len(bench.waits) <= 60
    assert bench.wire.left_safe is not farewell_fails
    bench.owner.faults.clear()
    bench.go_on(1.0)
    bench.hear(b'x')
    assert bench.owner.told[-1] is False
    assert not bench.wire.left_safe


@pytest.mark.parametrize('name', ['opened', 'receive', 'poll', 'deadline', 'on_events'])
def test_whoever_fails_at_a_port_has_it_closed_and_tried_again(
    bench: WireBench, name: str
) -> None:
    bench.expects_fault = True
    faults = bench.owner.faults if name == 'on_events' else bench.session.faults
    if name != 'opened':
        bench.run()
    faults.add(name)
    if name == 'opened':
        bench.activate()
    else:
        bench.port.say(b'y')
    bench.go_on(0.05)
    assert bench.owner.told[-1] is True
    assert not bench.port.is_open
    assert bench.session.calls[-1] == 'closed'
    bench.waits.clear()
    bench.go_on(1.0)
    assert len(bench.waits) <= 150
    faults.clear()
    bench.go_on(1.0)
    bench.hear(b'x')
    assert bench.owner.told[-1] is False


def test_fault_without_a_port_is_told_once_a_second(bench: WireBench) -> None:
    bench.expects_fault = True
    bench.owner.faults.add('pace')
    told_at = []
    for _ in range(50):
        bench.step()
        told_at += [bench.now] * len([line for line in bench.log() if 'internal' in line])
    assert told_at[0] == 0.0
    assert 1.0 - 1e-9 <= min(gaps(told_at)) <= max(gaps(told_at)) <= 1.11


@pytest.mark.parametrize('disk_is_full', [False, True])
def test_owner_that_cannot_be_told_of_a_fault_has_it_printed_where_that_works(
    bench: WireBench,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    disk_is_full: bool,
) -> None:
    def refuse() -> None:
        raise OSError(errno.ENOSPC, 'no space left')

    if disk_is_full:
        monkeypatch.setattr(traceback, 'print_exc', refuse)
    bench.expects_fault = True
    bench.run()
    bench.owner.faults |= {'pace', 'on_events', 'link_changed'}
    bench.go_on(0.5)
    printed = capsys.readouterr().err.count('RuntimeError: fault in on_events')
    assert printed == (not disk_is_full)
    bench.owner.faults.clear()
    bench.go_on(1.0)
    assert bench.wire.status.is_open


def test_owner_that_cannot_log_the_loss_of_a_port_gets_its_stop(bench: WireBench) -> None:
    bench.expects_fault = True
    bench.run()
    bench.owner.faults.add('link_changed')
    bench.lose()
    assert bench.owner.told[-1] is True
    assert not bench.port.is_open
    assert bench.session.calls.count('closed') == 1


def test_report_that_fails_each_time_does_not_silence_the_stop(bench: WireBench) -> None:
    bench.expects_fault = True
    bench.run()
    bench.wire._reporter._levels = ()
    bench.session.problems = fault  # type: ignore[method-assign,assignment]
    bench.owner.paced.clear()
    bench.waits.clear()
    bench.go_on(2.0)
    assert max(gaps(bench.owner.paced)) <= PACE + 1e-9
    assert len(bench.waits) <= 150
    assert bench.owner.told[-1] is True
