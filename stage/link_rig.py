# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fakes of all that a link has around it: port, session and owner, each of which can fail."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
import math
import socket
import threading
from typing import Any

from bridge_core import clock
from bridge_core.framing import Decoder
from bridge_core.reasons import Coded
from bridge_core.report import LinkStatus, Report
from bridge_core.session import Session, StopChanged, Verdict
from bridge_core.transports import TransportError
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.link import ThreadLink
from bridge_core.transports.request import Call
from stage.rig import holds_for, wait_for

PACE = 0.02


class FakeTransport:
    """A port on a socket pair; ``faults`` names the methods that fail, and with what."""

    is_pumped = False

    def __init__(self, name: str = 'port') -> None:
        self.name = name
        self.faults: dict[str, Exception] = {}
        self.calls: Counter[str] = Counter()
        self.sent: list[bytes] = []
        self.busy = 0  # sends that find the line busy
        self.gate = threading.Event()  # open() blocks until it is set
        self.gate.set()
        self.openers = 0
        self._ours: socket.socket | None = None
        self.peer: socket.socket | None = None

    def _call(self, name: str) -> None:
        self.calls[name] += 1
        if name in self.faults:
            raise self.faults[name]

    def open(self) -> None:
        self.openers += 1
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

    def counts(self) -> dict[str, int | str]:
        self._call('counts')
        return {}

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


Output = tuple[list[Any], list[Any]]


class FakeSession(Session[Any, bytes, str]):
    """Healthy once it has received anything; ``faults`` names the methods that fail."""

    def __init__(self) -> None:
        super().__init__(Decoder(), 1.0)
        self.faults: set[str] = set()
        self.calls: list[str] = []
        self.received = b''
        self.due = math.inf
        self.leaves = -math.inf
        self.wanted: list[bytes] = []
        self.stop = False
        self.told_sent: list[tuple[bytes, float]] = []
        self._pending: list[Any] = []

    def _call(self, name: str) -> None:
        self.calls.append(name)
        if name in self.faults:
            raise RuntimeError(f'fault in {name}')

    def opened(self, now: float) -> Output:
        self._call('opened')
        return ['opened'], [b'hello']

    def closed(self, now: float) -> list[Any]:
        self._call('closed')
        return [*self._change(Verdict.stop(link_up=False)), 'closed']

    def interrupted(self, reason: str, now: float) -> None:
        self._call('interrupted')
        self._pending = self._change(
            Verdict.stop(Coded('link.interrupted', reason), link_up=False)
        )

    def _change(self, verdict: Verdict) -> list[Any]:
        before, self.verdict = self.verdict, verdict
        return [] if before == verdict else [StopChanged(verdict)]

    def _take(self, message: bytes, now: float) -> None:
        raise NotImplementedError

    def _judge(self, now: float) -> Verdict:
        raise NotImplementedError

    def _silence(self, now: float) -> Coded:
        raise NotImplementedError

    def receive(self, data: bytes, now: float) -> Output:
        self._call('receive')
        self.received += data
        return [*self._change(Verdict()), 'heard'], []

    def poll(self, now: float) -> Output:
        self._call('poll')
        frames, self.wanted = self.wanted, []
        if self.stop:
            frames.append(b'stop')
        events, self._pending = self._pending, []
        return events, frames

    def sent(self, frame: bytes, now: float) -> None:
        self.told_sent.append((frame, now))

    def deadline(self) -> float:
        if 'deadline' in self.faults:
            raise RuntimeError('fault in deadline')
        return self.due

    def do(self, function: Callable[[float], object], now: float) -> None:
        """Let a test run something where the session runs."""
        function(now)

    def leaves_at(self) -> float:
        return self.leaves

    def farewell(self, now: float) -> list[bytes]:
        self._call('farewell')
        return [b'bye 1', b'bye 2']

    def frame_age(self, now: float) -> float:
        return math.inf

    def stop_reasons(self, now: float) -> list[Coded]:
        return []


class FakeOwner:
    """Notes what it is told; ``told`` is the stop as it would be published."""

    def __init__(self) -> None:
        self.stop = True
        self.faults: set[str] = set()
        self.paced: list[float] = []
        self.told: list[bool] = []
        self.verdicts: list[Verdict] = []
        self.log: list[str] = []  # in the order of the calls
        self.reports: list[Report] = []
        self.refused: list[tuple[int, str, str]] = []
        self.next: float | None = None
        self.threads: set[int] = set()
        self.carried: dict[str, Any] = {}

    def on_events(self, events: Sequence[Any], now: float) -> None:
        for event in events:
            if isinstance(event, StopChanged):
                self.verdicts.append(event.verdict)
                self._publish(event.verdict.estop)
            else:
                self.log.append(f'event {event}')
        if 'on_events' in self.faults:
            raise RuntimeError('fault in on_events')

    def on_report(self, report: Report, now: float) -> None:
        self.reports.append(report)

    def on_refused(self, number: int, key: str, text: str) -> None:
        self.refused.append((number, key, text))

    def carried_over(self, values: Mapping[str, Any]) -> dict[str, Any]:
        return {**self.carried, 'to': values.get('number')}

    def on_lost(self) -> None:
        self.log.append('lost')

    def link_ended(self, error: BaseException) -> None:
        self.log.append(f'ended {error!r}')

    def pace(self, now: float) -> float:
        self.threads.add(threading.get_ident())
        self.paced.append(now)
        if 'pace' in self.faults:
            raise RuntimeError('fault in pace')
        self._publish(self.stop)
        return now + PACE if self.next is None else self.next

    def _publish(self, stop: bool) -> None:
        if not self.told or self.told[-1] != stop:
            self.log.append(f'stop {stop}')
        self.stop = stop
        self.told.append(stop)

    def link_changed(self, text: str, ok: bool) -> None:
        self.log.append(f'{"ok" if ok else "bad"} {text}')
        if 'link_changed' in self.faults:
            raise RuntimeError('fault in link_changed')


class Bench:
    """A wire with all its fakes, in a thread that counts its steps."""

    def __init__(self) -> None:
        self.owner, self.session = FakeOwner(), FakeSession()
        self.transport: Any = FakeTransport()
        self.on_make: Callable[[], None] = lambda: None  # may raise what contradicts
        self.bridge: Bridge[Any] = Bridge(
            __name__, self._make_session, lambda values: self.transport
        )
        self.link = ThreadLink('link', self.bridge, self.owner, reconnect_period=0.4)

    def _make_session(self, values: dict[str, Any]) -> FakeSession:
        self.on_make()
        return self.session

    @property
    def status(self) -> LinkStatus:
        return self.link.wire.status

    def activate(self) -> None:
        self.link.activate({})

    def do(self, function: Callable[[float], object], key: str = '', *, stop: bool = False) -> int:
        """Have the wire's thread call ``function`` with the time; return the request's number."""
        return self.link.request(Call('do', (function,)), key=key, stop=stop)

    def wait_open(self) -> None:
        wait_for(
            lambda: self.status.is_open and self.session.calls[-1:] == ['poll'],
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

    def opened(self, times: int) -> bool:
        return self.status.opens == times

    def steps_within(self, duration: float) -> int:
        """Count how often the owner was paced: every step of the thread does."""
        begin = clock.now()
        holds_for(lambda: True, duration)
        return sum(begin <= at < begin + duration for at in self.owner.paced)


def fault(now: float) -> None:
    raise ZeroDivisionError


def wait_at(
    gate: threading.Event, timeout: float = 2.0, *, begun: threading.Event | None = None
) -> Callable[[float], None]:
    """Return what keeps the wire's thread busy until the gate opens, from ``begun`` on."""

    def wait(now: float) -> None:
        if begun is not None:
            begun.set()
        gate.wait(timeout)

    return wait


def fails(transport: FakeTransport, name: str, text: str) -> None:
    transport.faults[name] = TransportError(text)
