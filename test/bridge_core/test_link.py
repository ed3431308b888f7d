# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A wire in a thread: what other threads ask of it, and its end; test_wire.py has the rest."""

import functools
import os
import threading

import pytest

from bridge_core.transports import link, TransportError
from bridge_core.transports.link import ANSWER_TIME, ThreadLink
from bridge_core.transports.request import Call
from stage.link_rig import Bench, PACE, wait_at
from stage.rig import wait_for


def thread_of(bench: Bench) -> threading.Thread | None:
    """Return the link's thread, while it is alive."""
    return next((t for t in threading.enumerate() if t.name == bench.link.name), None)


def test_request_is_no_stop_and_counts_shorter_as_input(bench: Bench) -> None:
    link = ThreadLink('link', bench.bridge, bench.owner)  # without a thread that takes them
    link.request(Call('do', ('early',)))
    link.request(Call('do', ('kept',)), each=True)
    link.request(Call('do', ('late',)), received_at=7.0)
    link.request(Call('do', ('first',)), key='other', stop=True)
    taken = link._mailbox.take()
    assert [(request.what.arguments, request.key, request.stop) for request in taken] == [  # type: ignore[union-attr]
        (('first',), 'other', True),
        (('kept',), 'do', False),
        (('late',), 'do', False),
    ]
    assert (taken[-1].at, taken[-1].limit) == (7.0, 0.03)
    link.stop()


def test_open_that_blocks_stops_neither_pacing_nor_requests_nor_the_end(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(link, 'ANSWER_TIME', ANSWER_TIME)
    bench.transport.gate.clear()
    bench.activate()
    wait_for(lambda: bench.transport.openers == 1, 2.0, 'an open in progress')
    done: list[float] = []
    paced = len(bench.owner.paced)
    bench.do(done.append, 'x')
    wait_for(lambda: done and len(bench.owner.paced) > paced + 10, 2.0, 'pace and request')
    bench.link.stop()
    assert bench.transport.openers == 1
    bench.transport.gate.set()
    wait_for(lambda: bench.transport.calls['close'] >= 1, 2.0, 'the late port closed')


# Requests.


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


def test_request_after_the_end_is_ignored(bench: Bench) -> None:
    bench.link.stop()
    before = os.open('/dev/null', os.O_WRONLY)  # takes the number of the closed descriptor
    bench.do(lambda now: None, 'x')
    os.close(before)
    with pytest.raises(TransportError, match='has ended'):
        bench.activate()


# Leaving.


def test_deactivations_from_several_threads_all_return_behind_one_farewell(bench: Bench) -> None:
    bench.run()
    bench.owner.log.clear()
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
    assert bench.transport.sent[-2:] == [b'bye 1', b'bye 2']
    assert not bench.transport.is_open
    assert bench.owner.log == ['stop True', 'event closed']
    assert bench.session.calls.count('farewell') == 1
    bench.run()
    assert bench.transport.calls['open'] == 2


def test_stop_says_farewell_once_and_ends_the_thread_also_without_a_start() -> None:
    bench = Bench()
    for starts in (False, True):
        if starts:
            bench = Bench()
            bench.link.start()
            bench.run()
            thread = thread_of(bench)
            assert thread is not None
            assert thread.daemon  # a program that ends without it does not wait
        for _ in range(2):
            bench.link.stop()
        bench.link.deactivate()
        assert bench.session.calls.count('farewell') == starts
        assert not bench.transport.is_open


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


def test_thread_that_ends_by_a_fault_says_so(bench: Bench) -> None:
    def leave(now: float) -> float:
        raise SystemExit

    bench.owner.pace = leave  # type: ignore[method-assign]
    wait_for(lambda: bench.owner.log[-1:] == ['ended SystemExit()'], 2.0, 'the end')


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
