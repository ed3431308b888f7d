# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What sessions share: verdicts, neutral sticks, pacing, the end of a connection."""

import math

from hypothesis import given, strategies as st
import pytest

from bridge_core.session import HeldButtons, Pacer, StickStream, Verdict
from esi_drive_bridge.session import Session as DriveSession
from stage.esi_drive_rig import IDLE, make_settings


def test_verdicts_that_differ_in_words_only_are_equal() -> None:
    assert Verdict.stop('heard 250 ms ago') == Verdict.stop('heard 260 ms ago')
    assert Verdict.stop('a') != Verdict.stop('a', link_up=False)
    assert Verdict.stop('a') != Verdict(estop=True, own_estop=False, reasons=('a',))


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans())))
def test_exactly_one_neutral_follows_sticks_that_do_not_hold_any_more(
    steps: list[tuple[bool, bool, bool]],
) -> None:
    """The last published event is never motion from sticks that are stale or do not count."""
    stream, published = StickStream(), []
    for publish, fresh, counts in steps:
        if stream.owes_neutral(fresh=fresh, counts=counts):
            published.append('neutral')
            assert not stream.owes_neutral(fresh=fresh, counts=counts)
        assert (published or ['neutral'])[-1] == 'neutral' or (fresh and counts)
        if publish and fresh:
            stream.published(counts=counts)
            published.append('motion' if counts else 'neutral')


def test_lost_stream_owes_one_neutral_though_its_last_was_neutral() -> None:
    stream = StickStream()
    stream.published(counts=False)
    assert not stream.owes_neutral(fresh=True, counts=False)
    assert stream.owes_neutral(fresh=False, counts=False)
    assert not stream.owes_neutral(fresh=False, counts=False)


def test_button_held_while_nothing_counted_counts_once_it_was_let_go_of() -> None:
    buttons = HeldButtons(0.25)
    assert buttons.of((1, 0, -1), 1.0) == (1, 0, -1)
    buttons.miss(1.1, stopped=False)
    buttons.miss(2.0, stopped=False)
    assert buttons.of((1, 1, -1), 2.1) == (0, 1, 0)
    buttons.miss(2.2, stopped=False)
    assert buttons.of((1, 1, 0), 3.0) == (0, 0, 0)
    assert buttons.of((0, 1, -1), 3.1) == (0, 0, -1)
    assert buttons.of((1, 0, -1), 3.2) == (1, 0, -1)
    assert buttons.of((1, 1, -1), 3.3) == (1, 1, -1)


@pytest.mark.parametrize(('gap', 'counts'), [(0.25, 0), (0.26, 1)])
def test_button_that_went_just_before_was_held(gap: float, counts: int) -> None:
    buttons = HeldButtons(0.25)
    buttons.of((1,), 0.0)
    buttons.of((0,), 1.0)
    buttons.of((0,), 1.01)
    buttons.miss(1.0 + gap, stopped=False)
    assert buttons.of((1,), 2.0) == (counts,)


@pytest.mark.parametrize(('pauses', 'counts'), [((False, True), 1), ((True, False), 0)])
def test_button_held_through_a_stop_counts_unless_a_pause_follows(
    pauses: tuple[bool, bool], counts: int
) -> None:
    """In the pause nobody sees that it is held, and the mux may be reset."""
    buttons = HeldButtons(0.25)
    buttons.of((1, 0), 1.0)
    for at, stopped in zip((1.1, 2.0), pauses, strict=True):
        buttons.miss(at, stopped=stopped)
    assert buttons.of((1, 0), 3.0) == (counts, 0)
    assert buttons.of((0, 0), 3.1) == (0, 0)
    assert buttons.of((1, 0), 3.2) == (1, 0)


def test_button_that_was_pressed_when_it_was_seen_last_is_held_however_long_ago() -> None:
    buttons = HeldButtons(0.25)
    buttons.of((1, 0), 1.0)
    buttons.miss(60.0, stopped=True)
    buttons.miss(60.1, stopped=False)
    assert buttons.of((1, 1), 60.2) == (0, 1)


@pytest.mark.parametrize(('pauses', 'counts'), [((), 1), ((True,), 1), ((True, False), 0)])
def test_button_that_nobody_has_seen_is_held_where_a_pause_comes_first(
    pauses: tuple[bool, ...], counts: int
) -> None:
    buttons = HeldButtons(0.25, unseen=2)
    for at, stopped in enumerate(pauses):
        buttons.miss(at, stopped=stopped)
    assert buttons.of((1, 0), 3.0) == (counts, 0)
    assert buttons.of((0, 1), 3.1) == (0, 1)
    assert buttons.of((1, 1), 3.2) == (1, 1)
    buttons.of((0, 0), 4.0)
    for at, stopped in enumerate(pauses, 5):
        buttons.miss(at, stopped=stopped)
    assert buttons.of((1, 0), 8.0) == (counts, 0)


def test_button_of_a_device_that_shows_it_all_the_time_is_not_held_unseen() -> None:
    buttons = HeldButtons(0.25)
    buttons.miss(1.0, stopped=True)
    buttons.miss(2.0, stopped=False)
    assert buttons.of((1, 1), 3.0) == (1, 1)


def test_button_that_cannot_be_read_is_held_until_it_is_seen_let_go_of() -> None:
    buttons = HeldButtons(0.25)
    assert buttons.of((1, None, 1), 1.0) == (1, 0, 1)
    assert buttons.of((None, None, 1), 1.1) == (0, 0, 1)
    assert buttons.of((1, 1, 1), 60.0) == (0, 0, 1)
    assert buttons.of((0, None, 1), 60.1) == (0, 0, 1)
    assert buttons.of((1, 1, 1), 60.2) == (1, 0, 1)
    buttons.miss(60.3, stopped=False, buttons=(0, 0, None))
    assert buttons.of((0, 0, 0), 61.0) == (0, 0, 0)
    buttons.miss(62.0, stopped=False, buttons=(0, None, 0))
    assert buttons.of((1, 1, 1), 62.1) == (1, 0, 1)


def test_nothing_is_owed_where_nothing_was_published() -> None:
    assert not StickStream().owes_neutral(fresh=False, counts=False)


def test_stopped_pacer_is_never_due() -> None:
    pacer = Pacer(0.1)
    assert not pacer.is_due(1e9)
    pacer.start(5.0)
    assert pacer.is_due(5.0)
    pacer.stop()
    assert pacer.due == math.inf


def test_a_little_late_is_made_up_for() -> None:
    pacer = Pacer(0.1)
    pacer.start(0.0)
    pacer.sent(0.03)
    assert pacer.due == 0.1


def test_long_stall_makes_no_burst() -> None:
    pacer = Pacer(0.1)
    pacer.start(0.0)
    pacer.sent(10.0)
    assert pacer.due == 10.05


@given(st.lists(st.floats(0.0, 0.5), max_size=50))
def test_two_frames_are_never_closer_than_half_a_period(delays: list[float]) -> None:
    pacer, sent = Pacer(0.1), []
    pacer.start(0.0)
    for delay in delays:
        now = pacer.due + delay
        sent.append(now)
        pacer.sent(now)
    gaps = [later - earlier for earlier, later in zip(sent, sent[1:])]  # noqa: B905, RUF007
    assert all(gap >= 0.05 - 1e-9 for gap in gaps)


@pytest.mark.parametrize('between', ['closed and opened', 'interrupted'])
def test_frame_that_began_before_the_bytes_were_lost_does_not_end_after_it(between: str) -> None:
    """Its first half is of another connection: who knows what was between the two."""
    session = DriveSession(make_settings())
    session.opened(0.0)
    session.receive(IDLE[:-1], 0.0)
    if between == 'interrupted':
        session.interrupted('a test', 0.001)
    else:
        session.closed(0.001)
        session.opened(0.002)
    session.receive(IDLE[-1:], 0.003)
    session.poll(0.003)
    assert session.counters.frames == 0
    assert session.estop
    session.receive(IDLE, 0.004)
    assert session.counters.frames == 1
