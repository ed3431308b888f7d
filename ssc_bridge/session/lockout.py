"""Locking the configuration menus out, and seeing that it worked: manual 3.6 and 4.2.2.3."""

from __future__ import annotations

import math

from ssc_bridge.protocol import Lockout
from ssc_bridge.session.events import LockoutDone

_REPEAT = 0.2  # s; one message may be lost
_PATIENCE = 1.0  # s until it is given up
_REFUSED = (
    'the SSC does not lock its configuration out: enable "On Rcv Msg 98" in its menu Config '
    'Lockout; it locks out by itself 5 s after power-on'
)


class LockoutKeeper:
    """One lockout at a time."""

    def __init__(self) -> None:
        self._due = self._until = math.inf

    @property
    def pending(self) -> bool:
        """A lockout was asked for, and how it went is not known yet."""
        return math.isfinite(self._until)

    def ask(self, now: float) -> None:
        """Begin, or begin again."""
        self._due, self._until = now, now + _PATIENCE

    def fail(self, text: str) -> list[LockoutDone]:
        """End a pending lockout without success."""
        return self._end(LockoutDone(False, text))

    def told(self, *, config_available: bool) -> list[LockoutDone]:
        """Take what a status message says of it."""
        if config_available:
            return []
        return self._end(LockoutDone(True, 'the configuration menus are locked out'))

    def expire(self, now: float) -> list[LockoutDone]:
        """End a lockout that takes too long."""
        return self.fail(_REFUSED) if now >= self._until else []

    def frames(self, now: float) -> list[bytes]:
        """Return the message that is due."""
        if now < self._due:
            return []
        self._due = now + _REPEAT
        return [Lockout().to_bytes()]

    @property
    def deadline(self) -> float:
        """When something is due; infinite if nothing is pending."""
        return min(self._due, self._until)

    def _end(self, event: LockoutDone) -> list[LockoutDone]:
        events = [event] if self.pending else []
        self._due = self._until = math.inf
        return events
