# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether the unit moves, by its angles alone: what is a step, and when it stands again."""

from __future__ import annotations

from dataclasses import replace
import math

from akron_can_bridge.protocol import Position, PositionLimit, Status
from akron_can_bridge.session.motion import Motion
from akron_can_bridge.session.unit import Unit

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
        motion.take(at(tenths), since + PERIOD * number)
    return motion


def test_steps_of_half_a_degree_are_motion_and_smaller_ones_are_noise() -> None:
    assert turning(100, 105, 110).moving(NOW + 2 * PERIOD)
    assert not turning(100, 104, 100, 104).moving(NOW + 3 * PERIOD)


def test_slow_motion_adds_up_to_a_step() -> None:
    motion = turning(100, 103, 106, 109, 112)
    assert motion.began_at == NOW + 2 * PERIOD
    assert motion.moving(NOW + 4 * PERIOD)


def test_one_jump_is_no_motion() -> None:
    motion = turning(100, 900, 900)
    assert motion.began_at == NOW + PERIOD
    assert not motion.moving(NOW + 2 * PERIOD)


def test_steps_of_both_angles_in_one_message_are_one() -> None:
    motion = Motion(Unit(0.3))
    for number, tenths in enumerate((100, 110, 120)):
        up = Position(tenths, positive=Status.ON)
        motion.take(replace(at(tenths), elevation=up), NOW + PERIOD * number)
    assert motion.began_at == NOW + PERIOD


def test_unit_stands_half_a_second_after_its_last_step() -> None:
    motion = turning(100, 110, 120)
    stands = NOW + 2 * PERIOD + HOLD
    assert motion.ends_at == stands
    assert motion.moving(stands - 1e-6)
    assert not motion.moving(stands)


def test_angle_that_is_back_elsewhere_is_no_step() -> None:
    motion = turning(100)
    motion.take(replace(at(100), rotation=NO_ANGLE), NOW + 0.1)
    turning(200, 210, motion=motion, since=NOW + 0.2)
    assert not motion.moving(NOW + 0.2 + PERIOD)


def test_step_at_the_moment_at_which_it_stands_begins_anew() -> None:
    motion = turning(100, 110, 120)
    motion.take(at(130), motion.ends_at)
    assert motion.began_at == NOW + 2 * PERIOD + HOLD
    assert not motion.moving(motion.began_at)


def test_forgotten_motion_is_over_and_its_angle_begins_no_other() -> None:
    motion = turning(100, 110, 120)
    motion.forget()
    assert (motion.began_at, motion.ends_at) == (-math.inf, -math.inf)
    assert not motion.moving(NOW + 2 * PERIOD)
    since = NOW + 3 * PERIOD
    turning(200, 210, motion=motion, since=since)
    assert not motion.moving(since + PERIOD)
    turning(220, motion=motion, since=since + 2 * PERIOD)
    assert motion.moving(since + 2 * PERIOD)
