"""
Between the drive's counts and ROS: joint names, SI units, words for diagnostics.

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

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState

from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.protocol import Status

FIELDS = {Mode.TORQUE: 'effort', Mode.VELOCITY: 'velocity', Mode.POSITION: 'position'}
DEFAULT_SCALES = {Mode.TORQUE: 0.001, Mode.VELOCITY: 1.0, Mode.POSITION: 0.000191753}  # 4.2.3-5
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
    :raises ValueError: for what cannot be, and for a count too small or large to compute with.
    """

    joint: str
    mode: Mode
    command_scale: float
    gear_ratio: float = 1.0
    torque_constant: float = 0.0
    inverted: bool = False

    def __post_init__(self) -> None:
        if not self.joint:
            raise ValueError('a joint needs a name')
        for name in ('command_scale', 'gear_ratio'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f'{name} must be above 0 and finite, not {value}')
        if not (math.isfinite(self.torque_constant) and self.torque_constant >= 0.0):
            raise ValueError(f'torque_constant must be 0 or above, not {self.torque_constant}')
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
    def field(self) -> str:
        """The JointState field that the mode commands and measures."""
        return FIELDS[self.mode]

    @property
    def unit(self) -> str:
        """Unit of the joint's value."""
        if self.mode is Mode.TORQUE:
            return 'N·m' if self.torque_constant else 'A'
        return 'rad/s' if self.mode is Mode.VELOCITY else 'rad'


def command_values(message: Any, axes: Sequence[Axis]) -> tuple[float, ...]:
    """
    Return a JointState command as one SI value an axis, in the axes' order.

    Joints are found by name; a message without names means the axes in order. A joint's value is
    read from the field of its mode; other fields are not looked at.

    :raises ValueError: for a missing, unknown or doubled joint, a field of the wrong length, or a
        value that is not finite. The text is for the sender.
    """
    names = list(message.name) or [axis.joint for axis in axes]
    known = [axis.joint for axis in axes]
    if sorted(names) != sorted(known):
        raise ValueError(f'joints {names} in the command, but this drive has {known}')
    return tuple(_value_of(message, axis, names) for axis in axes)


def _value_of(message: Any, axis: Axis, names: Sequence[str]) -> float:
    values = getattr(message, axis.field)
    if len(values) != len(names):
        raise ValueError(
            f'{len(values)} entries in {axis.field} for {len(names)} joints; '
            f'{axis.joint} is commanded in {axis.field} ({axis.unit})'
        )
    value = float(values[names.index(axis.joint)])
    if not math.isfinite(value):
        raise ValueError(f'{axis.field} of {axis.joint} is {value}')
    return value


def joint_state(
    status: Status, axes: Sequence[Axis], stamp: Any = None, frame_id: str = ''
) -> JointState:
    """
    Return what was measured, by joint name.

    Only fields that some axis measures are filled; there, axes of another mode have NaN.
    """
    message = JointState(name=[axis.joint for axis in axes])
    for field in {axis.field for axis in axes}:
        setattr(message, field, [_measured(field, *pair) for pair in _pairs(axes, status)])
    if stamp is not None:
        message.header.stamp = stamp
    message.header.frame_id = frame_id
    return message


def _pairs(axes: Sequence[Axis], status: Status) -> list[tuple[Axis, int]]:
    """:raises ValueError: where status and configuration differ in the number of axes."""
    feedback = (axis.feedback for axis in status.axes)
    return list(zip(axes, feedback, strict=True))


def _measured(field: str, axis: Axis, counts: int) -> float:
    return counts * axis.si_per_count if axis.field == field else math.nan


def problems(status: Status) -> list[tuple[bytes, str]]:
    """Return level and sentence for every error and warning bit, with what to do."""
    return [
        *((DiagnosticStatus.ERROR, text) for text in status.faults()),
        *((DiagnosticStatus.WARN, text) for text in status.warnings()),
    ]


def diagnostic_values(status: Status, axes: Sequence[Axis]) -> dict[str, Any]:
    """Return every bit and number of the status, by joint and the manual's word."""
    values: dict[str, Any] = {}
    for axis, (letter, state) in zip(axes, status.lettered(), strict=True):
        name = f'axis {letter} ({axis.joint})'
        values[f'{name} enabled'] = state.enabled
        values[f'{name} errors'] = ', '.join(state.fault_names()) or 'none'
        values[f'{name} warning'] = state.warning
        values[f'{name} {axis.field} ({axis.unit})'] = state.feedback * axis.si_per_count
        values[f'{name} feedback counts'] = state.feedback
    return values
