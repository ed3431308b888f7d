# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The base of all sessions, moment by moment, and what they share: sticks, buttons, pacing."""

import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given, strategies as st
import pytest

from bridge_core.framing import Decoder
from bridge_core.reasons import Coded
from bridge_core.session import (
    HeldButtons,
    INTERRUPTION_TIME,
    Level,
    Pacer,
    Session,
    StickStream,
    StopChanged,
    Verdict,
)
from esi_drive_bridge.session import Session as DriveSession
from stage.esi_drive_rig import IDLE, make_settings

TIMEOUT = 0.5  # s; it and the moments below are exact, so that each edge can be met
ANSWER_TIME = 0.25
CLEAR = Verdict()
LOST = Verdict.stop(link_up=False)
STOP = Verdict.stop()


class Words(Decoder[str, str]):
    """What is received is a word; noise is none."""

    def feed(self, data: str, now: float) -> list[str]:
        del now
        self.counters.frames += data != 'noise'
        return [data] if data != 'noise' else []


class Toy(Session[str, str, str]):
    """
    Its device says ``clear`` or ``stop``, and ``again`` for the same; ``ask`` has it asked.

    A question goes out with the next poll, and is to be answered within ANSWER_TIME by a word;
    if not, that is a stop.
    """

    def __init__(self) -> None:
        super().__init__(Words(), TIMEOUT)
        self.stopped = self.asks = False
        self.asked_until = math.inf
        self.failed = False
        self.seen: list[tuple[str, float]] = []  # what time and messages led to

    def ask(self, now: float) -> None:
        """Ask the device something; a request."""
        self._expire(now)
        self.seen.append(('asked', now))
        self.asks = True

    def answer_within(self, seconds: float, now: float) -> None:
        """Let what was asked before expire sooner; a request that leaves the verdict alone."""
        self._expire(now)
        self.asked_until = now + seconds

    def _take(self, message: str, now: float) -> None:
        self._heard.feed(now)
        self.stopped = message == 'stop'
        self.asked_until = math.inf

    def _take_repeated(self, message: str, now: float) -> bool:
        if message != 'again':
            return bool(super()._take_repeated(message, now))
        self._heard.feed(now)
        return True

    def _judge(self, now: float) -> Verdict:
        return (
            Verdict.stop(Coded('toy.stop', 'it says so'))
            if self.stopped or self.failed
            else Verdict()
        )

    def _silence(self, now: float) -> Coded:
        return Coded('toy.silent', 'garbled' if self._garbled(now) else 'silent')

    def _follow(self, now: float) -> None:
        self.failed |= now >= self.asked_until
        if self.failed and not self.verdict.estop:
            self.asked_until = math.inf
            self._refresh(now)
        self.seen.append(('followed', now))

    def _expires_at(self) -> float:
        return min(super()._expires_at(), self.asked_until)

    def _due_frames(self, now: float) -> list[str]:
        if not self.asks:
            return []
        self.asks, self.asked_until = False, now + ANSWER_TIME
        return ['?']


def opened(*words: str) -> Toy:
    """Return a session that was opened at 0 and heard this at 1."""
    session = Toy()
    session.opened(0.0)
    for word in words:
        session.receive(word, 1.0)
    return session


def verdicts(events: list[Any]) -> list[Verdict]:
    return [event.verdict for event in events if isinstance(event, StopChanged)]


def test_base_inhibits_nothing_and_knows_no_more() -> None:
    session = opened('clear')
    assert session.inhibits(1.0) == []
    assert session.values(1.0) == {}
    assert session.farewell(1.0) == []
    assert Session._due_frames(session, 1.0) == []
    assert (session.HELD, session.summary()) == ('held', 'ok')


def test_levels_are_those_of_diagnostic_status() -> None:
    assert {level.name: bytes([level]) for level in Level} == {
        'OK': DiagnosticStatus.OK,
        'WARN': DiagnosticStatus.WARN,
        'ERROR': DiagnosticStatus.ERROR,
        'STALE': DiagnosticStatus.STALE,
    }


def test_stop_of_a_device_that_is_heard_is_a_warning_and_silence_an_error() -> None:
    assert opened('stop').problems(1.0) == [(Level.WARN, 'it says so')]
    assert opened().problems(1.0) == [(Level.ERROR, 'silent')]
    assert opened('clear').problems(1.0) == []
    assert (opened().frame_age(1.0), opened('clear').frame_age(1.25)) == (math.inf, 0.25)


def test_verdict_changes_at_the_moment_at_which_silence_is_too_long() -> None:
    session = opened('clear', 'again')
    assert session.deadline() == 1.5
    before = math.nextafter(1.5, 0.0)
    assert session.poll(before) == ([], [])
    assert verdicts(session.poll(1.5)[0]) == [LOST]
    assert session.deadline() == math.inf


def test_time_alone_is_looked_at_when_something_may_change_or_the_clock_runs_backwards() -> None:
    session = opened('clear')
    session.seen.clear()
    for now in (1.0, 1.125, 1.25):
        session.receive('again', now)
        session.poll(now)
    assert session.seen == []
    assert verdicts(session.poll(0.5)[0]) == [LOST]


def test_question_that_went_out_expires_though_the_link_has_more_time() -> None:
    """Sending may begin a time-out, which none of the moments known before are."""
    session = opened('clear')
    session.ask(1.0)
    assert session.poll(1.0) == ([], ['?'])
    session.receive('again', 1.125)
    assert session.deadline() == 1.25
    assert verdicts(session.poll(1.25)[0]) == [STOP]


def test_request_may_let_something_expire_sooner() -> None:
    session = opened('clear')
    session.poll(1.0)
    session.answer_within(0.125, 1.0625)
    assert session.poll(1.125) == ([], [])
    assert verdicts(session.poll(1.1875)[0]) == [STOP]


def test_what_has_expired_comes_before_what_is_asked() -> None:
    session = opened('clear')
    session.seen.clear()
    session.ask(1.5)
    assert session.seen == [('followed', 1.5), ('asked', 1.5)]
    assert verdicts(session.poll(1.5)[0]) == [LOST]


@pytest.mark.parametrize('word', ['clear', 'again'])
def test_discarded_input_is_a_stop_for_its_time_whatever_comes(word: str) -> None:
    session = opened('clear')
    session.interrupted('lost input', 2.0)
    assert verdicts(session.poll(2.0)[0]) == [LOST]
    assert session.stop_reasons(2.0) == ['lost input']
    end = 2.0 + INTERRUPTION_TIME
    events, _ = session.receive('clear', 2.0625)
    assert verdicts(events) == [STOP]
    assert session.stop_reasons(2.0625) == ['lost input']
    assert session.deadline() == end
    events, _ = session.receive(word, math.nextafter(end, 0.0))
    assert verdicts(events) == []
    assert verdicts(session.poll(end)[0]) == [CLEAR]
    assert session.deadline() == math.nextafter(end, 0.0) + TIMEOUT


# What is called with what when, and why it stops just before and at a moment behind that.
REASONS: dict[str, tuple[list[tuple[str, Any, float]], tuple[str, str, float]]] = {
    'silence behind discarded input': (
        [('receive', 'clear', 1.0), ('interrupted', 'lost input', 2.0)],
        ('lost input', 'silent', 2.5),
    ),
    'discarded input of a port that is closed': (
        [('closed', None, 2.0), ('interrupted', 'lost input', 2.0)],
        (Toy.CLOSED, Toy.CLOSED, 2.25),
    ),
    'discarded input of a port that was closed': (
        [('closed', None, 2.0), ('interrupted', 'lost input', 2.0), ('opened', None, 2.0)],
        ('silent', 'silent', 2.25),
    ),
    "noise for the link's time": (
        [('receive', 'noise', 1.0), ('receive', 'noise', 1.25), ('receive', 'noise', 1.5)],
        ('silent', 'garbled', 1.5),
    ),
    'noise of another connection': (
        [
            *(('receive', 'noise', 1.0), ('closed', None, 1.25), ('opened', None, 1.25)),
            ('receive', 'noise', 1.375),
        ],
        ('silent', 'silent', 1.75),
    ),
}


@pytest.mark.parametrize('name', REASONS)
def test_reason_of_a_stop(name: str) -> None:
    session = opened()
    calls, (before, then, moment) = REASONS[name]
    for method, what, now in calls:
        getattr(session, method)(*[what] * (what is not None), now)
    assert session.stop_reasons(math.nextafter(moment, 0.0)) == [before]
    assert session.stop_reasons(moment) == [then]


def test_held_buttons_know_whether_a_stop_came_last() -> None:
    held = HeldButtons(1.0)
    assert held.after_stop
    held.miss(0.0, stopped=False)
    assert not held.after_stop
    held.miss(1.0, stopped=True)
    assert held.after_stop
    held.of((1,), 2.0)
    assert not held.after_stop


# What sessions share.


def test_verdicts_that_differ_in_words_only_are_equal() -> None:
    sooner, later = Coded('a', 'heard 250 ms ago'), Coded('a', 'heard 260 ms ago')
    assert Verdict.stop(sooner) == Verdict.stop(later)
    assert Verdict.stop(later) != Verdict.stop(later, link_up=False)
    assert Verdict.stop(later) != Verdict(estop=True, own_estop=False, reasons=(later,))


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans())))
def test_exactly_one_neutral_follows_sticks_that_hold_no_more(
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
