# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is asked of a wire, who waits for the end of a command, and a wire in a thread."""

import functools
import os
import pickle
import re
import select
import threading
from typing import Any

import pytest

from bridge_core.transports import link, TransportError
from bridge_core.transports.link import Link, Mailbox, ThreadLink
from bridge_core.transports.request import Activate, Call, Deactivate, Request
from stage.link_rig import Bench, PACE
from stage.rig import wait_for
from stage.toy_wire import Session


class Further(Session):
    """As sessions of one device that speak over several wires."""

    def request_stop(self, value: bool, now: float) -> None:
        if now > 1.0:
            raise ValueError('too late')
        super().request_stop(not value, now)


def test_call_is_that_of_the_session_that_runs() -> None:
    call = Call.of(Session.request_stop, True)
    assert call == Call('request_stop', (True,))
    for kind, requested in ((Session, True), (Further, False)):
        session = kind(0.25)
        call.on(session, 1.0)
        assert session.requested is requested
    with pytest.raises(ValueError, match='too late'):
        call.on(session, 2.0)


@pytest.mark.parametrize(
    ('what', 'is_command'),
    [
        (Call.of(Session.ping), False),
        (Activate({'port': '/dev/toy'}, resting=True), True),
        (Deactivate(), True),
    ],
)
def test_request_goes_to_a_process_as_is(
    what: Call | Activate | Deactivate, is_command: bool
) -> None:
    request = Request(1, 'key', what, 1.0)
    there = Request(*pickle.loads(pickle.dumps(tuple(request))))
    assert there == request
    assert type(there.what) is type(what)
    assert there.is_command is is_command


# Requests that wait.


def request(number: int, key: str, *, stop: bool = False) -> Request:
    return Request(number, key, Call('set'), 0.0, stop=stop)


def is_readable(mailbox: Mailbox) -> bool:
    return bool(select.select([mailbox], [], [], 0)[0])


@pytest.mark.parametrize(
    ('puts', 'takes'),
    [
        # Letters are keys, capital ones of a stop; what has a + replaces nothing.
        ('aaa', [2]),
        ('a+a+a+', [0, 1, 2]),
        ('aa+a+', [0, 1, 2]),
        ('Ee', [0, 1]),
        ('eE', [1]),
        ('EeE', [2]),
        ('cE', [1, 0]),
        ('ED+A+E', [1, 2, 3]),  # behind the activation that it was asked after
    ],
)
def test_newest_of_a_key_is_taken_and_stops_first(puts: str, takes: list[int]) -> None:
    mailbox = Mailbox(lambda number, error: None)
    for number, (key, each) in enumerate(re.findall(r'(\w)(\+?)', puts)):
        mailbox.put(request(number, key.lower(), stop=key.isupper()), bool(each))
    assert [taken.number for taken in mailbox.take()] == takes
    assert mailbox.take() == []
    mailbox.close()


def test_it_is_readable_while_there_are_requests_and_from_the_end_on() -> None:
    mailbox = Mailbox(lambda number, error: None)
    assert not is_readable(mailbox)
    for number in range(2):
        mailbox.put(request(number, 'a'), True)
    assert is_readable(mailbox)
    assert len(mailbox.take()) == 2
    assert not is_readable(mailbox)
    mailbox.end()
    for _ in range(2):
        assert is_readable(mailbox)
        with pytest.raises(EOFError):
            mailbox.take()
    mailbox.close()


def test_its_descriptor_blocks_nobody_is_no_childs_and_is_closed_once() -> None:
    mailbox = Mailbox(lambda number, error: None)
    assert not os.get_blocking(mailbox.fileno())
    assert not os.get_inheritable(mailbox.fileno())
    mailbox.close()
    others = [os.open(os.devnull, os.O_RDONLY) for _ in range(3)]
    before = sorted(os.listdir('/proc/self/fd'))
    mailbox.close()
    assert sorted(os.listdir('/proc/self/fd')) == before
    for other in others:
        os.close(other)


class SilentLink(Link):
    """A link whose wire answers when the test says so."""

    def __init__(self) -> None:
        owner: Any = None
        bridge: Any = None
        super().__init__('silent', bridge, owner)
        self.put: list[tuple[Request, bool]] = []
        self.takes = True
        self.has_put = threading.Event()
        self.ended = threading.Event()
        self.start()

    def _put(self, request: Request, each: bool) -> bool:
        self.put.append((request, each))
        self.has_put.set()
        return self.takes

    def _run(self) -> None:
        self.ended.wait()

    def _end(self) -> None:
        self.ended.set()

    def answer(self, error: str) -> None:
        self._done(self.put[0][0].number, error)


@pytest.mark.parametrize('error', ['', 'rate is 0'])
def test_command_is_no_request_and_its_error_is_raised_where_it_was_given(error: str) -> None:
    """No other one replaces it, and age does not refuse it."""
    silent = SilentLink()
    ends: list[str] = []

    def activate() -> None:
        try:
            silent.activate({'rate': 1}, resting=True)
            ends.append('')
        except ValueError as raised:
            ends.append(str(raised))

    threading.Thread(target=activate).start()
    assert silent.has_put.wait(20.0)
    [(command, each)] = silent.put
    assert (command.what, command.stop, each) == (Activate({'rate': 1}, resting=True), True, True)
    silent.answer(error)
    wait_for(lambda: ends == [error], 20.0, 'the end')
    silent.stop()


@pytest.mark.parametrize('takes', [True, False])
def test_request_that_no_wire_takes_has_no_number(takes: bool) -> None:
    silent = SilentLink()
    silent.takes = takes
    number = silent.request(Call('ping'))
    assert number == (silent.put[0][0].number if takes else 0)
    silent.stop()


def test_command_that_nobody_answers_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    silent = SilentLink()
    monkeypatch.setattr(link, 'ANSWER_TIME', 0.01)
    with pytest.raises(TransportError, match='of silent does not answer'):
        silent.deactivate()
    assert not silent._waiting
    silent.answer('late')
    silent.stop()


# In a thread.


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
