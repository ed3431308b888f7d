# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Between the drive's counts and ROS messages; scales and signs are those of Axis."""

from __future__ import annotations

from collections.abc import Sequence
import math
import reprlib
from typing import Any

from sensor_msgs.msg import JointState

from esi_drive_bridge.axes import Axis
from esi_drive_bridge.protocol import Status

_FIELDS = ('position', 'velocity', 'effort')


def command_values(
    message: Any, axes: Sequence[Axis], *, apart: bool = False
) -> tuple[float | None, ...]:
    """
    Return a JointState command as one SI value an axis, in the axes' order.

    Joints are found by name, and those of other drives are left alone; a message without names
    means the axes in order. A joint's value is read from the field of its mode; other fields are
    not looked at.

    :param apart: an axis may be left out, which gives None, and a value that is not finite is the
        session's to refuse, for that axis alone.
    :raises ValueError: for a missing or doubled joint, a field of the wrong length, or a value
        that is not finite. The text is for the sender.
    """
    known = [axis.joint for axis in axes]
    names = list(message.name) or known
    missing = set(known) - set(names)
    if len(set(names)) < len(names) or (missing and not (apart and set(known) & set(names))):
        raise ValueError(
            f'name each of {known} once: the command names {reprlib.repr(names)}, '
            f'and this drive has {known}'
        )
    values = tuple(
        None if axis.joint in missing else _value_of(message, axis, names) for axis in axes
    )
    for axis, value in zip(axes, values, strict=True):
        if not (apart or value is None or math.isfinite(value)):
            raise ValueError(f'{axis.field} of {axis.joint} is {value}')
    return values


def _value_of(message: Any, axis: Axis, names: Sequence[str]) -> float:
    values = getattr(message, axis.field)
    if len(values) != len(names):
        raise ValueError(
            f'command {axis.joint} in {axis.field} ({axis.unit}): there are {len(values)} entries '
            f'in {axis.field} for {len(names)} joints'
        )
    return float(values[names.index(axis.joint)])


def joint_state(
    status: Status,
    axes: Sequence[Axis],
    stamp: Any = None,
    frame_id: str = '',
    *,
    every_field: bool = False,
) -> JointState:
    """
    Return what was measured, by joint name.

    Only fields that some axis measures are filled, or every field; there, axes of another mode
    have NaN.

    :raises ValueError: where status and configuration differ in the number of axes.
    """
    message = JointState(name=[axis.joint for axis in axes])
    for field in _FIELDS if every_field else {axis.field for axis in axes}:
        measured = [
            each.feedback * axis.si_per_count if axis.field == field else math.nan
            for axis, each in zip(axes, status.axes, strict=True)
        ]
        setattr(message, field, measured)
    if stamp is not None:
        message.header.stamp = stamp
    message.header.frame_id = frame_id
    return message
