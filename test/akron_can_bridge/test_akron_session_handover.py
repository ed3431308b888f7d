# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an Akron session is told of the one before, and tells the next; and the one at rest."""

from __future__ import annotations

import pytest

from akron_can_bridge.session import Handover, HandoverWanted, Request, Resting, Settings
from bridge_core.session import Level
from stage.akron_session_rig import (
    ANNOUNCED,
    moved,
    NEUTRAL,
    of,
    OTHER_ANNOUNCED,
    OTHER_PIN,
    OURS,
    OUTPUTS,
    PIN,
    SLOT,
    Turning,
)
from stage.session_rig import SessionBench


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


ASKS: list[tuple[str, int, list[bool]]] = [
    # What happens; how often it asks after the mark; whether it tells last of setup mode.
    ('mark; open', 1, []),
    ('open; mark; 1 rest', 0, []),
    ('open; mark; close', 0, []),
    ('open; close; mark; open', 1, []),
    ('open; mark; lost', 1, []),  # the question may be among what was lost
    ('open; mark; told', 0, [False]),
    ('open; lost; told; mark; say unit outputs well; 0.5 rest', 0, [False]),
    # What it told may be lost as well.
    ('find; say setup; mark; lost', 0, [True]),
    ('find; say setup; mark; close; open', 0, [True]),
]


@pytest.mark.parametrize(('script', 'asked', 'in_setup'), ASKS)
def test_session_asks_until_it_was_told_and_tells_nothing_before(
    script: str, asked: int, in_setup: list[bool]
) -> None:
    bench = Turning().play(script)
    assert len(of(HandoverWanted, bench.events)) == asked
    assert [told.in_setup for told in of(Handover, bench.events)][-1:] == in_setup


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
