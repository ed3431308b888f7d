# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The SSC's pulse outputs by themselves: what drives them, what they forget, what is sent."""

from __future__ import annotations

import math

import pytest

from ssc_bridge.protocol import PULSE_CHANNELS
from ssc_bridge.session import Settings
from ssc_bridge.session.outputs import Channel
from ssc_bridge.session.outputs import Outputs
from test.ssc_rig import PAN
from test.ssc_rig import TILT

COUNT = 16
NOW = 100.0


@pytest.fixture
def outputs() -> Outputs:
    result = Outputs(Settings(servos=(PAN, TILT)))
    result.begin(NOW)
    return result


def test_only_what_is_beyond_the_limits_counts_as_limited(outputs: Outputs) -> None:
    outputs.ask(PAN.channel, PAN.max_us, NOW)
    assert outputs.limited == 0
    outputs.ask(PAN.channel, PAN.max_us + 1, NOW)
    outputs.ask(PAN.channel, PAN.min_us - 1, NOW)
    assert outputs.limited == 2


def test_every_output_may_be_commanded(outputs: Outputs) -> None:
    for number in range(1, PULSE_CHANNELS + 1):
        outputs.ask(number, 1500.0, NOW)
    assert list(outputs.commanded()) == [*range(1, 25)]


def test_command_of_no_pulse_is_sent_for_as_long_as_it_is_fresh() -> None:
    outputs = Outputs(Settings())
    outputs.begin(NOW)
    assert outputs.frames(NOW, COUNT, at_once=True) == []
    outputs.ask(1, 0.0, NOW)
    for _ in range(5):
        assert outputs.frames(NOW, COUNT, at_once=True)
    outputs.forget()
    sent = [bool(outputs.frames(NOW, COUNT, at_once=True)) for _ in range(52)]
    assert sent == [True] * 50 + [False] * 2


def test_command_that_never_went_out_needs_no_release() -> None:
    outputs = Outputs(Settings())
    outputs.begin(NOW)
    outputs.ask(1, 1500.0, NOW)
    outputs.forget()
    assert outputs.frames(NOW, COUNT, at_once=True) == []


def test_servo_with_a_rate_loses_its_pulse_at_once() -> None:
    channel = Channel(TILT, 0.3)
    channel.ask(1200.0, NOW)
    assert channel.step(0.02) == 1200
    channel.ask(1300.0, NOW)
    assert channel.step(0.02) == 1220  # 1000 us/s
    channel.ask(0.0, NOW)
    assert channel.step(0.02) == 0


def test_first_frame_moves_a_servo_by_two_periods_at_most(outputs: Outputs) -> None:
    outputs.driven_elsewhere([None, None, 1200], NOW)
    outputs.ask(TILT.channel, 2000.0, NOW)
    (frame,) = outputs.frames(NOW, COUNT, at_once=True)
    pulse = int.from_bytes(frame[4 + 2 * (TILT.channel - 1) :][:2], 'big')
    assert pulse == 1200 + round(1000.0 * 2.0 / Settings().command_rate)


def test_closed_port_forgets_commands_and_sends_nothing(outputs: Outputs) -> None:
    outputs.ask(PAN.channel, 1700.0, NOW)
    assert outputs.frames(NOW, COUNT, at_once=True)
    outputs.end()
    assert outputs.commanded() == {}
    assert outputs.sends_at() == math.inf
    assert outputs.frames(NOW + 1.0, COUNT) == []
