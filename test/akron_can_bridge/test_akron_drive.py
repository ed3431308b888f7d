# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron output gate by itself: what shuts it, what it forgets, and what is due when."""

from __future__ import annotations

import math
from typing import Any

import pytest

from akron_can_bridge.protocol import Axis, BasicJoystick, ExtendedJoystick, Permission
from akron_can_bridge.session import Settings
from akron_can_bridge.session.drive import Command, Drive, PAUSE_TIME
from bridge_core.j1939 import CanFrame
from stage.akron_session_rig import COMMAND_LIMIT, ESTOP_LIMIT, MOVE, MOVING, NEUTRAL, REST, UNIT

NOW = 100.0
RIGHT = Permission.RIGHT
PAUSE = bytes.fromhex('0100010000000400')  # switch 7, by the manual's table
AT_REST, AT_WORK = Command(*REST), Command(*MOVE)
JOYSTICK, PERMISSION = 0x0CFDD638, 0x18EF8038


def moving(**options: Any) -> Drive:
    """Return one whose frames move the unit."""
    drive = Drive(Settings(**options))
    drive.start(NOW)
    drive.set_estop(False, NOW)
    drive.set_command(AT_REST, NOW, [])
    drive.set_command(AT_WORK, NOW, [])
    assert drive.moving
    return drive


def said(drive: Drive, now: float) -> bytes:
    """Return the data of the one frame that is due."""
    (frame,) = drive.joystick_frames(now)
    assert frame.identifier == JOYSTICK
    return frame.data


def test_stopped_drive_has_no_frame_due() -> None:
    drive = moving(soe_permissive=True)
    assert drive.permissive_frames(NOW, UNIT, RIGHT)
    assert drive.due == NOW
    drive.extended_refused(NOW)
    drive.stop()
    assert drive.due == math.inf
    assert drive.joystick_frames(NOW + 9.0) == []
    assert drive.permissive_frames(NOW + 9.0, UNIT, RIGHT) == []


def test_former_unit_is_told_nothing_on_a_port_that_was_opened_again() -> None:
    drive = moving(soe_permissive=True)
    assert drive.permissive_frames(NOW, UNIT, RIGHT)
    drive.forget()
    drive.stop()
    drive.start(NOW + 1.0)
    assert drive.permissive_frames(NOW + 1.0, None, Permission(0)) == []


# -- what a port that closed, or input that was lost, leaves behind -------------------------------


def test_forgotten_command_does_not_go_out() -> None:
    drive = moving()
    drive.forget()
    assert not drive.moving
    assert said(drive, NOW) == NEUTRAL


def test_gate_is_shut_once_all_is_forgotten() -> None:
    drive = moving()
    drive.forget()
    drive.set_command(AT_WORK, NOW, [])
    assert not drive.moving
    drive.set_estop(False, NOW)
    drive.set_command(AT_WORK, NOW, [])
    assert said(drive, NOW) == NEUTRAL
    assert drive.inhibits(NOW, []) == ['the command must be neutral once']


def test_forgotten_estop_input_is_not_taken_for_released() -> None:
    drive = moving()
    drive.forget()
    drive.set_command(AT_REST, NOW, [])
    drive.set_command(AT_WORK, NOW, [])
    assert not drive.moving
    assert drive.forbidden(NOW, []) == ['e-stop input is stale: never heard, limit 250 ms']


def test_forgotten_command_is_neither_fresh_nor_refused() -> None:
    drive = moving()
    drive.refuse_command('axis 0 is nan')
    drive.forget()
    drive.set_estop(False, NOW)
    assert drive.inhibits(NOW, []) == ['command is stale: never heard, limit 150 ms']
    assert drive.stale(NOW)


def test_forgotten_pause_is_not_pressed_on() -> None:
    drive = Drive(Settings())
    drive.start(NOW)
    drive.pause(NOW)
    assert said(drive, NOW) == PAUSE
    drive.forget()
    drive.start(NOW + 0.02)
    assert said(drive, NOW + 0.02) == NEUTRAL


def test_permission_is_said_anew_on_a_port_that_was_opened_again() -> None:
    drive = Drive(Settings(soe_permissive=True))
    frame = CanFrame(PERMISSION, bytes.fromhex('A10001'))
    assert drive.permissive_frames(NOW, UNIT, RIGHT) == [frame]
    assert drive.permissive_frames(NOW, UNIT, RIGHT) == []
    drive.stop()
    drive.forget()
    assert drive.permissive_frames(NOW + 0.02, UNIT, RIGHT) == [frame]


def test_permission_is_said_anew_to_a_unit_that_is_back() -> None:
    drive = Drive(Settings(soe_permissive=True))
    frame = CanFrame(PERMISSION, bytes.fromhex('A10001'))
    assert drive.permissive_frames(NOW, UNIT, RIGHT) == [frame]
    assert drive.permissive_frames(NOW, None, RIGHT) == []
    assert drive.permissive_frames(NOW + 0.02, UNIT, RIGHT) == [frame]


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


def test_gate_says_nothing_while_nothing_forbids_motion_and_its_reason_once() -> None:
    drive = moving()
    assert drive.watch(NOW, []) == ()
    assert drive.watch(NOW, ['a reason']) == ('a reason',)
    assert drive.watch(NOW, ['a reason']) == ()
    assert said(drive, NOW) == NEUTRAL


# -- motion that a neutral stick does not end -----------------------------------------------------


def test_target_of_the_grip_is_motion_that_goes_on_by_itself() -> None:
    drive = moving()
    assert not drive.automatic
    drive.set_command(Command(REST[0], ExtendedJoystick(grip_x=Axis.of(0))), NOW, [])
    assert drive.automatic


def test_pause_is_pressed_at_once_and_no_longer_than_its_time() -> None:
    drive = Drive(Settings())
    drive.start(NOW)
    assert said(drive, NOW) == NEUTRAL
    drive.pause(NOW + 0.001)
    assert drive.due == NOW + 0.001
    assert said(drive, NOW + 0.001) == PAUSE
    assert said(drive, NOW + 0.001 + PAUSE_TIME - 1e-6) == PAUSE
    drive.start(NOW + 0.001 + PAUSE_TIME)
    assert said(drive, NOW + 0.001 + PAUSE_TIME) == NEUTRAL


def test_command_is_not_lost_to_a_pause_that_is_still_pressed() -> None:
    drive = moving()
    drive.pause(NOW)
    assert said(drive, NOW) == MOVING


# -- a press that the line did not take -----------------------------------------------------------


def test_press_of_which_nothing_went_out_is_none() -> None:
    drive = Drive(Settings())
    drive.start(NOW)
    drive.pause(NOW)
    assert said(drive, NOW) == PAUSE
    assert drive.stick_refused(NOW)
    assert said(drive, NOW + 0.001) == NEUTRAL


def test_press_of_which_something_went_out_goes_on() -> None:
    drive = Drive(Settings())
    drive.start(NOW)
    drive.pause(NOW)
    assert said(drive, NOW) == PAUSE
    assert said(drive, NOW + 0.02) == PAUSE
    assert not drive.stick_refused(NOW + 0.02)
    assert said(drive, NOW + 0.021) == PAUSE


def test_press_does_not_go_on_behind_a_command_in_its_midst() -> None:
    drive = moving()
    drive.set_command(AT_REST, NOW, [])
    drive.pause(NOW)
    assert said(drive, NOW) == PAUSE
    drive.set_command(AT_WORK, NOW + 0.025, [])
    assert said(drive, NOW + 0.025) == MOVING
    drive.set_command(AT_REST, NOW + 0.05, [])
    assert said(drive, NOW + 0.05) == NEUTRAL


def test_press_begins_behind_a_command_before_its_first_frame() -> None:
    drive = moving()
    drive.pause(NOW)
    assert said(drive, NOW) == MOVING
    drive.set_command(AT_REST, NOW + 0.02, [])
    assert said(drive, NOW + 0.02) == PAUSE
    assert drive.stick_refused(NOW + 0.02)
    assert said(drive, NOW + 0.021) == NEUTRAL


# -- until when we asked for the motion that the unit reports -------------------------------------


def test_motion_was_asked_for_until_the_stick_was_let_go_of() -> None:
    drive = moving()
    drive.set_command(AT_REST, NOW + 0.1, [])
    assert drive.asked_until == NOW + 0.1
    drive.set_command(AT_REST, NOW + 0.2, [])
    assert drive.asked_until == NOW + 0.1


@pytest.mark.parametrize(('x', 'y'), [(1, 0), (0, -1)])
def test_stick_that_leaves_its_centre_on_one_axis_asks_for_motion(x: int, y: int) -> None:
    drive = moving()
    drive.set_command(Command(BasicJoystick(Axis.of(x), Axis.of(y)), REST[1]), NOW + 0.1, [])
    assert drive.pushes
    drive.set_command(AT_REST, NOW + 0.2, [])
    assert drive.asked_until == NOW + 0.2


def test_motion_was_asked_for_until_a_stop() -> None:
    drive = moving()
    drive.watch(NOW + 0.1, ['a reason'])
    assert drive.asked_until == NOW + 0.1
    drive.watch(NOW + 0.2, ['a reason'])
    assert drive.asked_until == NOW + 0.1
