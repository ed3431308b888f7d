# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversions that several bridges share. Pure."""

from collections.abc import Sequence
import math

from builtin_interfaces.msg import Time
from sensor_msgs.msg import BatteryState, Joy


def scaled(value: float, full_scale: float, deadband: float = 0.0) -> float:
    """
    Return a control as -1 to 1, clipped, without a step at the edge of the deadband.

    Zero is never -0.0.

    :param full_scale: the magnitude that is 1. :param deadband: 0 to below 1, of full scale.
    """
    magnitude = min(abs(value) / full_scale, 1.0)
    if magnitude <= deadband:
        return 0.0
    return math.copysign((magnitude - deadband) / (1.0 - deadband), value)


def time_message(nanoseconds: int) -> Time:
    """Return a time as a header has it."""
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def joy_message(axes: Sequence[float], buttons: Sequence[int], stamp: Time, frame_id: str) -> Joy:
    """Return a Joy. :param axes: -1 to 1, left and forward positive."""
    message = Joy()
    message.header.stamp = stamp
    message.header.frame_id = frame_id
    message.axes = [axis + 0.0 for axis in axes]  # -0.0 becomes 0.0
    message.buttons = [int(button) for button in buttons]
    return message


def unknown_battery(location: str, stamp: Time, frame_id: str) -> BatteryState:
    """Return a battery of unknown state: not present, all values NaN."""
    message = BatteryState()
    message.header.stamp = stamp
    message.header.frame_id = frame_id
    for field in ('voltage', 'temperature', 'current', 'charge', 'capacity', 'design_capacity'):
        setattr(message, field, math.nan)  # BatteryState: NaN if unmeasured
    message.percentage = math.nan
    message.location = location
    return message
