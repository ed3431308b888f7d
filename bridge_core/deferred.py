# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What waits until a stop is out: events that came with it, then log lines."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import math
from typing import Any

from bridge_core.session import Level

_WAIT = 0.01  # s that the words about a stop leave to the stop itself
_SITE_PERIOD = 1.0  # s, between two lines of one site
_MOST_LINES = 1000  # that wait to be logged


class Deferred:
    """
    Events and log lines in their order, behind a stop.

    Any thread may ``log``; all else is for the thread of the link.

    :param tell: publishes an event.
    """

    def __init__(self, tell: Callable[[Any], None], logger: Any) -> None:
        self._tell = tell
        self._logger = logger
        self._events: deque[Any] = deque()
        self._holds = False  # events wait, so that none overtakes another
        self._lines: deque[tuple[Level, str]] = deque(maxlen=_MOST_LINES)
        self._logged_at: dict[str, float] = {}  # by site
        self._late: dict[str, tuple[Level, str]] = {}  # by site: the newest waits
        self.due = 0.0  # when ``flush`` is to be called

    def hold(self, now: float) -> None:
        """Hold events back: a stop was published."""
        self._holds = True
        self.due = min(self.due, now + _WAIT)

    def tell(self, event: Any) -> None:
        """Publish an event, now or behind what waits."""
        if self._holds:
            self._events.append(event)
        else:
            self._tell(event)

    def log(self, level: Level, text: str, now: float, site: str = '') -> None:
        """Have ``flush`` log a line; of each site one a second, and always the last one."""
        if site:
            if now < self._logged_at.get(site, -math.inf) + _SITE_PERIOD:
                self._late[site] = level, text
                return
            self._late.pop(site, None)
            self._logged_at[site] = now
        self._lines.append((level, text))
        self.due = min(self.due, now + _WAIT)

    def log_late(self, now: float) -> None:
        """Let sites whose second is over log what waits, and whatever else does."""
        for site in list(self._late):
            if now >= self._logged_at[site] + _SITE_PERIOD:
                late = self._late.pop(site, None)  # another thread logs, too
                if late is not None:
                    self.log(*late, now, site)
        self.due = min(self.due, now)  # whatever another thread did to it

    def flush(self) -> None:
        """Publish and log what waits."""
        self.due = math.inf
        while self._events:
            self._tell(self._events.popleft())
        self._holds = False  # not before: one may fail, and none may overtake those behind it
        while self._lines:
            level, text = self._lines.popleft()
            # On lines of their own: rclpy refuses a change of severity within one call site.
            if level is Level.OK:
                self._logger.info(text)
            elif level is Level.WARN:
                self._logger.warning(text)
            else:
                self._logger.error(text)
