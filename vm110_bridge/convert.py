# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Between the VM-110's values and ROS messages; pure functions."""

from __future__ import annotations

from collections.abc import Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import KeyValue
from sensor_msgs.msg import BatteryState, Joy
from std_msgs.msg import Int32, MultiArrayDimension, MultiArrayLayout, UInt8MultiArray

from bridge_core.convert import joy_message, scaled, unknown_battery
from vm110_bridge.protocol import AXIS_NAMES, DATA_SIZE, MAX_PERCENT, MAX_POSITION

_AS_SENT = (False,) * len(AXIS_NAMES)


def joy(
    axes: Sequence[int],
    buttons: Sequence[int],
    stamp: Time,
    frame_id: str,
    *,
    axis_inverted: Sequence[bool] = _AS_SENT,
    deadband: float = 0.0,
) -> Joy:
    """
    Return a Joy of 4 axes and 9 buttons (8 raw switch values, encoder switch).

    :param axis_inverted: one an axis; which way a joystick counts depends on how it is fitted.
    """
    values = (
        (-1.0 if inverted else 1.0) * scaled(value, MAX_POSITION, deadband)
        for value, inverted in zip(axes, axis_inverted, strict=True)
    )
    return joy_message(list(values), buttons, stamp, frame_id)


def battery_state(
    percent: int | None, stamp: Time, frame_id: str, *, docked: bool = False
) -> BatteryState:
    """
    Return the armed remote's battery; ``present`` is false where no remote is armed.

    :param percent: 0-100; more is nothing that can be, and not a number.
    """
    message = unknown_battery('remote', stamp, frame_id)
    if percent is None:
        return message
    message.present = True
    if percent <= MAX_PERCENT:
        message.percentage = percent / 100.0
    if not docked:  # the docking station may charge it, but nothing says so
        message.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
    return message


def encoder(position: int) -> Int32:
    """Return the position; beyond 32 bits it wraps as an int32 does."""
    return Int32(data=(position + 0x80000000 & 0xFFFFFFFF) - 0x80000000)


def command(command_id: int, data: bytes) -> UInt8MultiArray:
    """Return 16 bytes, with the Command ID in decimal as the label of their one dimension."""
    dimension = MultiArrayDimension(label=str(command_id), size=DATA_SIZE, stride=DATA_SIZE)
    return UInt8MultiArray(layout=MultiArrayLayout(dim=[dimension]), data=list(data))


def data_of(message: UInt8MultiArray) -> bytes:
    """Return the bytes of a request. :raises ValueError: if it has a data_offset beyond them."""
    data = bytes(message.data)
    if message.layout.data_offset > len(data):
        raise ValueError(f'data_offset {message.layout.data_offset}, but {len(data)} bytes')
    return data[message.layout.data_offset :]


def command_result(command_id: int | None, outcome: str) -> KeyValue:
    """Return ID and outcome; the key is 'refused' for a command that got no ID."""
    return KeyValue(key='refused' if command_id is None else str(command_id), value=outcome)
