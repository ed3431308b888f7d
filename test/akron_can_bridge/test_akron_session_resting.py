# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a node sends that is not active: neutral frames at its pace, whatever it hears."""

from __future__ import annotations

from akron_can_bridge.session import Handover, HandoverWanted, Resting, Settings
from bridge_core.session import Level
from stage.akron_session_rig import ANNOUNCED, moved, NEUTRAL, OURS, OUTPUTS, PIN, SLOT
from stage.session_rig import SessionBench


def resting() -> SessionBench[Resting]:
    return SessionBench(Resting(Settings()))


def test_it_says_neutral_in_every_slot_and_nothing_else() -> None:
    bench = resting()
    bench.open()
    bench.wait(1.0)
    assert {frame.data for _, frame in bench.sent} == {NEUTRAL}
    assert {frame.identifier for _, frame in bench.sent} == {0x0CFDD600 | OURS}
    assert abs(len(bench.sent) - 1.0 / SLOT) <= 1


def test_it_hears_nothing() -> None:
    bench = resting()
    bench.open()
    sent = len(bench.sent)
    assert bench.take(ANNOUNCED, OUTPUTS, moved(ANNOUNCED, OURS)) == []
    assert len(bench.sent) == sent
    assert bench.session.finder.unit is None


def test_it_hands_nothing_over_and_asks_for_nothing_so_that_what_is_known_outlives_it() -> None:
    bench = SessionBench(Resting(Settings(device_pin=PIN)))
    bench.open()
    bench.wait(1.0)
    bench.close()
    assert not [each for each in bench.events if isinstance(each, Handover | HandoverWanted)]


def test_it_is_a_stop_with_its_reason() -> None:
    bench = resting()
    assert (Level.ERROR, 'the node is not active') in bench.session.problems(bench.now)
