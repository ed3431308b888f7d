# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Limits of the output: magnitude, acceleration and deceleration.

The arbiter passes its demand through one limiter as the last step of a tick, so nothing reaches
the drive without it. Time is an argument here, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import repeat
import math
from operator import gt

from bridge_core.reasons import Coded


@dataclass(frozen=True, slots=True)
class JointLimit:
    """
    The limits of one joint, in its own unit (such as rad/s) and that unit per second.

    It accelerates away from zero and decelerates towards zero.

    :param group: joints of one group keep their proportion where one would exceed its magnitude,
        and while they grow.
    :param jerk: greatest change per second of the acceleration, which rises from 0 and is 0 again
        when the target is reached. 0: none. The way towards zero is as without it.
    :param together: whether it grows in proportion to its group. Not for a torque, of which growth
        may brake.
    """

    magnitude: float
    acceleration: float
    deceleration: float
    group: str = ''
    jerk: float = 0.0
    together: bool = True


class JointLimiter:
    """
    Follows a target within the limits, beginning at zero.

    A target beyond one joint's magnitude is reduced for all joints of its group by the same
    factor, so that a curve stays the same curve. Of the joints of a group that grow each takes the
    same share of its way in a step, unless one of the group has a jerk. Towards zero each goes at
    its own deceleration and waits for no other. A change of sign stops at zero for the rest of
    that step. A target that is not finite counts as zero.

    :param limits: of one joint or more.
    :param max_dt: seconds, the longest step: after a late one the output continues from its last
        value and does not jump to make up for the time.
    """

    def __init__(self, limits: Sequence[JointLimit], *, max_dt: float = 0.1) -> None:
        self._limits = tuple(limits)
        self._magnitudes = tuple(limit.magnitude for limit in limits)
        self._eased = any(limit.jerk for limit in limits)
        self._together = _together(limits)
        self._max_dt = max_dt
        self._values = (0.0,) * len(self._limits)
        self._ramp: tuple[float, ...] | None = None
        self._accelerations = tuple(limit.acceleration for limit in limits)
        self._rates = (0.0,) * len(self._limits)  # of growth in the last step, where eased

    @property
    def output(self) -> tuple[float, ...]:
        """The last output, one number a joint."""
        return self._values

    @property
    def words(self) -> list[Coded]:
        """As of Limiter: this one knows no places."""
        return []

    def reset(self) -> None:
        """Set the output to zero at once."""
        self._values = self._rates = (0.0,) * len(self._limits)

    def halt(self, joint: int) -> None:
        """Set the output of one joint to zero at once. :param joint: its place in a demand."""
        self._values = (*self._values[:joint], 0.0, *self._values[joint + 1 :])
        self._rates = (*self._rates[:joint], 0.0, *self._rates[joint + 1 :])

    def step(self, target: Sequence[float], dt: float, scale: float = 1.0) -> tuple[float, ...]:
        """
        Return the next output on the way to ``target``, ``dt`` seconds after the last.

        A dt below 0 or NaN counts as 0, one beyond ``max_dt`` as ``max_dt``.

        :param scale: 0 to 1, of what the magnitudes leave of the target.
        :raises ValueError: the number of targets is not that of the joints.
        """
        if len(target) != len(self._limits):
            raise ValueError(f'{len(target)} targets for {len(self._limits)} joints')
        self._ramp = None
        dt = min(_forward(dt), self._max_dt)
        if any(map(gt, map(abs, target), self._magnitudes)):
            target = self._reduced(target)
        if scale != 1.0:
            target = [goal * scale for goal in target]
        if not self._eased:
            rates = self._accelerations
        else:
            rates = tuple(map(_eased, self._values, target, self._limits, self._rates, repeat(dt)))
        values = tuple(map(_follow, self._values, target, self._limits, rates, repeat(dt)))
        self._values = self._joined(values, target, dt) if self._together else values
        if self._eased:
            steps = zip(self._values, target, rates, strict=True)
            self._rates = tuple(0.0 if value == goal else rate for value, goal, rate in steps)
        return self._values

    def _reduced(self, target: Sequence[float]) -> list[float]:
        excess = dict.fromkeys((limit.group for limit in self._limits), 1.0)
        for goal, limit in zip(target, self._limits, strict=True):
            if math.isfinite(goal):
                excess[limit.group] = max(excess[limit.group], abs(goal) / limit.magnitude)
        pairs = zip(target, self._limits, strict=True)
        return [goal / excess[limit.group] for goal, limit in pairs]

    def _joined(
        self, values: tuple[float, ...], target: Sequence[float], dt: float
    ) -> tuple[float, ...]:
        """Return the values with those that grow held to the least share of their group."""
        joined = list(values)
        for group in self._together:
            left = {
                n: abs(target[n]) - abs(self._values[n])
                for n in group
                if abs(self._values[n]) < abs(target[n]) < math.inf
                and self._values[n] * target[n] >= 0.0
            }
            share = min(
                (self._accelerations[n] * dt / way for n, way in left.items()), default=1.0
            )
            if share < 1.0:
                for n, way in left.items():
                    size = min(abs(self._values[n]) + share * way, abs(values[n]))
                    joined[n] = math.copysign(size, target[n]) + 0.0  # no -0.0
        return tuple(joined)

    def ramp(self, dt: float, stop_time: float) -> tuple[float, ...]:
        """
        Return the next output of a straight ramp to zero.

        The first call of a ramp fixes the slopes: the joint's deceleration, or steeper if that
        takes longer than ``stop_time`` seconds. ``max_dt`` does not apply, so that the ramp ends
        in time; a dt below 0 or NaN counts as 0.
        """
        if self._ramp is None:
            self._ramp = tuple(
                max(limit.deceleration, _slope(value, stop_time))
                for value, limit in zip(self._values, self._limits, strict=True)
            )
        dt = _forward(dt)
        self._rates = (0.0,) * len(self._limits)
        self._values = tuple(
            math.copysign(size, value) if (size := abs(value) - slope * dt) > 0.0 else 0.0
            for value, slope in zip(self._values, self._ramp, strict=True)
        )
        return self._values


def _together(limits: Sequence[JointLimit]) -> list[list[int]]:
    """Return the joints, by number, of each group that grows in proportion."""
    groups: dict[str, list[int]] = {}
    for n, limit in enumerate(limits):
        groups.setdefault(limit.group, []).append(n)
    return [
        group
        for group in groups.values()
        if len(group) > 1 and all(limits[n].together and not limits[n].jerk for n in group)
    ]


def _forward(dt: float) -> float:
    return dt if dt > 0.0 else 0.0  # NaN is not above 0 either


def _slope(value: float, stop_time: float) -> float:
    return abs(value) / stop_time if stop_time > 0.0 else math.inf


def _eased(value: float, goal: float, limit: JointLimit, rate: float, dt: float) -> float:
    """
    Return the rate of growth that follows ``rate``, or 0 if there is to be none.

    It can fall to 0 again, by the jerk times dt a step, within what is left: by steps the rate a
    takes a * a / (2 * jerk) + a * dt / 2 for that, which is solved for a. The last step is what
    is left, so the rate may fall by an eighth more there; hence the smaller jerk.
    """
    left = abs(goal) - abs(value)
    if not 0.0 < left < math.inf or value * goal < 0.0:
        return 0.0
    if not limit.jerk:
        return limit.acceleration
    if not dt:
        return rate
    half = dt / 2.0
    falls = 2.0 * left / (half + math.sqrt(half * half + 2.25 * left / limit.jerk))
    return min(limit.acceleration, rate + limit.jerk * dt, falls)


def _follow(value: float, goal: float, limit: JointLimit, rate: float, dt: float) -> float:
    """
    Return ``value`` moved towards ``goal`` for ``dt`` seconds, not across zero.

    :param rate: of growth; towards zero it is the joint's deceleration.
    """
    size = abs(goal)
    if not size < math.inf or value * goal < 0.0:
        goal = size = 0.0
    elif size > limit.magnitude:
        goal = math.copysign(limit.magnitude, goal)
        size = limit.magnitude
    most = (rate if size > abs(value) else limit.deceleration) * dt
    if abs(goal - value) <= most:
        return goal + 0.0  # turns -0.0 into 0.0
    return value + math.copysign(most, goal - value)
