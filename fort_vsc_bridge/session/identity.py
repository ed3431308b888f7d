# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Serial number and firmware of the VSC, by what a fork of the vendor's driver does.

Nothing of it is in the manual. It asks, and writes nothing; but it unlocks the setup first, and
nobody knows for how long that lasts. So it is off unless the user wants it.
"""

from __future__ import annotations

import math

from fort_vsc_bridge.protocol.messages import SetupString, SetupStringGet, SetupUnlock
from fort_vsc_bridge.session.send_queue import SendQueue

_KEYS = {1: 'serial number', 111: 'firmware'}
_ASK_PERIOD = 2.0  # s
_QUESTIONS = 3
NOT_ANSWERED = 'not known, as the VSC does not answer'


class IdentityReader:
    """Asks for serial number and firmware once the VSC is heard; a few times, then no more."""

    def __init__(self, queue: SendQueue, *, wanted: bool) -> None:
        self.due = math.inf
        self._queue = queue
        self._wanted = wanted
        self._known: dict[str, str] = {}
        self._questions = 0

    @property
    def values(self) -> dict[str, str]:
        """What is known, by name; nothing unless it is wanted."""
        unknown = NOT_ANSWERED if self._questions > _QUESTIONS else 'not known yet'
        names = _KEYS.values() if self._wanted else ()
        return {name: self._known.get(name, unknown) for name in names}

    def link_changed(self, link_up: bool, now: float) -> None:
        """Forget, and ask anew when the link comes up: it may be another VSC."""
        self._known.clear()
        self._questions = 0
        self.due = now if link_up and self._wanted else math.inf

    def poll(self, now: float) -> None:
        """Ask for what is not known."""
        if now < self.due:
            return
        self._questions += 1
        unknown = [key for key, name in _KEYS.items() if name not in self._known]
        if not unknown or self._questions > _QUESTIONS:
            self.due = math.inf
            return
        for key in unknown:
            self._queue.put(SetupUnlock(), SetupStringGet(key))
        self.due = now + _ASK_PERIOD

    def answered(self, message: SetupString) -> None:
        """Take an answer to what was asked."""
        text = message.text.partition(b'\0')[0].decode('ascii', 'replace').strip()
        if self._questions and message.key in _KEYS and text.isprintable() and text:
            self._known[_KEYS[message.key]] = text
