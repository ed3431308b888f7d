# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One contract for all six sessions, with their wire: silence, a closed port, a freeze, a busy line.

What each session hears, and what is asked of it, is that of test_session_order and _quiet.
"""

from __future__ import annotations

import math
from typing import Any

from hypothesis import given, settings as hypothesis_settings, strategies as st

from bridge_core.session import INTERRUPTION_TIME, Session
from stage.session_rig import tell_sent
from test.bridge_core.test_session_order import begun, every_session, feed, PLAYS, START, stops
from test.bridge_core.test_session_quiet import ASKED


def healthy(name: str) -> Session[Any, Any, Any]:
    session, _ = begun(PLAYS[name], [])
    return session


def hear(session: Session[Any, Any, Any], name: str, now: float) -> list[Any]:
    """Have the device say that all is well; return events."""
    return feed(session, PLAYS[name].number(PLAYS[name].healthy), now)


def poll(session: Session[Any, Any, Any], now: float) -> list[Any]:
    """Poll on a line that takes everything; return what was sent."""
    frames = session.poll(now)[1]
    tell_sent(session, frames, now)
    return list(frames)


@every_session
def test_silence_is_a_stop_at_its_deadline_and_not_before(name: str) -> None:
    session, now = healthy(name), START
    for _ in range(1000):
        if session.estop:
            break
        assert session.link_up
        now = session.deadline()
        poll(session, now)
    assert session.estop
    assert not session.link_up
    assert session.stop_reasons(now)
    assert now <= START + 1.0  # no link_timeout of ours is longer


@every_session
def test_closed_port_is_a_stop_and_nothing_is_heard_or_due(name: str) -> None:
    session = healthy(name)
    assert stops(session.closed(START)) == [(True, True, False)]
    assert session.deadline() == math.inf
    assert hear(session, name, START) == []
    assert session.poll(START) == ([], [])
    assert session.closed(START) == [] or not stops(session.closed(START))


@every_session
def test_opened_again_it_begins_stopped_and_with_nothing_heard_before(name: str) -> None:
    session = healthy(name)
    session.closed(START)
    session.opened(START)
    assert session.estop
    assert not session.link_up
    assert session.frame_age(START) == math.inf
    session, _ = begun(PLAYS[name], [])  # and as from new it can be well
    assert not session.estop


@every_session
def test_freeze_is_a_stop_with_its_reason_for_a_while_whatever_is_heard(name: str) -> None:
    session = healthy(name)
    session.interrupted('held up', START)
    session.poll(START)
    now, end = START, START + INTERRUPTION_TIME
    while now < end:
        assert session.estop
        assert session.stop_reasons(now) == ['held up']
        hear(session, name, now)
        now += INTERRUPTION_TIME / 8


@every_session
@hypothesis_settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_frame_that_a_busy_line_does_not_take_is_offered_again(
    name: str, data: st.DataObject
) -> None:
    """Nothing counts as sent before the wire has said so: to offer frames changes nothing."""
    session, now = healthy(name), START
    asked = st.sampled_from([None, *ASKED[name]])
    for _ in range(data.draw(st.integers(1, 8))):
        now += data.draw(st.sampled_from([0.0, 0.001, 0.01, 0.04]))
        ask = data.draw(asked)
        if ask is not None:
            try:
                ask(session, now)
            except ValueError:
                session.poll(now)
        frames = session.poll(now)[1]
        events, again = session.poll(now)
        assert again == frames
        assert events == []
        if data.draw(st.booleans()):
            tell_sent(session, again, now)
            assert len(session.poll(now)[1]) <= len(frames)


@every_session
def test_farewell_on_a_line_that_takes_all_or_nothing_leaves_a_session_to_close(name: str) -> None:
    for takes in (True, False):
        session = healthy(name)
        for frame in session.farewell(START):
            if takes:
                session.sent(frame, START)
        assert stops(session.closed(START))[-1] == (True, True, False)
