# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the operator is told on the remote: the mux's state and the first step, and a rumble.

It only puts messages into the queue, which goes out behind our heartbeats.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
import math

from bridge_core.watchdog import Watchdog
from fort_vsc_bridge.display_texts import lines_of, MuxStatus
from fort_vsc_bridge.protocol.frames import Message
from fort_vsc_bridge.protocol.messages import UserFeedback, UserFeedbackName
from fort_vsc_bridge.protocol.values import Key, TEXT_KEYS
from fort_vsc_bridge.session.send_queue import SendQueue

_NEWS_TIMEOUT = 2.0  # s; the mux repeats its status at 1 Hz or more
_STAYS = 1.0  # s that a text stays at least: four lines take as long (6.5)


class StatusDisplay:
    """
    Shows the mux's status, but while it lets drive and the user gave a text: then that.

    :param check: lets a message pass that the wire can carry, else it raises ValueError.
    """

    def __init__(self, queue: SendQueue, check: Callable[[Message], None]) -> None:
        self._queue, self._check = queue, check
        self._news = Watchdog(_NEWS_TIMEOUT)
        self._status: MuxStatus | None = None
        self._of_user = dict.fromkeys(TEXT_KEYS, '')
        self.lines: tuple[str, ...] = ()  # that are shown, or queued to be
        self._stays_until = -math.inf
        self._waits = False  # another text, until then

    def begin(self, now: float) -> None:
        """Begin on an open port: from now on the silence of the mux counts."""
        if not self._news.heard:
            self._news.feed(now)

    def hear(self, status: MuxStatus, now: float) -> None:
        """Take a status. Rumble where it is a new stop, or the deadman is refused anew."""
        self.poll(now)
        before, self._status = self._status, status
        self._news.feed(now)
        if before is not None:
            stopped = status.stops and not before.stops
            if stopped or status.refused > before.refused:
                self._rumble()
            if stopped:
                self._stays_until = now  # it waits for no other text
        self.poll(now)

    def take_text(self, lines: Iterable[UserFeedbackName], now: float) -> None:
        """Take lines of the user. :raises ValueError: the wire cannot carry one; none is taken."""
        lines = list(lines)
        for line in lines:
            self._check(line)
        self._of_user |= {line.key: line.name for line in lines}
        self.poll(now)

    def poll(self, now: float) -> None:
        """Queue what is to be shown now."""
        if self._status is not None and self._news.expired(now):
            if not self._status.stops:
                self._rumble()
            self._status = None
            self._stays_until = now
        wanted = self._wanted(now)
        self._waits = wanted != self.lines and now < self._stays_until
        if self._waits or wanted == self.lines:
            return
        before = self.lines or (None,) * len(wanted)
        changed = [
            UserFeedbackName(key, line)
            for key, line, old in zip(TEXT_KEYS, wanted, before, strict=True)
            if line != old
        ]
        self._queue.put(*changed)
        if changed[0].key == Key.TEXT_LINE_1:
            self._queue.put_first(changed[0])  # the state, before what is left of another text
        if not self._queue.shows(Key.DISPLAY_MODE):
            self._queue.put(UserFeedback(Key.DISPLAY_MODE, 1))
        self.lines = wanted
        self._stays_until = now + _STAYS

    @property
    def deadline(self) -> float:
        """The moment at which poll has something to do; infinite: never."""
        silent_at = math.inf if self.lines == lines_of(None) else self._news.deadline
        return min(silent_at, self._stays_until if self._waits else math.inf)

    def _wanted(self, now: float) -> tuple[str, ...]:
        status, text = self._status, tuple(self._of_user.values())
        if status is None:
            return lines_of(None) if self._news.heard and self._news.expired(now) else self.lines
        return text if status.state == 'ACTIVE' and any(text) else lines_of(status)

    def _rumble(self) -> None:
        self._queue.put(UserFeedback(Key.BOTH_VIBRATION, 1))
