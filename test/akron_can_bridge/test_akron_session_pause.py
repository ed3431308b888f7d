# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""When a stop presses switch 7, pause and resume in one: for an oscillation of ours alone."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from typing import Any

from hypothesis import given, strategies as st
import pytest

from akron_can_bridge.parameters import Cause
from akron_can_bridge.session import PausePressed, Request, Settings
from stage.akron_loop_rig import Bench as Loop
from stage.akron_session_rig import (
    ANNOUNCED,
    COAST,
    DEPLOY,
    joystick,
    MOVE,
    NEUTRAL,
    of,
    OSCILLATE,
    OSCILLATES,
    oscillating,
    OTHER_ANNOUNCED,
    OURS,
    PAUSE,
    REST,
    SLOT,
    STANDS,
    Turning,
    WATER,
)
from stage.session_rig import SessionBench

ALLOWED = 0x33
OURS_TO_PAUSE: dict[str, Any] = {
    'automatic_motion': True,
    'button_switches': (4,),
    'pause_on_stop': True,
}
COMMANDS = {
    'rest': REST,
    'water': WATER,
    'move': MOVE,
    'oscillate': OSCILLATE,
    'deploy': DEPLOY,
}


def presses(bench: Turning, seconds: float = 2 * COAST) -> list[float]:
    """Return when a stop presses switch 7, as seconds since its start."""
    start = bench.now
    bench.estop_in(True)
    bench.run(seconds, REST, estop=True)
    return [at - start for at, frame in bench.sent if at >= start and frame.data == PAUSE]


def test_stop_pauses_an_oscillation_of_ours_once_by_its_first_type_81() -> None:
    bench = oscillating()
    pressed = presses(bench)
    assert 0.0 < pressed[0] <= SLOT
    assert 0.16 <= pressed[-1] - pressed[0] < 0.2
    assert of(PausePressed, bench.events) == [PausePressed()]
    assert bench.session.values(bench.now)['switch 7 pressed by stops'] == 1
    assert bench.joystick_frames()[-1] == NEUTRAL


def test_by_default_no_stop_presses_it() -> None:
    bench = oscillating(pause_on_stop=False)
    assert presses(bench) == []
    assert 'it oscillates though nobody asks it to' in bench.session.stop_reasons(bench.now)[0]


@pytest.mark.parametrize('stop', [False, True])
def test_farewell_never_presses_it(stop: bool) -> None:
    bench = oscillating()
    bench.estop_in(stop)
    assert {frame.data for frame in bench.session.farewell(bench.now)} == {NEUTRAL}


# -- what else explains it, or may have paused it -------------------------------------------------


def by_a_hand_too(bench: Turning) -> None:
    """Have it pause and resume by the unit's own switches."""
    bench.turns, bench.says = False, [STANDS]
    bench.run(0.2, REST)
    bench.turns, bench.says = True, [OSCILLATES]
    bench.run(COAST, REST)


def by_a_joystick_too(bench: Turning) -> None:
    bench.take(joystick(source=ALLOWED))
    bench.run(2 * COAST, REST)


def beside_another_unit(bench: Turning) -> None:
    bench.take(OTHER_ANNOUNCED)


def pushed(command: Any) -> Callable[[Turning], None]:
    """Return what pushes, and goes on oscillating."""

    def push(bench: Turning) -> None:
        bench.run(SLOT, command)
        bench.run(COAST, REST)

    return push


def closed(bench: Turning) -> None:
    bench.close()
    bench.wait(0.1)
    SessionBench.open(bench)
    bench.take(ANNOUNCED)


def interrupted(bench: Turning) -> None:
    bench.session.interrupted('messages were lost', bench.now)
    bench.take(ANNOUNCED)


def silent(bench: Turning) -> None:
    bench.run(0.5, REST, unit=False)


def standing(bench: Turning) -> None:
    """Stand, and say "oscillating" all along."""
    bench.turns = False
    bench.run(COAST, REST)


@pytest.mark.parametrize(
    'happens',
    [
        *(by_a_hand_too, by_a_joystick_too, beside_another_unit, pushed(MOVE), pushed(DEPLOY)),
        *(closed, interrupted, silent, standing),
    ],
)
def test_oscillation_that_something_else_may_explain_is_not_paused(
    happens: Callable[[Turning], None],
) -> None:
    bench = oscillating(allowed_joysticks=frozenset({ALLOWED}))
    happens(bench)
    assert presses(bench) == []


def test_water_explains_no_oscillation() -> None:
    bench = oscillating()
    bench.run(0.1, WATER)
    assert presses(bench)


@pytest.mark.parametrize(
    ('said', 'late'), [([OSCILLATES], 0.0), ([], 0.0), ([STANDS], 1.1 * COAST)]
)
def test_oscillation_that_did_not_begin_with_our_command_is_not_ours(
    said: list[Any], late: float
) -> None:
    bench = Turning(**OURS_TO_PAUSE)
    bench.says = said
    bench.ready()
    bench.run(0.1, OSCILLATE)
    bench.run(late, REST)
    bench.turns, bench.says = True, [OSCILLATES]
    bench.run(COAST, REST)
    assert presses(bench) == []


def test_stop_whose_first_type_81_says_no_oscillation_has_it_pressed_no_more() -> None:
    bench = oscillating()
    bench.says = [STANDS]
    bench.run(SLOT, REST, estop=True)
    bench.says = [OSCILLATES]
    assert presses(bench) == []


def test_reset_that_is_under_way_is_no_time_to_press_it() -> None:
    bench = oscillating()
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    assert presses(bench) == []


# -- once, and the next one -----------------------------------------------------------------------


def test_each_stop_presses_it_where_we_began_to_oscillate_again() -> None:
    bench = oscillating()
    for _ in range(2):
        assert presses(bench, 0.3)
        bench.turns, bench.says = False, [STANDS]
        bench.run(COAST, REST)
        bench.run(0.1, OSCILLATE)
        bench.turns, bench.says = True, [OSCILLATES]
        bench.run(COAST, REST)
    assert not bench.session.oscillation.is_doubted


def test_unit_that_tells_of_no_pause_is_believed_no_more() -> None:
    bench = oscillating()
    assert presses(bench)
    assert 'set pause_on_stop to false' in ''.join(bench.session.warnings(bench.now))
    bench.turns, bench.says = False, [STANDS]
    bench.run(COAST, REST)
    bench.run(0.1, OSCILLATE)
    bench.turns, bench.says = True, [OSCILLATES]
    bench.run(COAST, REST)
    assert presses(bench) == []


def test_stop_that_comes_again_at_once_does_not_press_it_again() -> None:
    bench = oscillating()
    assert presses(bench, 0.1)
    bench.run(0.1, REST)
    start = bench.now + 0.1  # the press goes on for as long
    presses(bench)
    assert bench.all_neutral(start)


@cache
def swinging() -> Loop:
    """Return a bus whose unit oscillates as we asked; no motion of it is a stop."""
    loop = Loop(estop_on=frozenset(Cause) - {Cause.MOTION}, **OURS_TO_PAUSE)
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
def test_whatever_a_hand_does_a_press_pauses_what_runs(
    plays: list[tuple[str, bool, str, int]],
) -> None:
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
        Settings(device_type=1052, **OURS_TO_PAUSE)
    for kind in (0, 1032):
        Settings(device_type=kind, **OURS_TO_PAUSE)
