# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A session and its clock, for tests: a wire's part, without a thread or a port."""

from collections.abc import Sequence
import math
from typing import Any, Generic, TypeVar

from bridge_core.session import RETRY

SessionT = TypeVar('SessionT', bound=Any)


def tell_sent(session: Any, frames: Sequence[Any], now: float) -> None:
    """Tell a session that frames of its last poll or farewell went out, as a wire does."""
    for frame in frames:
        session.sent(frame, now)


class SessionBench(Generic[SessionT]):
    """
    Drives one session as bridge_core.transports.link does.

    ``events`` and ``sent`` (with the time of each frame) keep all output. The tests of a bridge
    derive from it and add the messages of their device.
    """

    def __init__(self, session: SessionT) -> None:
        self.session = session
        self.now = 100.0
        self.events: list[Any] = []
        self.sent: list[tuple[float, Any]] = []
        self.busy = False  # the line takes no frame
        self._retry_at = -math.inf  # not before, as the line took no frame

    def open(self) -> list[Any]:
        """Open the port; return the events, as all these methods do."""
        return self._keep(self.session.opened(self.now))

    def close(self) -> list[Any]:
        return self._keep((self.session.closed(self.now), []))

    def take(self, *reads: Any) -> list[Any]:
        """Receive what the transport reads at once, then poll."""
        before = len(self.events)
        for data in reads:
            self._keep(self.session.receive(data, self.now))
        self.poll()
        return self.events[before:]

    def poll(self) -> list[Any]:
        return self._keep(self.session.poll(self.now))

    def wait(self, seconds: float) -> list[Any]:
        """Poll at every deadline."""
        before, end = len(self.events), self.now + seconds
        for _ in range(10_000):
            due = max(self.session.deadline(), self.now, self._retry_at)
            if due > end:
                break
            self.now = due
            self.poll()
        else:
            raise AssertionError('the session spins')
        self.now = end
        return self.events[before:]

    def _keep(self, output: tuple[list[Any], list[Any]]) -> list[Any]:
        events, frames = output
        self.events += events
        if not self.busy:
            tell_sent(self.session, frames, self.now)
            self.sent += [(self.now, frame) for frame in frames]
        elif frames:
            self._retry_at = self.now + RETRY
        return events
