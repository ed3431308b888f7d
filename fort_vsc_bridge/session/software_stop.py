# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The stop that our heartbeats ask the VSC for: manual 7.3.4."""

from __future__ import annotations

import math

from bridge_core.watchdog import Watchdog

_ASKED = 'end what ~/software_estop asks for'


class SoftwareStop:
    """
    What ~/software_estop asks for, and what of it the VSC has heard.

    Once the topic was heard, its silence is a stop too. A stop that is over before the line takes
    it is asked for once all the same.

    :param timeout: seconds of silence. :param required: in use before the topic was ever heard.
    """

    def __init__(self, timeout: float, *, required: bool) -> None:
        self.in_use = required
        self.leaving = False  # this node ends: a stop, if it is in use
        self._required = required
        self._wanted = False
        self._heard = Watchdog(timeout)
        self._said = ''  # what ends the stop in our last heartbeat; empty: none
        self._owed = ''  # what ends, or ended, a stop that the VSC has not heard of
        self._spoke = False  # a heartbeat of ours went out, on any line

    def opened(self) -> None:
        """Begin on a new line: nobody knows what the one before has carried."""
        if self._spoke and not self.leaving:
            self._owed = self._owed or 'wait: the port was opened anew'
        self._said = ''
        self.leaving = False

    def want(self, stop: bool, now: float) -> None:
        """Take what the topic says. From now on it is in use."""
        before = self._remedy(now) if self._heard.heard else ''
        self.in_use = True
        self._wanted = stop
        self._heard.feed(now)
        if not self._said:
            self._owed = before or self._remedy(now)

    def forget_topic(self) -> None:
        """Be as before the topic was heard."""
        self.in_use = self._required
        self._wanted = False
        self._owed = ''
        self._heard.reset()

    def is_new(self, now: float) -> bool:
        """Tell whether there is a stop that our last heartbeat did not ask for."""
        return not self._said and bool(self._remedy(now))

    def offer(self, now: float) -> str:
        """Return what ends the stop that our next heartbeat asks for; empty: none."""
        remedy = self._remedy(now)
        if remedy and not self._said:
            self._owed = remedy
        return remedy

    def sent(self, remedy: str) -> None:
        """Note that a heartbeat of ours went out. :param remedy: what ``offer`` returned."""
        self._said, self._owed, self._spoke = remedy, '', True

    @property
    def deadline(self) -> float:
        """The moment at which our heartbeat has to ask for a stop; infinite while it does."""
        if not self.in_use or self._said:
            return math.inf
        return -math.inf if self._owed else self._heard.deadline

    def _remedy(self, now: float) -> str:
        if not self.in_use:
            return ''
        if self.leaving:
            return 'start this node anew'
        if self._heard.expired(now):
            return f'start what publishes ~/software_estop ({self._heard.describe(now)})'
        return _ASKED if self._wanted else self._owed
