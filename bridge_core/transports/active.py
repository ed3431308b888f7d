# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A session on a port, and what passes between the two while the port is open."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import time
from typing import Any, Generic

from bridge_core import clock
from bridge_core.report import LinkStatus, NOT_ACTIVE
from bridge_core.session import RETRY, Session
from bridge_core.transports import FrameT, Transport, TransportError
from bridge_core.transports.request import Call, Request
from bridge_core.transports.tap import Tap
from bridge_core.waiting import ready

# Nobody is called sooner than this again after having been called: who keeps saying "now" is at
# fault, and must not take the whole processor.
SHORTEST_WAIT = 0.0005
# Waking this much later than meant, this process was frozen: what waits in the port is old news.
FROZEN_TIME = 0.2
_PATIENCE = 0.01  # s that what comes may wait for the session's deadline, if it may wait at all
_FAREWELL_TIME = 0.1
_DISCARD_READS = 1000


class Active(Generic[FrameT]):
    """
    What one activation of a wire runs.

    :param resting: the session is that of an inactive node. :param status: of the port.
    :param tell: takes the session's events, and the time. :param tap: as of Wire.
    """

    def __init__(
        self,
        session: Session[FrameT, Any, Any],
        transport: Transport[FrameT],
        *,
        resting: bool,
        status: LinkStatus,
        tell: Callable[[Sequence[Any], float], None],
        tap: Tap | None,
    ) -> None:
        self.session = session
        self.transport = transport
        self.resting = resting
        self._status = status
        self._tell = tell
        self._tap = tap
        self._polled_at = self._retry_at = 0.0

    def ask(self, call: Call, request: Request, now: float) -> str:
        """Call the session; return why it refuses."""
        if self.resting:
            return NOT_ACTIVE
        age = now - request.at
        if age > request.limit and not request.stop:
            return f'it waited for {age * 1e3:.0f} ms, as this node was held up'
        if request.waits and not self._status.is_open:
            return self._status.error
        try:
            call.on(self.session, now)
        except ValueError as error:
            return str(error)
        return ''

    def due(self) -> float:
        """Return when the session is to be polled; a while after the line took no frame."""
        earliest = max(self._polled_at + SHORTEST_WAIT, self._retry_at)
        return max(self.session.deadline(), earliest)

    def waits(self, due: float) -> bool:
        """Tell whether to read only when the session is due, with one wake-up for both."""
        return self.session.may_wait() and due - clock.now() <= _PATIENCE

    def begin(self, now: float) -> None:
        """Begin on a port that has opened. :raises TransportError: it is gone."""
        self._deliver(self.session.opened(now), now)
        self.exchange(False, now)

    def exchange(self, readable: bool, now: float) -> None:
        """Receive if there is anything, then poll. :raises TransportError: the port is gone."""
        if readable:
            self.receive(now)
        self._deliver(self.session.poll(now), now)
        self._polled_at = now

    def receive(self, now: float) -> None:
        """Receive what there is. :raises TransportError: the port is gone."""
        for data in self.transport.receive():
            self._deliver(self.session.receive(data, now), now)
            self._show(False, [data], now)

    def discard(self) -> bool:
        """
        Discard what waits: it is old. Tell whether that is possible.

        What threads carry waits before them, too, where nobody sees it.

        :raises TransportError: the port is gone.
        """
        if getattr(self.transport, 'is_pumped', False):  # serial ports and CAN may be
            return False
        for _ in range(_DISCARD_READS):
            if not ready([self.transport.fileno()], 0.0):
                break
            self.transport.receive()
        return True

    def say_farewell(self, now: float) -> str:
        """Send the farewell; return why not all of it went out."""
        end = clock.now() + _FAREWELL_TIME
        error = ''
        for frame in self.session.farewell(now):
            try:
                # A line busy with earlier frames is no reason to leave the device moving.
                while not (taken := self.transport.send(frame)) and clock.now() < end:
                    time.sleep(0.001)
            except TransportError as failure:
                taken, error = False, str(failure)
            if taken:
                self.session.sent(frame, now)
                self._show(True, [frame], clock.now())
            else:
                error = error or f'{self.transport.name} takes nothing'
        return error

    def _deliver(self, output: tuple[Sequence[Any], Sequence[FrameT]], now: float) -> None:
        """
        Frames first (a stop on the wire), then the events, also where the port fails.

        Frames are dropped if there was a freeze since they were made: the next step says stop.
        """
        events, frames = output
        taken: list[FrameT] = []
        try:
            for frame in frames:
                if clock.now() - now <= FROZEN_TIME and self.transport.send(frame):
                    self._status.sent += 1
                    taken.append(frame)
                    self.session.sent(frame, now)
                else:
                    self._status.dropped += 1
                    self._retry_at = now + RETRY
        finally:
            at = clock.now()
            if events:
                self._tell(events, now)
            self._show(True, taken, at)

    def _show(self, sent: bool, frames: Iterable[FrameT], at: float) -> None:
        if self._tap is not None:
            for frame in frames:
                self._tap.note(sent, frame, at)  # type: ignore[arg-type]
