# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VM-110's values as ROS messages."""

import math
from typing import Any

from builtin_interfaces.msg import Time
import pytest
from sensor_msgs.msg import BatteryState
from std_msgs.msg import UInt8MultiArray

from vm110_bridge import convert

STAMP = Time(sec=12, nanosec=34)


def joy(axes: Any, buttons: Any = (0,) * 9, **options: Any) -> Any:
    return convert.joy(axes, buttons, STAMP, 'remote', **options)


def test_joy_has_the_sticks_by_their_signs_then_switches_and_encoder_switch() -> None:
    raw = (1, -1, 1000, 0, 3, 0, 0, 0, 1)
    message = joy((1000, -1000, 500, 0), raw)
    assert list(message.axes) == [1.0, -1.0, 0.5, 0.0]
    assert list(message.buttons) == list(raw)
    assert (message.header.stamp, message.header.frame_id) == (STAMP, 'remote')
    turned = joy((1000, 1000, 0, -500), axis_inverted=(True, False, True, True))
    assert list(turned.axes) == [-1.0, 1.0, 0.0, 0.5]
    assert math.copysign(1.0, turned.axes[2]) == 1.0


DISCHARGING = BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
UNKNOWN = BatteryState.POWER_SUPPLY_STATUS_UNKNOWN


@pytest.mark.parametrize(
    ('percent', 'docked', 'percentage', 'supply'),
    [
        (42, False, 0.42, DISCHARGING),
        (42, True, 0.42, UNKNOWN),
        (0, False, 0.0, DISCHARGING),
        (100, False, 1.0, DISCHARGING),
        (101, False, math.nan, DISCHARGING),
        (None, False, math.nan, UNKNOWN),  # no remote
    ],
)
def test_battery(percent: int | None, docked: bool, percentage: float, supply: int) -> None:
    message = convert.battery_state(percent, STAMP, 'remote', docked=docked)
    assert message.percentage == pytest.approx(percentage, nan_ok=True)
    assert message.present is (percent is not None)
    assert message.power_supply_status == supply
    assert math.isnan(message.voltage)


@pytest.mark.parametrize(
    ('position', 'data'),
    [(0, 0), (-5, -5), (0x7FFFFFFF, 0x7FFFFFFF), (0x80000000, -0x80000000), (1 << 40, 0)],
)
def test_encoder_wraps_as_an_int32(position: int, data: int) -> None:
    assert convert.encoder(position).data == data


def test_command_carries_its_id_as_a_label() -> None:
    message = convert.command(513, bytes(range(16)))
    assert bytes(message.data) == bytes(range(16))
    assert [(d.label, d.size, d.stride) for d in message.layout.dim] == [('513', 16, 16)]


def test_data_offset_is_honoured_and_a_wild_one_refused() -> None:
    message = UInt8MultiArray(data=[1, 2, 3])
    for offset, data in enumerate((b'\1\2\3', b'\2\3', b'\3', b'')):
        message.layout.data_offset = offset
        assert convert.data_of(message) == data
    message.layout.data_offset = 4
    with pytest.raises(ValueError, match='data_offset 4'):
        convert.data_of(message)
    assert convert.data_of(UInt8MultiArray()) == b''


def test_command_results() -> None:
    result = convert.command_result(7, 'acknowledged')
    assert (result.key, result.value) == ('7', 'acknowledged')
    assert convert.command_result(None, 'too many').key == 'refused'
