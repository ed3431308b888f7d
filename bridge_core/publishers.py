# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Distinguish two live publishers on one topic from one that was restarted.

Discovery counts a dead publisher for up to 20 s, so its count alone would reject a restarted
bridge. Sequence numbers show the difference: those of one publisher only grow, a restart sets them
back once, and those of two live publishers interleave. So one is heard again after the other, as
soon as a slow one has said one message, and fast ones set the numbers back repeatedly.
"""

from collections import deque

UNSUPPORTED = (None, 0, 0xFFFFFFFFFFFFFFFF)  # what a middleware without sequence numbers reports
_LIVE = 3.0  # s; who was heard within may well be alive, and be heard again
_LOST = 10  # messages that a publisher may lose while another is heard


class PublisherWatch:
    """
    Watches the publication sequence numbers of one topic.

    Two live publishers count as such for as long as discovery knows of two (``counted``), and for
    3 s after they were last told apart. ``blind``: the middleware tells no numbers. Then all that
    discovery knows count, one that has just died among them.

    :param window: seconds. Two steps back within a window mean two live publishers.
    :param settling_time: seconds after a step back until it is known that there is one.
    """

    def __init__(self, window: float = 1.0, settling_time: float = 0.25) -> None:
        self._window = window
        self._settling_time = settling_time
        self._last: tuple[int, float] | None = None  # the newest number, and when it came
        self._former: tuple[int, float] | None = None  # the same, before the numbers last jumped
        self._found_at: float | None = None  # two live publishers
        self._several = False
        self.blind = False
        self._steps_back: deque[float] = deque(maxlen=2)

    def heard(self, sequence_number: int | None, now: float) -> int:
        """
        Note the sequence number of a message that arrived at ``now``, in monotonic seconds.

        Return the number of messages that were published before it and never arrived.
        """
        self.blind = sequence_number in UNSUPPORTED
        if sequence_number is None or self.blind:
            return 0
        before, self._last = self._last, (sequence_number, now)
        if before is None or sequence_number == before[0] + 1:
            return 0
        former, self._former = self._former, before
        if sequence_number <= before[0]:
            self._steps_back.append(now)
        if former is not None and _resumed(former, before, sequence_number, now):
            self._found_at = now
            return sequence_number - former[0] - 1
        if len(self._steps_back) == 2 and now - self._steps_back[0] <= self._window:
            self._found_at = now
        return max(0, sequence_number - before[0] - 1)

    def counted(self, publishers: int) -> None:
        """Note how many publishers discovery knows: two were found until there is one again."""
        self._several = publishers > 1
        if not self._several:
            self._found_at = None

    def doubled(self, now: float) -> bool:
        """Return whether two live publishers were heard, and neither is known to be gone."""
        if self.blind:
            return self._several
        if self._found_at is None:
            return False
        return self._several or now - self._found_at <= _LIVE

    def settled(self, now: float) -> bool:
        """
        Tell whether all that came lately is of one publisher.

        What a restarted one says has to wait until it is known to be no second one.
        """
        if self._steps_back and now - self._steps_back[-1] <= self._settling_time:
            return False
        return not self.doubled(now)


def _resumed(former: tuple[int, float], last: tuple[int, float], number: int, now: float) -> bool:
    """Tell whether ``number`` continues the numbers before the last jump, not those after it."""
    ahead = number - former[0]
    jumps = number <= last[0] or last[0] < former[0]
    return jumps and 0 < ahead <= 1 + _LOST and now - former[1] <= _LIVE
