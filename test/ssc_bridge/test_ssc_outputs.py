# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The SSC's pulse outputs by themselves: what drives them, what they forget, what is sent."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from ssc_bridge.channels import Failsafe
from ssc_bridge.protocol import MAX_OUTPUTS
from ssc_bridge.session import Settings
from ssc_bridge.session.outputs import Channel, Outputs
from stage.ssc_rig import PAN, TILT

COUNT = 16
NOW = 100.0


def send(outputs: Outputs, now: float = NOW) -> list[bytes]:
    """Have a message go out at once; return it."""
    frames = outputs.frames(now, COUNT, at_once=True)
    if frames:
        outputs.note_sent(now)
    return frames


def step(channel: Channel) -> float:
    channel.state = channel.after(0.02)
    return channel.us


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
    for number in range(1, MAX_OUTPUTS + 1):
        outputs.ask(number, 1500.0, NOW)
    assert list(outputs.commanded()) == [*range(1, MAX_OUTPUTS + 1)]


def test_command_of_no_pulse_is_sent_for_as_long_as_it_is_fresh() -> None:
    outputs = Outputs(Settings())
    outputs.begin(NOW)
    assert send(outputs) == []
    outputs.ask(1, 0.0, NOW)
    for _ in range(5):
        assert send(outputs)
    outputs.forget()
    sent = [bool(send(outputs)) for _ in range(52)]
    assert sent == [True] * 50 + [False] * 2


def test_command_that_never_went_out_needs_no_release() -> None:
    outputs = Outputs(Settings())
    outputs.begin(NOW)
    outputs.ask(1, 1500.0, NOW)
    outputs.forget()
    assert send(outputs) == []


HELD = replace(PAN, channel=1, failsafe=Failsafe.HOLD)


def held(*told: float) -> Outputs:
    """Return outputs of one servo to be held, told of so many s after the start."""
    outputs = Outputs(Settings(servos=(HELD,)))
    outputs.begin(NOW)
    for seconds in told:
        outputs.driven_elsewhere([1600], NOW + seconds)
    return outputs


@pytest.mark.parametrize(
    ('told', 'due'), [((), 0.3), ((0.05,), 0.1), ((0.2,), 0.2), ((0.05, 0.25), 0.1)]
)
def test_first_message_waits_for_what_is_to_be_held(told: tuple[float, ...], due: float) -> None:
    assert held(*told).sends_at() == pytest.approx(NOW + due)


def test_what_was_told_or_commanded_before_is_not_waited_for() -> None:
    told = held(0.05)
    commanded = held()
    commanded.ask(1, 0.0, NOW)  # no pulse is held, too
    send(commanded)
    for outputs in (told, commanded):
        outputs.begin(NOW + 9.0)
        assert outputs.sends_at() == pytest.approx(NOW + 9.1)


def test_device_that_tells_after_the_first_message_holds_up_none() -> None:
    outputs = held()
    assert outputs.frames(NOW + 0.3, COUNT)
    due = outputs.sends_at()
    outputs.driven_elsewhere([1600], NOW + 5.0)
    assert outputs.sends_at() == due


def test_nothing_is_sent_to_a_port_that_is_closed_whatever_was_waited_for() -> None:
    outputs = held()
    outputs.end()
    outputs.driven_elsewhere([1600], NOW)
    assert outputs.sends_at() == math.inf


def test_nothing_is_sent_before_the_device_could_tell(outputs: Outputs) -> None:
    assert outputs.frames(NOW, COUNT) == []


def test_servo_with_a_rate_loses_its_pulse_at_once() -> None:
    channel = Channel(TILT, 0.3)
    channel.ask(1200.0, NOW)
    assert step(channel) == 1200
    channel.ask(1300.0, NOW)
    assert step(channel) == 1220  # 1000 us/s
    channel.ask(0.0, NOW)
    assert step(channel) == 0


def test_first_frame_moves_a_servo_by_two_periods_at_most(outputs: Outputs) -> None:
    outputs.driven_elsewhere([None, None, 1200], NOW)
    outputs.ask(TILT.channel, 2000.0, NOW)
    (frame,) = send(outputs)
    pulse = int.from_bytes(frame[4 + 2 * (TILT.channel - 1) :][:2], 'big')
    assert pulse == 1200 + round(1000.0 * 2.0 / Settings().command_rate)


def test_closed_port_forgets_commands_and_sends_nothing(outputs: Outputs) -> None:
    outputs.ask(PAN.channel, 1700.0, NOW)
    assert send(outputs)
    outputs.end()
    assert outputs.commanded() == {}
    assert outputs.sends_at() == math.inf
    assert outputs.frames(NOW + 1.0, COUNT) == []


def test_failsafe_pulse_goes_out_for_as_long_as_there_is_no_command() -> None:
    outputs = Outputs(Settings(servos=(TILT,)))
    outputs.begin(NOW)
    assert all(send(outputs) for _ in range(200))


@pytest.mark.parametrize('failsafe', [Failsafe.PULSE, Failsafe.HOLD])
def test_command_begins_at_our_last_pulse_whoever_drives_the_output_now(
    failsafe: Failsafe,
) -> None:
    """At a failsafe pulse, or held after a command; it may be handed over to us at any time."""
    channel = Channel(replace(TILT, failsafe=failsafe), 0.3)
    if failsafe is Failsafe.HOLD:
        channel.ask(TILT.failsafe_us, NOW)
        step(channel)
        channel.command.reset()
    assert step(channel) == TILT.failsafe_us
    channel.driven_elsewhere(1900, serial=False)
    channel.ask(2000.0, NOW)
    assert step(channel) == TILT.failsafe_us + 20  # 1000 us/s


def test_offer_that_does_not_go_out_changes_nothing(outputs: Outputs) -> None:
    outputs.ask(TILT.channel, 2000.0, NOW)
    (first,) = outputs.frames(NOW + 0.1, COUNT)
    assert outputs.sent == ()
    assert outputs.frames(NOW + 0.1, COUNT) == [first]
    assert outputs.sends_at() <= NOW + 0.1


def test_failsafe_that_began_before_the_device_was_there_is_due_at_once(outputs: Outputs) -> None:
    outputs.ask(PAN.channel, 1700.0, NOW)
    assert send(outputs)
    outputs.forget()
    outputs.begin(NOW + 1.0)
    assert outputs.sends_at() <= NOW + 1.0
