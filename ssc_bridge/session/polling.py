# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Asking for the messages that do not come by themselves (manual 4.2.1), and for the lockout."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import math

from bridge_core.session import Answer, Pacer
from ssc_bridge.protocol import MessageType, Poll

LOCKOUT = 'lockout'  # the request's name in its Answer
_LOCKOUT_PERIOD = 0.2  # s; one message may be lost
_LOCKOUT_TIMEOUT = 1.0  # s
# What comes by itself may be late by this part of its period before it is asked for.
_LATE = 1.5


class Poller:
    """
    Polls; which messages are wanted at the moment, the session says.

    :param rates: Hz; a message with 0 is never asked for.
    """

    def __init__(self, rates: Mapping[MessageType, float]) -> None:
        self._periods = {kind: 1.0 / rate if rate else math.inf for kind, rate in rates.items()}
        self._due = dict.fromkeys(rates, math.inf)
        self._asked: set[MessageType] = set()  # and not answered yet

    def start(self, now: float) -> None:
        """Have all due at once, and none heard."""
        self._due = {
            kind: now if math.isfinite(period) else math.inf
            for kind, period in self._periods.items()
        }
        self._asked.clear()

    def heard(self, kind: MessageType, now: float) -> None:
        """Note that a message came."""
        if kind in self._asked:
            self._asked.remove(kind)
        else:
            self._due[kind] = now + _LATE * self._periods[kind]

    def frames(self, now: float, wanted: Iterable[MessageType]) -> list[bytes]:
        """Return the polls that are due."""
        return [Poll(kind).to_bytes() for kind in wanted if now >= self._due[kind]]

    def note_sent(self, kind: MessageType, now: float) -> None:
        """Note that this was asked for."""
        self._due[kind] = now + self._periods[kind]
        self._asked.add(kind)

    def deadline(self, wanted: Iterable[MessageType]) -> float:
        """Return when the next of these is due."""
        return min(self._due[kind] for kind in wanted)


class LockoutRequest:
    """A request to lock the configuration menus out (4.2.2.3), repeated until it is answered."""

    def __init__(self) -> None:
        self.pacer = Pacer(_LOCKOUT_PERIOD)  # runs while one is asked for
        self.deadline = math.inf

    def start(self, now: float) -> None:
        """Ask for it."""
        self.pacer.start(now)
        self.deadline = now + _LOCKOUT_TIMEOUT

    def finish(self, success: bool, text: str) -> list[Answer]:
        """Return the answer, if it is asked for."""
        if math.isinf(self.deadline):
            return []
        self.pacer.stop()
        self.deadline = math.inf
        return [Answer(LOCKOUT, success, text)]
