# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""When a recording begins and ends, so that a storm of stops gives one a minute. Pure."""

from __future__ import annotations

from dataclasses import dataclass
import math

_WEIGHTS = ('save', 'fault', 'trip', 'stop')  # how a reason begins, the weightiest last


@dataclass
class Schedule:
    """
    One recording at a time.

    What is asked for within one prolongs it, up to ``period``; then the next one follows. What is
    asked for later, but sooner than ``period`` after its beginning, waits until then: the ring
    still has it.

    :param after: seconds that a recording goes on after what was asked for.
    :param period: least seconds from the beginning of one to that of the next.
    :param reason: of what is recorded, or waits: the weightiest that was asked for.
    """

    after: float
    period: float
    reason: str = ''
    is_open: bool = False
    begun_at: float = -math.inf
    _asked_at: float = -math.inf

    def ask(self, reason: str, now: float, *, at_once: bool = False) -> None:
        """Have a recording made. :param at_once: somebody asks, so the period does not matter."""
        self._asked_at = now
        if not self.reason or _weight(reason) > _weight(self.reason):
            self.reason = reason
        if at_once and not self.is_open:
            self.begun_at = -math.inf

    def may_begin(self, now: float) -> bool:
        """Tell whether a recording has to begin now."""
        return bool(self.reason) and not self.is_open and now >= self.begun_at + self.period

    def begin(self, now: float) -> None:
        """Note that it has begun."""
        self.is_open, self.begun_at = True, now

    def may_end(self, now: float) -> bool:
        """Tell whether the recording is complete."""
        return self.is_open and now >= min(
            self._asked_at + self.after, self.begun_at + self.period
        )

    def end(self, now: float) -> None:
        """Note that it has ended; what is too young for it has the next one, at once."""
        self.is_open = False
        if now >= self._asked_at + self.after:
            self.reason = ''


def _weight(reason: str) -> int:
    return _WEIGHTS.index(reason.partition('_')[0])
