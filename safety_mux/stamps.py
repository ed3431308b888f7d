# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Senders that repeat an old message: its stamp stays the same, while messages keep arriving.

A node whose pad is gone may go on with the last thing that it has heard of it. Only the sender can
tell that, by its stamps. They are compared with each other, and never with a clock: whether they
are late, early or step back is no matter.
"""

from bridge_core.watchdog import in_words, Watchdog

_NONE = (0, 0)  # what nobody has set


class StampWatch:
    """
    Watches the stamps of one topic.

    :param timeout: seconds that a stamp may stay the same. Above 0.
    :param required: whether one that stays longer, or is not set, is a fault; else it is a
        warning, and one that is not set is not.
    """

    def __init__(self, timeout: float, *, required: bool) -> None:
        self._changed = Watchdog(timeout)
        self._required = required
        self._newest = _NONE
        self._text: str | None = None

    def hear_stamp(self, stamp: tuple[int, int], now: float) -> None:
        """Take the stamp, in seconds and nanoseconds, of a message that arrived at ``now``."""
        if stamp != self._newest or not self._changed.heard:
            self._changed.feed(now)
        self._newest = stamp
        self._text = None
        if self._changed.expired(now):
            same = f'its stamp has been the same for {in_words(self._changed.age(now))}'
            self._text = 'its messages have no stamp' if stamp == _NONE else same

    @property
    def fault(self) -> str | None:
        """Why the newest message does not count, in words; None if it does."""
        return self._text if self._required else None

    @property
    def warning(self) -> str | None:
        """Why the newest message may be an old one, in words; None if nothing tells so."""
        return None if self._required or self._newest == _NONE else self._text
