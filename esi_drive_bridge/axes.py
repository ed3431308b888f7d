# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What joins an axis of the drive to a joint: name, mode, scale and sign.

A word on the wire times the scale configured in HiDS (manual 4.4.2) is A, rpm or rad of the motor.

========  =======================  ==================  ==========================================
mode      scale                    JointState field    joint value of one count
========  =======================  ==================  ==========================================
torque    CommandCurrentScale      effort              A, or N·m = A * torque_constant * gear
velocity  CommandVelocityScale     velocity            rad/s = rpm * 2 pi / 60 / gear
position  CommandPositionScale     position            rad = motor rad / gear
========  =======================  ==================  ==========================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from bridge_core.reasons import Coded
from esi_drive_bridge.protocol import Mode, VALUE_MAX, VALUE_MIN

FIELDS = {Mode.TORQUE: 'effort', Mode.VELOCITY: 'velocity', Mode.POSITION: 'position'}
_SCALES = {
    Mode.TORQUE: 'command_current_scale',
    Mode.VELOCITY: 'command_velocity_scale',
    Mode.POSITION: 'command_position_scale',
}
_RAD_PER_S_PER_RPM = 2.0 * math.pi / 60.0


@dataclass(frozen=True, slots=True)
class Axis:
    """
    What joins one axis of the drive to one joint.

    :param joint: the joint's name.
    :param command_scale: A, rpm or rad of the motor a count; above 0.
    :param gear_ratio: turns of the motor for one of the joint; above 0.
    :param torque_constant: N·m/A of the motor, or 0: effort is then the motor's current in A.
    :param inverted: positive counts turn the joint in its negative direction.
    :param slew_limit: of what is sent, in ``unit`` a second; above 0, infinite: not limited.
    :raises ValueError: for what cannot be, and for a count too small or large to compute with.
    """

    joint: str
    mode: Mode
    command_scale: float
    gear_ratio: float = 1.0
    torque_constant: float = 0.0
    inverted: bool = False
    slew_limit: float = math.inf

    def __post_init__(self) -> None:
        if not self.joint:
            raise ValueError('joint_names: each joint needs a name')
        for name in ('command_scale', 'gear_ratio'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f'{name} must be above 0 and finite, not {value}')
        if not (math.isfinite(self.torque_constant) and self.torque_constant >= 0.0):
            raise ValueError(f'torque_constant must be 0 or above, not {self.torque_constant}')
        if not self.slew_limit > 0.0:
            raise ValueError(f'slew_limit must be above 0, not {self.slew_limit}')
        if not (math.isfinite(self.si_per_count) and self.si_per_count != 0.0):
            raise ValueError(f'scale and gear give {self.si_per_count} a count')

    @property
    def si_per_count(self) -> float:
        """The joint's rad/s, rad, N·m or A for one count, with its sign."""
        scale = -self.command_scale if self.inverted else self.command_scale
        if self.mode is Mode.VELOCITY:
            return scale * _RAD_PER_S_PER_RPM / self.gear_ratio
        if self.mode is Mode.POSITION:
            return scale / self.gear_ratio
        return scale * self.torque_constant * self.gear_ratio if self.torque_constant else scale

    @property
    def reach(self) -> str:
        """The greatest value that a packet can say, in words."""
        return f'±{abs(self.si_per_count) * VALUE_MAX:.4g} {self.unit}'

    def beyond(self, value: float) -> str:
        """Say of a value that no packet can say it."""
        return f'command {self.joint} within {self.reach}: {value:.4g} is beyond'

    @property
    def field(self) -> str:
        """The JointState field that the mode commands and measures."""
        return FIELDS[self.mode]

    @property
    def unit(self) -> str:
        """Unit of the joint's value."""
        if self.mode is Mode.TORQUE:
            return 'N·m' if self.torque_constant else 'A'
        return 'rad/s' if self.mode is Mode.VELOCITY else 'rad'


def axes_of(values: Mapping[str, Any]) -> tuple[Axis, ...]:
    """Return the axes from the parameters. :raises ValueError: lists that do not fit."""
    joints = values['joint_names']
    if len(joints) not in (1, 2) or len(set(joints)) < len(joints):
        raise ValueError(f'joint_names = {joints}: one or two different names are needed')

    def spread(name: str) -> list[Any]:
        given = values[name]
        if len(given) not in (1, len(joints)):
            needed = '1 element is' if len(joints) == 1 else f'1 or {len(joints)} elements are'
            raise ValueError(f'{name} = {given}: {needed} needed')
        return list(given) * (len(joints) if len(given) == 1 else 1)

    modes = [Mode[name.upper()] for name in spread('mode')]
    every_scale = {mode: spread(name) for mode, name in _SCALES.items()}
    scales = [every_scale[mode][index] for index, mode in enumerate(modes)]
    rest = map(spread, ('gear_ratio', 'torque_constant', 'inverted', 'slew_limit'))
    return tuple(map(Axis, joints, modes, scales, *rest))


def to_counts(
    values: Sequence[float], axes: Sequence[Axis]
) -> tuple[tuple[int, ...], list[Coded]]:
    """
    Return a command in counts, and what of it was cut, in words.

    Where a velocity or torque is beyond what a packet can say, those of all axes are reduced by
    the same factor, so that a curve stays.

    :raises ValueError: for a value that is not finite, and for a position that is beyond.
    """
    wanted = [value / axis.si_per_count for value, axis in zip(values, axes, strict=True)]
    if not all(map(math.isfinite, wanted)):
        raise ValueError(f'not finite in counts: {list(values)}')
    beyond = [n for n, count in enumerate(wanted) if abs(count - _held(count)) > 0.5]
    for n in beyond:
        if axes[n].mode is Mode.POSITION:
            raise ValueError(axes[n].beyond(values[n]))
    factor = min((_held(wanted[n]) / wanted[n] for n in beyond), default=1.0)
    counts = tuple(
        round(_held(count if axis.mode is Mode.POSITION else count * factor))
        for count, axis in zip(wanted, axes, strict=True)
    )
    how = f'so every velocity and torque is cut to {100.0 * factor:.3g} %'
    return counts, [
        Coded('esi.command.cut', f'{axes[n].beyond(values[n])}, {how}', joint=axes[n].joint)
        for n in beyond
    ]


def _held(count: float) -> float:
    """Return the nearest that a packet can say."""
    return min(max(count, VALUE_MIN), VALUE_MAX)
