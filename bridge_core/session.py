"""What the sessions of all rooms share: verdicts on stops, neutral sticks, pacing."""

from __future__ import annotations

from dataclasses import dataclass
import math


@dataclass(frozen=True, slots=True)
class StopChanged:
    """An event: one of the three changed; they are the session's properties at this moment."""

    estop: bool
    own_estop: bool
    link_up: bool


@dataclass(frozen=True, slots=True)
class Verdict:
    """What one message, or several together, mean. :param reasons: in words, and what to do."""

    estop: bool = False
    own_estop: bool = False
    reasons: tuple[str, ...] = ()

    def worst(self, other: Verdict) -> Verdict:
        """Return both together: a stop in either is a stop."""
        return Verdict(
            self.estop or other.estop,
            self.own_estop or other.own_estop,
            tuple(dict.fromkeys(self.reasons + other.reasons)),
        )


class StickStream:
    """
    Sees to it that sticks which were told do not outlive what vouched for them.

    Once they do not count any more, or come no more, one neutral event is owed; then none.
    """

    __slots__ = ('_counted', 'streaming')

    def __init__(self) -> None:
        self.streaming = False  # events go out: the next silence owes a neutral one
        self._counted = False

    def told(self, *, counts: bool) -> None:
        """Note that sticks were told. :param counts: they were not forced to neutral."""
        self.streaming, self._counted = True, counts

    def owes_neutral(self, *, fresh: bool, counts: bool) -> bool:
        """
        Tell, once, whether a neutral event must follow what was told.

        :param fresh: sticks still come. :param counts: sticks that came now would count.
        """
        lost = self.streaming and not fresh
        owed = lost or (self._counted and not counts)
        self._counted = self._counted and not owed
        self.streaming = self.streaming and not lost
        return owed


class Pacer:
    """
    Slots of a periodic frame, paced by time and never by input.

    Late by a little is made up for, or the rate would sag; late by much is not, or a burst would
    follow.

    :param period: seconds between two frames.
    """

    __slots__ = ('due', 'period')

    def __init__(self, period: float) -> None:
        self.period = period
        self.due = math.inf  # when the next frame is; infinite: stopped

    def start(self, now: float) -> None:
        """Have the first frame due at once."""
        self.due = now

    def stop(self) -> None:
        """Have none due any more."""
        self.due = math.inf

    def is_due(self, now: float) -> bool:
        """Tell whether a frame is due."""
        return now >= self.due

    def sent(self, now: float) -> None:
        """Note that a frame goes now, due or sooner; the next one gets its slot."""
        slot = min(self.due, now) + self.period
        self.due = max(slot, now + self.period / 2)
