# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What sessions share: verdicts, neutral sticks, pacing, the end of a connection."""

import math

from hypothesis import given, strategies as st
import pytest

from bridge_core.reasons import Coded
from bridge_core.session import HeldButtons, Pacer, StickStream, Verdict
from esi_drive_bridge.session import Session as DriveSession
from stage.esi_drive_rig import IDLE, make_settings


def test_verdicts_that_differ_in_words_only_are_equal() -> None:
    sooner, later = Coded('a', 'heard 250 ms ago'), Coded('a', 'heard 260 ms ago')
    assert Verdict.stop(sooner) == Verdict.stop(later)
    assert Verdict.stop(later) != Verdict.stop(later, link_up=False)
    assert Verdict.stop(later) != Verdict(estop=True, own_estop=False, reasons=(later,))


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


# What is seen of the buttons and then counts, or a moment at which none are: whether by a stop.
Seen = tuple[float, tuple[int | None, ...], tuple[int, ...]] | tuple[float, bool]
UNSEEN: list[Seen] = [(4.0, (0, 0), (0, 0)), (5.0, True), (6.0, False), (8.0, (1, 0), (0, 0))]
HELD: dict[str, list[Seen]] = {
    'while nothing counted, until it is let go of': [
        *((1.0, (1, 0, -1), (1, 0, -1)), (1.1, False), (2.0, False), (2.1, (1, 1, -1), (0, 1, 0))),
        *((2.2, False), (3.0, (1, 1, 0), (0, 0, 0)), (3.1, (0, 1, -1), (0, 0, -1))),
        *((3.2, (1, 0, -1), (1, 0, -1)), (3.3, (1, 1, -1), (1, 1, -1))),
    ],
    'gone just before': [
        *((0.0, (1,), (1,)), (1.0, (0,), (0,)), (1.01, (0,), (0,)), (1.25, False)),
        (2.0, (1,), (0,)),
    ],
    'gone long before': [
        *((0.0, (1,), (1,)), (1.0, (0,), (0,)), (1.01, (0,), (0,)), (1.26, False)),
        (2.0, (1,), (1,)),
    ],
    'through a stop behind a pause': [
        *((1.0, (1, 0), (1, 0)), (1.1, False), (2.0, True), (3.0, (1, 0), (1, 0))),
        *((3.1, (0, 0), (0, 0)), (3.2, (1, 0), (1, 0))),
    ],
    'through a stop and a pause, in which nobody sees it and the mux may be reset': [
        *((1.0, (1, 0), (1, 0)), (1.1, True), (2.0, False), (3.0, (1, 0), (0, 0))),
        *((3.1, (0, 0), (0, 0)), (3.2, (1, 0), (1, 0))),
    ],
    'however long ago it was seen last': [
        *((0.0, (1, 0), (1, 0)), (60.0, True), (60.1, False), (60.2, (1, 1), (0, 1))),
    ],
    'where a device shows it all the time': [(1.0, True), (2.0, False), (3.0, (1, 1), (1, 1))],
    'unseen': [(3.0, (1, 0), (1, 0)), (3.1, (0, 1), (0, 1)), (3.2, (1, 1), (1, 1))],
    'unseen, a stop before': [(0.0, True), (3.0, (1, 0), (1, 0)), (3.1, (0, 1), (0, 1))],
    'unseen, a pause before': [
        *((0.0, True), (1.0, False), (3.0, (1, 0), (0, 0)), (3.1, (0, 1), (0, 1))),
        *((3.2, (1, 1), (1, 1)), *UNSEEN),
    ],
    'unseen, but let go of before a pause without a stop': [
        *((4.0, (0, 0), (0, 0)), (5.0, False), (8.0, (1, 0), (1, 0))),
    ],
    'unreadable, until it is seen let go of': [
        *((1.0, (1, None, 1), (1, 0, 1)), (1.1, (None, None, 1), (0, 0, 1))),
        *((60.0, (1, 1, 1), (0, 0, 1)), (60.1, (0, None, 1), (0, 0, 1))),
        (60.2, (1, 1, 1), (1, 0, 1)),
    ],
}


@pytest.mark.parametrize('name', HELD)
def test_button_held_where_it_did_not_count_counts_once_it_was_let_go_of(name: str) -> None:
    buttons = HeldButtons(0.25, unseen=2 * name.startswith('unseen'))
    for at, *seen in HELD[name]:
        if len(seen) == 1:
            buttons.miss(at, stopped=bool(seen[0]))
        else:
            assert buttons.of(seen[0], at) == seen[1], at  # type: ignore[arg-type]


def test_button_that_cannot_be_read_while_nothing_counts_is_held_too() -> None:
    buttons = HeldButtons(0.25)
    buttons.miss(60.3, stopped=False, buttons=(0, 0, None))
    assert buttons.of((0, 0, 0), 61.0) == (0, 0, 0)
    buttons.miss(62.0, stopped=False, buttons=(0, None, 0))
    assert buttons.of((1, 1, 1), 62.1) == (1, 0, 1)


def test_nothing_is_owed_where_nothing_was_published() -> None:
    assert not StickStream().owes_neutral(fresh=False, counts=False)


@pytest.mark.parametrize(
    ('early', 'sent', 'due'),
    [
        (0.0, [0.03], 0.125),  # a little late is made up for
        (0.0, [10.0], 10.0625),  # a long stall makes no burst
        (0.03125, [0.0, 0.09375], 0.25),  # early with something else, it keeps its slots
    ],
)
def test_pacer_keeps_its_slots(early: float, sent: list[float], due: float) -> None:
    pacer = Pacer(0.125, early=early)
    assert not pacer.is_due(1e9)
    pacer.start(0.0)
    assert pacer.is_due(0.0)
    for now in sent:
        pacer.sent(now)
    assert pacer.due == due
    assert [pacer.is_due(due - early + late) for late in (-0.03125, 0.0)] == [False, True]
    pacer.stop()
    assert pacer.due == math.inf


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
