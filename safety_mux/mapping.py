# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Mappings to joints: from Joy axes and buttons, from a twist, from named joints.

Numbers are passed in plain sequences, so that this module does not need ROS. A bad message raises
MalformedInput with the reason in words (rule 9); a bad configuration raises ValueError when the
mapping is made.
"""

from collections.abc import Sequence
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
    One axis of a Joy message and its scaling.

    :param axis: index in the message. 0 or more.
    :param scale: joint value (such as rad/s) at full deflection. Finite, not 0.
    :param inverted: reverses the sign.
    :param deadband: deflection up to which the stick counts as neutral; the rest of the travel is
        rescaled, so that motion begins at zero. 0 to below 1.
    :param expo: 0 is linear, 1 is cubic: fine near the centre, full at the end. 0 to 1.
    :raises ValueError: a value is out of range.
    """

    axis: int
    scale: float = 1.0
    inverted: bool = False
    deadband: float = 0.05
    expo: float = 0.0

    def __post_init__(self) -> None:
        if self.axis < 0:
            raise ValueError(f'axis must be 0 or more, not {self.axis}')
        if not math.isfinite(self.scale) or self.scale == 0.0:
            raise ValueError(f'scale of axis {self.axis} must be finite and not 0: {self.scale}')
        if not 0.0 <= self.deadband < 1.0:
            raise ValueError(
                f'deadband of axis {self.axis} must be 0 to below 1, not {self.deadband}'
            )
        if not 0.0 <= self.expo <= 1.0:
            raise ValueError(f'expo of axis {self.axis} must be 0 to 1, not {self.expo}')

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
    From a Joy message to an operator's demand.

    :param sticks: by ``mixing``: one a joint (``none``); left, right (``tank``); forward, turn
        (``arcade``).
    :param deadman: indices of the buttons that must all be held. One or more.
    :param mixing: ``tank`` and ``arcade`` give two joints, left and right. In ``arcade`` the turn
        is positive to the left: left = forward - turn, right = forward + turn. If one side would
        exceed the greater of the two scales, both are reduced by the same factor, so that the
        curve stays the same.
    :param axes: least number of axes of a message, if more than the sticks need.
    :param buttons: least number of buttons of a message, if more than the deadman needs.
    :param pressed_at: least value of a held button. 1 or more; switches with raw values need more
        than 1.
    :param levels: factors of the demand, each above 0 and at most 1, by the value of
        ``level_button``: the first one is for 0. A value without one has the least.
    :param level_button: index of a button or switch; -1: none, and one level.
    :param axis_buttons: for each stick the index of a button that has to be held for it to count;
        -1: none. Empty: none for all.
    :raises ValueError: a value is out of range.
    """

    sticks: tuple[Stick, ...]
    deadman: tuple[int, ...]
    mixing: Mixing = 'none'
    axes: int = 0
    buttons: int = 0
    pressed_at: int = 1
    levels: tuple[float, ...] = (1.0,)
    level_button: int = -1
    axis_buttons: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.mixing not in ('none', 'tank', 'arcade'):
            raise ValueError(f"mixing must be 'none', 'tank' or 'arcade', not {self.mixing!r}")
        if not self.sticks:
            raise ValueError('there must be one stick or more')
        if self.mixing != 'none' and len(self.sticks) != 2:
            raise ValueError(f'{self.mixing} mixing needs two sticks, not {len(self.sticks)}')
        if not self.deadman:
            raise ValueError('there must be a deadman button: nothing moves without one')
        if min(self.deadman) < 0 or len(set(self.deadman)) < len(self.deadman):
            raise ValueError(f'deadman indices must be 0 or more and differ: {self.deadman}')
        if self.axes < 0 or self.buttons < 0:
            raise ValueError('the least number of axes or buttons must be 0 or more')
        if self.pressed_at < 1:
            raise ValueError(f'pressed_at must be 1 or more, not {self.pressed_at}')
        if not all(0.0 < level <= 1.0 for level in self.levels):
            raise ValueError(f'speed_levels must be above 0 and at most 1, not {self.levels}')
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
        return OperatorSample(
            neutral=all(stick.neutral(axes[stick.axis]) for stick in self.sticks),
            deadman=all(held),
            demand=self._demand(axes, buttons),
            partial=any(held) and not all(held),
        )

    def _check(self, axes: Sequence[float], buttons: Sequence[int]) -> None:
        need = max(self.axes, 1 + max(stick.axis for stick in self.sticks))
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

    def _demand(self, axes: Sequence[float], buttons: Sequence[int]) -> Demand:
        values = tuple(stick.shape(axes[stick.axis]) for stick in self.sticks)
        if self.axis_buttons:
            values = tuple(
                value if index < 0 or buttons[index] >= self.pressed_at else 0.0
                for value, index in zip(values, self.axis_buttons, strict=True)
            )
        demand = self._mix(values)
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

    :param wheel_separation: metres between the two wheels. Above 0.
    :param wheel_radius: metres. Above 0.
    :raises ValueError: a value is out of range.
    """

    wheel_separation: float
    wheel_radius: float

    def __post_init__(self) -> None:
        for name in ('wheel_separation', 'wheel_radius'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f'{name} must be above 0 m and finite, not {value}')

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

    :param names: the joints, in the order of a demand. One or more, all different.
    :raises ValueError: there is no name, or one is empty or repeated.
    """

    names: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) < len(self.names) or '' in self.names:
            raise ValueError(f'joint names must be there and differ: {self.names}')

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
