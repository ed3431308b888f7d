# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The demo's monitor and SSC: what they hear, and a scene that can fail."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest
from sensor_msgs.msg import JointState, Joy

from demo.actuators import Actuators, pulses_in, turns_in
from demo.stage import monitor_command, servo_command
from rugged_teleop.ports import Chunk
from test.demo.demo_rig import FakeStage, still, turn

# By hand from Akron's Appendix B: a neutral stick; the manual's own example of one that is not.
AKRON_REST = bytes.fromhex('8cfdd638 0100 0100 00000000')
AKRON_TURN = bytes.fromhex('8cfdd638 107d 0464 00100000')
# By hand from the SSC manual, 4.1 and 4.2.2.1: message 20 for 16 outputs, the first at 1000 us.
SSC_SHUT = bytes.fromhex('81a1 1420 03e8' + 15 * '0000' + '1f40')
SSC_IDLE = bytes.fromhex('81a1 1420 05dc' + 15 * '0000' + '150c')


def test_monitor_hears_the_right_stick_and_no_button() -> None:
    # Left and right X, Y, Z; a pressed pad would be a switch of the monitor's.
    joy = Joy(axes=[0.5, 0.5, 0.5, -0.25, 0.75, 0.5], buttons=8 * [1])
    command = monitor_command(joy)
    assert list(command.axes) == [-0.25, 0.75]
    assert list(command.buttons) == []


@pytest.mark.parametrize(
    ('velocities', 'position'), [((), 0.0), ((0.0, 0.0), 0.0), ((-10.0, 5.0), 0.5), ((30.0,), 1.0)]
)
def test_throttle_opens_with_the_faster_joint(
    velocities: tuple[float, ...], position: float
) -> None:
    command = servo_command(JointState(velocity=velocities))
    assert (list(command.name), list(command.position)) == (['throttle'], [position])


def test_frame_that_is_no_joysticks_turns_no_monitor() -> None:
    claim = bytes.fromhex('98eeff80 0000000000000000')
    chunks = [Chunk(1.0, AKRON_REST), Chunk(2.0, claim), Chunk(3.0, AKRON_TURN)]
    assert turns_in(chunks) == [(1.0, False), (3.0, True)]
    foreign = bytes.fromhex('8cfdd633') + AKRON_TURN[4:]
    assert turns_in([*chunks, Chunk(4.0, foreign)], 0x38) == [(1.0, False), (3.0, True)]


def test_poll_of_the_ssc_is_no_pulse() -> None:
    poll = bytes.fromhex('81a1 0a00 0a14')
    chunks = [Chunk(1.0, poll + SSC_SHUT[:7]), Chunk(1.01, SSC_SHUT[7:])]
    assert pulses_in(chunks) == [(1.01, 1000)]


def all_still(frames: list[bytes], pulses: list[bytes]) -> str:
    """Let the scene watch that nothing moves, while monitor and SSC hear this."""
    later = time.monotonic() + 60.0
    stage: Any = FakeStage(still(later))
    stage.monitor = SimpleNamespace(received=lambda since: [Chunk(later, f) for f in frames])
    stage.ssc = SimpleNamespace(received=lambda since: [Chunk(later, p) for p in pulses])
    return Actuators(stage).all_still(time.monotonic())


@pytest.mark.parametrize(
    ('frames', 'pulses', 'expected'),
    [
        ([AKRON_REST, AKRON_TURN], [SSC_SHUT], 'turns the monitor'),
        ([], [SSC_SHUT], '0 frames'),
        ([AKRON_REST], [SSC_SHUT, SSC_IDLE], r'gets \[1000, 1500\] us'),
        ([AKRON_REST], [], r'gets \[\] us'),
    ],
    ids=['turned', 'silent', 'opened', 'no pulses'],
)
def test_monitor_or_servo_that_moves_is_missed(
    frames: list[bytes], pulses: list[bytes], expected: str
) -> None:
    well = '1 packets, all disable; 1 frames, all neutral; servo shut'
    assert all_still([AKRON_REST], [SSC_SHUT]) == well
    with pytest.raises(AssertionError, match=expected):
        all_still(frames, pulses)


def stop_all(heard: bytes) -> str:
    """Let the scene measure a stop before which the monitor has ``heard`` this."""
    now = time.monotonic()
    frames = [Chunk(now - 0.02, heard), Chunk(now + 0.01, AKRON_REST)]
    stage: Any = FakeStage(turn(now - 0.01))
    stage.monitor = SimpleNamespace(received=lambda since: [f for f in frames if f.at > since])
    stage.ssc = SimpleNamespace(received=lambda since: [Chunk(now + 0.02, SSC_SHUT)])
    actuators: Any = Actuators(stage)
    actuators._spin = lambda seconds: None
    actuators._is_turned = actuators._is_open = lambda: True

    def act() -> float:
        stage.drive.all_packets += (still(now + 0.03),)
        return now

    return str(actuators.all_stopped('a stop', act, 0.15))


def test_stop_of_motors_monitor_and_servo_is_measured_for_each() -> None:
    assert stop_all(AKRON_TURN) == (
        'disabled 30.0 ms after the cause, STOPPED; monitor neutral 10.0 ms after the cause; '
        'servo shut 20.0 ms after the cause'
    )


def test_stop_of_a_monitor_that_did_not_turn_is_missed() -> None:
    with pytest.raises(AssertionError, match='no frame turned the monitor before'):
        stop_all(AKRON_REST)
