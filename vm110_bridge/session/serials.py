# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which packet is newer: manual section 3.2, 'Serial'.

A network loses, doubles and reorders datagrams. Only a packet that is newer than all before it may
say how things are now. Numbers wrap at 65536; a base unit that was restarted begins anew, which
looks like very old packets, so a new beginning has to last before it is believed. Until then its
packets are not taken for copies of those that had their numbers: a copy comes soon, and says the
same. One whose number is missing is late, and no beginning. After that, what comes late of the
numbers before would look new: it is known by them for a while, and where both lines have the same
numbers, by what it says.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum

_HALF = 0x8000  # further ahead than this is behind
_ALL = (1 << _HALF + 1) - 1
WINDOW = 64  # overtaken by more than this, a packet is history
RESTART_TIME = 1.0  # seconds that a line of numbers from the past has to go on, in silence
_RESTART_PACKETS = 4
_LARGEST_STEP = 64  # within such a line
FORMER_TIME = 8.0  # s for which packets of the line before may come, as long as WINDOW VRPI take
_FORMER_AHEAD = 8  # of its last, lost; a line that goes on after all is further by RESTART_TIME
_MOST_FORMER = 4  # a base unit takes seconds to restart


class Arrival(Enum):
    """How a packet's number relates to those before it."""

    NEW = 'newer than all before'
    LATE = 'overtaken by a newer one, not seen before'
    OLD = 'overtaken long ago, from before the first, or with a number that was used before'
    COPY = 'seen before, not long ago'


@dataclass(frozen=True, slots=True)
class _Former:
    """A line of numbers that may have ended; ``recent`` is as of SerialNumbers."""

    newest: int
    recent: list[object]
    ends_at: float

    def has(self, serial: int, content: object, *, shared: bool) -> bool:
        """Tell whether a packet is of it. :param shared: the newer line has such numbers, too."""
        behind = (self.newest - serial) & 0xFFFF
        if shared:
            return content in self.recent[behind : behind + 1]
        return (behind + _FORMER_AHEAD) & 0xFFFF < WINDOW + _FORMER_AHEAD


class SerialNumbers:
    """The numbers of one sender."""

    def __init__(self) -> None:
        self.lost = 0
        self.repeated = 0
        self.reordered = 0
        self.restarts = 0
        self.lines = 0  # how often numbers began anew, or may have: they went on far ahead
        self._newest: int | None = None
        self._seen = 0  # bit n: the number n below the newest came
        self._recent: list[object] = []  # at n: what came last with the number n below the newest
        self._length = (
            0  # numbers since the line began, the newest apart; those before are not lost
        )
        self._count_gap = True
        self._former: deque[_Former] = deque(maxlen=_MOST_FORMER)
        self._run_start = self._run_at = 0.0
        self._run_newest = 0
        self._run_length = 0

    def restarting(self, now: float) -> bool:
        """Tell whether a line of numbers from the past goes on: the sender may have restarted."""
        return self._run_length > 1 and now - self._run_at < RESTART_TIME

    def begin(self) -> None:
        """Forget all numbers: those of another sender come."""
        self._newest = None
        self._former.clear()

    def forgive_gap(self) -> None:
        """Do not count what was sent while nobody listened."""
        self._count_gap = False
        self._run_length = 0

    def hear(self, serial: int, now: float, *, silent: bool, content: object) -> Arrival:
        """
        Place a packet.

        :param silent: nothing new has come for so long that the link counts as lost.
        :param content: what the packet says; two that say the same are equal.
        """
        newest = self._newest
        ahead = _HALF if newest is None else (serial - newest) & 0xFFFF
        behind = -ahead & 0xFFFF
        if newest is None:
            self._start(serial, content)
        elif self._is_former(serial, newest, content, now):
            self.repeated += 1
            return Arrival.OLD
        elif 0 < ahead < _HALF:
            if ahead > WINDOW > serial:  # a restart begins at 0; all else is loss
                self._leave(newest, now)
            self._advance(serial, ahead, content)
        elif not (
            self._is_copy(behind, content) or self._is_missing(behind)
        ) and self._has_restarted(serial, now, silent):
            self.restarts += 1
            self._leave(newest, now)
            self._start(serial, content)
        else:
            return self._place_behind(behind, content)
        return Arrival.NEW

    def _leave(self, newest: int, now: float) -> None:
        self.lines += 1
        self._former.append(_Former(newest, self._recent, now + FORMER_TIME))

    def _is_former(self, serial: int, newest: int, content: object, now: float) -> bool:
        shared = (serial - newest + WINDOW) & 0xFFFF <= 2 * WINDOW
        return any(
            now < line.ends_at and line.has(serial, content, shared=shared)
            for line in self._former
        )

    def _start(self, serial: int, content: object) -> None:
        self._newest, self._seen, self._length = serial, 1, 0
        self._recent = [content, *[None] * (WINDOW - 1)]
        self._run_length, self._count_gap = 0, True

    def _advance(self, serial: int, ahead: int, content: object) -> None:
        self._seen = (self._seen << ahead | 1) & _ALL
        self._recent = [content, *[None] * (ahead - 1), *self._recent][:WINDOW]
        self._newest = serial
        self._run_length = 0
        if self._count_gap:
            self.lost += ahead - 1
            self._length = min(self._length + ahead, _HALF)
        else:
            self._count_gap, self._length = True, 0

    def _is_copy(self, behind: int, content: object) -> bool:
        """Tell whether it says the same as what came under its number, not long ago."""
        return content in self._recent[behind : behind + 1]

    def _is_missing(self, behind: int) -> bool:
        """Tell whether it has a number that did not come, not long ago."""
        return behind < WINDOW and behind <= self._length and not self._seen >> behind & 1

    def _place_behind(self, behind: int, content: object) -> Arrival:
        bit, is_copy = 1 << behind, self._is_copy(behind, content)
        if behind < WINDOW:
            self._recent[behind] = content
        if self._seen & bit:
            self.repeated += 1
            return Arrival.COPY if is_copy else Arrival.OLD
        self._seen |= bit
        self.reordered += 1
        if behind > self._length:
            return Arrival.OLD
        self.lost -= 1  # it was only late
        return Arrival.LATE if behind < WINDOW else Arrival.OLD

    def _has_restarted(self, serial: int, now: float, silent: bool) -> bool:
        """Follow a line of growing numbers from the past; tell when it is a new beginning."""
        if not silent:
            self._run_length = 0
            return False
        step = (serial - self._run_newest) & 0xFFFF
        if self._run_length and step == 0:
            return False  # a copy neither breaks the line nor carries it on
        if not (self._run_length and step <= _LARGEST_STEP):
            self._run_start, self._run_length = now, 0
        self._run_newest, self._run_at = serial, now
        self._run_length += 1
        return self._run_length >= _RESTART_PACKETS and now - self._run_start >= RESTART_TIME
