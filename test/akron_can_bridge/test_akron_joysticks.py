# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the Akron session keeps of other joysticks, and for how long."""

from __future__ import annotations

import math
from typing import Any

import pytest

from akron_can_bridge.protocol import (
    Axis,
    BasicJoystick,
    ExtendedJoystick,
    JOYSTICK_TIMEOUT,
    Status,
)
from akron_can_bridge.session import Settings
from akron_can_bridge.session.events import Sticks
from akron_can_bridge.session.joysticks import Joysticks
from stage.akron_session_rig import joystick

NOW = 100.0
OTHER = 0x33
RIGHT = BasicJoystick(Axis.of(500), Axis.of(0))
CENTRED = BasicJoystick(Axis.of(0), Axis.of(0))
GRIP = ExtendedJoystick(grip_x=Axis.of(250))
BROKEN = BasicJoystick(Axis(0, Status.ERROR), Axis.of(0))


def heard(*messages: Any) -> Joysticks:
    """Return what has heard one joystick, which is published as ``~/joy``."""
    joysticks = Joysticks(Settings(joy_source=OTHER))
    joysticks.hear(joystick(), OTHER, NOW)
    for message in messages:
        joysticks.take(message, OTHER, NOW)
    return joysticks


def test_forgotten_joystick_is_not_there_and_moves_nothing() -> None:
    joysticks = heard(RIGHT)
    assert (joysticks.foreign(NOW), joysticks.moving(NOW)) == ([OTHER], [OTHER])
    joysticks.forget()
    assert (joysticks.foreign(NOW), joysticks.moving(NOW)) == ([], [])


def test_forgotten_joystick_that_is_held_does_not_count_until_it_was_let_go_of() -> None:
    joysticks = Joysticks(Settings(allowed_joysticks=frozenset({OTHER})))
    for message in (CENTRED, RIGHT):
        joysticks.take(message, OTHER, NOW)
    assert joysticks.pushes(NOW)
    joysticks.forget()
    joysticks.take(RIGHT, OTHER, NOW)
    assert not joysticks.pushes(NOW)


def test_grip_of_before_is_none_of_after() -> None:
    joysticks = heard(GRIP)
    (sticks,) = joysticks.take(CENTRED, OTHER, NOW)
    assert sticks.axes[2] == 250
    joysticks.forget()
    (sticks,) = joysticks.take(CENTRED, OTHER, NOW)
    assert sticks.axes[2] == 0


def test_fault_of_a_joystick_is_forgotten_with_it_and_with_its_silence() -> None:
    joysticks = heard(BROKEN)
    assert joysticks.faulty
    joysticks.forget()
    assert joysticks.faulty == ()
    joysticks.take(BROKEN, OTHER, NOW)
    assert joysticks.expire(NOW + JOYSTICK_TIMEOUT, stopped=True) == [
        Sticks((0, 0, 0, 0, 0), (False,) * 16, ())
    ]
    assert joysticks.faulty == ()
    assert joysticks.expire(NOW + JOYSTICK_TIMEOUT, stopped=True) == []


@pytest.mark.parametrize('source', [0x32, 0x39])
def test_sender_that_no_unit_obeys_asks_for_nothing(source: int) -> None:
    joysticks = Joysticks(Settings())
    for message in (RIGHT, GRIP):
        assert joysticks.take(message, source, NOW) == []
    assert joysticks.moving(NOW) == []
    assert joysticks.asked_until < NOW
    assert not joysticks.automatic_asked


@pytest.mark.parametrize('allowed', [False, True])
def test_motion_is_asked_for_by_an_allowed_joystick_alone(allowed: bool) -> None:
    joysticks = Joysticks(Settings(allowed_joysticks=frozenset({OTHER} if allowed else ())))
    for message in (RIGHT, GRIP):
        joysticks.take(message, OTHER, NOW)
    assert joysticks.automatic_asked is allowed
    assert joysticks.asked_until == (NOW + JOYSTICK_TIMEOUT if allowed else -math.inf)


def test_only_what_looks_like_a_vsc_is_called_one() -> None:
    joysticks = heard()
    assert 'list it in allowed_joysticks' in joysticks.describe([OTHER])
    joysticks.hear(joystick('01000100FF00FFFF'), OTHER, NOW)
    assert 'by identifier and bytes this is a FORT VSC' in joysticks.describe([OTHER])
    other = 0x34
    joysticks.hear(joystick('01000100FF00FFFF', other), other, NOW)
    assert 'list it in allowed_joysticks' in joysticks.describe([other])
