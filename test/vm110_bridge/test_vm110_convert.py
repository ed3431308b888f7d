# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VM-110's values as ROS messages."""

import math
from typing import Any

from builtin_interfaces.msg import Time
import pytest
from sensor_msgs.msg import BatteryState
from std_msgs.msg import MultiArrayLayout, UInt8MultiArray

from vm110_bridge import convert

STAMP = Time(sec=12, nanosec=34)


def joy(axes: Any, buttons: Any = (0,) * 9, **options: Any) -> Any:
    return convert.joy(axes, buttons, STAMP, 'remote', **options)


def test_full_way_is_one() -> None:
    assert list(joy((1000, -1000, 500, 0)).axes) == [1.0, -1.0, 0.5, 0.0]


def test_signs_turn_round_one_by_one() -> None:
    message = joy((1000, 1000, 0, -500), axis_inverted=(True, False, True, True))
    assert list(message.axes) == [-1.0, 1.0, 0.0, 0.5]
    assert all(math.copysign(1.0, axis) == 1.0 for axis in (message.axes[2], message.axes[1]))


def test_buttons_are_the_raw_switches_then_the_encoder_switch() -> None:
    raw = (1, -1, 1000, 0, 3, 0, 0, 0, 1)
    assert list(joy((0,) * 4, raw).buttons) == list(raw)


def test_stamp_and_frame_are_passed_on() -> None:
    message = joy((0,) * 4)
    assert (message.header.stamp, message.header.frame_id) == (STAMP, 'remote')


def test_battery() -> None:
    message = convert.battery_state(42, STAMP, 'remote')
    assert message.present
    assert message.percentage == pytest.approx(0.42)
    assert message.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
    assert math.isnan(message.voltage)


def test_battery_in_the_dock_is_not_said_to_discharge() -> None:
    message = convert.battery_state(42, STAMP, 'remote', docked=True)
    assert message.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_UNKNOWN


def test_battery_of_no_remote_is_not_present() -> None:
    message = convert.battery_state(None, STAMP, 'remote')
    assert not message.present
    assert math.isnan(message.percentage)


@pytest.mark.parametrize(('percent', 'percentage'), [(0, 0.0), (100, 1.0)])
def test_empty_and_full_batteries_are_numbers(percent: int, percentage: float) -> None:
    assert convert.battery_state(percent, STAMP, 'remote').percentage == percentage


def test_battery_above_a_hundred_is_not_a_number() -> None:
    assert math.isnan(convert.battery_state(101, STAMP, 'remote').percentage)


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
    assert convert.data_of(message) == b'\1\2\3'
    message.layout.data_offset = 1
    assert convert.data_of(message) == b'\2\3'
    message.layout.data_offset = 4
    with pytest.raises(ValueError, match='data_offset 4'):
        convert.data_of(message)


@pytest.mark.parametrize('data', [[], [1, 2, 3]])
def test_data_offset_at_the_end_leaves_no_bytes(data: list[int]) -> None:
    layout = MultiArrayLayout(data_offset=len(data))
    assert convert.data_of(UInt8MultiArray(layout=layout, data=data)) == b''


def test_command_results() -> None:
    result = convert.command_result(7, 'acknowledged')
    assert (result.key, result.value) == ('7', 'acknowledged')
    assert convert.command_result(None, 'too many').key == 'refused'
