# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an Akron session is told of the one before, and tells the next; and the one at rest."""

from __future__ import annotations

from typing import Any

import pytest

from akron_can_bridge.session import Handover, HandoverWanted, Request, Resting, Settings
from bridge_core.session import Level
from stage.akron_session_rig import (
    ANNOUNCED,
    ef,
    MOVE,
    moved,
    MOVING,
    NEUTRAL,
    NO_FAULTS,
    of,
    OTHER_ANNOUNCED,
    OTHER_PIN,
    OURS,
    OUTPUTS,
    permission,
    PIN,
    REST,
    SLOT,
    Turning,
)
from stage.session_rig import SessionBench

ALLOWED = 0x33


@pytest.mark.parametrize('late', [False, True])
@pytest.mark.parametrize(('lost', 'followed'), [(True, PIN), (False, OTHER_PIN)])
def test_wire_after_one_that_died_follows_the_same_unit(
    late: bool, lost: bool, followed: str
) -> None:
    bench = Turning(soe_permissive=True)
    bench.open()
    if late:  # the request comes after the first answer
        bench.take(OTHER_ANNOUNCED)
    bench.session.take_over(Handover(pin=PIN), lost, bench.now)
    bench.take(OTHER_ANNOUNCED, ANNOUNCED)
    assert bench.session.finder.name == followed
    assert bench.session.finder.rivals() == [OTHER_PIN if followed == PIN else PIN]


@pytest.mark.parametrize('lost', [True, False])
def test_unit_of_another_wire_that_was_found_is_forgotten(lost: bool) -> None:
    bench = Turning().ready()
    bench.session.take_over(Handover(pin=OTHER_PIN), lost, bench.now)
    bench.poll()
    assert bench.session.estop is lost
    asked = [data.hex() for data in bench.frames(0x18EAFF00 | OURS, bench.now)]
    assert asked == ['00ee00'] * lost


def test_node_knows_of_setup_mode_before_the_unit_does() -> None:
    bench = Turning().ready()
    bench.events.clear()
    start = bench.now
    bench.session.request(Request.ENTER_SETUP, bench.now)
    bench.poll()
    assert of(Handover, bench.events)[-1].in_setup
    assert bench.asked(start) == []
    bench.wait(SLOT)
    assert bench.asked(start) == ['46']


def test_session_that_was_told_nothing_yet_tells_nothing_and_permits_nothing() -> None:
    bench = Turning(soe_permissive=True, device_pin=PIN)
    SessionBench.open(bench)
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    bench.run(0.5, REST)
    assert not bench.session.estop
    assert permission(bench) == 'A10000'
    assert of(Handover, bench.events) == []
    bench.run(0.1, MOVE)
    assert bench.all_neutral(0.0)
    bench.session.take_over(None, False, bench.now)
    bench.run(0.1, REST)
    assert of(Handover, bench.events) == [Handover(pin=PIN)]
    bench.run(0.1, MOVE)
    assert permission(bench) == 'A1000F'


def test_permission_after_another_session_takes_a_push_of_the_stick_once() -> None:
    bench = Turning(soe_permissive=True)
    bench.ready(Handover())
    assert permission(bench) == 'A10000'
    bench.run(0.1, MOVE)
    assert permission(bench) == 'A1000F'
    start = bench.now
    bench.session.take_over(Handover(), False, bench.now)
    bench.run(0.1, MOVE)
    assert set(bench.joystick_frames(start)) == {MOVING}
    assert permission(bench) == 'A1000F'
    bench.run(0.1, REST, estop=True)
    bench.session.take_over(Handover(), True, bench.now)
    bench.run(0.1, REST)
    assert permission(bench) == 'A10000'


# -- asking for it --------------------------------------------------------------------------------


def wanted(bench: SessionBench[Any], events: list[Any]) -> int:
    """Count how often these ask for it, and forget all that was told."""
    bench.events.clear()
    return len(of(HandoverWanted, events))


def test_session_asks_for_it_until_it_was_told_and_tells_nothing_before() -> None:
    bench = Turning()
    assert wanted(bench, SessionBench.open(bench)) == 1
    assert wanted(bench, bench.run(1.0, REST)) == 0
    assert wanted(bench, bench.close()) == 0
    assert wanted(bench, SessionBench.open(bench)) == 1
    bench.session.take_over(None, False, bench.now)
    told = bench.poll()
    assert of(Handover, told) == [Handover()]
    assert wanted(bench, told) == 0


def test_session_asks_again_where_the_question_may_be_lost_and_moves_the_unit_then() -> None:
    bench = Turning()
    SessionBench.open(bench)
    bench.events.clear()
    bench.session.interrupted('the node did not take what its wire had to tell', bench.now)
    assert wanted(bench, bench.poll()) == 1
    bench.session.take_over(None, False, bench.now)
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    bench.run(0.5, REST)
    bench.run(0.1, MOVE)
    assert bench.joystick_frames()[-1] == MOVING


def test_session_that_was_told_asks_no_more_but_tells_again_what_may_be_lost() -> None:
    bench = Turning().ready()
    bench.take(ef('46', destination=OURS))
    bench.events.clear()
    bench.session.interrupted('messages were lost', bench.now)
    told = bench.poll()
    assert of(Handover, told)[-1].in_setup
    told += bench.close()
    told += SessionBench.open(bench)
    assert wanted(bench, told) == 0


# -- a node that is not active --------------------------------------------------------------------


def test_resting_session_is_a_stop_says_neutral_in_every_slot_and_hears_nothing() -> None:
    bench = SessionBench(Resting(Settings(device_pin=PIN)))
    assert (Level.ERROR, 'the node is not active') in bench.session.problems(bench.now)
    bench.open()
    assert bench.take(ANNOUNCED, OUTPUTS, moved(ANNOUNCED, OURS)) == []
    bench.wait(1.0)
    assert {frame.data for _, frame in bench.sent} == {NEUTRAL}
    assert {frame.identifier for _, frame in bench.sent} == {0x0CFDD600 | OURS}
    assert abs(len(bench.sent) - 1.0 / SLOT) <= 1
    assert bench.session.finder.unit is None
    bench.close()  # what is known outlives it
    assert not [each for each in bench.events if isinstance(each, Handover | HandoverWanted)]
