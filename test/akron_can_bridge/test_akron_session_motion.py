# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion that a neutral stick does not end: what a stop does to it, and who is told."""

from __future__ import annotations

from typing import Any

import pytest

from akron_can_bridge.protocol import Axis, BasicJoystick, ExtendedJoystick, Status
from akron_can_bridge.session import Cause, Request
from akron_can_bridge.simulator import JoystickSimulator, Simulator
from stage.akron_loop_rig import Bench
from stage.akron_session_rig import MOVE, PIN, REST

COAST = 1.0
ALLOWED = 0x33
OSCILLATE, PAUSE, DEPLOY, STOW = 4, 7, 8, 9
AUTOMATIC: dict[str, Any] = {'automatic_motion': True}


def press(switch: int) -> tuple[BasicJoystick, ExtendedJoystick]:
    switches = tuple(Status(number == switch) for number in range(1, 13))
    return BasicJoystick(Axis.of(0), Axis.of(0), switches), ExtendedJoystick()


def start(bench: Bench, switch: int) -> Bench:
    """Press a switch for a moment; the unit moves by itself from then on."""
    bench.run(0.1)
    bench.ours.command = press(switch)
    bench.run(0.1)
    bench.ours.command = REST
    bench.run(1.0)
    assert bench.unit.motion.moving
    return bench


def switch_7(bench: Bench) -> list[bool]:
    """Tell of each joystick frame heard since the last run began whether it presses switch 7."""
    frames = [bytes.fromhex(text) for text in bench.of('0CFDD638')]
    return [frame == bytes.fromhex('0100010000000400') for frame in frames if frame]


PAUSES: dict[str, Any] = {**AUTOMATIC, 'button_switches': (OSCILLATE,), 'pause_on_stop': True}
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
    bench = Bench(*others, device_pin=PIN, **options)
    bench.unit.apply('pausetold on')
    start(bench, OSCILLATE)
    bench.ours.stop = True
    bench.run(COAST + 0.3)
    assert sum(switch_7(bench)) == pressed  # in 0.2 s
    assert bench.unit.motion.moving is not bool(pressed)
    assert [UNTOLD in text for text in bench.reasons] == [True] * (not pressed)
    bench.ours.stop = False
    assert (bench.moved(2.0) == 0.0) is bool(pressed)  # what is paused does not resume by itself


@pytest.mark.parametrize('told', ['on', 'off'])
@pytest.mark.parametrize('axis', [1, 2])
@pytest.mark.parametrize('options', [AUTOMATIC, PAUSES])
def test_hand_that_moves_a_unit_whose_oscillation_is_paused_has_none_resumed(
    told: str, axis: int, options: dict[str, Any]
) -> None:
    bench = Bench(**options)
    for line in (f'pausetold {told}', 'oscillate on', 'pause on', f'physical {axis} 0.3'):
        bench.unit.apply(line)
    bench.run(1.5)
    bench.ours.stop = True
    bench.run(3.0)
    assert sum(switch_7(bench)) == 0
    bench.unit.apply(f'physical {axis} 0')
    assert bench.moved(1.0) == 0.0


@pytest.mark.parametrize('switch', [DEPLOY, STOW])
def test_journey_that_goes_on_through_a_stop_is_a_stop_of_the_unit(switch: int) -> None:
    bench = Bench(**AUTOMATIC)
    bench.unit.apply('position 1 170')
    start(bench, switch)
    assert bench.reasons == []  # it was asked for
    bench.ours.stop = True
    bench.run(COAST - 0.2)
    assert bench.reasons == []
    assert bench.unit.motion.moving
    bench.run(0.4)
    assert 'it moves though nobody asks it to' in bench.reasons[0]
    bench.wait(lambda: not bench.unit.motion.moving, 10.0)
    bench.run(1.0)
    assert bench.reasons == []


def test_motion_by_an_allowed_joystick_is_no_stop() -> None:
    stick = JoystickSimulator(0x33)
    bench = Bench(stick, allowed_joysticks=frozenset({0x33}))
    stick.apply('stick x -1')
    bench.run(3.0)
    assert bench.unit.motion.moving
    assert bench.reasons == []


@pytest.mark.parametrize('asks', ['stick x -1', 'switch 8 on'])
def test_motion_by_a_foreign_joystick_is_a_stop(asks: str) -> None:
    stick = JoystickSimulator(0x34)
    bench = Bench(stick, estop_on=frozenset({Cause.MOTION}))
    bench.unit.apply('position 1 175')
    stick.apply(asks)
    bench.run(COAST - 0.1)
    assert bench.reasons == []
    bench.run(2.0)
    assert 'nobody asks it to' in bench.reasons[0]


def test_oscillation_by_an_allowed_joystick_is_none_until_a_stop_that_cannot_end_it() -> None:
    stick = JoystickSimulator(0x33)
    bench = Bench(stick, allowed_joysticks=frozenset({0x33}))
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


@pytest.mark.parametrize('switch', [OSCILLATE, DEPLOY])
def test_stop_withdraws_the_permission_and_a_reset_alone_does_not_give_it_back(
    switch: int,
) -> None:
    bench = Bench(soe_permissive=True, **AUTOMATIC)
    bench.unit.apply('soe on')
    bench.unit.apply('position 1 170')
    start(bench, switch)
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


def test_setup_mode_keeps_the_frames_neutral_until_a_reset() -> None:
    bench = Bench()
    bench.session.request(Request.ENTER_SETUP, bench.now)
    bench.wait(lambda: bench.unit.motion.setup)
    bench.ours.command = REST
    bench.run(0.2)
    bench.ours.command = MOVE
    bench.run(3.0)
    assert not bench.session.drive.moving
    assert 'the unit is in setup mode' in bench.session.inhibits(bench.now)[0]
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.wait(lambda: bench.session.estop)
    bench.wait(lambda: not bench.session.estop)
    bench.move()
