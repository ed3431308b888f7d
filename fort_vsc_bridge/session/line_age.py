# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How old at most is what comes over a line that may queue, such as a serial server's?

The VSC is asked for a value (manual 7.3.7), and answers in its order with all else. So what comes
after an answer was said after its question went out: the round trip bounds the age. Between two
answers each heartbeat vouches for one interval: fewer heartbeats are a queue that grows.

The value is that of key 85, which the VSC itself has: others may have to come from the remote.
"""

from __future__ import annotations

from collections import deque
import math

from fort_vsc_bridge.protocol.values import Key

AGE_KEY = Key.USER_ESTOP_TIMEOUT
PERIOD = 1.0  # s between two questions; sooner where the bound has reached half of the limit
_LEAST_PERIOD = 0.1  # s; the VSC takes 20 a second (table 17)
LATE_TIME = 1.0  # s for which what comes is late after it was late last


class LineAge:
    """
    Follows how old at most is what comes over one line.

    :param limit: s; more is late. :param interval: s between two heartbeats of the device.
    """

    # s without an answer until the question or its answer is taken as lost, as an answer must not
    # be taken for that to a later question. Longer where answers or heartbeats are late.
    PATIENCE = 3.0
    FIRST_PATIENCE = 10.0

    def __init__(self, limit: float, interval: float) -> None:
        self.limit = limit
        self._interval = interval
        self.begin(-math.inf)

    def begin(self, now: float) -> None:
        """Begin on a new line, of which nothing is known."""
        self.trip = math.inf  # s of the newest question and its answer; infinite: no answer yet
        self.as_of = -math.inf  # what comes now was said later; -inf: nobody knows
        self.said_at = -math.inf  # the newest heartbeat was; likewise
        self.is_silent = False  # it does not answer
        self._asked: deque[float] = deque()  # what waits for an answer, the oldest first
        self._ask_at = now
        self._asked_last = -math.inf  # when the newest question went out
        # Until then an answer to a question of before this line may come, and be taken for ours.
        self._flushed_at = now + max(PERIOD, self.PATIENCE)
        self._answers_last = False  # no heartbeat has come since the answer
        self._late_until = -math.inf

    def asked(self, now: float) -> None:
        """Note that a question went out, whoever asked it."""
        self._give_up(now)
        self._asked.append(now)
        self._ask_at = now + PERIOD
        self._asked_last = now

    def answered(self, now: float) -> None:
        """Note that an answer came; one that nothing waits for is to the newest question."""
        asked = self._asked.popleft() if self._asked else self._asked_last
        if math.isfinite(asked):
            self._note_late(now)
            self.as_of = asked
            self.trip, self.is_silent, self._answers_last = now - asked, False, True

    def heard(self, now: float) -> None:
        """
        Note a heartbeat. The first one after an answer may have been said at its moment.

        A VSC that is set to send them faster vouches for no more than the time that has passed.
        """
        if not self._answers_last:
            self._note_late(now)
            self.as_of = min(self.as_of + self._interval, now - self.trip)
        self._answers_last, self.said_at = False, self.as_of

    def is_late(self, now: float) -> bool:
        """Tell whether what comes may be older than the limit, or was not long ago."""
        return now >= self.limit_at or now < self._late_until

    @property
    def limit_at(self) -> float:
        """The moment from which what comes may be too old; infinite where nobody knows."""
        return math.inf if math.isinf(self.as_of) else self.as_of + self.limit

    def changes_at(self, now: float) -> float:
        """Return the first moment after ``now`` at which time alone changes what is late."""
        moments = (self.limit_at, self._late_until)
        return min((each for each in moments if each > now), default=math.inf)

    @property
    def ask_at(self) -> float:
        """The moment at which to ask, even if that is past."""
        if self._asked:
            return self._asked[0] + self._patience
        least = self._asked_last + _LEAST_PERIOD
        if not -math.inf < self._asked_last < self._flushed_at:
            return min(self._ask_at, max(self.limit_at - self.limit / 2, least))
        # Leave the answer to the newest question time to come behind one of before.
        spare = self.limit / 10
        sooner = self.limit_at - spare if self.trip < self.limit - spare else math.inf
        return min(self._flushed_at, max(sooner, least))

    def _note_late(self, now: float) -> None:
        if now >= self.limit_at:
            self._late_until = now + LATE_TIME

    def _give_up(self, now: float) -> None:
        while self._asked and now >= self._asked[0] + self._patience:
            self.is_silent = True
            self._asked.popleft()

    @property
    def _patience(self) -> float:
        # An answer would have come with heartbeats that are young; with others it may be as late.
        young = self.trip <= self.limit and self.limit_at > self._asked[0] + self.PATIENCE
        return self.PATIENCE if young else self.FIRST_PATIENCE
