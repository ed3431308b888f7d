"""The link thread with everything around it at fault: port, session, owner and callers."""

from collections import Counter
from collections.abc import Callable
from collections.abc import Iterator
import contextlib
import functools
import itertools
import math
import os
import socket
import threading
import time
from typing import Any

import pytest

from bridge_core.framing import Counters
from bridge_core.transports import TransportError
from bridge_core.transports.link import Link
from bridge_core.transports.link import Mailbox
from bridge_core.transports.link import Output
from test.rig import holds_for
from test.rig import wait_for

PACE = 0.02


class FakeTransport:
    """A port on a socket pair; ``faults`` names the methods that fail, and with what."""

    def __init__(self, name: str = 'port') -> None:
        self.name = name
        self.faults: dict[str, Exception] = {}
        self.calls: Counter[str] = Counter()
        self.opens_at: list[float] = []
        self.sent: list[bytes] = []
        self.busy = 0  # sends that find the line busy
        self.gate = threading.Event()  # open() blocks until it is set
        self.gate.set()
        self.openers = self.most_openers = 0
        self._ours: socket.socket | None = None
        self.peer: socket.socket | None = None

    def _call(self, name: str) -> None:
        self.calls[name] += 1
        if name in self.faults:
            raise self.faults[name]

    def open(self) -> None:
        self.opens_at.append(time.monotonic())
        self.openers += 1
        self.most_openers = max(self.openers, self.most_openers)
        try:
            self.gate.wait(20.0)
            self._call('open')
            self._ours, self.peer = socket.socketpair()
            self._ours.setblocking(False)
        finally:
            self.openers -= 1

    def close(self) -> None:
        self.calls['close'] += 1
        for end in (self._ours, self.peer):
            if end is not None:
                end.close()
        self._ours = self.peer = None

    @property
    def is_open(self) -> bool:
        return self._ours is not None

    def fileno(self) -> int:
        return -1 if self._ours is None else self._ours.fileno()

    def receive(self) -> list[bytes]:
        self._call('receive')
        assert self._ours is not None
        data = self._ours.recv(4096)
        if not data:
            raise TransportError(f'{self.name}: unplugged')
        return [data]

    def send(self, frame: bytes) -> bool:
        self._call('send')
        if self.busy:
            self.busy -= 1
            return False
        self.sent.append(frame)
        return True

    def unplug(self) -> None:
        assert self.peer is not None
        self.peer.close()

    def say(self, data: bytes) -> None:
        assert self.peer is not None
        self.peer.send(data)


class FakeSession:
    """Healthy once it has received anything; ``faults`` names the methods that fail."""

    def __init__(self) -> None:
        self.estop = self.own_estop = True
        self.link_up = False
        self.counters = Counters()
        self.faults: set[str] = set()
        self.calls: list[str] = []
        self.received = b''
        self.due = math.inf
        self.wanted: list[bytes] = []
        self.stop = False

    def _call(self, name: str) -> None:
        self.calls.append(name)
        if name in self.faults:
            raise RuntimeError(f'fault in {name}')

    def opened(self, now: float) -> Output:
        self._call('opened')
        return ['opened'], [b'hello']

    def closed(self, now: float) -> list[Any]:
        self.estop = self.own_estop = True
        self.link_up = False
        self._call('closed')
        return ['closed']

    def receive(self, data: bytes, now: float) -> Output:
        self._call('receive')
        self.received += data
        self.estop = self.own_estop = False
        self.link_up = True
        return ['heard'], []

    def poll(self, now: float) -> Output:
        self._call('poll')
        frames, self.wanted = self.wanted, []
        if self.stop:
            frames.append(b'stop')
        return [], frames

    def deadline(self) -> float:
        if 'deadline' in self.faults:
            raise RuntimeError('fault in deadline')
        return self.due

    def farewell(self, now: float) -> list[bytes]:
        self._call('farewell')
        return [b'bye 1', b'bye 2']

    def frame_age(self, now: float) -> float:
        return math.inf

    def stop_reasons(self, now: float) -> list[str]:
        return []


class FakeOwner:
    """Notes what it is told; ``told`` is the stop as it would be published."""

    def __init__(self) -> None:
        self.session: FakeSession | None = None
        self.faults: set[str] = set()
        self.paced: list[float] = []
        self.told: list[bool] = []
        self.log: list[str] = []  # in the order of the calls
        self.next: float | None = None
        self.threads: set[int] = set()

    def on_event(self, event: Any) -> None:
        self.log.append(f'event {event}')
        if 'on_event' in self.faults:
            raise RuntimeError('fault in on_event')

    def pace(self, now: float) -> float:
        self.threads.add(threading.get_ident())
        self.paced.append(now)
        if 'pace' in self.faults:
            raise RuntimeError('fault in pace')
        stop = self.session is None or self.session.estop
        if not self.told or self.told[-1] != stop:
            self.log.append(f'stop {stop}')
        self.told.append(stop)
        return now + PACE if self.next is None else self.next

    def link_changed(self, text: str, ok: bool) -> None:
        self.log.append(f'{"ok" if ok else "bad"} {text}')
        if 'link_changed' in self.faults:
            raise RuntimeError('fault in link_changed')


class Bench:
    """A link with all its fakes, and the number of steps that its thread has made."""

    def __init__(self) -> None:
        self.owner, self.session, self.transport = FakeOwner(), FakeSession(), FakeTransport()
        self.link = Link('link', self.owner, reconnect_period=0.4)

    def activate(self) -> None:
        self.owner.session = self.session
        self.link.activate(self.transport, self.session)

    def wait_open(self) -> None:
        wait_for(
            lambda: self.link.status.is_open and self.session.calls[-1:] == ['poll'],
            5.0,
            'an open port',
        )

    def make_healthy(self) -> None:
        self.transport.say(b'x')
        wait_for(lambda: self.owner.told[-1] is False, 2.0, 'no stop')

    def run(self) -> None:
        self.activate()
        self.wait_open()
        self.make_healthy()

    def steps_within(self, duration: float) -> int:
        """Count how often the owner was paced: every step of the thread does."""
        start = len(self.owner.paced)
        holds_for(lambda: True, duration)
        return len(self.owner.paced) - start


@pytest.fixture
def bench() -> Iterator[Bench]:
    result = Bench()
    result.link.start()
    yield result
    result.transport.gate.set()
    result.link.stop()


def fault(now: float) -> None:
    raise ZeroDivisionError


def wait_at(gate: threading.Event, timeout: float = 2.0) -> Callable[[float], None]:
    """Return a request that keeps the link thread busy until the gate opens."""

    def wait(now: float) -> None:
        gate.wait(timeout)

    return wait


def fails(transport: FakeTransport, name: str, text: str) -> None:
    transport.faults[name] = TransportError(text)


# Opening, losing, opening again.


def test_the_stop_is_paced_without_a_port_and_without_a_session(bench: Bench) -> None:
    wait_for(lambda: len(bench.owner.told) >= 5, 2.0, 'five paces')
    assert all(bench.owner.told)


def test_port_opens_and_bytes_reach_the_session(bench: Bench) -> None:
    bench.activate()
    bench.wait_open()
    bench.transport.say(b'abc')
    wait_for(lambda: bench.session.received == b'abc', 2.0, 'the bytes')
    assert bench.transport.sent == [b'hello']
    assert bench.link.status.opens == 1


def test_absent_port_is_tried_for_ever_with_growing_pauses(bench: Bench) -> None:
    fails(bench.transport, 'open', 'cannot open port: no such port')
    bench.activate()
    wait_for(lambda: len(bench.transport.opens_at) >= 6, 10.0, 'six attempts')
    times = bench.transport.opens_at[:6]
    pauses = [b - a for a, b in itertools.pairwise(times)]
    # A pause may last longer on a busy machine, never shorter.
    for pause, least in zip(pauses, [0.1, 0.2, 0.4, 0.4, 0.4], strict=True):
        assert pause >= least
    assert bench.link.status.error == 'cannot open port: no such port'
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
    assert 'driver fault' in bench.link.status.error
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
    assert bench.link.status.opens == 2
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
        wait_for(lambda n=number: bench.link.status.opens == n, 5.0, 'an open port')
        wait_for(lambda: bench.session.calls[-1] == 'poll', 5.0, 'a poll')
        bench.transport.unplug()
        wait_for(lambda: not bench.link.status.is_open, 2.0, 'a lost port')
    times = bench.transport.opens_at
    assert times[3] - times[0] >= 0.1 + 0.2 + 0.4


def test_back_off_starts_anew_only_after_a_healthy_link(bench: Bench) -> None:
    bench.run()
    bench.transport.unplug()
    lost = time.monotonic()
    wait_for(lambda: len(bench.transport.opens_at) == 2, 2.0, 'the next attempt')
    assert bench.transport.opens_at[1] - lost < 0.4 + PACE  # 0.1 s, and not the longest pause


def test_open_that_blocks_stops_neither_pacing_nor_requests(bench: Bench) -> None:
    bench.transport.gate.clear()
    bench.activate()
    wait_for(lambda: bench.transport.openers == 1, 2.0, 'an open in progress')
    done: list[float] = []
    paced = len(bench.owner.paced)
    bench.link.post('x', done.append)
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
    assert not bench.link.status.is_open
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
    bench.link.post('hold', wait_at(hold))
    # Both come back while the link thread is busy with something else.
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
    bench.link.post('fault', fault)
    holds_for(lambda: bench.transport.openers == 1, 0.5, 'a single open')
    assert bench.transport.calls['close'] == 0  # not under the feet of the open either
    bench.transport.gate.set()
    bench.wait_open()
    assert bench.transport.most_openers == 1


# Requests.


def test_latest_of_a_key_wins() -> None:
    mailbox = Mailbox()
    seen: list[int] = []
    for number in range(3):
        mailbox.put('a', lambda now, number=number: seen.append(number))  # type: ignore[misc]
    for request in mailbox.take():
        request(0.0)
    assert seen == [2]
    assert mailbox.take() == []


def take_all(*puts: tuple[str, str, bool]) -> list[str]:
    mailbox = Mailbox()
    seen: list[str] = []
    for key, name, sticky in puts:
        mailbox.put(key, lambda now, name=name: seen.append(name), sticky=sticky)  # type: ignore[misc]
    for request in mailbox.take():
        request(0.0)
    return seen


def test_stop_is_not_replaced_by_a_release_and_comes_first() -> None:
    assert take_all(('e', 'stop', True), ('e', 'release', False)) == ['stop', 'release']
    assert take_all(('e', 'release', False), ('e', 'stop', True)) == ['stop']
    assert take_all(('e', 'stop', True), ('e', 'release', False), ('e', 'stop again', True)) == [
        'stop again'
    ]
    assert take_all(('c', 'command', False), ('e', 'stop', True)) == ['stop', 'command']


def test_stop_and_release_that_arrive_together_still_put_the_stop_on_the_wire(
    bench: Bench,
) -> None:
    bench.run()
    hold = threading.Event()
    bench.link.post('hold', wait_at(hold))
    bench.link.post('estop', lambda now: setattr(bench.session, 'stop', True), sticky=True)
    bench.link.post('estop', lambda now: setattr(bench.session, 'stop', False))
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
            bench.link.post(name, functools.partial(note, name=name))

    workers = [threading.Thread(target=post, args=(worker,)) for worker in range(8)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    wait_for(lambda: len(seen) == 1600, 5.0, lambda: f'1600 requests, {len(seen)} came')
    assert len(set(seen)) == 1600
    assert threads == bench.owner.threads
    assert len(threads) == 1


def test_newest_request_of_a_storm_is_never_lost(bench: Bench) -> None:
    last = -1

    def note(now: float, number: int) -> None:
        nonlocal last
        last = number

    for number in range(5000):
        bench.link.post('command', functools.partial(note, number=number))
    wait_for(lambda: last == 4999, 2.0, 'the newest request')


def test_session_is_polled_right_after_a_request(bench: Bench) -> None:
    bench.run()
    bench.link.post('x', lambda now: bench.session.wanted.append(b'now'))
    wait_for(lambda: b'now' in bench.transport.sent, 2.0, 'the frame')


def test_fault_in_one_request_does_not_lose_the_others(bench: Bench) -> None:
    bench.run()
    hold = threading.Event()
    seen: list[float] = []
    bench.link.post('hold', wait_at(hold))
    bench.link.post('bad', fault)
    bench.link.post('good', seen.append)
    hold.set()
    wait_for(lambda: seen, 2.0, 'the request behind the bad one')


def test_request_after_the_end_is_ignored(bench: Bench) -> None:
    bench.link.stop()
    before = os.open('/dev/null', os.O_WRONLY)  # takes the number of the closed descriptor
    bench.link.post('x', lambda now: None)
    os.close(before)
    with pytest.raises(TransportError, match='has ended'):
        bench.link.activate(bench.transport, bench.session)


# Leaving.


def test_deactivation_sends_the_farewell_tells_the_stop_and_closes(bench: Bench) -> None:
    bench.run()
    bench.owner.log.clear()
    bench.link.deactivate()
    assert bench.transport.sent[-2:] == [b'bye 1', b'bye 2']
    assert not bench.transport.is_open
    assert bench.owner.log == ['stop True', 'event closed']
    assert bench.session.calls[-2:] == ['farewell', 'closed']
    assert bench.link.status.error == 'the node is not active'
    bench.link.deactivate()
    assert bench.session.calls.count('farewell') == 1


def test_farewell_waits_for_a_busy_line(bench: Bench) -> None:
    bench.run()
    bench.transport.busy = 5
    bench.link.deactivate()
    assert bench.transport.sent[-2:] == [b'bye 1', b'bye 2']


def test_farewell_on_a_line_that_stays_busy_ends(bench: Bench) -> None:
    bench.run()
    bench.transport.busy = 10**9
    bench.link.deactivate()
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
    link = Link('link', FakeOwner())
    link.stop()
    link.stop()


def test_stop_does_not_wait_for_an_open_that_blocks(bench: Bench) -> None:
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
    bench.link.post('hold', wait_at(hold, 0.1))
    workers = [threading.Thread(target=deactivate) for _ in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert errors == []
    assert bench.session.calls.count('farewell') == 1


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


# Faults of ours: stop, say so, start anew, never spin.


def test_quiet_link_sleeps(bench: Bench) -> None:
    bench.run()
    assert bench.steps_within(0.5) < 0.5 / PACE + 30


@pytest.mark.parametrize('due', [0.0, -1.0, -math.inf])
def test_deadline_that_is_always_past_cannot_take_the_processor(bench: Bench, due: float) -> None:
    bench.run()
    bench.session.due = due
    bench.link.post('wake', lambda now: None)
    polls = bench.session.calls.count('poll')
    holds_for(lambda: True, 0.3)
    assert bench.session.calls.count('poll') - polls <= 0.3 / 0.0005 + 30
    bench.session.due = math.inf


def test_pace_that_is_always_due_cannot_take_the_processor(bench: Bench) -> None:
    bench.owner.next = 0.0
    assert bench.steps_within(0.3) <= 0.3 / 0.0005 + 30


def fault_of_session(name: str) -> Callable[[Bench], set[str]]:
    def cause(bench: Bench) -> set[str]:
        bench.session.faults.add(name)
        if name == 'receive':
            bench.transport.say(b'y')
        bench.link.post('wake', lambda now: None)
        return bench.session.faults

    return cause


def fault_of_owner(name: str) -> Callable[[Bench], set[str]]:
    def cause(bench: Bench) -> set[str]:
        bench.owner.faults.add(name)
        bench.transport.say(b'y')
        return bench.owner.faults

    return cause


@pytest.mark.parametrize(
    'cause',
    [
        *[fault_of_session(name) for name in ('receive', 'poll', 'deadline')],
        *[fault_of_owner(name) for name in ('on_event', 'pace')],
    ],
    ids=['receive', 'poll', 'deadline', 'on_event', 'pace'],
)
def test_fault_stops_backs_off_and_recovers(
    bench: Bench, cause: Callable[[Bench], set[str]], capfd: pytest.CaptureFixture[str]
) -> None:
    bench.run()
    faults = cause(bench)
    wait_for(lambda: bench.session.estop, 2.0, 'the stop')
    wait_for(lambda: 'closed' in bench.session.calls, 2.0, 'the session closed')
    assert bench.steps_within(0.5) < 0.5 / PACE + 60
    assert bench.session.estop
    assert len(capfd.readouterr().err.splitlines()) < 60
    faults.clear()
    bench.wait_open()
    bench.make_healthy()


@pytest.mark.parametrize('name', ['opened', 'closed'])
def test_fault_at_either_end_of_a_connection_recovers(bench: Bench, name: str) -> None:
    bench.activate()
    bench.wait_open()
    bench.session.faults.add(name)
    bench.transport.unplug()
    wait_for(lambda: name in bench.session.calls[3:], 2.0, 'the fault')
    holds_for(lambda: all(bench.owner.told), 0.3, 'the stop')
    bench.session.faults.clear()
    wait_for(lambda: bench.link.status.is_open, 3.0, 'an open port')


def test_port_counts_as_closed_before_the_session_can_fail(bench: Bench) -> None:
    bench.run()
    bench.transport.gate.clear()
    bench.session.faults.add('closed')
    bench.transport.unplug()
    wait_for(lambda: not bench.link.status.is_open, 2.0, 'a closed port')
    assert bench.steps_within(0.3) < 0.3 / PACE + 30


def test_owner_that_cannot_be_told_anything_makes_no_busy_loop_and_no_flood(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    bench.owner.faults |= {'pace', 'on_event', 'link_changed'}
    assert bench.steps_within(0.5) < 30
    with contextlib.suppress(TransportError):
        bench.activate()
    assert bench.steps_within(0.5) < 60
    assert capfd.readouterr().err.count('Traceback') <= 6
    bench.owner.faults.clear()
    bench.wait_open()


def test_fault_without_a_port_is_told_once_a_second_at_most(bench: Bench) -> None:
    bench.owner.faults.add('pace')
    assert bench.steps_within(0.5) < 30
    assert sum(line.startswith('bad internal error') for line in bench.owner.log) == 1
    bench.owner.faults.clear()
    wait_for(lambda: bench.owner.told, 2.0, 'pacing again')
