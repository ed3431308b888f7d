# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the Akron session sends as a joystick: what makes it neutral, and a line that is busy."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

from akron_can_bridge.parameters import Cause
from akron_can_bridge.protocol import Axis, BasicJoystick, ExtendedJoystick, Permission, Status
from akron_can_bridge.session import PausePressed, Request, Settings, Stopped
from akron_can_bridge.session.drive import Command, Drive, PAUSE_TIME
from bridge_core.j1939 import CanFrame
from bridge_core.session import Answer
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    COAST,
    COMMAND_LIMIT,
    ef,
    ESTOP_LIMIT,
    LINK_LIMIT,
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
    permission,
    REST,
    SLOT,
    Turning,
    UNIT,
    WATER,
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


def a1_frames(drive: Drive, now: float, unit: int | None = UNIT) -> list[str]:
    """Return the A1 that goes out, in hexadecimal."""
    frames = drive.permissive_frames(now, unit, RIGHT)
    for frame in frames:
        drive.permission_sent(frame, now)
    return [f'{frame.identifier:08X} {frame.data.hex().upper()}' for frame in frames]


# -- what a port that closed, or input that was lost, leaves behind -------------------------------


def test_permission_is_said_anew_where_the_unit_may_have_missed_it() -> None:
    drive = Drive(Settings(soe_permissive=True))
    frame = [f'{PERMISSION:08X} A10001']
    assert a1_frames(drive, NOW) == frame
    assert a1_frames(drive, NOW) == []
    drive.forget_inputs()
    drive.stop()  # the port was closed, and is opened again
    assert a1_frames(drive, NOW + 0.02, None) == []  # nothing to the former unit either
    assert a1_frames(drive, NOW + 0.02) == frame
    assert a1_frames(drive, NOW + 0.03, None) == []  # the unit has lost its address
    assert a1_frames(drive, NOW + 0.04) == frame


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


@pytest.mark.parametrize(('x', 'y'), [(1, 0), (0, -1)])
def test_stick_that_leaves_its_centre_on_one_axis_asks_for_motion(x: int, y: int) -> None:
    drive = moving()
    drive.set_command(Command(BasicJoystick(Axis.of(x), Axis.of(y)), REST[1]), NOW + 0.1, [])
    assert drive.pushes
    drive.set_command(AT_REST, NOW + 0.15, [])
    assert drive.asked_until == NOW + 0.15


GRIPS = (
    MOVE[0],
    ExtendedJoystick(
        Axis.of(500), Axis.of(-400), switches=(*(Status.OFF,) * 2, Status.ON, Status.OFF)
    ),
)
A1 = 0x18EF8038
GRIPPING = bytes.fromhex('107D0464FFFF0004')  # the manual's


def test_neutral_every_20_ms_from_the_opening_on_with_nobody_there() -> None:
    bench = Bench()
    bench.open()
    bench.wait(1.0)
    sent = [at for at, frame in bench.sent if frame.identifier == 0x0CFDD638]
    assert len(sent) == 51
    assert sent[0] == 100.0
    assert all(abs(b - a - SLOT) < 1e-9 for a, b in itertools.pairwise(sent))
    assert set(bench.joystick_frames()) == {NEUTRAL}


@pytest.mark.parametrize('address', range(0x33, 0x39))
def test_command_becomes_the_manuals_frame_from_every_address(address: int) -> None:
    bench = Bench(source_address=address)
    bench.open()
    bench.take(ANNOUNCED, OUTPUTS, CanFrame(0x18EF0080 | address << 8, NO_FAULTS.data))
    bench.play('0.1 rest; 0.1 move')
    assert bench.joystick_frames(source=address)[-1] == MOVING


# -- what ends motion -----------------------------------------------------------------------------


def late(seconds: float) -> str:
    """Return what comes too late though nobody looked meanwhile."""
    return f'late {seconds}; do move; clear; say outputs'


LONG = 2.0  # s, of what is not to be the reason
ENDS: list[tuple[str, str, dict[str, Any]]] = [  # what happens, and why motion ends
    ('estop', 'e-stop input is true', {}),
    ('blink', 'e-stop input is true', {}),
    ('refuse', 'command refused: axis 0 is nan', {}),
    ('say disabled outputs', 'the enable input is not asserted', {}),
    ('lost', 'messages were lost', {}),
    (late(COMMAND_LIMIT), 'command is stale', {'estop_in_timeout': LONG, 'link_timeout': LONG}),
    (
        f'late {COMMAND_LIMIT}; refuse',
        'command is stale',
        {'estop_in_timeout': LONG, 'link_timeout': LONG},
    ),
    (late(ESTOP_LIMIT), 'e-stop input is stale', {'command_timeout': LONG, 'link_timeout': LONG}),
    (late(LINK_LIMIT), 'it is silent', {'command_timeout': LONG, 'estop_in_timeout': LONG}),
    (late(1.0), 'it is silent', {}),
]


@pytest.mark.parametrize(('script', 'reason', 'options'), ENDS)
def test_motion_ends_at_once_and_begins_anew_by_a_neutral_command_alone(
    script: str, reason: str, options: dict[str, Any]
) -> None:
    bench = Bench(**options).moving()
    bench.play(f'late 0.001; mark; {script}')  # within a slot
    assert bench.joystick_frames(bench.now) == [NEUTRAL]
    (stopped,) = of(Stopped, bench.events)
    assert reason in '; '.join(stopped.reasons)
    bench.run(0.3, MOVE)
    assert bench.all_neutral(0.0)
    bench.play('say unit outputs well; 0.2 rest; 0.04 move')
    assert bench.joystick_frames()[-1] == MOVING


@pytest.mark.parametrize(
    'options', [{'link_timeout': 5.0}, {'estop_on': frozenset({Cause.FOREIGN_JOYSTICK})}]
)
@pytest.mark.parametrize(('silence', 'goes_on'), [(0.46, True), (0.5, False)])
def test_unit_that_may_have_been_switched_off_moves_by_a_fresh_command_alone(
    options: dict[str, Any], silence: float, goes_on: bool
) -> None:
    bench = Bench(**options).moving()
    bench.run(silence, MOVE, unit=False)
    bench.run(0.1, MOVE)
    assert bench.joystick_frames()[-1] == (MOVING if goes_on else NEUTRAL)
    bench.play('0.1 rest; 0.1 move')
    assert bench.joystick_frames()[-1] == MOVING


@pytest.mark.parametrize('soe_permissive', [False, True])
def test_farewell_is_neutral_several_times_and_takes_the_permission(soe_permissive: bool) -> None:
    bench = Bench(soe_permissive=soe_permissive).moving()
    frames = [CanFrame(0x0CFDD638, NEUTRAL)]
    frames += [CanFrame(A1, bytes.fromhex('A10000'))] * soe_permissive
    assert bench.session.farewell(bench.now) == frames * 3
    bench.close()
    assert bench.session.farewell(bench.now) == []


# -- extended -------------------------------------------------------------------------------------


def test_extended_carries_targets_and_switches_as_in_the_manual_where_asked_for() -> None:
    bench = Bench().moving()
    assert bench.frames(0x0CFDD738) == []
    bench = Bench(extended=True).play('find; 0.1 rest')
    assert set(bench.frames(0x0CFDD738)) == {NO_TARGETS}
    bench.run(0.1, GRIPS)
    assert bench.frames(0x0CFDD738)[-1] == GRIPPING
    assert bench.joystick_frames()[-1] == MOVING


def test_stop_leaves_no_target_to_travel_to() -> None:
    bench = Bench(extended=True).play('find; 0.1 rest')
    bench.run(0.1, GRIPS)
    bench.estop_in(True)
    assert bench.frames(0x0CFDD738)[-1] == NO_TARGETS
    # Nor does a target count as neutral afterwards, not even one of 0.
    start = bench.now
    bench.run(0.2, (REST[0], ExtendedJoystick(grip_x=Axis.of(0))))
    assert set(bench.frames(0x0CFDD738, start + 1e-9)) == {NO_TARGETS}
    assert bench.session.farewell(bench.now)[:2] == [
        CanFrame(0x0CFDD638, NEUTRAL),
        CanFrame(0x0CFDD738, NO_TARGETS),
    ]


# -- SOE permission -------------------------------------------------------------------------------

HEARD = 'say unit outputs well'
PUSHED = 'find; 0.1 rest; 0.1 move; '
LIMITED = f'{PUSHED}directions 9; '  # down and right only
STEADY = {'estop_on': frozenset({Cause.FOREIGN_JOYSTICK})}  # a lost link is no stop
STICK = {'allowed_joysticks': frozenset({0x33})}
STICK_PUSHED = 'find; 0.02; say stick; 0.02; say right; '
STOPPED = f'{STICK_PUSHED}0.02 stop; '
ALONE = {'automatic_motion': True}
ENDED = '; 0.1 rest stop; stand; says stands; 1 rest'
PERMITTED: list[tuple[dict[str, Any], str, str]] = [  # settings, what happens, each change of A1
    ({}, 'find; 0.2 rest; 0.2 water; 0.8 move', '0 F'),
    ({}, f'{PUSHED}estop', '0 F 0'),
    # Another one that gives it would undo every stop.
    ({}, f'{PUSHED}say permits; 0.5 move', '0 F 0'),
    ({}, f'{PUSHED}say permits; 1.1 rest; 0.1 move', '0 F 0 F'),
    ({}, f'{PUSHED}0.5 move stop; 0.1 move; 0.1 rest', '0 F 0'),
    ({}, f'{PUSHED}0.5 move stop; 0.1 move; 0.1 rest; do move', '0 F 0 F'),
    ({'link_timeout': 0.6}, f'{PUSHED}0.1 rest; wait 1; 1 rest', '0 F 0'),
    ({'link_timeout': 5.0}, f'{PUSHED}0.46 rest gone; 0.1 rest', '0 F'),
    ({'link_timeout': 5.0}, f'{PUSHED}0.5 rest gone; 0.1 rest', '0 F 0'),
    # Before it was told what a session before it knew it permits nothing; that one's is no push.
    ({}, f'open; {HEARD}; 0.5 rest; 0.1 move', '0'),
    ({}, f'open; {HEARD}; 0.5 rest; told; 0.1 rest; 0.1 move', '0 F'),
    ({}, f'open; told on; {HEARD}; 0.5 rest', '0'),
    ({}, f'open; told on; {HEARD}; 0.5 rest; 0.1 move; told on; 0.1 move', '0 F'),
    ({}, f'open; told on; {HEARD}; 0.5 rest; 0.1 move; 0.1 rest stop; told lost; 1 rest', '0 F 0'),
    # Directions are permitted one by one, and have to be repeated once they were said.
    ({}, LIMITED, '0 F 9'),
    ({}, f'{LIMITED}0.2; clear; wait 0.049', '0 F 9'),
    ({}, f'{LIMITED}0.2; clear; wait 0.051', '0 F 9 0'),
    ({}, f'{LIMITED}0.3; directions 6', '0 F 9 0 6'),
    ({}, f'{LIMITED}estop; directions 15; wait 5', '0 F 9 0'),
    ({}, f'limit; {PUSHED}', '0'),  # they were said to a session before
    ({}, f'limit; {PUSHED}directions 1; limit', '0 1'),
    # An allowed joystick gives it, once it was let go of and is pushed.
    (STICK, 'find; 0.02; say right; 0.02; say stick', '0'),
    (STICK, STICK_PUSHED, '0 F'),
    (STICK, f'{STOPPED}0.02; say right', '0 F 0'),  # it is held
    (STICK, f'{STOPPED}0.02; say stick; 0.02; say broken; 0.02; say right', '0 F 0'),
    (STICK, f'{STOPPED}0.02; say stick@34; 0.02; say right@34', '0 F 0'),  # that is a stop
    (STICK, f'{STOPPED}say stick@34; 1.1; say stick; 0.02; say right', '0 F 0 F'),
    # A lost link takes it, whatever is held meanwhile.
    *(
        (STEADY, f'{PUSHED}1 {held} gone; say unit; 0.2 {held}', '0 F 0')
        for held in ('rest', 'move')
    ),
    (STEADY, f'{PUSHED}1 move gone; say unit; 0.2 move; 0.04 rest; 0.04 move', '0 F 0 F'),
    (
        STEADY | STICK,
        f'{PUSHED}0.1 rest; {25 * "say right; 0.02 rest gone; "}{25 * "say right; 0.02 rest; "}',
        '0 F 0',
    ),
    # Motion that goes on by itself keeps it, until a stop takes it for good.
    *(
        (ALONE, f'find; 2 rest; 0.02 move; 1 rest; {moves}; 0.4 rest{script}', said)
        for moves in ('0.1 deploy; 0.1 rest', 'turn', 'says aims', 'says oscillates')
        for script, said in (
            ('', '0 F'),
            (ENDED, '0 F 0'),
            (f'{ENDED}; 0.04 move; 0.2 rest', '0 F 0 F'),
        )
    ),
    *(
        ({}, f'find; 2 rest; 0.1 move; turn; {later} rest; 0.5 rest stop; 0.5 rest', '0 F 0')
        for later in (0, 0.35, 2)
    ),
]


@pytest.mark.parametrize(('options', 'script', 'said'), PERMITTED)
def test_permission_by_what_happened(options: dict[str, Any], script: str, said: str) -> None:
    bench = Turning(soe_permissive=True, **options).play(script)
    permitted = [data.hex().upper() for data in bench.frames(A1) if data[0] == 0xA1]
    assert [data[-1] for data, _ in itertools.groupby(permitted)] == said.split()
    assert {data[:-1] for data in permitted} == {'A1000'}


def test_permission_goes_to_the_unit_alone_every_100_ms() -> None:
    bench = Bench(soe_permissive=True).play('open; wait 0.5')
    assert bench.frames(A1) == []
    bench.play(f'{PUSHED}mark; 0.8 move')
    times = [at for at, frame in bench.sent if frame == CanFrame(A1, bytes.fromhex('A1000F'))]
    assert all(b - a <= 0.1 + SLOT for a, b in itertools.pairwise(times))
    assert 7 <= len(times) <= 9
    bench.play('say thief; mark; wait 5')
    assert bench.frames(A1) == []
    assert not [data for data in Bench().moving().frames(A1) if data[0] == 0xA1]


def test_directions_that_are_none_permit_nothing() -> None:
    bench = Bench(soe_permissive=True).play(PUSHED)
    with pytest.raises(ValueError, match='16 is no sum of 1 right'):
        bench.play('directions 16')
    bench.poll()
    assert permission(bench) == 'A10000'


# -- a busy line ----------------------------------------------------------------------------------

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


def timed_permissions(bench: Bench, since: float, unit: int = UNIT) -> list[tuple[float, str]]:
    """Return each A1 to an address: after how many ms it went, and what it permits."""
    identifier = 0x18EF0000 | unit << 8 | OURS
    return [
        (round((at - since) * 1e3, 3), frame.data.hex().upper()[4:])
        for at, frame in bench.sent
        if at >= since and frame.identifier == identifier and frame.data[0] == 0xA1
    ]


def permitted_bench() -> Bench:
    bench = Bench(soe_permissive=True).play('find; 0.1 rest; 0.2 move')
    assert timed_permissions(bench, 0.0)[-1][1] == ALL
    bench.now += RETRY / 2  # within a slot
    return bench


# -- sticks ---------------------------------------------------------------------------------------


def test_stop_that_a_busy_line_did_not_take_goes_with_the_next_poll() -> None:
    bench = permitted_bench()
    start, bench.refuses = bench.now, everything
    bench.estop_in(True)
    assert bench.session.deadline() <= bench.now
    bench.wait(5 * RETRY)
    assert bench.joystick_frames(start) == []
    bench.refuses = nothing
    bench.wait(RETRY)
    assert bench.joystick_frames(start) == [NEUTRAL]
    assert timed_permissions(bench, start) == [(5.0, NONE)]


def test_grip_that_a_busy_line_did_not_take_goes_soon_and_alone() -> None:
    bench = Bench(extended=True, automatic_motion=True).play('find; 0.1 rest')
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
    bench = Bench(command_timeout=2.0).play('find; 0.1 rest')
    bench.run(0.1, command)
    bench.refuses = everything
    bench.run(busy, command)
    start, bench.refuses = bench.now, nothing
    bench.run(0.1, command)
    assert (NEUTRAL not in bench.joystick_frames(start)) is again
    bench.run(SLOT, REST)
    bench.run(2 * SLOT, MOVE)
    assert bench.joystick_frames()[-1] == MOVING


# -- the permission -------------------------------------------------------------------------------


@pytest.mark.parametrize('address', [None, 0x90])
def test_permission_is_taken_back_at_the_former_address_too(address: int | None) -> None:
    bench = permitted_bench()
    bench.refuses = everything
    bench.session.interrupted('messages were lost', bench.now)
    bench.poll()
    if address is not None:
        bench.take(ef('FF83150226021A0B', address), ef('83C051', address))
    start, bench.refuses = bench.now, nothing
    bench.wait(2 * RETRY)
    assert timed_permissions(bench, start) == [(1.0, NONE)]
    bench.wait(0.09)
    assert len(timed_permissions(bench, start)) == 1
    assert len(timed_permissions(bench, start, 0x90)) == (address == 0x90)


def test_grip_is_no_permission_whatever_its_first_byte_is() -> None:
    bench = permitted_bench()
    frame = ExtendedJoystick().to_frame(OURS)
    bench.session.sent(CanFrame(frame.identifier, b'\xa1' + frame.data[1:]), bench.now)
    start, at = bench.now, [at for at, f in bench.sent if f.data[0] == 0xA1][-1]
    bench.run(0.1, MOVE)
    assert timed_permissions(bench, start)[0][0] <= round((at + 0.1 + SLOT - start) * 1e3, 3)


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
def test_request_that_did_not_go_out_goes_once(request_: Request, data: list[str]) -> None:
    bench = Bench().find_unit()
    bench.run(1.5)
    start, bench.refuses = bench.now, everything
    bench.play(f'ask {request_.value}')
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
    bench.play('ask reset_controller')
    bench.refuses = lambda frame: frame.data.hex() == '21'  # a poll
    bench.run(1.0)
    assert bench.asked(start) == ['45']
