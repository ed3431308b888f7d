# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How a simulated monitor moves, and what keeps it from moving."""

from __future__ import annotations

from dataclasses import dataclass
import math

from akron_can_bridge.simulator.controls import Controls

PERMISSIVE_TIMEOUT = 0.3  # type A1
_STEP = 0.005  # seconds
_LONGEST = 1.0  # what is made up for after a pause of the process
_NEAR_DEG = 0.05
_SLOW_DEG = 2.0  # from here on an automatic motion slows down
_STOW_DEG = (0.0, -45.0)
_DEPLOY_DEG = (0.0, 0.0)


@dataclass(slots=True)
class Axis:
    """
    One motor axis. It speeds up by its acceleration and stops at once: worm gears hold.

    :param low: its negative end; degrees, or a share of the way for what is no angle.
    :param speed: a second, at full deflection. :param acceleration: a second squared.
    :param slowing: a second squared, of one that coasts.
    """

    low: float
    high: float
    speed: float
    acceleration: float
    position: float = 0.0
    velocity: float = 0.0
    slowing: float = math.inf

    def step(self, seconds: float, demand: float, limits: tuple[float, float]) -> None:
        """Move. :param demand: -1 to 1 of full speed. :param limits: besides the two ends."""
        target = demand * self.speed
        same_way, coasts = target * self.velocity > 0, abs(self.velocity) - self.slowing * seconds
        if coasts > (abs(target) if same_way else 0.0):
            self.velocity = math.copysign(coasts, self.velocity)
        else:
            before = abs(self.velocity) if same_way else 0.0
            reached = min(abs(target), before + self.acceleration * seconds)
            self.velocity = math.copysign(reached, target) if target else 0.0
        # Beyond a limit an axis may stand still or come back.
        low = min(max(self.low, limits[0]), self.position)
        high = max(min(self.high, limits[1]), self.position)
        wanted = self.position + self.velocity * seconds
        self.position = min(max(wanted, low), high)
        if self.position != wanted:
            self.velocity = 0.0

    @property
    def hard_stops(self) -> tuple[bool, bool]:
        """It is at its positive end, at its negative end."""
        return self.position >= self.high, self.position <= self.low


def _angle(low: float, high: float) -> Axis:
    return Axis(low, high, speed=20.0, acceleration=80.0)


def _valve(position: float) -> Axis:
    return Axis(0.0, 1.0, speed=0.5, acceleration=10.0, position=position)


class Motion:
    """
    Axes from 1 on (rotation, elevation, then as in Appendix C), and all that bears on them.

    :param count: of axes. :param controls: who asks.
    """

    def __init__(self, count: int, controls: Controls) -> None:
        starts = (_angle(-175.0, 175.0), _angle(-45.0, 90.0), _valve(0.5), _valve(0.5), _valve(0))
        self.axes = starts[:count]
        self.controls = controls
        self.zero_deg = [0.0, 0.0]
        self.soft_limits = {'left': -175.0, 'right': 175.0, 'down': -45.0, 'up': 90.0}
        self.running = False  # the controller is up
        self.enabled = True  # its enable input
        self.tells_pause = False  # type 81 says "oscillating" of what runs only, not in a pause
        self.soe = False
        self.permitted_for = PERMISSIVE_TIMEOUT
        self.faulty: set[int] = set()  # axes from 0
        self.owners: dict[int, str] = {}  # who moves which axis
        self.moved_at = -math.inf  # when an axis moved last
        self._at: float | None = None
        self.reset()

    def reset(self) -> None:
        """Forget what does not outlive a restart."""
        self.controls.forget_sources()
        self.setup = False
        self.point_aim = False
        self.stowed = False
        self.oscillating = self.paused = False
        self._turning_right = True
        self._stowing = False
        self._goal: tuple[float, float] | None = None
        self._permitted, self._permitted_at = 0, -math.inf

    def permit(self, directions: int, now: float) -> None:
        """Take type A1: bits right, left, up, down from the lowest on."""
        self._permitted, self._permitted_at = directions, now

    def switched_on(self, switches: frozenset[int]) -> None:
        """Begin what a switch begins as it is turned on, and goes on by itself."""
        if 4 in switches:
            self.oscillating, self.paused = not self.oscillating, False
        if 7 in switches:
            self.paused = not self.paused
        if 8 in switches:
            self.go(stow=False)
        if 9 in switches:
            self.go(stow=True)

    def go(self, *, stow: bool) -> None:
        """Stow or deploy; a 6033 has nothing to move."""
        if not self.axes:
            return
        self._goal, self._stowing = (_STOW_DEG if stow else _DEPLOY_DEG), stow
        self.oscillating = False

    @property
    def says_oscillating(self) -> bool:
        """What type 81 says of it; the manual leaves open what that is in a pause."""
        return self.oscillating and not (self.paused and self.tells_pause)

    def degrees(self, axis: int) -> float:
        """Return what the sensor of an axis reads: 0 rotation, 1 elevation."""
        return self.axes[axis].position - self.zero_deg[axis]

    def zero(self) -> None:
        """Make the present positions zero."""
        self.zero_deg = [axis.position for axis in self.axes[:2]]

    def advance(self, now: float) -> None:
        """Let time pass."""
        at = now if self._at is None else max(self._at, now - _LONGEST)
        while at < now:
            seconds = min(_STEP, now - at)
            at += seconds
            self.controls.expire(at)
            self._step(seconds, at)
        self._at = now

    @property
    def moving(self) -> bool:
        """Some axis moves."""
        return any(axis.velocity for axis in self.axes)

    def _step(self, seconds: float, at: float) -> None:
        self.owners = {}
        for number, axis in enumerate(self.axes):
            before = axis.position
            axis.step(seconds, self._demand(number, at), self._limits(number))
            if axis.position != before:
                self.moved_at = at
                self.stowed = False
        self._arrive()

    def _demand(self, number: int, at: float) -> float:
        """Return -1 to 1 for an axis: the first who asks is obeyed, if nothing forbids it."""
        owner, demand = next(
            iter(self.controls.requests(number).items()), ('automatic', self._automatic(number))
        )
        if owner != 'automatic' and number < 2:
            # What is paused stays so: the manual does not say that a hand ends it.
            self._goal, self.oscillating = None, self.oscillating and self.paused
        if not demand or not self._may_move(number, demand > 0, at):
            return 0.0
        self.owners[number] = owner
        return demand

    def _may_move(self, number: int, positive: bool, at: float) -> bool:
        if not self.running or not self.enabled or self.setup or number in self.faulty:
            return False
        if not self.soe or number > 1:
            return True
        bit = 1 << (2 * number + (0 if positive else 1))
        return at - self._permitted_at < self.permitted_for and bool(self._permitted & bit)

    def _limits(self, number: int) -> tuple[float, float]:
        """Return the soft limits of an axis as positions."""
        names = {0: ('left', 'right'), 1: ('down', 'up')}.get(number)
        if names is None:
            return -math.inf, math.inf
        low, high = (self.soft_limits[name] + self.zero_deg[number] for name in names)
        return low, high

    def _automatic(self, number: int) -> float:
        goal = self._goal_of(number)
        if goal is None:
            return 0.0
        way = goal - self.degrees(number)
        return 0.0 if abs(way) < _NEAR_DEG else min(max(way / _SLOW_DEG, -1.0), 1.0)

    def _goal_of(self, number: int) -> float | None:
        """Return where an axis is to go by itself, in degrees."""
        if number > 1:
            return None
        if self._goal is not None:
            return self._goal[number]
        if self.oscillating and number == 0:
            return None if self.paused else self._far_end()
        return self.controls.aim()[number] if self.point_aim else None

    def _far_end(self) -> float:
        """Return the limit that the oscillation is on its way to."""
        end = self.soft_limits['right' if self._turning_right else 'left']
        if abs(end - self.degrees(0)) < 2 * _NEAR_DEG:
            self._turning_right = not self._turning_right
        return end

    def _arrive(self) -> None:
        goal = self._goal
        if goal and all(abs(goal[n] - self.degrees(n)) < 2 * _NEAR_DEG for n in (0, 1)):
            self.stowed, self._goal = self._stowing, None
