# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion that nobody asks for, or that a neutral stick does not end: stop, permission, pause."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache
import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from akron_can_bridge.protocol import (
    Axis,
    BasicJoystick,
    ExtendedJoystick,
    Position,
    PositionLimit,
    Status,
)
from akron_can_bridge.session import Cause, PausePressed, Settings
from akron_can_bridge.session.motion import Motion
from akron_can_bridge.session.unit import Unit
from akron_can_bridge.simulator import JoystickSimulator, Simulator
from fort_vsc_bridge.simulator import CanSimulator
from stage.akron_loop_rig import Bench as Loop
from stage.akron_session_rig import (
    COAST,
    COMMANDS,
    MOVE,
    NEUTRAL,
    of,
    OSCILLATE,
    oscillating,
    OURS,
    PAUSE,
    PIN,
    REST,
    SLOT,
    Turning,
)

# -- a stop of the unit ---------------------------------------------------------------------------


def test_coasting_is_no_stop_until_its_time_is_over() -> None:
    bench = Turning().ready()
    bench.turns = True
    bench.run(3.0, MOVE)
    assert not bench.session.estop
    bench.run(SLOT, REST)
    ends = bench.now + COAST
    bench.run(COAST - SLOT, REST)
    assert not bench.session.estop
    assert [event for event in bench.events if 'nobody' in str(event)] == []
    bench.wait(ends - 1e-6 - bench.now)
    assert not bench.session.estop
    bench.wait(2e-6)
    assert bench.session.estop


# -- by the angles alone --------------------------------------------------------------------------


NOW = 100.0
PERIOD, HOLD = 0.125, 0.5  # s; in floats their sums are exact

NO_ANGLE = Position(0, Status.ERROR, Status.ERROR)


def at(tenths: int) -> PositionLimit:
    """Return a type 01 with the unit so far to the right, in 0.1 degree."""
    rotation = Position(tenths, positive=Status.ON)
    return PositionLimit(
        rotation, Position(10, positive=Status.ON), (Status.OFF,) * 10, Status.OFF, Status.ON
    )


def turning(*places: int, motion: Motion | None = None, since: float = NOW) -> Motion:
    """Return one that was told these angles, in 0.1 degree, one each period."""
    motion = motion or Motion(Unit(0.3))
    for number, tenths in enumerate(places):
        motion.hear_angles(at(tenths), since + PERIOD * number)
    return motion


@pytest.mark.parametrize(
    ('places', 'began', 'moves'),
    [
        ((100, 105, 110), 1, True),  # steps of half a degree
        ((100, 104, 100, 104), None, False),  # noise
        ((100, 103, 106, 109, 112), 2, True),  # slow motion adds up to steps
        ((100, 900, 900), 1, False),  # a jump
    ],
)
def test_two_half_degrees_are_motion(
    places: tuple[int, ...], began: int | None, moves: bool
) -> None:
    motion = turning(*places)
    assert motion.began_at == (-math.inf if began is None else NOW + began * PERIOD)
    assert motion.moving(NOW + (len(places) - 1) * PERIOD) is moves


def test_angle_that_is_back_elsewhere_is_no_step() -> None:
    motion = turning(100)
    motion.hear_angles(replace(at(100), rotation=NO_ANGLE), NOW + 0.1)
    turning(200, 210, motion=motion, since=NOW + 0.2)
    assert not motion.moving(NOW + 0.2 + PERIOD)


def test_step_at_the_moment_at_which_it_stands_begins_anew() -> None:
    motion = turning(100, 110, 120)
    motion.hear_angles(at(130), motion.ends_at)
    assert motion.began_at == NOW + 2 * PERIOD + HOLD
    assert not motion.moving(motion.began_at)


def test_forgotten_motion_is_over_and_its_angle_begins_no_other() -> None:
    motion = turning(100, 110, 120)
    motion.forget_angles()
    assert (motion.began_at, motion.ends_at) == (-math.inf, -math.inf)
    assert not motion.moving(NOW + 2 * PERIOD)
    since = NOW + 3 * PERIOD
    turning(200, 210, motion=motion, since=since)
    assert not motion.moving(since + PERIOD)
    turning(220, motion=motion, since=since + 2 * PERIOD)
    assert motion.moving(since + 2 * PERIOD)


SWITCH_4, SWITCH_8 = 4, 8
AUTOMATIC: dict[str, Any] = {'automatic_motion': True}


def press(switch: int) -> tuple[BasicJoystick, ExtendedJoystick]:
    switches = tuple(Status(number == switch) for number in range(1, 13))
    return BasicJoystick(Axis.of(0), Axis.of(0), switches), ExtendedJoystick()


def set_off(bench: Loop, switch: int) -> Loop:
    """Press a switch for a moment; the unit moves by itself from then on."""
    bench.run(0.1)
    bench.ours.command = press(switch)
    bench.run(0.1)
    bench.ours.command = REST
    bench.run(1.0)
    assert bench.unit.motion.moving
    return bench


def switch_7(bench: Loop) -> list[bool]:
    """Tell of each joystick frame heard since the last run began whether it presses switch 7."""
    frames = [bytes.fromhex(text) for text in bench.of('0CFDD638')]
    return [frame == bytes.fromhex('0100010000000400') for frame in frames if frame]


PAUSES: dict[str, Any] = {**AUTOMATIC, 'button_switches': (SWITCH_4,), 'pause_on_stop': True}
UNTOLD = 'it oscillates though nobody asks it to'


@pytest.mark.parametrize(
    ('other', 'options', 'pressed'),
    [
        *((None, PAUSES, 10), (1033, PAUSES, 10), (1032, PAUSES, 0), (1052, PAUSES, 0)),
        (None, AUTOMATIC, 0),
    ],
)
def test_stop_pauses_an_oscillation_of_ours_where_no_other_unit_hears_it(
    other: int | None, options: dict[str, Any], pressed: int
) -> None:
    others = [Simulator(pin=f'{other}AE100801036', device_type=other)] if other else []
    bench = Loop(*others, device_pin=PIN, **options)
    bench.unit.apply('pausetold on')
    set_off(bench, SWITCH_4)
    bench.ours.stop = True
    bench.run(COAST + 0.3)
    assert sum(switch_7(bench)) == pressed  # in 0.2 s
    assert bench.unit.motion.moving is not bool(pressed)
    assert [UNTOLD in text for text in bench.reasons] == [True] * (not pressed)
    bench.ours.stop = False
    assert (bench.moved(2.0) == 0.0) is bool(pressed)  # what is paused does not resume by itself


@pytest.mark.parametrize('asks', ['stick x -1', 'switch 8 on'])
def test_motion_by_a_foreign_joystick_is_a_stop(asks: str) -> None:
    stick = JoystickSimulator(0x34)
    bench = Loop(stick, estop_on=frozenset({Cause.MOTION}))
    bench.unit.apply('position 1 175')
    stick.apply(asks)
    bench.run(COAST - 0.1)
    assert bench.reasons == []
    bench.run(2.0)
    assert 'nobody asks it to' in bench.reasons[0]


def test_oscillation_by_an_allowed_joystick_is_none_until_a_stop_that_cannot_end_it() -> None:
    stick = JoystickSimulator(0x33)
    bench = Loop(stick, allowed_joysticks=frozenset({0x33}))
    stick.apply('switch 8 on')
    bench.unit.apply('position 1 175')
    bench.run(0.5)
    stick.apply('switch 8 off')
    bench.run(2.0)
    assert bench.reasons == []
    bench.ours.stop = True
    bench.run(COAST + 0.3)
    assert 'nobody asks it to' in bench.reasons[0]


# -- SOE mode -------------------------------------------------------------------------------------


@pytest.mark.parametrize('switch', [SWITCH_4, SWITCH_8])
def test_stop_withdraws_the_permission_and_a_reset_does_not_give_it(switch: int) -> None:
    bench = Loop(soe_permissive=True, **AUTOMATIC)
    bench.unit.apply('soe on')
    bench.unit.apply('position 1 170')
    set_off(bench, switch)
    bench.ours.stop = True
    bench.wait(lambda: not bench.unit.motion.moving, 0.5)
    bench.run(2.0)
    assert bench.reasons == []
    bench.ours.stop = False
    assert bench.moved(2.0) == 0.0
    assert 'move the stick' in bench.session.warnings(bench.now)[0]
    bench.ours.command = MOVE
    assert bench.moved(1.0) != 0.0
    assert bench.session.warnings(bench.now) == []


# -- requests -------------------------------------------------------------------------------------


def presses(bench: Turning) -> list[float]:
    """Return when a stop presses switch 7, as seconds since its start."""
    start = bench.now
    bench.estop_in(True)
    bench.run(2 * COAST, REST, estop=True)
    return [at - start for at, frame in bench.sent if at >= start and frame.data == PAUSE]


def test_stop_pauses_an_oscillation_of_ours_once_by_its_first_type_81() -> None:
    bench = oscillating()
    pressed = presses(bench)
    assert 0.0 < pressed[0] <= SLOT
    assert 0.16 <= pressed[-1] - pressed[0] < 0.2
    assert of(PausePressed, bench.events) == [PausePressed()]
    assert bench.session.values(bench.now)['switch 7 pressed by stops'] == 1
    assert bench.joystick_frames()[-1] == NEUTRAL


# What may have paused or resumed it, or began it, beside our command.
OSCILLATING = 'says stands; find; 2 rest; 0.1 oscillate; turn; says oscillates; 1 rest; '
NOT_OURS = [
    *(
        f'{OSCILLATING}{script}'
        for script in (
            'stand; says stands; 0.2 rest; turn; says oscillates; 1 rest',  # by a hand
            'say stick; 2 rest',
            'say other',
            '0.02 move; 1 rest',
            '0.02 deploy; 1 rest',
            'close; wait 0.1; open; say unit',
            'lost; say unit',
            '0.5 rest gone',
            'stand; 1 rest',  # and oscillate, as it says
            'says stands; 0.02 rest stop; says oscillates',  # by the first type 81 of the stop
            'ask reset_controller',
        )
    ),
    # It did not begin with our command.
    'says oscillates; find; 2 rest; 0.1 oscillate; turn; 1 rest',
    'find; 2 rest; 0.1 oscillate; turn; says oscillates; 1 rest',
    'says stands; find; 2 rest; 0.1 oscillate; 1.1 rest; turn; says oscillates; 1 rest',
]


@pytest.mark.parametrize('script', NOT_OURS)
def test_oscillation_that_something_else_may_explain_is_not_paused(script: str) -> None:
    bench = Turning(allowed_joysticks=frozenset({0x33}), **PAUSES)
    bench.play(script)
    assert presses(bench) == []


def test_unit_that_tells_of_no_pause_is_believed_no_more() -> None:
    bench = oscillating()
    assert presses(bench)
    assert 'set pause_on_stop to false' in ''.join(bench.session.warnings(bench.now))
    bench.play('stand; says stands; 1 rest; 0.1 oscillate; turn; says oscillates; 1 rest')
    assert presses(bench) == []


@cache
def swinging() -> Loop:
    """Return a bus whose unit oscillates as we asked; no motion of it is a stop."""
    loop = Loop(estop_on=frozenset(Cause) - {Cause.MOTION}, **PAUSES)
    loop.unit.apply('pausetold on')
    for command in (REST, OSCILLATE, REST):
        loop.ours.command = command
        loop.run(0.2)
    assert loop.session.oscillation.is_ours
    return loop


HAND = st.sampled_from(['', '', '', 'pause on', 'pause off', 'physical 1 -0.5', 'physical 1 0'])
PLAYS = st.tuples(
    st.sampled_from(['rest', 'rest', 'rest', *COMMANDS]),
    st.sampled_from([False, False, False, True]),
    HAND,
    st.sampled_from([1, 2, 3, 15]),
)


@given(st.lists(PLAYS, min_size=3, max_size=6))
def test_whatever_a_hand_does_a_press_pauses(plays: list[tuple[str, bool, str, int]]) -> None:
    loop, last = deepcopy(swinging()), NEUTRAL
    for command, stop, hand, slots in [*plays, ('rest', True, '', 9), ('rest', False, '', 9)]:
        loop.ours.command, loop.ours.stop = COMMANDS[command], stop
        if hand:
            loop.unit.apply(hand)
        for _ in range(slots):
            paused = loop.unit.motion.paused
            loop.run(SLOT)
            frames = [bytes.fromhex(data) for data in loop.of(f'0CFDD6{OURS:02X}')]
            for frame in frames:
                assert not (frame == PAUSE != last and paused)
                last = frame


def test_parameter_that_can_press_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match='pause_on_stop needs 4 in button_switches'):
        Settings(automatic_motion=True, button_switches=(7,), pause_on_stop=True)
    with pytest.raises(ValueError, match='type 81, which a 6032 alone sends'):
        Settings(device_type=1052, **PAUSES)
    for kind in (0, 1032):
        Settings(device_type=kind, **PAUSES)


@pytest.mark.parametrize('kind', [1032, 1040, 1042, 1052])
def test_every_controller_moves_and_stops(kind: int) -> None:
    bench = Loop(unit={'device_type': kind}, device_type=kind).move()
    assert bench.moved(0.5) > 0.5
    bench.ours.stop = True
    bench.wait(lambda: not bench.unit.motion.moving, 1.0)
    assert abs(bench.moved(1.0)) < 0.01


def test_the_trap_between_two_manuals_is_sprung_and_told() -> None:
    vsc = CanSimulator()
    bench = Loop(vsc)
    vsc.apply('mode operational')
    vsc.apply('stick left_x 1')
    # The remote turns the unit past the mux, whatever we send ...
    assert bench.moved(1.0) > 1.0
    # ... and whoever asks the mux is told.
    assert bench.session.estop
    (reason,) = bench.reasons
    assert '0CFDD633' in reason or '0CFDD733' in reason
    assert "a FORT VSC's left joystick" in reason
    bench.ours.command = MOVE
    bench.run(0.2)
    assert not bench.session.drive.moving
