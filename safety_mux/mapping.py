# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Mappings to joints: from Joy axes and buttons, from a twist, from named joints.

Numbers are passed in plain sequences, so that this module does not need ROS. A bad message raises
MalformedInput with the reason in words (rule 9); a bad configuration raises ValueError when the
mapping is made.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass
import math
import reprlib
from typing import Literal

from safety_mux.protocol import Demand, MalformedInput, OperatorSample

AXIS_LIMIT = 1.05  # axes of Joy are -1...1; drivers may overshoot a little
Mixing = Literal['none', 'tank', 'arcade']


@dataclass(frozen=True, slots=True)
class Stick:
    """
    One axis of a Joy message and its scaling; the parameters say what is allowed.

    :param axis: index in the message.
    :param scale: joint value (such as rad/s) at full deflection. Finite, not 0.
    :param inverted: reverses the sign.
    :param deadband: deflection up to which the stick counts as neutral; the rest of the travel is
        rescaled, so that motion begins at zero.
    :param expo: 0 is linear, 1 is cubic: fine near the centre, full at the end.
    :raises ValueError: for a scale that is none.
    """

    axis: int
    scale: float = 1.0
    inverted: bool = False
    deadband: float = 0.05
    expo: float = 0.0

    def __post_init__(self) -> None:
        if not math.isfinite(self.scale) or self.scale == 0.0:
            raise ValueError(f'scale of axis {self.axis} must be finite and not 0: {self.scale}')

    def neutral(self, value: float) -> bool:
        """Return whether a deflection is within the deadband."""
        return abs(value) <= self.deadband

    def shape(self, value: float) -> float:
        """Return the joint value of a deflection of -1.05 to 1.05 (beyond 1 counts as 1)."""
        if self.neutral(value):
            return 0.0
        travel = (min(abs(value), 1.0) - self.deadband) / (1.0 - self.deadband)
        curved = (1.0 - self.expo) * travel + self.expo * travel**3
        sign = math.copysign(1.0, value) * (-1.0 if self.inverted else 1.0)
        return sign * curved * self.scale


@dataclass(frozen=True, slots=True)
class JoyMapping:
    """
    From a Joy message to an operator's demand; the parameters say what is allowed.

    :param sticks: by ``mixing``: one a joint (``none``); left, right (``tank``); forward, turn
        (``arcade``).
    :param deadman: indices of the buttons that must all be held. One or more.
    :param mixing: ``tank`` and ``arcade`` give two joints, left and right. In ``arcade`` the turn
        is positive to the left: left = forward - turn, right = forward + turn. If one side would
        exceed the greater of the two scales, both are reduced by the same factor, so that the
        curve stays the same.
    :param buttons: least number of buttons of a message, if more than the deadman needs.
    :param pressed_at: least value of a held button; switches with raw values need more than 1.
    :param levels: factors of the demand, by the value of ``level_button``: the first one is for 0.
        A value without one has the least.
    :param level_button: index of a button or switch; -1: none, and one level.
    :param axis_buttons: for each stick the index of a button that has to be held for it to count;
        -1: none. Empty: none for all.
    :raises ValueError: values contradict each other.
    """

    sticks: tuple[Stick, ...]
    deadman: tuple[int, ...]
    mixing: Mixing = 'none'
    buttons: int = 0
    pressed_at: int = 1
    levels: tuple[float, ...] = (1.0,)
    level_button: int = -1
    axis_buttons: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.sticks:
            raise ValueError('there must be one stick or more')
        if self.mixing != 'none' and len(self.sticks) != 2:
            raise ValueError(f'{self.mixing} mixing needs two sticks, not {len(self.sticks)}')
        if not self.deadman:
            raise ValueError('there must be a deadman button: nothing moves without one')
        if len(set(self.deadman)) < len(self.deadman):
            raise ValueError(f'deadman indices must differ: {self.deadman}')
        if (self.level_button >= 0) != (len(self.levels) > 1):
            raise ValueError('speed_levels of two or more need a speed_button, and it needs them')
        if self.axis_buttons and len(self.axis_buttons) != len(self.sticks):
            raise ValueError(f'axis_buttons are for {len(self.sticks)} sticks')

    @property
    def joints(self) -> int:
        """The number of joints in a demand."""
        return len(self.sticks)

    @property
    def reach(self) -> Demand:
        """The greatest absolute demand of each joint."""
        scales = tuple(abs(stick.scale) for stick in self.sticks)
        most = scales if self.mixing != 'arcade' else (max(scales),) * 2
        return tuple(max(self.levels) * each for each in most)

    def buttons_of_axes(self) -> dict[int, list[int]]:
        """Return, by index of each axis that needs one, the buttons that enable it."""
        found: dict[int, list[int]] = {}
        for stick, button in zip(self.sticks, self.axis_buttons, strict=False):
            found.setdefault(stick.axis, []).append(button)
        return {axis: buttons for axis, buttons in found.items() if min(buttons) >= 0}

    def sample(self, axes: Sequence[float], buttons: Sequence[int]) -> OperatorSample:
        """
        Read one message: axes -1 to 1, buttons 0 or 1 (or a switch's raw value).

        :raises MalformedInput: too few axes or buttons; any axis, used or not, is NaN or beyond
            1.05.
        """
        self._check(axes, buttons)
        held = [buttons[index] >= self.pressed_at for index in self.deadman]
        let_go = self._let_go(buttons)
        return OperatorSample(
            neutral=all(stick.neutral(axes[stick.axis]) for stick in self.sticks),
            deadman=all(held),
            demand=self._demand(axes, buttons, let_go),
            partial=any(held) and not all(held),
            unheld=tuple(
                (stick.axis, let_go[place])
                for place, stick in enumerate(self.sticks)
                if place in let_go and not stick.neutral(axes[stick.axis])
            ),
        )

    def _let_go(self, buttons: Sequence[int]) -> dict[int, int]:
        """Return the places of the sticks whose button is not held, and that button."""
        needed = enumerate(self.axis_buttons)
        return {place: n for place, n in needed if n >= 0 and buttons[n] < self.pressed_at}

    def _check(self, axes: Sequence[float], buttons: Sequence[int]) -> None:
        need = 1 + max(stick.axis for stick in self.sticks)
        if len(axes) < need:
            raise MalformedInput(f'it has {len(axes)} axes, {need} are needed')
        for what, indices in (
            ('deadman', self.deadman),
            ('speed', (self.level_button,)),
            ('axis', self.axis_buttons),
        ):
            if indices and max(indices) >= len(buttons):
                raise MalformedInput(
                    f'{what} button {max(indices)} does not exist: it has {len(buttons)} buttons'
                )
        if len(buttons) < self.buttons:
            raise MalformedInput(f'it has {len(buttons)} buttons, {self.buttons} are needed')
        for index, value in enumerate(axes):
            if not abs(value) <= AXIS_LIMIT:  # also true for NaN
                raise MalformedInput(
                    f'axis {index} is {value}, beyond -{AXIS_LIMIT}...{AXIS_LIMIT}'
                )

    def _demand(
        self, axes: Sequence[float], buttons: Sequence[int], let_go: Container[int]
    ) -> Demand:
        demand = self._mix(
            tuple(
                0.0 if place in let_go else stick.shape(axes[stick.axis])
                for place, stick in enumerate(self.sticks)
            )
        )
        if self.level_button < 0:
            return demand
        value = buttons[self.level_button]
        level = self.levels[value] if 0 <= value < len(self.levels) else min(self.levels)
        return tuple(level * each for each in demand)

    def _mix(self, values: Demand) -> Demand:
        if self.mixing != 'arcade':
            return values
        forward, turn = values
        left, right = forward - turn, forward + turn
        most = max(abs(stick.scale) for stick in self.sticks)
        shrink = most / max(abs(left), abs(right), most)
        return left * shrink, right * shrink


@dataclass(frozen=True, slots=True)
class DifferentialDrive:
    """
    From a twist to two wheels, left and right, in rad/s.

    :param wheel_separation: metres between the two wheels. :param wheel_radius: metres.
    """

    wheel_separation: float
    wheel_radius: float

    def demand(self, linear: Sequence[float], angular: Sequence[float]) -> Demand:
        """
        Return left and right for a twist; x of linear is forward, z of angular to the left.

        :param linear: m/s along x, y, z. :param angular: rad/s around x, y, z.
        :raises MalformedInput: one of the six is not finite, used or not.
        """
        forward, turn = forward_and_turn(linear, angular)
        half = turn * self.wheel_separation / 2.0
        return (forward - half) / self.wheel_radius, (forward + half) / self.wheel_radius


def forward_and_turn(linear: Sequence[float], angular: Sequence[float]) -> tuple[float, float]:
    """
    Return what a robot on wheels follows of a twist: m/s forward, rad/s to the left.

    :param linear: m/s along x, y, z. :param angular: rad/s around x, y, z.
    :raises MalformedInput: one of the six is not finite, used or not.
    """
    forward, _, turn = over_the_ground(linear, angular)
    return forward, turn


def over_the_ground(
    linear: Sequence[float], angular: Sequence[float]
) -> tuple[float, float, float]:
    """Return m/s forward and to the left, and rad/s to the left; as ``forward_and_turn``."""
    if not all(map(math.isfinite, (*linear, *angular))):
        raise MalformedInput(f'the twist is not finite: linear {linear}, angular {angular}')
    return linear[0], linear[1], angular[2]


@dataclass(frozen=True, slots=True)
class NamedJoints:
    """
    From a JointState to a demand.

    :param names: the joints, in the order of a demand, all different.
    """

    names: tuple[str, ...]

    def demand(self, names: Sequence[str], values: Sequence[float]) -> Demand:
        """
        Return the named values in the order of a demand.

        :raises MalformedInput: a joint is missing, unknown or repeated, or a value is not finite.
        """
        if len(names) == len(values) and sorted(names) != sorted(self.names):
            raise MalformedInput(
                f'its joints are {reprlib.repr(list(names))}, not {list(self.names)}'
            )
        return self.among(names, values)

    def among(self, names: Sequence[str], values: Sequence[float]) -> Demand:
        """
        Return the same of a message that may have more joints.

        :raises MalformedInput: a joint is missing or repeated, or its value is not finite.
        """
        if len(names) != len(values):
            raise MalformedInput(f'it has {len(names)} names and {len(values)} values')
        by_name = dict(zip(names, values, strict=True))
        for name in self.names:
            if names.count(name) != 1:
                how_often = 'twice' if name in by_name else 'not'
                raise MalformedInput(f"joint '{name}' is {how_often} there")
            if not math.isfinite(by_name[name]):
                raise MalformedInput(f"joint '{name}' is {by_name[name]}")
        return tuple(by_name[name] for name in self.names)
