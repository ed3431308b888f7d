# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversions that several bridges share."""

import math

from builtin_interfaces.msg import Time
from hypothesis import given, strategies as st
import pytest

from bridge_core.convert import joy_message, scaled, time_message, unknown_battery

STAMP = Time(sec=3, nanosec=4)


def test_deadband_has_no_step_at_its_edge() -> None:
    assert scaled(100, 1000, 0.1) == 0.0
    assert math.copysign(1.0, scaled(-100, 1000, 0.1)) == 1.0  # no -0.0
    assert scaled(101, 1000, 0.1) == pytest.approx(0.001 / 0.9)
    assert scaled(-1000, 1000, 0.1) == -1.0
    assert scaled(500, 1000) == 0.5


@given(st.integers(-0x8000, 0x7FFF), st.integers(1, 1023), st.floats(0.0, 0.99))
def test_axis_is_never_beyond_one_and_keeps_its_side(value: int, full: int, band: float) -> None:
    axis = scaled(value, full, band)
    assert -1.0 <= axis <= 1.0
    assert axis * value >= 0.0


def test_joy_has_no_negative_zero() -> None:
    message = joy_message([-0.0, 0.0], [True, 0], STAMP, 'remote')
    assert [math.copysign(1.0, axis) for axis in message.axes] == [1.0, 1.0]
    assert list(message.buttons) == [1, 0]
    assert (message.header.stamp, message.header.frame_id) == (STAMP, 'remote')


def test_nothing_is_claimed_of_an_unknown_battery() -> None:
    battery = unknown_battery('remote', STAMP, 'pad')
    assert (battery.header.stamp, battery.header.frame_id) == (STAMP, 'pad')
    assert not battery.present
    assert math.isnan(battery.percentage)
    assert math.isnan(battery.voltage)
    assert battery.location == 'remote'


def test_time_has_seconds_and_the_rest() -> None:
    seconds = 1_700_000_000
    assert time_message(seconds * 10**9 + 999_999_999) == Time(sec=seconds, nanosec=999_999_999)
    assert time_message(seconds * 10**9) == Time(sec=seconds)
