# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron output by itself: what shuts it, what it forgets, and what is due when."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

import pytest

from akron_can_bridge.protocol import Axis, BasicJoystick, ExtendedJoystick, Permission
from akron_can_bridge.session import Settings
from akron_can_bridge.session.drive import Command, Drive, PAUSE_TIME
from stage.akron_session_rig import (
    COMMAND_LIMIT,
    ESTOP_LIMIT,
    MOVE,
    MOVING,
    NEUTRAL,
    PAUSE,
    REST,
    SLOT,
    UNIT,
)

NOW = 100.0
RIGHT = Permission.RIGHT
AT_REST, AT_WORK = Command(*REST), Command(*MOVE)
JOYSTICK, PERMISSION = 0x0CFDD638, 0x18EF8038


def started(**options: Any) -> Drive:
    drive = Drive(Settings(**options))
    drive.start(NOW)
    return drive


def moving(**options: Any) -> Drive:
    """Return one whose frames move the unit; the next slot is at NOW + SLOT."""
    drive = started(**options)
    assert said(drive, NOW) == NEUTRAL
    drive.set_estop(False, NOW)
    drive.set_command(AT_REST, NOW, [])
    drive.set_command(AT_WORK, NOW, [])
    assert drive.moving
    return drive


def said(drive: Drive, now: float, *, taken: bool = True) -> bytes:
    """Return the data of the one frame that is due. :param taken: by the line."""
    (frame,) = drive.joystick_frames(now)
    assert frame.identifier == JOYSTICK
    if taken:
        drive.stick_sent(now)
    return frame.data


def permitted(drive: Drive, now: float, unit: int | None = UNIT) -> list[str]:
    """Return the A1 that goes out, in hexadecimal."""
    frames = drive.permissive_frames(now, unit, RIGHT)
    for frame in frames:
        drive.permission_sent(frame, now)
    return [f'{frame.identifier:08X} {frame.data.hex().upper()}' for frame in frames]


def test_stopped_drive_has_no_frame_due() -> None:
    drive = started(soe_permissive=True, extended=True)
    assert permitted(drive, NOW)
    drive.stop()
    assert drive.due == math.inf
    assert drive.joystick_frames(NOW + 9.0) == []


# -- what a port that closed, or input that was lost, leaves behind -------------------------------


def test_permission_is_said_anew_where_the_unit_may_have_missed_it() -> None:
    drive = Drive(Settings(soe_permissive=True))
    frame = [f'{PERMISSION:08X} A10001']
    assert permitted(drive, NOW) == frame
    assert permitted(drive, NOW) == []
    drive.forget_inputs()
    drive.stop()  # the port was closed, and is opened again
    assert permitted(drive, NOW + 0.02, None) == []  # nothing to the former unit either
    assert permitted(drive, NOW + 0.02) == frame
    assert permitted(drive, NOW + 0.03, None) == []  # the unit has lost its address
    assert permitted(drive, NOW + 0.04) == frame


def test_farewell_leaves_nothing_commanded_and_needs_no_unit() -> None:
    drive = moving(soe_permissive=True)
    frames = drive.farewell(None, NOW)
    assert {(frame.identifier, frame.data) for frame in frames} == {(JOYSTICK, NEUTRAL)}
    assert not drive.moving


# -- stale inputs ---------------------------------------------------------------------------------


def test_one_stale_input_is_enough_to_be_told() -> None:
    drive = moving(command_timeout=COMMAND_LIMIT, estop_in_timeout=ESTOP_LIMIT)
    assert not drive.stale(NOW + COMMAND_LIMIT - 1e-6)
    assert drive.stale(NOW + COMMAND_LIMIT)
    drive.set_command(AT_WORK, NOW + 0.2, [])
    assert not drive.stale(NOW + ESTOP_LIMIT - 1e-6)
    assert drive.stale(NOW + ESTOP_LIMIT)


# -- motion that a neutral stick does not end -----------------------------------------------------


def test_target_of_the_grip_is_motion_that_goes_on_by_itself() -> None:
    drive = moving()
    assert not drive.automatic
    drive.set_command(Command(REST[0], ExtendedJoystick(grip_x=Axis.of(0))), NOW, [])
    assert drive.automatic


START = NOW + 0.001  # of a press


@pytest.mark.parametrize(
    ('taken', 'expected'),
    [
        # When each frame goes, whether the line takes it, and what it is.
        ((0.0, True), [(0.02, PAUSE), (PAUSE_TIME - 1e-6, PAUSE), (PAUSE_TIME, NEUTRAL)]),
        ((0.0, False), [(0.001, PAUSE), (0.1, PAUSE)]),
        ((0.0, False), [(SLOT, NEUTRAL)]),  # it came too late
    ],
)
def test_press_begins_within_a_slot_and_lasts_its_time(
    taken: tuple[float, bool], expected: list[tuple[float, bytes]]
) -> None:
    drive = started()
    said(drive, NOW)
    drive.pause(START)
    assert drive.due == START
    assert said(drive, START + taken[0], taken=taken[1]) == PAUSE
    for after, data in expected:
        drive.start(START + after)
        assert said(drive, START + after) == data


def test_press_is_told_once_by_its_first_frame() -> None:
    drive = started()
    drive.pause(NOW)
    assert [drive.stick_sent(NOW + n * SLOT) for n in range(12)] == [True, *[False] * 11]


def test_press_does_not_go_on_behind_a_command_in_its_midst() -> None:
    drive = moving()
    drive.set_command(AT_REST, NOW, [])
    drive.pause(START)
    assert said(drive, START) == PAUSE
    drive.set_command(AT_WORK, NOW + 0.025, [])
    assert said(drive, NOW + 0.025) == MOVING
    drive.set_command(AT_REST, NOW + 0.05, [])
    assert said(drive, NOW + 0.05) == NEUTRAL


def test_command_is_not_lost_to_a_press_and_a_forgotten_press_is_none() -> None:
    drive = moving()
    drive.pause(START)
    assert said(drive, START) == MOVING
    drive.set_command(AT_REST, START, [])
    drive.pause(START)
    drive.forget_inputs()
    assert said(drive, START) == NEUTRAL


# -- until when we asked for the motion that the unit reports -------------------------------------


@pytest.mark.parametrize(
    'end', [lambda drive, at: drive.set_command(AT_REST, at, []), lambda d, at: d.watch(at, ['x'])]
)
def test_motion_was_asked_for_until_the_stick_was_let_go_of_or_a_stop(
    end: Callable[[Drive, float], Any],
) -> None:
    drive = moving()
    for after in (0.1, 0.15):
        end(drive, NOW + after)
        assert drive.asked_until == NOW + 0.1


@pytest.mark.parametrize(('x', 'y'), [(1, 0), (0, -1)])
def test_stick_that_leaves_its_centre_on_one_axis_asks_for_motion(x: int, y: int) -> None:
    drive = moving()
    drive.set_command(Command(BasicJoystick(Axis.of(x), Axis.of(y)), REST[1]), NOW + 0.1, [])
    assert drive.pushes
    drive.set_command(AT_REST, NOW + 0.15, [])
    assert drive.asked_until == NOW + 0.15
