# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A wire in a thread: opening and losing the port, requests from other threads, leaving."""

import functools
import itertools
import os
import threading
import time

import pytest

from bridge_core import clock
from bridge_core.session import Level
from bridge_core.transports import link, TransportError, wire
from bridge_core.transports.link import ANSWER_TIME, ThreadLink
from bridge_core.transports.request import Call, INPUT_LIMIT, REQUEST_LIMIT
from stage.link_rig import Bench, fails, FakeTransport, fault, PACE, wait_at
from stage.rig import holds_for, wait_for
from stage.run_delay import RunDelay

# Opening, losing, opening again.


def test_wire_that_does_not_answer_leaves_the_process_its_second_to_end() -> None:
    assert 2 * ANSWER_TIME < 1.0  # the farewell, then the end of its thread


def test_request_is_no_stop_and_the_newest_of_its_key_unless_it_says_so(bench: Bench) -> None:
    link = ThreadLink('link', bench.bridge, bench.owner)  # without a thread that takes them
    link.request(Call('do', ('early',)))
    link.request(Call('do', ('kept',)), each=True)
    link.request(Call('do', ('late',)))
    link.request(Call('do', ('first',)), key='other', stop=True)
    taken = link._mailbox.take()
    assert [request.what for request in taken] == [
        Call('do', (word,)) for word in ('first', 'kept', 'late')
    ]
    assert [request.stop for request in taken] == [True, False, False]
    link.stop()


def test_the_stop_is_paced_without_a_port_and_without_a_session(bench: Bench) -> None:
    wait_for(lambda: len(bench.owner.told) >= 5, 2.0, 'five paces')
    assert all(bench.owner.told)


def test_port_opens_and_bytes_reach_the_session(bench: Bench) -> None:
    bench.activate()
    bench.wait_open()
    bench.transport.say(b'abc')
    wait_for(lambda: bench.session.received == b'abc', 2.0, 'the bytes')
    assert bench.transport.sent == [b'hello']
    assert bench.status.opens == 1


def test_absent_port_is_tried_for_ever_with_growing_pauses(bench: Bench) -> None:
    fails(bench.transport, 'open', 'cannot open port: no such port')
    bench.activate()
    wait_for(lambda: len(bench.transport.opens_at) >= 6, 10.0, 'six attempts')
    times = bench.transport.opens_at[:6]
    pauses = [b - a for a, b in itertools.pairwise(times)]
    # A pause may last longer on a busy machine, never shorter.
    for pause, least in zip(pauses, [0.1, 0.2, 0.4, 0.4, 0.4], strict=True):
        assert pause >= least
    assert bench.status.error == 'cannot open port: no such port'
    assert bench.owner.log.count('bad cannot open port: no such port') == 1  # once, not for ever
    del bench.transport.faults['open']
    bench.wait_open()
    assert all(bench.owner.told)


def test_absent_port_makes_no_busy_loop(bench: Bench) -> None:
    fails(bench.transport, 'open', 'no such port')
    bench.activate()
    assert bench.steps_within(0.5) < 0.5 / PACE + 30


def test_driver_that_throws_anything_is_a_port_that_did_not_open(bench: Bench) -> None:
    bench.transport.faults['open'] = RuntimeError('driver fault')
    bench.activate()
    wait_for(lambda: bench.transport.calls['open'] >= 2, 5.0, 'two attempts')
    assert 'driver fault' in bench.status.error
    bench.transport.faults.clear()
    bench.wait_open()


def test_lost_port_tells_the_stop_before_anything_else_and_closes_once(bench: Bench) -> None:
    bench.run()
    bench.owner.log.clear()
    bench.transport.gate.clear()
    bench.transport.unplug()
    wait_for(lambda: 'event closed' in bench.owner.log, 2.0, 'the closed event')
    wait_for(lambda: bench.transport.calls['close'] == 1, 2.0, 'the port closed')
    assert bench.owner.log == ['bad port: unplugged', 'stop True', 'event closed']
    assert bench.session.calls.count('closed') == 1
    bench.transport.gate.set()
    bench.wait_open()
    bench.make_healthy()
    assert bench.status.opens == 2
    assert bench.session.calls.count('closed') == 1


def test_end_of_file_makes_no_busy_loop(bench: Bench) -> None:
    bench.run()
    bench.transport.gate.clear()
    bench.transport.unplug()
    assert bench.steps_within(0.5) < 0.5 / PACE + 30
    assert bench.transport.calls['receive'] <= 2


def test_port_that_dies_at_every_write_backs_off(bench: Bench) -> None:
    fails(bench.transport, 'send', 'port: cannot write')
    bench.activate()
    wait_for(lambda: len(bench.transport.opens_at) >= 4, 10.0, 'four attempts')
    times = bench.transport.opens_at[:4]
    assert times[3] - times[0] >= 0.1 + 0.2 + 0.4
    assert bench.session.calls.count('closed') <= bench.session.calls.count('opened')
    assert all(bench.owner.told)


def test_port_that_opens_but_never_gets_healthy_backs_off(bench: Bench) -> None:
    bench.activate()
    for number in range(1, 5):
        wait_for(functools.partial(bench.opened, number), 5.0, 'an open port')
        wait_for(lambda: bench.session.calls[-1] == 'poll', 5.0, 'a poll')
        bench.transport.unplug()
        wait_for(lambda: not bench.status.is_open, 2.0, 'a lost port')
    times = bench.transport.opens_at
    assert times[3] - times[0] >= 0.1 + 0.2 + 0.4


def test_back_off_starts_anew_only_after_a_healthy_link(bench: Bench) -> None:
    bench.run()
    delay = RunDelay([])
    bench.transport.unplug()
    lost = time.monotonic()
    wait_for(lambda: len(bench.transport.opens_at) == 2, 2.0, 'the next attempt')
    paused = bench.transport.opens_at[1] - lost  # 0.1 s, and not the longest pause
    assert paused < 0.4 + PACE + delay.seconds()


def test_open_that_blocks_stops_neither_pacing_nor_requests(bench: Bench) -> None:
    bench.transport.gate.clear()
    bench.activate()
    wait_for(lambda: bench.transport.openers == 1, 2.0, 'an open in progress')
    done: list[float] = []
    paced = len(bench.owner.paced)
    bench.do(done.append, 'x')
    wait_for(lambda: done and len(bench.owner.paced) > paced + 10, 2.0, 'pace and request')
    bench.transport.gate.set()
    bench.wait_open()


def test_deactivation_while_opening_leaves_the_port_closed(bench: Bench) -> None:
    bench.transport.gate.clear()
    bench.activate()
    wait_for(lambda: bench.transport.openers == 1, 2.0, 'an open in progress')
    bench.link.deactivate()
    bench.transport.gate.set()
    wait_for(lambda: bench.transport.calls['close'] == 1, 2.0, 'the late port closed')
    assert not bench.status.is_open
    assert bench.session.calls == []


def test_new_activation_while_the_old_port_opens_leaks_neither(bench: Bench) -> None:
    old, new = bench.transport, FakeTransport('new port')
    old.gate.clear()
    new.gate.clear()
    bench.activate()
    wait_for(lambda: old.openers == 1, 2.0, 'the old one opening')
    bench.link.deactivate()
    bench.transport = new
    bench.activate()
    wait_for(lambda: new.openers == 1, 2.0, 'the new one opening')
    hold = threading.Event()
    bench.do(wait_at(hold), 'hold')
    # Both come back while the wire is busy with something else.
    old.gate.set()
    new.gate.set()
    wait_for(lambda: old.openers == new.openers == 0, 2.0, 'both opened')
    hold.set()
    bench.wait_open()
    wait_for(lambda: not old.is_open, 2.0, 'the old port closed')
    assert new.is_open


def test_only_one_open_at_a_time_even_after_a_fault(bench: Bench) -> None:
    bench.transport.gate.clear()
    bench.activate()
    wait_for(lambda: bench.transport.openers == 1, 2.0, 'an open in progress')
    bench.do(fault, 'fault')
    holds_for(lambda: bench.transport.openers == 1, 0.5, 'a single open')
    assert bench.transport.calls['close'] == 0  # not under the feet of the open either
    bench.transport.gate.set()
    bench.wait_open()
    assert bench.transport.most_openers == 1


# Requests.


def test_key_of_a_request_is_its_name_unless_another_is_given(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    put: list[str] = []
    monkeypatch.setattr(bench.link, '_put', lambda request, each: put.append(request.key))
    bench.link.request(Call('set_command', (1,)))
    bench.link.request(Call('set_command', (1,)), key='left')
    assert put == ['set_command', 'left']


def test_stop_and_release_that_arrive_together_still_put_the_stop_on_the_wire(
    bench: Bench,
) -> None:
    bench.run()
    hold = threading.Event()
    bench.do(wait_at(hold), 'hold')
    bench.do(lambda now: setattr(bench.session, 'stop', True), 'estop', stop=True)
    bench.do(lambda now: setattr(bench.session, 'stop', False), 'estop')
    hold.set()
    wait_for(lambda: b'stop' in bench.transport.sent, 2.0, 'the stop')
    wait_for(lambda: not bench.session.stop, 2.0, 'the release')


def test_requests_from_many_threads_all_arrive_on_the_link_thread(bench: Bench) -> None:
    bench.run()
    seen: list[str] = []
    threads: set[int] = set()

    def note(now: float, name: str) -> None:
        seen.append(name)
        threads.add(threading.get_ident())

    def post(worker: int) -> None:
        for number in range(200):
            name = f'{worker} {number}'
            bench.do(functools.partial(note, name=name), name)

    workers = [threading.Thread(target=post, args=(worker,)) for worker in range(8)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    late = bench.owner.refused  # by a busy machine
    wait_for(lambda: len(seen) + len(late) == 1600, 5.0, lambda: f'1600, {len(seen)} came')
    assert len({*seen, *(key for _, key, _ in late)}) == 1600
    assert threads == bench.owner.threads
    assert len(threads) == 1


def test_newest_request_of_a_storm_is_never_lost(bench: Bench) -> None:
    bench.run()
    last = -1

    def note(now: float, number: int) -> None:
        nonlocal last
        last = number

    for number in range(5000):
        bench.do(functools.partial(note, number=number), 'command')
    wait_for(lambda: last == 4999, 2.0, 'the newest request')


def test_input_that_waited_for_a_node_that_was_held_up_counts_only_as_a_stop(
    bench: Bench,
) -> None:
    bench.run()
    done: list[str] = []
    received_at = clock.now() - 2 * INPUT_LIMIT
    for key, stop in (('release', False), ('stop', True)):
        act = functools.partial(lambda now, key: done.append(key), key=key)
        bench.link.request(Call('do', (act,)), key=key, stop=stop, received_at=received_at)
    bench.do(lambda now: done.append('fresh'), 'fresh')
    wait_for(lambda: done[-1:] == ['fresh'] and bench.owner.refused, 2.0, 'all three')
    assert done == ['stop', 'fresh']
    assert [key for _, key, _ in bench.owner.refused] == ['release']


def test_session_is_polled_right_after_a_request(bench: Bench) -> None:
    bench.run()
    bench.do(lambda now: bench.session.wanted.append(b'now'), 'x')
    wait_for(lambda: b'now' in bench.transport.sent, 2.0, 'the frame')


def test_fault_in_one_request_does_not_lose_the_others(bench: Bench) -> None:
    bench.run()
    hold = threading.Event()
    seen: list[float] = []
    bench.do(wait_at(hold), 'hold')
    bench.do(fault, 'bad')
    bench.do(seen.append, 'good')
    hold.set()
    wait_for(lambda: seen, 2.0, 'the request behind the bad one')


@pytest.mark.parametrize('stop', [False, True])
def test_request_that_waited_for_long_is_refused_unless_it_is_a_stop(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, stop: bool
) -> None:
    bench.run()
    hold, begun = threading.Event(), threading.Event()
    seen: list[float] = []
    bench.do(wait_at(hold, begun=begun), 'hold')
    assert begun.wait(2.0)
    monkeypatch.setattr(link, 'REQUEST_LIMIT', REQUEST_LIMIT)
    asked = time.monotonic()
    number = bench.do(seen.append, 'late', stop=stop)
    wait_for(lambda: time.monotonic() > asked + 0.25, what='its age')
    hold.set()
    refused = bench.owner.refused
    wait_for(lambda: seen or refused, 2.0, 'the end of the request')
    assert bool(seen) == stop
    assert stop or refused[0][:2] == (number, 'late')


def test_request_that_makes_no_sense_is_told_and_disturbs_nothing(bench: Bench) -> None:
    bench.run()

    def refuse(now: float) -> None:
        raise ValueError('too many')

    number = bench.do(refuse, 'count')
    wait_for(lambda: bench.owner.refused, 2.0, 'the refusal')
    assert bench.owner.refused == [(number, 'count', 'too many')]
    assert bench.status.is_open


def test_request_without_a_session_is_refused(bench: Bench) -> None:
    number = bench.do(fault, 'x')
    wait_for(lambda: bench.owner.refused, 2.0, 'the refusal')
    assert bench.owner.refused == [(number, 'x', 'the node is not active')]


def test_parameters_that_contradict_leave_what_runs(bench: Bench) -> None:
    bench.run()

    def refuse() -> None:
        raise ValueError('contradiction')

    bench.on_make = refuse
    with pytest.raises(ValueError, match='contradiction'):
        bench.activate()
    assert bench.status.is_open
    assert bench.transport.calls['close'] == 0


def test_report_comes_each_second_and_at_once_when_a_level_changes(bench: Bench) -> None:
    bench.run()
    reports = bench.owner.reports
    wait_for(lambda: reports[-1].link.level is Level.OK, 2.0, 'a sound link')
    count = len(reports)
    wait_for(lambda: len(reports) >= count + 2, 5.0, 'two more')
    # Levels are looked at ten times a second; numbers are made for a report alone.
    assert bench.transport.calls['counts'] <= len(reports) + 1
    bench.transport.gate.clear()
    bench.transport.unplug()
    # A machine that held this up made it an ERROR before, with other words.
    wait_for(lambda: reports[-1].link.message == 'port: unplugged', 2.0, 'the loss')
    assert reports[-1].link.level is Level.ERROR


def test_request_after_the_end_is_ignored(bench: Bench) -> None:
    bench.link.stop()
    before = os.open('/dev/null', os.O_WRONLY)  # takes the number of the closed descriptor
    bench.do(lambda now: None, 'x')
    os.close(before)
    with pytest.raises(TransportError, match='has ended'):
        bench.activate()


# Leaving.


def test_deactivation_sends_the_farewell_tells_the_stop_and_closes(bench: Bench) -> None:
    bench.run()
    bench.owner.log.clear()
    bench.link.deactivate()
    assert bench.transport.sent[-2:] == [b'bye 1', b'bye 2']
    assert not bench.transport.is_open
    assert bench.owner.log == ['stop True', 'event closed']
    assert bench.session.calls[-2:] == ['farewell', 'closed']
    assert bench.status.error == 'the node is not active'
    bench.link.deactivate()
    assert bench.session.calls.count('farewell') == 1


def test_farewell_waits_for_a_busy_line(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, '_FAREWELL_TIME', 20.0)
    bench.run()
    bench.transport.busy = 5
    bench.link.deactivate()
    assert bench.transport.sent[-2:] == [b'bye 1', b'bye 2']


def test_farewell_on_a_line_that_stays_busy_ends(bench: Bench) -> None:
    bench.run()
    bench.transport.busy = 10**9
    begin, delay = time.monotonic(), RunDelay([])
    bench.link.deactivate()
    assert time.monotonic() - begin < ANSWER_TIME + delay.seconds()
    assert not bench.transport.is_open


def test_farewell_to_a_lost_port_still_closes_and_stops(bench: Bench) -> None:
    bench.run()
    fails(bench.transport, 'send', 'port: unplugged')
    bench.link.deactivate()
    assert not bench.transport.is_open
    assert bench.owner.told[-1] is True
    assert 'bad no farewell: port: unplugged' in bench.owner.log


@pytest.mark.parametrize('fault', ['farewell', 'closed'])
def test_fault_while_leaving_never_opens_the_port_again(bench: Bench, fault: str) -> None:
    bench.run()
    bench.session.faults.add(fault)
    bench.link.deactivate()
    assert not bench.transport.is_open
    holds_for(lambda: len(bench.transport.opens_at) == 1, 0.3, 'the port stays closed')


def test_activation_after_deactivation_and_activation_twice(bench: Bench) -> None:
    bench.run()
    bench.link.deactivate()
    bench.run()
    assert bench.transport.calls['open'] == 2
    other = FakeTransport('other')
    first, bench.transport = bench.transport, other
    bench.activate()
    bench.wait_open()
    assert not first.is_open
    assert first.sent[-1] == b'bye 2'


def test_stop_twice_says_farewell_once_and_ends_the_thread(bench: Bench) -> None:
    bench.run()
    bench.link.stop()
    bench.link.stop()
    assert bench.session.calls.count('farewell') == 1
    assert not bench.transport.is_open
    assert bench.owner.told[-1] is True
    bench.link.deactivate()


def test_stop_without_start() -> None:
    bench = Bench()
    bench.link.stop()
    bench.link.stop()


def test_stop_from_its_own_thread_ends_it(bench: Bench) -> None:
    """As a node does that leaves because of what its wire has told."""
    stopped = threading.Event()

    def pace(now: float) -> float:
        bench.link.stop()
        stopped.set()
        return now + PACE

    bench.owner.pace = pace  # type: ignore[method-assign]
    assert stopped.wait(5.0)
    wait_for(lambda: thread_of(bench) is None, 5.0, 'its end')


def test_program_that_ends_without_stop_does_not_wait_for_it(bench: Bench) -> None:
    thread = thread_of(bench)
    assert thread is not None
    assert thread.daemon


def thread_of(bench: Bench) -> threading.Thread | None:
    """Return the link's thread, while it is alive."""
    return next((t for t in threading.enumerate() if t.name == bench.link.name), None)


def test_stop_does_not_wait_for_an_open_that_blocks(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(link, 'ANSWER_TIME', ANSWER_TIME)
    bench.transport.gate.clear()
    bench.activate()
    wait_for(lambda: bench.transport.openers == 1, 2.0, 'an open in progress')
    bench.link.stop()
    assert bench.transport.openers == 1
    bench.transport.gate.set()
    wait_for(lambda: bench.transport.calls['close'] >= 1, 2.0, 'the late port closed')


def test_deactivations_from_several_threads_all_return(bench: Bench) -> None:
    bench.run()
    errors: list[Exception] = []

    def deactivate() -> None:
        try:
            bench.link.deactivate()
        except TransportError as error:
            errors.append(error)

    hold = threading.Event()
    bench.do(wait_at(hold, 0.1), 'hold')
    workers = [threading.Thread(target=deactivate) for _ in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert errors == []
    assert bench.session.calls.count('farewell') == 1


@pytest.mark.usefixtures('patient_link')
def test_links_leak_no_descriptors_and_threads() -> None:
    def count() -> tuple[int, int]:
        return len(os.listdir('/proc/self/fd')), threading.active_count()

    before = count()
    for _ in range(10):
        bench = Bench()
        bench.link.start()
        bench.run()
        bench.link.stop()
    wait_for(lambda: count() <= before, 2.0, 'all given back')
