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

"""When a stop or a farewell presses switch 7, pause and resume in one, by the moment."""

from __future__ import annotations

from copy import deepcopy
from functools import cache
import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from akron_can_bridge.parameters import Cause
from akron_can_bridge.protocol import Axis, BasicJoystick, ExtendedJoystick, Status
from bridge_core.j1939 import CanFrame
from test.akron_loop_rig import Bench as Loop
from test.akron_session_rig import (
    ANNOUNCED,
    COAST,
    DEPLOY,
    ef,
    joystick,
    MOVE,
    NEUTRAL,
    NO_FAULTS,
    NO_TARGETS,
    OSCILLATE,
    OSCILLATES,
    oscillating,
    OURS,
    OUTPUTS,
    PAUSE,
    REST,
    SLOT,
    Turning,
    WATER,
)
from test.session_rig import SessionBench

STANDS = ef('81FED401C200')
ALLOWED = 0x33
STICK = joystick('7D04010000000000', ALLOWED)  # X to the right
SWITCH_7 = (
    BasicJoystick(Axis.of(0), Axis.of(0), tuple(Status(n == 7) for n in range(1, 13))),
    ExtendedJoystick(),
)
COMMANDS = {
    'rest': REST,
    'water': WATER,
    'move': MOVE,
    'oscillate': OSCILLATE,
    'deploy': DEPLOY,
}
LOST = 30.0  # s for which an angle that is missing may change
STEP = 5 * SLOT  # in which the unit turns by half a degree
COASTS = 0.9 * COAST


def test_stop_presses_pause_once_it_saw_two_steps_for_a_while_and_once() -> None:
    bench = oscillating()
    bench.now += 0.001  # within a slot
    start = bench.now
    bench.estop_in(True)
    bench.run(3.0, REST, estop=True)
    pressed = [at for at, f in bench.sent if at >= start and f.data == PAUSE]
    assert STEP < pressed[0] - start <= 2 * STEP + SLOT
    assert 0.16 <= pressed[-1] - pressed[0] < 0.2
    assert bench.joystick_frames(pressed[-1] + 1e-9)[0] == NEUTRAL


def test_one_step_after_the_stop_is_no_oscillation_that_runs() -> None:
    bench = oscillating()
    start = bench.now
    bench.estop_in(True)
    steps = bench.session.motion.ends_at
    while bench.session.motion.ends_at == steps:
        bench.run(SLOT, REST, estop=True)
    bench.turns = False
    bench.run(3.0, REST, estop=True)
    assert bench.all_neutral(start + 1e-9)


@pytest.mark.parametrize('turns', [False, True])
def test_pause_is_pressed_only_where_an_oscillation_surely_runs(turns: bool) -> None:
    bench = oscillating()
    bench.turns = turns
    bench.says = [STANDS if turns else OSCILLATES]
    bench.run(0.6, REST)
    start = bench.now
    bench.run(1.0, REST, estop=True)
    assert bench.all_neutral(start + 1e-9)


def test_pause_is_not_pressed_against_a_joystick_that_commands_motion() -> None:
    bench = oscillating(allowed_joysticks=frozenset({ALLOWED}))
    bench.says.append(STICK)
    bench.run(0.1, REST)
    start = bench.now
    bench.run(0.5, REST, estop=True)
    bench.says.pop()  # and coasts
    bench.run(0.5, REST, estop=True)
    assert bench.all_neutral(start + 1e-9)


def test_pause_by_a_joystick_that_fell_silent_is_not_undone_while_the_unit_coasts() -> None:
    bench = oscillating(allowed_joysticks=frozenset({ALLOWED}), coast_time=3.0)
    bench.says.append(joystick('0100010000000400', ALLOWED))
    bench.run(0.1, REST)
    bench.says.pop()
    bench.run(1.2, REST)
    start = bench.now
    bench.run(1.0, REST, estop=True)
    assert bench.all_neutral(start + 1e-9)
    assert {frame.data for frame in bench.session.farewell(bench.now)} == {NEUTRAL}


@pytest.mark.parametrize('coasts', [0.0, 0.4])
def test_stop_of_a_stick_does_not_resume_an_oscillation_that_is_paused(coasts: float) -> None:
    """Type 81 may say "oscillating" of that too, and it is the stick that changes the angles."""
    bench = oscillating()
    bench.run(1.0, MOVE)
    bench.estop_in(True)
    start = bench.now
    bench.run(coasts, REST, estop=True)
    bench.turns = False
    bench.run(3.0, REST, estop=True)
    assert bench.all_neutral(start + 1e-9)


@pytest.mark.parametrize('asked', [False, True])
def test_farewell_presses_pause_unless_the_stick_moves_the_unit(asked: bool) -> None:
    bench = oscillating()
    bench.run(SLOT, MOVE if asked else REST)
    frames = bench.session.farewell(bench.now)
    assert (PAUSE in [frame.data for frame in frames]) is not asked


def test_farewell_does_not_press_pause_where_the_angles_stand() -> None:
    bench = oscillating()
    bench.turns = False
    bench.run(3.0, REST)
    assert {frame.data for frame in bench.session.farewell(bench.now)} == {NEUTRAL}


def test_oscillation_that_begins_long_after_the_stop_is_not_paused() -> None:
    bench = Turning().ready()
    bench.run(COAST + SLOT, REST, estop=True)
    bench.turns, bench.says = True, [OSCILLATES]
    start = bench.now
    bench.run(1.0, REST, estop=True)
    assert bench.all_neutral(start + 1e-9)


@pytest.mark.parametrize(('later', 'pressed'), [(-1e-6, True), (0.0, False)])
def test_time_for_a_pause_is_over_at_its_end(later: float, pressed: bool) -> None:
    bench = Turning().ready()
    bench.turns = True
    bench.now = float(math.ceil(bench.now))
    ends = bench.now + COAST
    bench.estop_in(True)
    bench.run(COAST - SLOT, REST, estop=True)
    bench.now = ends + later
    bench.take(OSCILLATES)
    start = bench.now
    bench.run(0.2, REST, estop=True)
    assert (PAUSE in bench.joystick_frames(start)) is pressed


def test_node_that_starts_with_a_stop_does_not_press_pause() -> None:
    bench = Turning().find_unit()
    assert isinstance(bench, Turning)
    bench.turns, bench.says = True, [OSCILLATES]
    bench.run(COAST - SLOT, REST, estop=True)
    assert bench.session.motion.describe(bench.now) == 'oscillates'
    assert bench.all_neutral(0.0)


def test_oscillation_that_is_seen_soon_after_the_stop_is_paused() -> None:
    bench = Turning().ready()
    bench.run(0.3, REST, estop=True)
    bench.turns, bench.says = True, [OSCILLATES]
    start = bench.now
    bench.run(0.6, REST, estop=True)
    assert PAUSE in bench.joystick_frames(start)


# -- angles that changed while it coasted ---------------------------------------------------------


@pytest.mark.parametrize('command', [SWITCH_7, MOVE])
@pytest.mark.parametrize('after', [0.1, 0.3, 0.5, 0.7])
def test_stop_does_not_resume_by_steps_of_the_coasting(after: float, command: Any) -> None:
    bench = oscillating()
    bench.run(0.1, command)
    bench.run(after, REST)
    start = bench.now + 1e-9
    bench.run(COASTS - after, REST, estop=True)
    bench.turns = False
    bench.run(2 * COAST, REST, estop=True)
    assert bench.all_neutral(start)


@pytest.mark.parametrize(
    ('coast_time', 'coasts', 'after'),
    [(1.0, 0.7, 1.1), (1.0, 0.9, 1.3), (0.3, 0.0, 0.4), (0.1, 0.0, 0.2)],
)
def test_farewell_does_not_resume_by_steps_of_the_coasting(
    coast_time: float, coasts: float, after: float
) -> None:
    bench = oscillating(coast_time=coast_time)
    bench.run(0.1, SWITCH_7)
    bench.run(coasts, REST)
    bench.turns = False
    bench.run(after - coasts, REST)
    assert bench.session.motion.moving(bench.now)
    assert {frame.data for frame in bench.session.farewell(bench.now)} == {NEUTRAL}


def test_oscillation_that_runs_on_is_paused_two_steps_after_the_coasting() -> None:
    bench = oscillating()
    bench.run(0.1, SWITCH_7)
    coasted = bench.now + COAST
    bench.run(COAST / 2, REST)
    bench.run(COAST, REST, estop=True)
    pressed = [at for at, f in bench.sent if at >= coasted and f.data == PAUSE]
    assert STEP <= pressed[0] - coasted <= 2 * STEP + SLOT


def test_farewell_pauses_an_oscillation_that_took_two_steps_after_the_coasting() -> None:
    bench = oscillating()
    bench.run(0.1, SWITCH_7)
    bench.run(COAST + 2 * STEP, REST)
    assert PAUSE in [frame.data for frame in bench.session.farewell(bench.now)]


# -- motion by a travel: type 81 may say "oscillating" of one that is paused all along -----------

STOW = (
    BasicJoystick(Axis.of(0), Axis.of(0), tuple(Status(n == 9) for n in range(1, 13))),
    ExtendedJoystick(),
)
TARGET = (REST[0], ExtendedJoystick(grip_x=Axis.of(0)))
TRAVELS = {
    'deploy': joystick('0100010000000100', ALLOWED),
    'stow': joystick('0100010000000040', ALLOWED),
    'target': joystick('FFFF107DFFFF0000', ALLOWED, 0xFDD7),  # grip Y
    'broken': joystick('FEFFFFFFFFFF0000', ALLOWED, 0xFDD7),  # grip X
}


def paused(**options: Any) -> Turning:
    """Return one whose unit has been told to pause its oscillation long ago."""
    bench = oscillating(**options)
    bench.run(0.1, SWITCH_7)
    bench.turns = False
    bench.run(3 * COAST, REST)
    return bench


def presses(bench: Turning, seconds: float = COAST) -> bool:
    """Tell whether a stop presses switch 7."""
    start = bench.now + 1e-9
    bench.run(seconds, REST, estop=True)
    return PAUSE in bench.joystick_frames(start)


@pytest.mark.parametrize('command', [DEPLOY, STOW, TARGET])
@pytest.mark.parametrize('lag', [0.0, 0.7 * COAST])
def test_stop_does_not_take_a_travel_for_an_oscillation(command: Any, lag: float) -> None:
    bench = paused(extended=True)
    bench.run(0.1, command)
    bench.run(lag, REST)
    bench.turns = True
    bench.run(2 * COAST, REST)
    assert not presses(bench)
    assert {frame.data for frame in bench.session.farewell(bench.now)} == {NEUTRAL, NO_TARGETS}


@pytest.mark.parametrize('silence', [0.1, 0.45, 0.55, 0.6, 1.2])
@pytest.mark.parametrize('how', ['silent', 'closed', 'error'])
def test_travel_of_a_unit_that_was_not_heard_for_a_while_is_one_as_well(
    silence: float, how: str
) -> None:
    bench = paused()
    bench.run(0.1, STOW)
    bench.turns = True
    bench.run(2 * COAST, REST)
    if how == 'closed':
        bench.close()
        bench.now += silence
        bench.open()
        bench.take(ANNOUNCED)
    elif how == 'error':
        for _ in range(round(silence / SLOT)):
            bench.take(OUTPUTS, ef('01000A0371000041'), OSCILLATES)  # of rotation
            bench.run(SLOT, REST, unit=False)
    else:
        bench.run(silence, REST, unit=False)
    bench._tenths += round(silence / SLOT)  # it has gone on meanwhile
    bench.says = [OSCILLATES, NO_FAULTS]
    start = bench.now
    bench.run(3 * COAST, REST)  # motion is a stop by then
    assert PAUSE not in bench.joystick_frames(start)
    assert not presses(bench)


@pytest.mark.parametrize(
    ('coasts', 'stands', 'coast_time'),
    [(0.0, 0.6, COAST), (0.3, 0.6, COAST), (0.3, 0.4, COAST), (0.5, 0.8, 2 * COAST)],
)
def test_travel_that_begins_after_the_unit_has_coasted_and_stood_is_one_as_well(
    coasts: float, stands: float, coast_time: float
) -> None:
    bench = paused(coast_time=coast_time)
    bench.turns = True
    bench.run(1.0, MOVE)
    bench.run(0.1, STOW)
    bench.run(coasts, REST)
    bench.turns = False
    bench.run(stands, REST)
    bench.turns = True
    bench.run(2 * coast_time + COAST, REST)
    assert not presses(bench)


@pytest.mark.parametrize(('speed', 'lag'), [(5.0, 0.95), (2.5, 0.85), (1.25, 0.7), (1.25, 0.95)])
def test_travel_is_one_by_when_it_begins_and_not_by_its_first_step(
    speed: float, lag: float
) -> None:
    bench = paused()
    bench.speed = speed
    bench.run(0.1, STOW)
    bench.run(lag * COAST, REST)
    bench.turns = True
    bench.run(3 * COAST, REST)
    assert not presses(bench)


@pytest.mark.parametrize('elevation', ['FFFF', '037A'], ids=['missing', 'error'])
def test_angle_that_is_lost_for_good_does_not_make_a_travel_of_all_that_follows(
    elevation: str,
) -> None:
    bench = paused()
    bench.run(0.1, DEPLOY)
    bench.turns = True
    bench.run(COAST, REST)
    bench.elevation = elevation
    bench.turns = False
    bench.run(LOST - 1.0, REST)
    bench.turns = True
    bench.run(2 * COAST, REST)
    assert not presses(bench)  # it may still have travelled, unseen
    bench.turns = False
    bench.run(2 * COAST, REST)
    bench.run(0.1, SWITCH_7)
    bench.turns = True
    bench.run(5 * COAST, REST)
    assert presses(bench)


@pytest.mark.parametrize('frame', TRAVELS.values(), ids=TRAVELS)
def test_stop_does_not_take_the_travel_of_a_joystick_for_an_oscillation(frame: CanFrame) -> None:
    bench = paused(allowed_joysticks=frozenset({ALLOWED}))
    bench.take(frame)
    bench.turns = True
    bench.run(3 * COAST, REST)
    assert not bench.session.joysticks.present(bench.now)
    assert not presses(bench)


def test_grip_that_a_joystick_leaves_in_neutral_is_no_travel() -> None:
    bench = oscillating(allowed_joysticks=frozenset({ALLOWED}))
    bench.take(joystick('0100010001000000', ALLOWED, 0xFDD7))
    bench.run(3 * COAST, REST)
    assert presses(bench)


@pytest.mark.parametrize('by_joystick', [False, True])
def test_oscillation_is_paused_after_a_travel_that_has_ended(by_joystick: bool) -> None:
    bench = paused(allowed_joysticks=frozenset({ALLOWED} if by_joystick else ()))
    if by_joystick:
        bench.take(TRAVELS['stow'])
    else:
        bench.run(0.1, DEPLOY)
    bench.turns = True
    bench.run(2 * COAST, REST)
    bench.turns = False
    bench.run(1.5 * COAST, REST)
    bench.turns = True  # resumed by its own controls
    bench.run(0.8 * COAST, REST)
    assert presses(bench)


def test_travel_that_never_begins_is_forgotten() -> None:
    bench = paused()
    bench.run(0.1, STOW)
    bench.run(3 * COAST, REST)
    bench.turns = True  # resumed by its own controls
    bench.run(0.8 * COAST, REST)
    assert presses(bench)


@pytest.mark.parametrize('start', [SWITCH_7, OSCILLATE, REST], ids=['7', '4', 'its own controls'])
@pytest.mark.parametrize('stands', [0.6, 0.8 * COAST, 1.2 * COAST])  # s; it has arrived after 0.5
@pytest.mark.parametrize('coasts', [True, False])
def test_oscillation_that_begins_soon_after_a_travel_is_paused(
    start: Any, stands: float, coasts: bool
) -> None:
    bench = paused()
    bench.turns = coasts
    bench.run(0.1, DEPLOY)
    bench.turns = True
    bench.run(2 * COAST, REST)
    bench.turns = False
    bench.run(stands, REST)
    bench.run(0.1, start)
    bench.turns = True
    bench.run(5 * COAST, REST)
    assert presses(bench)


def test_oscillation_that_begins_during_a_travel_that_ended_another_is_paused() -> None:
    bench = paused()
    bench.run(0.1, DEPLOY)
    bench.turns, bench.says = True, [STANDS]
    bench.run(COAST, REST)
    bench.says = [OSCILLATES]
    bench.run(SLOT, REST)
    assert presses(bench)


def test_travel_of_a_unit_that_says_nothing_of_oscillating_is_one_as_well() -> None:
    bench = paused()
    bench.says = []
    bench.run(COAST, REST)
    bench.run(0.1, DEPLOY)
    bench.turns = True
    bench.run(COAST, REST)
    bench.says = [OSCILLATES]
    bench.run(COAST, REST)
    assert not presses(bench)


# -- once in a stop -------------------------------------------------------------------------------


def pressed_once(bench: Turning) -> float:
    """Have a stop press it; return a moment after the first frame of that."""
    start = bench.now
    bench.estop_in(True)
    while PAUSE not in bench.joystick_frames(start):
        assert bench.now < start + COAST
        bench.run(SLOT, REST, estop=True)
    return bench.now + 1e-9


def edges(frames: list[bytes], before: bytes = NEUTRAL) -> int:
    """Return how often switch 7 is turned on in these joystick frames."""
    return sum(last != PAUSE == now for last, now in zip([before, *frames], frames, strict=False))


@pytest.mark.parametrize('command', [WATER, MOVE])
def test_press_that_a_command_interrupts_does_not_go_on_after_it(command: Any) -> None:
    bench = oscillating()
    start = pressed_once(bench)
    bench.turns = False
    for each in (REST, command, REST):
        bench.run(2 * SLOT, each)
    bench.run(0.3, REST)
    assert bench.joystick_frames(start)[0] == PAUSE
    assert edges(bench.joystick_frames(start), PAUSE) == 0


@cache
def swinging() -> Loop:
    """Return a bus whose unit oscillates; no motion of it is a stop."""
    loop = Loop(automatic_motion=True, estop_on=frozenset(Cause) - {Cause.MOTION})
    loop.unit.motion.switched_on(frozenset({4}))
    loop.run(1.0)
    return loop


@given(
    st.lists(
        st.tuples(
            st.sampled_from(['rest', 'rest', 'rest', *COMMANDS]),
            st.sampled_from([False, False, False, True]),
            st.sampled_from([1, 2, 3, 15]),
        ),
        min_size=3,
        max_size=6,
    )
)
def test_stop_turns_switch_7_on_once_and_never_where_it_is_paused(
    plays: list[tuple[str, bool, int]],
) -> None:
    loop, last, pressed = deepcopy(swinging()), NEUTRAL, 0
    for command, stop, slots in [('rest', True, 9), *plays, ('rest', False, 9)]:
        pressed *= stop <= loop.ours.stop  # a stop that begins
        loop.ours.command, loop.ours.stop = COMMANDS[command], stop
        for _ in range(slots):
            paused = loop.unit.motion.paused
            loop.run(SLOT)
            frames = [bytes.fromhex(data) for data in loop.of(f'0CFDD6{OURS:02X}')]
            begun = edges(frames, last)
            last, pressed = frames[-1], pressed + begun
            assert pressed <= 1
            assert not (begun and paused)


def test_stop_that_presses_it_and_misses_messages_does_not_press_it_again() -> None:
    bench = oscillating()
    start = pressed_once(bench)
    bench.session.interrupted('messages were lost', bench.now)
    bench.take(ANNOUNCED)  # it still coasts
    bench.run(3 * COAST, REST, estop=True)
    assert bench.all_neutral(start)


@pytest.mark.parametrize('at_fault', [False, True])
def test_port_that_is_back_has_the_same_stop_press_it_no_more(at_fault: bool) -> None:
    bench = oscillating()
    if at_fault:  # of this process: the farewell presses it
        assert PAUSE in [frame.data for frame in bench.session.farewell(bench.now)]
    start = bench.now + 1e-9 if at_fault else pressed_once(bench)
    bench.close()
    bench.wait(0.1)
    SessionBench.open(bench)  # this session is still informed: it takes nothing over
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    bench.run(3 * COAST, REST, estop=True)
    assert bench.all_neutral(start)


def test_motion_by_other_controls_in_the_stop_that_pressed_it_has_it_pressed_no_more() -> None:
    bench = oscillating(coast_time=3.0)
    start = pressed_once(bench)
    bench.run(0.2, REST, estop=True)
    bench.turns = False
    bench.run(0.8, REST, estop=True)
    bench.turns = True
    bench.run(3.0, REST, estop=True)
    assert set(bench.joystick_frames(start + 0.2)) == {NEUTRAL}


def test_stop_right_after_the_one_that_pressed_it_waits_until_the_unit_has_coasted() -> None:
    bench = oscillating()
    pressed_once(bench)
    bench.run(0.3, REST, estop=True)
    start = bench.now + 1e-9
    bench.session.interrupted('messages were lost', bench.now)
    bench.take(ANNOUNCED, NO_FAULTS)
    bench.run(0.24, REST)
    assert bench.session.drive.inhibits(bench.now, bench.session.stop_reasons(bench.now)) == []
    bench.run(0.5, REST, estop=True)
    assert bench.all_neutral(start)


def test_stop_after_the_one_that_pressed_it_does_not_resume_by_steps_of_the_coasting() -> None:
    bench = oscillating()
    start = pressed_once(bench) + 0.2
    bench.run(0.3, REST, estop=True)
    bench.run(0.3, REST)
    bench.run(0.5, REST, estop=True)
    bench.turns = False
    bench.run(2 * COAST, REST, estop=True)
    assert bench.all_neutral(start)


def test_each_stop_presses_it_where_the_unit_oscillates_again() -> None:
    bench = oscillating()
    pressed_once(bench)
    bench.turns = False
    bench.run(2.0, REST, estop=True)
    bench.run(0.1, REST)
    bench.turns = True
    bench.run(0.1, OSCILLATE)
    bench.run(2.0, REST)
    pressed_once(bench)
