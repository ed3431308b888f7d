"""
The link thread: one a device, and the only one that touches its port and its session.

It waits in the kernel for bytes or for the next deadline, stamps what it reads, lets the session
think, sends what the session wants sent and hands its events to the owner. Requests from other
threads go into a mailbox. It lives as long as the node, port or no port, because a stop must be
told without a port too.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math
import os
import select
import threading
import time
import traceback
from typing import Any
from typing import Protocol

from bridge_core.framing import Counters
from bridge_core.transports import Transport
from bridge_core.transports import TransportError

Request = Callable[[float], None]
Output = tuple[list[Any], list[bytes]]

BACKOFF_START = 0.1
_LONGEST_WAIT = 1.0


class Session(Protocol):
    """What a link means over time; every room has one. ``now`` is seconds, monotonic."""

    @property
    def estop(self) -> bool:
        """The device or its link demands a stop, or has not proved itself healthy yet."""

    @property
    def own_estop(self) -> bool:
        """The same, without the echo of what this node itself asked of the device."""

    @property
    def link_up(self) -> bool:
        """Valid frames arrive within the link time-out."""

    @property
    def counters(self) -> Counters:
        """What was received so far."""

    def frame_age(self, now: float) -> float:
        """Return the seconds since the last good frame; infinite if there was none."""

    def stop_reasons(self, now: float) -> list[str]:
        """Say in words why ``estop`` is true, and what to do; empty if it is false."""

    def opened(self, now: float) -> Output:
        """Start: the port was opened. Return events and frames to send."""

    def closed(self, now: float) -> list[Any]:
        """Forget what was heard: the port is gone. Return events."""

    def receive(self, data: bytes, now: float) -> Output:
        """Take what came. Raises nothing."""

    def poll(self, now: float) -> Output:
        """Do what is due."""

    def deadline(self) -> float:
        """Return when poll wants to be called next; infinite for never."""

    def farewell(self, now: float) -> list[bytes]:
        """Return the frames that leave the device in its safe state."""


class Owner(Protocol):
    """Who is told, always on the link thread."""

    def handle(self, event: Any) -> None:
        """Take one event of the session."""

    def pace(self, now: float) -> float:
        """Publish what has changed or is due; return when to be called next."""

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
    ones come out first: a stop and a release that arrive together are still a stop.
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


class Link:
    """
    The thread, the port and the mailbox of one device.

    :param reconnect_period: the longest wait, in seconds, between two tries to open the port.
    """

    def __init__(self, name: str, owner: Owner, *, reconnect_period: float = 1.0) -> None:
        self.status = LinkStatus()
        self._owner = owner
        self._reconnect_period = reconnect_period
        self._mailbox = Mailbox()
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._transport: Transport | None = None
        self._session: Session | None = None
        self._backoff = BACKOFF_START
        self._open_at = math.inf
        self._pace_at = 0.0
        self._quit = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Start the thread, without a port."""
        self._thread.start()

    def post(self, key: str, request: Request, *, sticky: bool = False) -> None:
        """Have ``request(now)`` called on the link thread soon; see Mailbox."""
        self._mailbox.put(key, request, sticky=sticky)
        self._wake()

    def activate(self, transport: Transport, session: Session) -> None:
        """Open the port, now and whenever it was lost, and run the session on it."""
        self._call(lambda now: self._activate(transport, session, now))

    def deactivate(self) -> None:
        """Send the farewell and close the port; returns when that is done."""
        self._call(lambda now: self._deactivate(now))

    def stop(self) -> None:
        """End the thread; may be called twice."""
        if self._thread.is_alive():
            self.deactivate()
            self._quit = True
            self._wake()
            self._thread.join(timeout=1.0)
        if self._wake_fd >= 0 and not self._thread.is_alive():
            os.close(self._wake_fd)
            self._wake_fd = -1

    def _wake(self) -> None:
        if self._wake_fd >= 0:
            os.eventfd_write(self._wake_fd, 1)

    def _call(self, request: Request) -> None:
        """Run a request on the link thread and wait for its end."""
        done = threading.Event()

        def call(now: float) -> None:
            try:
                request(now)
            finally:
                done.set()

        self.post('link', call)
        if not done.wait(timeout=1.0):
            raise TransportError('the link thread does not answer')

    def _run(self) -> None:
        while not self._quit:
            try:
                self._wait_and_step()
            except Exception:  # a fault of ours: stop, say so, start the link anew, never spin
                self._survive()

    def _survive(self) -> None:
        try:
            self._lose(f'internal error: {traceback.format_exc()}', time.monotonic())
        except Exception:  # not even the owner can be told any more
            traceback.print_exc()
            time.sleep(BACKOFF_START)

    def _wait_and_step(self) -> None:
        # Anything that a request changes counts at once, so read the clock after the wait.
        readable = self._wait()
        now = time.monotonic()
        for request in self._mailbox.take():
            request(now)
        if self._session is not None and self.status.is_open:
            self._exchange(readable, now)
        elif now >= self._open_at:
            self._open_at = math.inf
            threading.Thread(target=self._open, args=(self._transport,), daemon=True).start()
        self._pace_at = self._owner.pace(now)

    def _wait(self) -> bool:
        """Sleep until something is to be done; tell whether the port has something to say."""
        deadline = min(self._pace_at, self._open_at)
        descriptors = [self._wake_fd]
        if self._session is not None and self._transport is not None and self.status.is_open:
            deadline = min(deadline, self._session.deadline())
            descriptors.append(self._transport.fileno())
        timeout = min(max(deadline - time.monotonic(), 0.0), _LONGEST_WAIT)
        ready = select.select(descriptors, [], [], timeout)[0]
        if self._wake_fd in ready:
            os.eventfd_read(self._wake_fd)
        return len(descriptors) == 2 and descriptors[1] in ready

    def _exchange(self, readable: bool, now: float) -> None:
        assert self._transport is not None
        assert self._session is not None
        try:
            if readable:
                for data in self._transport.receive():
                    self._deliver(self._session.receive(data, now), now)
            self._deliver(self._session.poll(now), now)
        except TransportError as error:
            self._lose(str(error), now)
            return
        if self._session.link_up:
            self._backoff = BACKOFF_START

    def _deliver(self, output: Output, now: float) -> None:
        """Frames first (a stop on the wire), then the stop topics, then everything else."""
        assert self._transport is not None
        events, frames = output
        for frame in frames:
            if self._transport.send(frame):
                self.status.sent += 1
            else:
                self.status.dropped += 1
        if events:
            self._owner.pace(now)
            for event in events:
                self._owner.handle(event)

    def _activate(self, transport: Transport, session: Session, now: float) -> None:
        self._transport, self._session = transport, session
        self.status = LinkStatus()
        self._backoff = BACKOFF_START
        self._open_at = now

    def _deactivate(self, now: float) -> None:
        transport, session = self._transport, self._session
        if transport is not None and session is not None and self.status.is_open:
            try:
                for frame in session.farewell(now):
                    transport.send(frame)
            except TransportError as error:
                self._owner.link_changed(f'no farewell: {error}', False)
            events = session.closed(now)
            transport.close()
            for event in events:
                self._owner.handle(event)
        self._transport = self._session = None
        self._open_at = math.inf
        self.status.is_open = False
        self.status.error = 'the node is not active'

    def _open(self, transport: Transport) -> None:
        """Open the port, beside the link thread: a URL port may take seconds to refuse."""
        error = ''
        try:
            transport.open()
        except TransportError as failure:
            error = str(failure)
        except Exception:  # whatever a driver throws is a port that did not open
            error = f'cannot open {transport.name}: {traceback.format_exc()}'
        self.post('opened', lambda now: self._opened(transport, error, now))

    def _opened(self, transport: Transport, error: str, now: float) -> None:
        if transport is not self._transport or self._session is None:
            transport.close()  # deactivated meanwhile
        elif error:
            self._retry_later(error, now)
        else:
            self.status.is_open, self.status.error = True, ''
            self.status.opens += 1
            self._owner.link_changed(f'{transport.name} opened', True)
            try:
                self._deliver(self._session.opened(now), now)
            except TransportError as failure:
                self._lose(str(failure), now)

    def _lose(self, error: str, now: float) -> None:
        """Take the port as gone: forget what was heard, tell, try again later."""
        if self._transport is None or self._session is None:
            self._owner.link_changed(error, False)
            return
        events = self._session.closed(now) if self.status.is_open else []
        self._retry_later(error, now)
        self._owner.pace(
            now
        )  # the stop goes out before the port is closed, which may take a while
        for event in events:
            self._owner.handle(event)
        self._transport.close()

    def _retry_later(self, error: str, now: float) -> None:
        if self.status.is_open or self.status.error != error:
            self._owner.link_changed(error, False)
        self.status.is_open, self.status.error = False, error
        self._open_at = now + self._backoff
        self._backoff = min(2 * self._backoff, self._reconnect_period)
