"""
Distinguish two live publishers on one topic from one that was restarted.

Discovery counts a dead publisher for up to 20 s, so its count alone would reject a restarted
bridge. Sequence numbers show the difference: those of one publisher only grow, a restart sets them
back once, and those of two live publishers interleave, so they step back repeatedly.
"""

from collections import deque

UNSUPPORTED = (None, 0, 0xFFFFFFFFFFFFFFFF)  # what a middleware without sequence numbers reports


class PublisherWatch:
    """
    Watches the publication sequence numbers of one topic.

    :param window: seconds. Two steps back within a window mean two live publishers; after a
        window without a step back there is one again.
    :param settling_time: seconds after a step back until that is known.
    """

    def __init__(self, window: float = 1.0, settling_time: float = 0.25) -> None:
        self._window = window
        self._settling_time = settling_time
        self._last: int | None = None
        self._steps_back: deque[float] = deque(maxlen=2)

    def heard(self, sequence_number: int | None, now: float) -> int:
        """
        Note the sequence number of a message that arrived at ``now``, in monotonic seconds.

        Return the number of messages that were published before it and never arrived.
        """
        if sequence_number is None or sequence_number in UNSUPPORTED:
            return 0
        last, self._last = self._last, sequence_number
        if last is None:
            return 0
        if sequence_number <= last:
            self._steps_back.append(now)
            return 0
        return sequence_number - last - 1

    def doubled(self, now: float) -> bool:
        """Return whether two live publishers were heard within the last window."""
        return len(self._steps_back) == 2 and now - self._steps_back[0] <= self._window

    def settled(self, now: float) -> bool:
        """
        Tell whether all that came lately is of one publisher.

        What a restarted one says has to wait until it is known to be no second one.
        """
        if self._steps_back and now - self._steps_back[-1] <= self._settling_time:
            return False
        return not self.doubled(now)
