# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Freshness of anything that must keep coming. Time is an argument, so tests need no clock."""

from collections import deque
import math

# Why what is asked just after a freeze is not done.
FROZEN = 'this node was frozen, so it may have waited as long; ask again'


class Watchdog:
    """
    Tells whether something was heard within the last ``timeout`` seconds.

    Never heard is expired, and so is a clock that ran backwards: when in doubt, it is not fresh.

    :param timeout: seconds, above 0 and finite. :raises ValueError: for any other value.
    """

    def __init__(self, timeout: float) -> None:
        if not (math.isfinite(timeout) and timeout > 0.0):
            raise ValueError(f'a timeout must be above 0 s and finite, not {timeout}')
        self.timeout = timeout
        self._last: float | None = None

    def feed(self, now: float) -> None:
        """Note that it was heard at ``now`` (seconds, monotonic)."""
        self._last = now

    def reset(self) -> None:
        """Forget that it was ever heard."""
        self._last = None

    @property
    def heard(self) -> bool:
        """Tell whether it was heard at all since the start or the last reset."""
        return self._last is not None

    def age(self, now: float) -> float:
        """Return the seconds since it was heard; infinite if never."""
        return math.inf if self._last is None else now - self._last

    def expired(self, now: float) -> bool:
        """Tell whether it is not fresh at ``now``; exactly at ``deadline`` it is not any more."""
        # Compared with the sum that deadline is, so that who wakes up at the deadline finds it
        # expired whatever way the sums are rounded.
        last = self._last
        return last is None or not last <= now < last + self.timeout

    @property
    def deadline(self) -> float:
        """The moment at which it expires, even if that is past; infinite if it was never heard."""
        return math.inf if self._last is None else self._last + self.timeout

    def describe(self, now: float) -> str:
        """Say the age in words, such as 'last heard 312 ms ago, limit 250 ms'."""
        limit = f'limit {self.timeout * 1e3:.0f} ms'
        if self._last is None:
            return f'never heard, {limit}'
        return f'last heard {in_words(self.age(now))} ago, {limit}'


class RateWatch:
    """
    Tells whether something comes more often than one sender says it, so that two do.

    Two are told apart within a second, and count as two for a while after that.

    :param rate: of one sender, in Hz; half as many more in a second are not of one.
    """

    HOLD = 3.0  # s

    def __init__(self, rate: float) -> None:
        self._arrivals: deque[float] = deque(maxlen=math.floor(1.5 * rate) + 1)
        self.until = -math.inf  # two senders count as such until then

    def feed(self, now: float) -> None:
        """Note that it was heard at ``now`` (seconds, monotonic)."""
        self._arrivals.append(now)
        if len(self._arrivals) == self._arrivals.maxlen and now - self._arrivals[0] < 1.0:
            self.until = now + self.HOLD

    def exceeded(self, now: float) -> bool:
        """Tell whether two were heard not long ago."""
        return now < self.until


class FreezeWatch:
    """
    Notices that this process was frozen: what comes in just after may have waited as long.

    Look often, from any thread. Nothing else tells the age of what waits in the kernel.

    :param limit: seconds between two looks; more is a freeze.
    :param settling_time: seconds after a freeze until all that waited has come in.
    """

    def __init__(self, limit: float, settling_time: float) -> None:
        self._limit = limit
        self._settling_time = settling_time
        self._looked_at = math.inf
        self._settled_at = -math.inf

    def look(self, now: float) -> None:
        """Note that this process runs at ``now`` (seconds, monotonic)."""
        if now - self._looked_at > self._limit:
            self._settled_at = now + self._settling_time
        self._looked_at = now

    def settling(self, now: float) -> bool:
        """Look, and tell whether what comes at ``now`` may have waited."""
        self.look(now)
        return now < self._settled_at


def in_words(seconds: float) -> str:
    """Return a time in the unit that is read at a glance: ms, s from 10 s on, min from 10 min."""
    if seconds < 10.0:
        return f'{seconds * 1e3:.0f} ms'
    return f'{seconds:.0f} s' if seconds < 600.0 else f'{seconds / 60.0:.0f} min'
