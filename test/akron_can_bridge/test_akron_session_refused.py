# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames of the Akron session that a busy line does not take: it counts on none of them."""

from __future__ import annotations

import pytest

from akron_can_bridge.protocol import Axis, ExtendedJoystick
from akron_can_bridge.session import PausePressed, Request, Stopped
from bridge_core.j1939 import CanFrame
from bridge_core.session import Answer
from stage.akron_session_rig import (
    Bench,
    COAST,
    ef,
    MOVE,
    MOVING,
    NEUTRAL,
    NO_FAULTS,
    NO_TARGETS,
    of,
    oscillating,
    OURS,
    OUTPUTS,
    PAUSE,
    REST,
    SLOT,
    Turning,
    UNIT,
    WATER,
)

RETRY = 0.001  # s, of the wire
FORGOTTEN = 0.2  # s after which a unit forgets a joystick: Appendix B
GRIP = 0x0CFDD700 | OURS
ALL, NONE = '0F', '00'


def everything(frame: CanFrame) -> bool:
    del frame
    return True


def nothing(frame: CanFrame) -> bool:
    del frame
    return False


def permissions(bench: Bench, since: float, unit: int = UNIT) -> list[tuple[float, str]]:
    """Return each A1 to an address: after how many ms it went, and what it permits."""
    identifier = 0x18EF0000 | unit << 8 | OURS
    return [
        (round((at - since) * 1e3, 3), frame.data.hex().upper()[4:])
        for at, frame in bench.sent
        if at >= since and frame.identifier == identifier and frame.data[0] == 0xA1
    ]


def permitted() -> Bench:
    bench = Bench(soe_permissive=True).find_unit()
    bench.run(0.1, REST)
    bench.run(0.2, MOVE)
    assert permissions(bench, 0.0)[-1][1] == ALL
    bench.now += RETRY / 2  # within a slot
    return bench


# -- sticks ---------------------------------------------------------------------------------------


def test_stop_that_a_busy_line_did_not_take_goes_with_the_next_poll() -> None:
    bench = permitted()
    start, bench.refuses = bench.now, everything
    bench.estop_in(True)
    assert bench.session.deadline() <= bench.now
    bench.wait(5 * RETRY)
    assert bench.joystick_frames(start) == []
    bench.refuses = nothing
    bench.wait(RETRY)
    assert bench.joystick_frames(start) == [NEUTRAL]
    assert permissions(bench, start) == [(5.0, NONE)]


def test_what_is_tried_again_is_what_is_asked_for_then() -> None:
    bench = permitted()
    bench.wait(SLOT / 2)
    bench.refuses = everything
    bench.wait(SLOT)
    start, bench.refuses = bench.now, nothing
    bench.estop_in(True)
    bench.wait(SLOT)
    assert bench.all_neutral(start)


def test_grip_that_a_busy_line_did_not_take_goes_soon_and_alone() -> None:
    bench = Bench(extended=True, automatic_motion=True).find_unit()
    bench.run(0.1, REST)
    bench.run(0.1, (REST[0], ExtendedJoystick(Axis.of(500), Axis.of(0))))
    bench.now += RETRY / 2  # within a slot
    start, bench.refuses = bench.now, lambda frame: frame.identifier == GRIP
    bench.estop_in(True)
    bench.wait(5 * RETRY)
    assert (bench.joystick_frames(start), bench.frames(GRIP, start)) == ([NEUTRAL], [])
    bench.refuses = nothing
    bench.wait(RETRY)
    assert (bench.joystick_frames(start), bench.frames(GRIP, start)) == ([NEUTRAL], [NO_TARGETS])


@pytest.mark.parametrize(
    ('busy', 'command', 'again'),
    [
        (FORGOTTEN - SLOT, WATER, True),
        (FORGOTTEN + SLOT, WATER, False),
        (FORGOTTEN + SLOT, MOVE, False),
    ],
)
def test_button_is_not_pressed_anew_for_a_unit_that_forgot_it(
    busy: float, command: tuple[object, object], again: bool
) -> None:
    bench = Bench(command_timeout=2.0).find_unit()
    bench.run(0.1, REST)
    bench.run(0.1, command)
    bench.refuses = everything
    bench.run(busy, command)
    start, bench.refuses = bench.now, nothing
    bench.run(0.1, command)
    assert (NEUTRAL not in bench.joystick_frames(start)) is again
    bench.run(SLOT, REST)
    bench.run(2 * SLOT, MOVE)
    assert bench.joystick_frames()[-1] == MOVING


def test_line_that_takes_nothing_while_the_stick_is_pushed_is_told_once() -> None:
    bench = Bench(command_timeout=2.0).moving()
    bench.events.clear()
    bench.refuses = everything
    bench.run(0.5, MOVE)
    bench.run(0.5, REST)
    text = 'no frame went out for 200 ms, so the unit forgot what was held'
    assert of(Stopped, bench.events) == [Stopped((text,))]
    assert bench.session.inhibits(bench.now) == []


# -- the permission -------------------------------------------------------------------------------


def test_permission_that_did_not_go_out_is_given_soon() -> None:
    bench = Bench(soe_permissive=True).find_unit()
    bench.run(0.1, REST)
    bench.refuses = everything
    bench.command(MOVE)
    start, bench.refuses = bench.now, nothing
    bench.wait(RETRY)
    assert permissions(bench, start) == [(1.0, ALL)]


@pytest.mark.parametrize('address', [None, 0x90])
def test_permission_that_was_not_taken_back_is_taken_back_at_the_former_address(
    address: int | None,
) -> None:
    bench = permitted()
    bench.refuses = everything
    bench.session.interrupted('messages were lost', bench.now)
    bench.poll()
    if address is not None:
        bench.take(ef('FF83150226021A0B', address), ef('83C051', address))
    start, bench.refuses = bench.now, nothing
    bench.wait(2 * RETRY)
    assert permissions(bench, start) == [(1.0, NONE)]
    bench.wait(0.09)
    assert len(permissions(bench, start)) == 1
    assert len(permissions(bench, start, 0x90)) == (address == 0x90)


def test_grip_is_no_permission_whatever_its_first_byte_is() -> None:
    bench = permitted()
    frame = ExtendedJoystick().to_frame(OURS)
    bench.session.sent(CanFrame(frame.identifier, b'\xa1' + frame.data[1:]), bench.now)
    start, at = bench.now, [at for at, f in bench.sent if f.data[0] == 0xA1][-1]
    bench.run(0.1, MOVE)
    assert permissions(bench, start)[0][0] <= round((at + 0.1 + SLOT - start) * 1e3, 3)


# -- NAMEs ----------------------------------------------------------------------------------------


def test_bus_is_asked_for_names_although_the_unit_is_known_and_heard() -> None:
    bench = Turning(automatic_motion=True, unit_address=UNIT, device_type=1032)
    bench.refuses = everything
    bench.open()
    bench.take(OUTPUTS, NO_FAULTS)
    assert not bench.session.finder.alone
    bench.refuses = nothing
    for seconds in (SLOT, 3.0):
        bench.run(seconds)
        assert len(bench.frames(0x18EAFF00 | OURS)) == 1
        assert bench.session.finder.alone


# -- the switch -----------------------------------------------------------------------------------


def pauses(frame: CanFrame) -> bool:
    return frame.data == PAUSE


def test_switch_that_did_not_go_out_is_not_pressed_later() -> None:
    bench = oscillating()
    start, bench.refuses = bench.now, pauses
    bench.run(0.3, REST, estop=True)
    bench.refuses = nothing
    bench.run(2 * COAST, REST, estop=True)
    assert bench.all_neutral(start)
    assert of(PausePressed, bench.events) == []
    assert bench.session.values(bench.now)['switch 7 pressed by stops'] == 0
    assert not bench.session.oscillation.is_doubted


def test_switch_of_which_one_frame_went_out_is_pressed_no_more() -> None:
    bench = oscillating()
    start = bench.now
    bench.refuses = lambda frame: pauses(frame) and PAUSE in bench.joystick_frames(start)
    bench.run(3 * COAST, REST, estop=True)
    assert bench.joystick_frames(start).count(PAUSE) == 1
    assert of(PausePressed, bench.events) == [PausePressed()]


# -- requests -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('request_', 'data'),
    [
        (Request.ZERO_POSITIONS, ['41']),
        (Request.ENTER_SETUP, ['46']),
        (Request.RESET_CONTROLLER, ['45']),
        (Request.POLL_VERSIONS, ['03', '04', '05']),
    ],
)
def test_request_that_did_not_go_out_goes_soon_and_once(
    request_: Request, data: list[str]
) -> None:
    bench = Bench().find_unit()
    bench.run(1.5)
    start, bench.refuses = bench.now, everything
    bench.session.request(request_, bench.now)
    bench.poll()
    bench.run(0.1)
    bench.refuses = nothing
    bench.run(SLOT)
    assert bench.asked(start) == data
    bench.run(0.2)
    assert bench.asked(start) == data
    assert of(Answer, bench.events) == []


def test_request_that_went_out_is_not_sent_anew_for_another_that_did_not() -> None:
    bench = Bench(vista_rate=10.0).find_unit()
    bench.run(1.5)
    start = bench.now
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.poll()
    bench.refuses = lambda frame: frame.data.hex() == '21'  # a poll
    bench.run(1.0)
    assert bench.asked(start) == ['45']
