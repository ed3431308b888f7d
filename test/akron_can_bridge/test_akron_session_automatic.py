# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion of the unit that nobody asks for, by the moment: its stop, permission, and steps."""

from __future__ import annotations

from dataclasses import replace
import math
from typing import Any

import pytest

from akron_can_bridge.protocol import Position, PositionLimit, Status
from akron_can_bridge.session import Cause
from akron_can_bridge.session.motion import Motion
from akron_can_bridge.session.unit import Unit
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    COAST,
    DEPLOY,
    ef,
    joystick,
    MOVE,
    MOVING,
    OSCILLATES,
    permission,
    REST,
    SLOT,
    Turning,
    WATER,
)

STANDS = ef('81FED401C200')
AIMS = ef('83D051')  # Point Aim mode is active
ALLOWED = 0x33


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


def test_unit_that_begins_to_move_alone_has_as_long() -> None:
    bench = Turning().ready()
    bench.turns = True
    while not bench.session.motion.moving(bench.now):
        bench.run(SLOT, REST)
    ends = bench.session.motion.began_at + COAST
    bench.run(ends - SLOT - bench.now, REST)
    assert not bench.session.estop
    bench.run(2 * SLOT, REST)
    assert bench.session.estop


def test_water_asks_for_no_motion() -> None:
    bench = Turning().ready()
    bench.turns = True
    bench.run(COAST + 1.0, WATER)
    assert bench.session.estop


def test_motion_by_a_switch_is_asked_for_until_a_stop() -> None:
    bench = Turning(automatic_motion=True).ready()
    bench.turns = True
    bench.run(0.1, DEPLOY)
    bench.run(3.0, REST)
    assert not bench.session.estop
    bench.run(SLOT, REST, estop=True)
    bench.run(COAST - 2 * SLOT, REST)
    assert not bench.session.estop
    bench.run(3 * SLOT, REST)
    assert bench.session.estop


# -- the permission of SOE mode -------------------------------------------------------------------


@pytest.mark.parametrize('what', ['switch', 'aims', 'alone', 'oscillates'])
def test_stop_of_what_moves_by_itself_keeps_the_permission_until_the_stick_moves(
    what: str,
) -> None:
    bench = Turning(soe_permissive=True, automatic_motion=True).ready()
    bench.run(SLOT, MOVE)
    bench.run(COAST, REST)
    assert permission(bench) == 'A1000F'
    if what == 'switch':
        bench.run(0.1, DEPLOY)
        bench.run(0.1, REST)
    bench.turns = what == 'alone'
    bench.says = {'aims': [AIMS], 'oscillates': [OSCILLATES]}.get(what, [])
    bench.run(0.4, REST)
    assert permission(bench) == 'A1000F'
    bench.run(0.1, REST, estop=True)
    assert permission(bench) == 'A10000'
    bench.turns, bench.says = False, [STANDS]
    bench.run(1.0, REST)
    assert bench.session.inhibits(bench.now) == []
    assert permission(bench) == 'A10000'
    assert bench.session.demand.withheld
    bench.run(2 * SLOT, MOVE)
    assert bench.joystick_frames()[-1] == MOVING
    assert permission(bench) == 'A1000F'
    bench.run(0.2, REST)
    assert permission(bench) == 'A1000F'


def permitted(**options: Any) -> Bench:
    """Return one that has the permission, and for which a lost link is no stop."""
    causes = frozenset({Cause.FOREIGN_JOYSTICK})
    bench = Bench(soe_permissive=True, estop_on=causes, **options).find_unit()
    bench.run(0.1, REST)
    bench.run(0.1, MOVE)
    assert permission(bench) == 'A1000F'
    return bench


@pytest.mark.parametrize('said', [REST, MOVE], ids=['let go', 'held'])
def test_lost_link_takes_the_permission_until_the_stick_is_pushed_anew(said: Any) -> None:
    bench = permitted()
    bench.run(1.0, said, unit=False)
    assert not bench.session.estop
    assert permission(bench) == 'A10000'
    bench.take(ANNOUNCED)
    bench.run(0.2, said)
    assert bench.session.link_up
    assert permission(bench) == 'A10000'
    bench.run(2 * SLOT, REST)
    bench.run(2 * SLOT, MOVE)
    assert permission(bench) == 'A1000F'


def test_link_that_is_back_takes_the_permission_that_was_given_in_its_silence() -> None:
    bench = permitted()
    bench.run(1.0, REST, unit=False)
    bench.run(0.1, MOVE, unit=False)
    assert permission(bench) == 'A1000F'
    bench.take(ANNOUNCED)
    bench.run(0.2, MOVE)
    assert permission(bench) == 'A10000'


def test_joystick_held_through_a_lost_link_gives_no_permission() -> None:
    bench = permitted(allowed_joysticks=frozenset({ALLOWED}))
    bench.run(0.1, REST)
    held = joystick('107D046400000000')
    for unit in (False, True):
        for _ in range(25):
            bench.take(held)
            bench.run(SLOT, REST, unit=unit)
        assert permission(bench) == 'A10000'
    bench.take(joystick(), held)
    assert permission(bench) == 'A1000F'


@pytest.mark.parametrize('later', [0.0, 0.35, 2.0])
def test_motion_that_began_soon_after_a_push_is_not_resumed_either(later: float) -> None:
    bench = Turning(soe_permissive=True).ready()
    bench.run(0.1, MOVE)
    bench.turns = True
    bench.run(later, REST)
    bench.run(0.5, REST, estop=True)
    bench.run(0.5, REST)
    assert permission(bench) == 'A10000'
    assert bench.session.demand.withheld


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
def test_two_steps_of_half_a_degree_are_motion(
    places: tuple[int, ...], began: int | None, moves: bool
) -> None:
    motion = turning(*places)
    assert motion.began_at == (-math.inf if began is None else NOW + began * PERIOD)
    assert motion.moving(NOW + (len(places) - 1) * PERIOD) is moves


def test_steps_of_both_angles_in_one_message_are_one() -> None:
    motion = Motion(Unit(0.3))
    for number, tenths in enumerate((100, 110, 120)):
        up = Position(tenths, positive=Status.ON)
        motion.hear_angles(replace(at(tenths), elevation=up), NOW + PERIOD * number)
    assert motion.began_at == NOW + PERIOD


def test_unit_stands_half_a_second_after_its_last_step() -> None:
    motion = turning(100, 110, 120)
    stands = NOW + 2 * PERIOD + HOLD
    assert motion.ends_at == stands
    assert motion.moving(stands - 1e-6)
    assert not motion.moving(stands)


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
