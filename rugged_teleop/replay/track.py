# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two courses of one value, compared with a tolerance in time, and what a replay finds. Pure."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

# Whether a value fits those that the other course had about the same time.
Fits = Callable[[Any, Sequence[Any]], bool]


class Difference(NamedTuple):
    """A span of time in which two courses differ, and what both were at its beginning."""

    since: float
    until: float
    recorded: Any
    replayed: Any


class Track:
    """The course of a value, which holds until the next one. Times must not decrease."""

    def __init__(self) -> None:
        self.points: list[tuple[float, Any]] = []
        self._times: list[float] = []

    def add(self, at: float, value: Any) -> None:
        """Note a value; times are seconds."""
        self.points.append((at, value))
        self._times.append(at)

    def at(self, when: float) -> Any:
        """Return the value then; before the first one, the first."""
        return self.points[max(0, bisect_right(self._times, when) - 1)][1]

    def held(self, when: float) -> float:
        """Return for how many seconds the value of then held, before and after."""
        place = max(0, bisect_right(self._times, when) - 1)
        value = self.points[place][1]
        before = (i for i in range(place, 0, -1) if self.points[i - 1][1] != value)
        begin = next((self._times[i] for i in before), -math.inf)
        after = (at for at, other in self.points[place:] if other != value)
        return next(after, math.inf) - begin

    def around(self, when: float, tolerance: float) -> list[Any]:
        """Return each value that held from ``tolerance`` s before until as long after."""
        first = max(0, bisect_right(self._times, when - tolerance) - 1)
        return [
            value for _, value in self.points[first : bisect_right(self._times, when + tolerance)]
        ]


def is_among(value: Any, others: Sequence[Any]) -> bool:
    """Tell whether a value is one of the others."""
    return value in others


def within_range(slack: Sequence[float]) -> Fits:
    """Return what tells whether numbers are in the range of the others. :param slack: of each."""

    def fits(value: Any, others: Sequence[Any]) -> bool:
        return all(
            min(column) - least <= number <= max(column) + least
            for number, column, least in zip(value, zip(*others, strict=True), slack, strict=True)
        )

    return fits


def differences(
    recorded: Track, replayed: Track, since: float, tolerance: float, fits: Fits = is_among
) -> list[Difference]:
    """
    Return where the courses differ from ``since`` on.

    A value of either fits if the other had such a value within ``tolerance`` s. Both ways, so that
    a moment that only one of them has is a difference. Differences that are near are one.
    """
    checked = []
    for track, other in ((recorded, replayed), (replayed, recorded)):
        for at, value in track.points:
            if at >= since:
                checked.append((at, fits(value, other.around(at, tolerance))))
    found: list[Difference] = []
    for at, fit in sorted(checked, key=lambda each: each[0]):
        if fit:
            continue
        if found and at - found[-1].until <= 2 * tolerance:
            found[-1] = found[-1]._replace(until=at)
        else:
            found.append(Difference(at, at, recorded.at(at), replayed.at(at)))
    return found


class Found(NamedTuple):
    """A span in which today's code decides otherwise. Times are seconds since 1970."""

    since: float
    until: float
    what: str
    recorded: str
    replayed: str


@dataclass(frozen=True)
class Outcome:
    """
    What became of one replay.

    :param since: from when it was compared. :param notes: what was done or not compared, in words.
    :param compared: what was.
    """

    name: str
    since: float
    until: float
    notes: Sequence[str]
    compared: Sequence[str]
    found: Sequence[Found]
