"""
The link thread: one a device, and the only one that touches its port and its session.

It waits in the kernel for bytes or for the next deadline, stamps what it reads, gives it to the
session, sends the frames and hands the events to the owner that the session returns. Requests from
other threads go into a mailbox. It lives as long as the node, port or no port, because a stop is
published without a port too.
"""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass
import itertools
import math
import os
import select
import threading
import time
import traceback
from typing import Any
from typing import Generic
from typing import Protocol

from bridge_core.session import Session
from bridge_core.transports import FrameT
from bridge_core.transports import Transport
from bridge_core.transports import TransportError

Request = Callable[[float], None]

BACKOFF_START = 0.1
_LONGEST_WAIT = 1.0
# Nobody is called sooner than this again after having been called: who keeps saying "now" is at
# fault, and must not take the whole processor.
_SHORTEST_WAIT = 0.0005
_FAREWELL_TIME = 0.1
# Waking this much later than meant, this process was frozen: what waits in the port is old news.
_FROZEN_TIME = 0.2
_DISCARD_READS = 1000
_ACTIVATE_TIME = 10.0  # a machine that is starved at start-up is no reason to give up
_ANSWER_TIME = 0.4  # a process has to be gone within a second of its signal


class Owner(Protocol):
    """Who takes events and changes of the port, always on the link thread."""

    def on_events(self, events: Sequence[Any], now: float) -> None:
        """Take events of the session, in their order."""

    def pace(self, now: float) -> float:
        """Publish what is due; return when to be called next."""

    def link_changed(self, text: str, ok: bool) -> None:
        """Log that the port was opened, lost or could not be opened."""


@dataclass(slots=True)
class LinkStatus:
    """The port's own story."""

    is_open: bool = False
    error: str = 'not opened yet'
    opens: int = 0
    sent: int = 0
    dropped: int = 0  # frames that the line had no room for


class Mailbox:
    """
    Requests for the link thread: of one key, the latest wins.

    A sticky request (a stop) is not replaced by later ones that are not sticky, and all sticky
    ones come out first. The session is polled after each, so that a stop and a release that
    arrive together still stop.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sticky: dict[str, Request] = {}
        self._latest: dict[str, Request] = {}

    def put(self, key: str, request: Request, *, sticky: bool = False) -> None:
        """Replace what waits under ``key``."""
        with self._lock:
            self._latest.pop(key, None)
            (self._sticky if sticky else self._latest)[key] = request

    def take(self) -> list[Request]:
        """Return and forget all requests, the sticky ones first."""
        with self._lock:
            requests = [*self._sticky.values(), *self._latest.values()]
            self._sticky.clear()
            self._latest.clear()
        return requests


class Link(Generic[FrameT]):
    """
    The thread, the port and the mailbox of one device.

    :param reconnect_period: the longest wait, in seconds, between two tries to open the port.
    """

    def __init__(self, name: str, owner: Owner, *, reconnect_period: float = 1.0) -> None:
        self.status = LinkStatus(error='the node is not active')
        self._owner = owner
        self._reconnect_period = reconnect_period
        self._mailbox = Mailbox()
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._wake_lock = threading.Lock()
        self._call_numbers = itertools.count()
        self._transport: Transport[FrameT] | None = None
        self._opening: Transport[FrameT] | None = None  # a thread is at work in its open()
        self._session: Session[FrameT, Any, Any] | None = None
        self._backoff = BACKOFF_START
        self._open_at = math.inf
        self._pace_at = self._polled_at = self._complain_at = self._stepped_at = 0.0
        self._quit = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Start the thread, without a port."""
        self._thread.start()

    def post(self, key: str, request: Request, *, sticky: bool = False) -> None:
        """Have ``request(now)`` called on the link thread soon; see Mailbox."""
        self._mailbox.put(key, request, sticky=sticky)
        self._wake()

    def call(self, request: Request, *, timeout: float = _ANSWER_TIME) -> None:
        """
        Run a request on the link thread and wait for its end.

        :raises TransportError: the thread has ended, or does not answer within ``timeout`` s.
        """
        if not self._thread.is_alive():
            raise TransportError('the link thread has ended')
        done = threading.Event()

        def call(now: float) -> None:
            try:
                request(now)
            finally:
                done.set()

        # A key of its own: a later call must not replace one that somebody waits for.
        self.post(f'call {next(self._call_numbers)}', call)
        if not done.wait(timeout=timeout):
            raise TransportError('the link thread does not answer')

    def activate(self, transport: Transport[FrameT], session: Session[FrameT, Any, Any]) -> None:
        """Open the port, now and whenever it was lost, and run the session on it."""
        self.call(lambda now: self._activate(transport, session, now), timeout=_ACTIVATE_TIME)

    def deactivate(self) -> None:
        """Send the farewell and close the port; returns when that is done."""
        if self._thread.is_alive():
            self.call(self._deactivate)

    def transport_counts(self) -> dict[str, int | str]:
        """Return what the port has received and not handed up; call it on the link thread."""
        return {} if self._transport is None else self._transport.counts()

    def stop(self) -> None:
        """End the thread, farewell included; may be called twice. Raises nothing."""
        if self._thread.is_alive():
            self._quit = True
            self._wake()
            self._thread.join(timeout=_ANSWER_TIME)
        if not self._thread.is_alive():
            with self._wake_lock:
                if self._wake_fd >= 0:
                    os.close(self._wake_fd)
                self._wake_fd = -1

    def _wake(self) -> None:
        with self._wake_lock:  # a number of a closed descriptor may be somebody else's by now
            if self._wake_fd >= 0:
                os.eventfd_write(self._wake_fd, 1)

    def _run(self) -> None:
        self._stepped_at = time.monotonic()
        while not self._quit:
            self._guarded(self._wait_and_step)
        self._guarded(lambda: self._deactivate(time.monotonic()))

    def _guarded(self, step: Callable[[], None]) -> None:
        """Survive a fault of ours: stop, say so, start the link anew after a while."""
        try:
            step()
        except Exception:
            now = time.monotonic()
            self._pace_at = now + BACKOFF_START
            try:
                self._lose(f'internal error: {traceback.format_exc()}', now)
            except Exception:  # the owner fails, too
                self._complain(traceback.print_exc, now)

    def _complain(self, say: Callable[[], None], now: float) -> None:
        """Say something about a fault that may come again and again, once a second at most."""
        if now >= self._complain_at:
            self._complain_at = now + 1.0
            say()

    def _wait_and_step(self) -> None:
        # Anything that a request changes counts at once, so read the clock after the wait.
        meant, readable = self._wait()
        now = time.monotonic()
        frozen = now - meant
        self._stepped_at = now
        if frozen > _FROZEN_TIME and self.status.is_open:
            readable = False
            self._guarded(lambda: self._forget_backlog(frozen, now))
        for request in self._mailbox.take():
            self._guarded(lambda request=request: self._serve(request, now))  # type: ignore[misc]
        if self.status.is_open:
            self._exchange(readable, now)
        elif now >= self._open_at:
            self._start_opening()
        self._pace_at = max(self._owner.pace(now), now + _SHORTEST_WAIT)

    def _serve(self, request: Request, now: float) -> None:
        request(now)
        if self.status.is_open:
            self._exchange(False, now)

    def _forget_backlog(self, frozen: float, now: float) -> None:
        """Discard what waited while this process was frozen: it is old, and it may be a stop."""
        assert self._transport is not None
        assert self._session is not None
        try:
            for _ in range(_DISCARD_READS):
                if not select.select([self._transport.fileno()], [], [], 0.0)[0]:
                    break
                self._transport.receive()
        except TransportError as error:
            self._lose(str(error), now)
            return
        reason = f'this node was held up for {frozen:.1f} s, and discarded what came meanwhile'
        self._session.interrupted(
            now, f'{reason}; if it happens again, give the computer less work'
        )

    def _wait(self) -> tuple[float, bool]:
        """
        Sleep until something is due; tell whether the port has to say.

        The other result is when this should be over, counted from the last step: the process may
        have been frozen in the midst of that one too.
        """
        deadline = min(self._pace_at, self._open_at)
        descriptors = [self._wake_fd]
        if self._session is not None and self._transport is not None and self.status.is_open:
            due = max(self._session.deadline(), self._polled_at + _SHORTEST_WAIT)
            deadline = min(deadline, due)
            descriptors.append(self._transport.fileno())
        timeout = min(max(deadline - time.monotonic(), 0.0), _LONGEST_WAIT)
        ready = select.select(descriptors, [], [], timeout)[0]
        if self._wake_fd in ready:
            os.eventfd_read(self._wake_fd)
        return self._stepped_at + timeout, len(descriptors) == 2 and descriptors[1] in ready

    def _exchange(self, readable: bool, now: float) -> None:
        assert self._transport is not None
        assert self._session is not None
        try:
            if readable:
                for data in self._transport.receive():
                    self._deliver(self._session.receive(data, now), now)
            self._deliver(self._session.poll(now), now)
            self._polled_at = now
        except TransportError as error:
            self._lose(str(error), now)
            return
        if self._session.link_up:
            self._backoff = BACKOFF_START

    def _deliver(self, output: tuple[Sequence[Any], Sequence[FrameT]], now: float) -> None:
        """Frames first (a stop on the wire), then the events."""
        assert self._transport is not None
        events, frames = output
        for frame in frames:
            if self._transport.send(frame):
                self.status.sent += 1
            else:
                self.status.dropped += 1
        if events:
            self._owner.on_events(events, now)

    def _activate(
        self, transport: Transport[FrameT], session: Session[FrameT, Any, Any], now: float
    ) -> None:
        self._deactivate(now)
        self._transport, self._session = transport, session
        self.status = LinkStatus()
        self._backoff = BACKOFF_START
        self._open_at = now

    def _deactivate(self, now: float) -> None:
        transport, session, was_open = self._transport, self._session, self.status.is_open
        self._transport = self._session = None  # first, so that no fault below opens it again
        self._open_at = math.inf
        self.status.is_open, self.status.error = False, 'the node is not active'
        if transport is None or session is None or not was_open:
            return
        try:
            self._say_farewell(transport, session.farewell(now))
            # The stop is published before the port is closed, which may take a while.
            self._owner.on_events(session.closed(now), now)
        finally:
            transport.close()

    def _say_farewell(self, transport: Transport[FrameT], frames: list[FrameT]) -> None:
        end = time.monotonic() + _FAREWELL_TIME
        try:
            for frame in frames:
                # A line busy with earlier frames is no reason to leave the device moving.
                while not transport.send(frame) and time.monotonic() < end:
                    time.sleep(0.001)
        except TransportError as error:
            self._owner.link_changed(f'no farewell: {error}', False)

    def _start_opening(self) -> None:
        assert self._transport is not None
        self._open_at, self._opening = math.inf, self._transport
        threading.Thread(target=self._open, args=(self._transport,), daemon=True).start()

    def _open(self, transport: Transport[FrameT]) -> None:
        """Open the port, beside the link thread: a URL port may take seconds to refuse."""
        error = ''
        try:
            transport.open()
        except TransportError as failure:
            error = str(failure)
        except Exception:  # whatever a driver throws is a port that did not open
            error = f'cannot open {transport.name}: {traceback.format_exc()}'
        self.post(f'opened {id(transport)}', lambda now: self._opened(transport, error, now))
        if self._quit:
            transport.close()

    def _opened(self, transport: Transport[FrameT], error: str, now: float) -> None:
        if self._opening is transport:
            self._opening = None
        if transport is not self._transport or self._session is None:
            transport.close()  # deactivated meanwhile
        elif error:
            self._retry_later(error, now)
        else:
            self.status.is_open, self.status.error = True, ''
            self.status.opens += 1
            self._polled_at = now
            self._owner.link_changed(f'{transport.name} opened', True)
            try:
                self._deliver(self._session.opened(now), now)
            except TransportError as failure:
                self._lose(str(failure), now)

    def _lose(self, error: str, now: float) -> None:
        """Take the port as gone: forget what was heard, publish that, try again later."""
        transport, session, was_open = self._transport, self._session, self.status.is_open
        if transport is None or session is None:
            self._complain(lambda: self._owner.link_changed(error, False), now)
            return
        self._retry_later(error, now)
        try:
            self._owner.on_events(session.closed(now) if was_open else [], now)
        finally:
            if self._opening is not transport:
                transport.close()

    def _retry_later(self, error: str, now: float) -> None:
        news = self.status.is_open or self.status.error != error
        self.status.is_open, self.status.error = False, error
        if self._opening is not self._transport:  # else its end decides what comes next
            self._open_at = now + self._backoff
        self._backoff = min(2 * self._backoff, self._reconnect_period)
        if news:
            self._owner.link_changed(error, False)
