# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How much later than before VRPI come: manual 3.2, 'Serial', and 5.1.1.

The base unit sends one each 125 ms, and numbers all that it sends. So VRPI that come later than
their numbers say are held back on the way, by a queue that shows no gap. What is held back from
the first one on cannot be seen: the base unit answers nothing of its own.
"""

from __future__ import annotations

PERIOD = 0.125  # s, as the manual has it
_MOST_ERROR = 0.01  # of it, in either direction: a timer of whole milliseconds, and its crystal
# The base unit's own period is learned, as 0.1 % for an hour are 4 s. It is known as well as the
# jitter of _JITTER s allows in the time that was watched, and no better than a crystal's drift.
_JITTER = 0.1
_DRIFT = 1e-4
_MEMORY = 3600.0  # s
_LEARNS_BELOW = 0.25  # s late: what is held back is no period
_EARLY = 0.05  # s before any expectation: what came before was held back, and is no measure
_LONG = 1000.0  # s of silence after which numbers may have wrapped


class Lateness:
    """Follows the VRPI of one base unit. :param limit: s later than before that are late."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.begin()

    def begin(self) -> None:
        """Begin anew: with other numbers, or another base unit."""
        self.lag = 0.0  # s that the newest VRPI came later than the earliest ones
        self.is_late = False
        self._newest: tuple[int, float] | None = None  # VRPI: its number, and when it came
        self._others = 0  # packets since, which are no VRPI
        self._watched = 0.0  # s, and how many periods that was
        self._periods = 0
        self._held = 0.0, 0  # the same since it was learned last

    def heard(self, serial: int, now: float) -> None:
        """Take the number of a VRPI that is newer than all before it."""
        before, self._newest = self._newest, (serial, now)
        if before is None:
            return
        gap, periods = now - before[1], (serial - before[0] & 0xFFFF) - self._others
        self._others = 0
        if gap >= _LONG:
            self.begin()
            self.heard(serial, now)
            return
        tolerance = min(max(_JITTER / max(self._watched, _JITTER), _DRIFT), _MOST_ERROR)
        expected = periods * self._period
        lag, drift = self.lag + gap - expected, expected * tolerance
        if self.is_late:  # what drifts, perhaps, makes it no younger: it ends as the queue does
            lag = min(max(lag - drift, self.limit), lag + drift)
        else:
            lag -= drift
        self.lag = max(lag, 0.0)
        self._held = self._held[0] + gap, self._held[1] + periods
        if lag < -_EARLY:
            self._watched, self._periods, self._held = 0.0, 0, (0.0, 0)
        elif lag < _LEARNS_BELOW:
            if self._held[0] * tolerance < _EARLY:  # else it may be held back still
                self._watched += self._held[0]
                self._periods += self._held[1]
            self._held = 0.0, 0
            if self._watched > _MEMORY:
                self._watched, self._periods = self._watched / 2, self._periods // 2
        self.is_late = self.lag > (self.limit / 2 if self.is_late else self.limit)

    def passed(self) -> None:
        """
        Note that a packet came that is newer than all before it, and no VRPI.

        What is lost counts as a VRPI, so a command that is lost or overtaken hides 0.125 s.
        """
        self._others += self._newest is not None

    @property
    def _period(self) -> float:
        if self._watched * _MOST_ERROR < _JITTER:  # the manual knows it better
            return PERIOD
        least, most = PERIOD * (1.0 - _MOST_ERROR), PERIOD * (1.0 + _MOST_ERROR)
        return min(max(self._watched / self._periods, least), most)
