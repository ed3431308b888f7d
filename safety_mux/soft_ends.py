# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Soft ends: a joint is slower before the end of its way, and goes no further; back is free."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Protocol

from bridge_core.reasons import Coded
from safety_mux.protocol import Demand, Limiter, MalformedInput

_NOWHERE = (0.0, 0.0)
_AHEAD = 1.2  # of what was commanded, so far may a joint have gone
_SEEN = 0.25  # of it; by less a joint that was heard has not moved: noise, or another unit


@dataclass(frozen=True, slots=True)
class SoftEnds:
    """
    The way that a joint has, in rad.

    :param least: where it ends on the negative side. :param most: on the positive one; above it.
    :param slow_zone: how long before an end it begins to be slower: its speed falls in proportion
        to what is left. Above 0.
    :param magnitude: its greatest speed, rad/s. Above 0.
    :raises ValueError: there is no way.
    """

    least: float
    most: float
    slow_zone: float
    magnitude: float

    def __post_init__(self) -> None:
        if not self.least < self.most:
            raise ValueError(f'position_min {self.least} must be below position_max {self.most}')

    def limited(self, speed: float, position: float) -> float:
        """Return what is left of a speed at this position; away from an end all of it."""
        left = self.most - position if speed > 0.0 else position - self.least
        allowed = self.magnitude * min(max(left / self.slow_zone, 0.0), 1.0)
        return math.copysign(min(abs(speed), allowed), speed) + 0.0 if speed else 0.0


class Haltable(Limiter, Protocol):
    """A limiter; see :class:`safety_mux.limits.JointLimiter`."""

    def halt(self, joint: int) -> None:
        """Set the output of one joint to zero at once. :param joint: its place in a demand."""


class EndedLimiter:
    """
    A limiter whose targets keep to the soft ends; see ``Limiter``.

    A joint whose position was not heard does not move. One that was told to move since its
    position last did counts as moved, so that a late, frozen or noisy position frees nothing.
    Nothing of that, nor of a joint that goes astray, ends with a second start. Beyond an end the
    output outwards is 0 at once.

    :param ends: by the joint's place in a demand; joints without have none.
    :param names: of all joints, for words.
    """

    def __init__(
        self, limiter: Haltable, ends: Mapping[int, SoftEnds], names: Sequence[str]
    ) -> None:
        self._limiter = limiter
        self.ends = ends
        self._names = names
        self._positions: dict[int, float] = {}
        self._told: dict[int, tuple[float, float]] = {}  # rad down and up, since that position
        self._seen: dict[int, float] = {}  # positions when they last moved
        self._unseen: dict[int, tuple[float, float]] = {}  # rad down and up, told since
        self._before: dict[int, float] = {}  # positions before these steps; empty: at rest
        self._astray: dict[int, tuple[float, float]] = {}  # rad down and up, untold, in motion
        self._held: dict[int, float] = {}  # the share of the last target that is left of it

    def hear(self, positions: Sequence[float]) -> None:
        """
        Take the positions of the joints that have ends, rad, in their order.

        :raises MalformedInput: one did not go where its joint was told to.
        """
        self._positions = dict(zip(self.ends, positions, strict=True))
        for n, position in self._positions.items():
            down, up = self._unseen.get(n, _NOWHERE)
            moved = position - self._seen.get(n, position)
            obeyed = (up if moved > 0.0 else down) and abs(moved) > _SEEN * max(down, up)
            if obeyed or not (down or up):
                self._seen[n], self._unseen[n] = position, _NOWHERE
        if self._before and not self._told:
            return  # there was no step meanwhile
        strays = [n for n in self._before if self._strays(n)]
        self._before, self._told = self._positions, {}
        if strays:
            self._astray = {}
            raise MalformedInput(
                f"position of joint '{self._names[strays[0]]}' goes where it was not told to: "
                'check its sign and unit, and that it does not wrap'
            )

    def _strays(self, n: int) -> bool:
        moved, (down, up) = self._positions[n] - self._before[n], self._told[n]
        below, above = self._astray.get(n, _NOWHERE)
        if down or up:  # who turns it by hand moves it untold
            below, above = below - moved - _AHEAD * down, above + moved - _AHEAD * up
            self._astray[n] = max(below, 0.0), max(above, 0.0)
        return max(below, above) > self.ends[n].slow_zone / 2.0

    def _left(self, n: int, speed: float) -> float:
        """Return what the end leaves of a speed, by the farthest that the joint may be."""
        if n not in self._positions:
            return 0.0
        down, up = self._unseen.get(n, _NOWHERE)
        return self.ends[n].limited(speed, self._positions[n] + (up if speed > 0.0 else -down))

    def trust(self) -> None:
        """Take each joint to be where it says: somebody has looked, who resets."""
        self._unseen, self._astray = {}, {}

    @property
    def words(self) -> list[Coded]:
        """Say which joints an end slows down or holds."""
        return [
            Coded(
                'mux.limit.end',
                f"joint '{self._names[n]}' is at {self._where(n)} rad, near its end: "
                + ('only back' if share == 0.0 else f'{100.0 * share:.0f} % of its speed'),
                joint=self._names[n],
            )
            for n, share in self._held.items()
            if n in self._positions
        ]

    def _where(self, n: int) -> str:
        at, (down, up) = self._positions[n], self._unseen.get(n, _NOWHERE)
        if max(down, up) <= self.ends[n].slow_zone / 2.0:
            return f'{at:.3g}'
        return f'{at - down:.3g} to {at + up:.3g}'  # its position stays the same

    @property
    def output(self) -> Demand:
        """The last output."""
        return self._limiter.output

    def step(self, target: Demand, dt: float, scale: float = 1.0) -> Demand:
        """Return the next output on the way to what the ends leave of the target."""
        if not self.ends:
            return self._limiter.step(target, dt, scale)
        wanted = list(target)
        self._held = {}
        for n, ends in self.ends.items():
            if not math.isfinite(wanted[n]):
                continue  # counts as zero
            # What is beyond its magnitude is the limiter's to reduce, with its group.
            speed = math.copysign(min(abs(wanted[n]), ends.magnitude), wanted[n]) * scale
            allowed = self._left(n, speed)
            if allowed != speed:
                self._held[n] = allowed / speed
                wanted[n] = allowed / scale
        self._limiter.step(tuple(wanted), dt, scale)
        return self._moved(dt)

    def ramp(self, dt: float, stop_time: float) -> Demand:
        """Return the next output of a ramp to zero."""
        self._limiter.ramp(dt, stop_time)
        return self._moved(dt)

    def _moved(self, dt: float) -> Demand:
        """Cut what goes outwards beyond an end, and note where the rest leads."""
        for n in self.ends:
            if not self._left(n, self._limiter.output[n]):
                self._limiter.halt(n)
            way = self._limiter.output[n] * max(0.0, dt)
            for ways in (self._told, self._unseen):
                down, up = ways.get(n, _NOWHERE)
                ways[n] = down + max(0.0, -way), up + max(0.0, way)  # 0 for NaN
        return self.output

    def reset(self) -> None:
        """Set the output to zero at once."""
        self._held, self._before, self._told = {}, {}, {}
        self._limiter.reset()
