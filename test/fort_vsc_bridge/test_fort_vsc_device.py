# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VSC keeps in EEPROM, by the moment: when it is asked, watched, judged and written."""

from collections.abc import Iterable
import math

import pytest

from fort_vsc_bridge.protocol.frames import Message, MessageType
from fort_vsc_bridge.protocol.messages import MessageControl, UserFeedback, UserFeedbackGet
from fort_vsc_bridge.protocol.values import Key
from fort_vsc_bridge.session.device import (
    AS_WANTED,
    Configurator,
    MAX_WRITES,
    OVERRULED,
    REFUSED,
    UNANSWERED,
    UNKNOWN,
    WRITTEN,
)
from fort_vsc_bridge.session.send_queue import SendQueue

# All of these moments and intervals (s) are exact.
ASK = 2.0
WATCH = 4.0  # four intervals of 1 s; at least 3 s
KEY = Key.AUTO_OFF_ENABLE
GPS, JOYSTICK = MessageType.GPS, MessageType.JOYSTICK
NAMES = {GPS: 'gps_interval_ms', JOYSTICK: 'joystick_interval_ms'}


class Queue(SendQueue):
    """Keeps what would be sent."""

    def __init__(self) -> None:
        self.said: list[object] = []

    def put(self, *messages: Message) -> None:
        for message in messages:
            if isinstance(message, UserFeedbackGet):
                self.said.append(message.key)
            elif isinstance(message, UserFeedback):
                self.said.append((message.key, message.value))
            else:
                self.said.append(message)


class Bench:
    """A configurator of one setting, or of more."""

    def __init__(self, **wanted: int) -> None:
        self.queue = Queue()
        self.configurator = Configurator(wanted, self.queue)

    @property
    def state(self) -> str:
        (state,) = self.configurator.states.values()
        return state

    @property
    def deadline(self) -> float:
        return self.configurator.deadline

    def link(self, now: float, *, up: bool = True) -> None:
        self.configurator.link_changed(up, now)

    def answer(self, value: int, now: float) -> None:
        self.configurator.answered(KEY, value, now)

    def poll(self, now: float, *, remote: bool = True) -> list[object]:
        """Return what is sent now."""
        self.queue.said.clear()
        self.configurator.poll(now, remote_connected=remote)
        return list(self.queue.said)

    def watched(self, kind: MessageType, times: Iterable[float], end: float) -> list[object]:
        """Hear messages of a type at these times; return what is sent at the end."""
        for now in times:
            self.configurator.watches[kind].heard(now)
        assert self.poll(math.nextafter(end, 0.0)) == []
        return self.poll(end)


def watching(interval_ms: int, kind: MessageType = JOYSTICK, now: float = 0.0) -> Bench:
    """Return a bench that watches since now."""
    bench = Bench(**{NAMES[kind]: interval_ms})
    bench.link(now)
    return bench


# Settings that can be asked for.


def test_nothing_is_due_before_the_link_is_up() -> None:
    bench = Bench(auto_off_enable=1, joystick_interval_ms=1000)
    assert bench.deadline == math.inf
    assert bench.poll(1e6) == []
    assert Bench().deadline == math.inf


def test_answer_to_a_question_of_somebody_else_counts_for_nothing() -> None:
    bench = Bench(auto_off_enable=1)
    bench.answer(0, 0.0)
    assert bench.state == UNKNOWN
    assert bench.queue.said == []


def test_first_of_several_is_due() -> None:
    bench = Bench(auto_off_enable=1, joystick_interval_ms=1000)
    bench.link(1.0)
    assert bench.deadline == 1.0
    assert bench.poll(1.0) == [KEY]
    assert bench.deadline == 1.0 + ASK


def test_question_is_repeated_until_it_is_answered() -> None:
    bench = Bench(auto_off_enable=1)
    bench.link(1.0)
    assert bench.poll(1.0) == [KEY]
    assert bench.poll(math.nextafter(1.0 + ASK, 0.0)) == []
    assert bench.poll(1.0 + ASK) == [KEY]
    bench.answer(1, 3.5)
    assert (bench.state, bench.deadline) == (AS_WANTED, math.inf)


def test_answer_is_looked_at_after_a_question_only() -> None:
    bench = Bench(auto_off_enable=1)
    bench.answer(0, 0.5)
    bench.link(1.0)
    bench.answer(0, 1.0)
    assert bench.poll(1.0) == [KEY]
    bench.link(1.5, up=False)
    assert bench.deadline == math.inf
    bench.link(2.0)
    bench.answer(0, 2.0)  # to the question of before
    assert bench.queue.said == [KEY]
    assert bench.state == UNKNOWN


def test_write_is_looked_at_a_while_later_and_refused_then() -> None:
    bench = Bench(auto_off_enable=1)
    bench.link(1.0)
    bench.poll(1.0)
    bench.answer(0, 2.5)
    assert bench.queue.said[1:] == [(KEY, 1)]
    assert (bench.state, bench.deadline) == (WRITTEN, 2.5 + ASK)
    bench.answer(0, 3.0)  # to a question of before the write
    assert bench.poll(2.5 + ASK) == [KEY]
    bench.answer(0, 5.0)
    assert (bench.state, bench.deadline) == (REFUSED, math.inf)


def test_setting_that_is_not_answered_for_is_said_so_and_asked_for_all_the_same() -> None:
    bench = Bench(auto_off_enable=1)
    for began in (1.0, 100.0):  # at each connection anew
        bench.link(began)
        for n in range(4):
            assert bench.poll(began + n * ASK) == [KEY]
            assert bench.state == UNKNOWN
        assert bench.poll(began + 4 * ASK) == [KEY]
        assert bench.state == UNANSWERED
        bench.link(began + 20.0, up=False)
        bench.configurator.forget()


def test_setting_that_was_written_is_not_called_unanswered() -> None:
    bench = Bench(auto_off_enable=1)
    bench.link(1.0)
    bench.poll(1.0)
    bench.answer(0, 1.5)
    for n in range(1, 9):
        assert bench.poll(1.5 + n * ASK) == [KEY]
        assert bench.state == WRITTEN


@pytest.mark.parametrize(('value', 'state'), [(1, WRITTEN), (0, OVERRULED)])
def test_value_that_the_user_writes_is_looked_at_a_while_later(value: int, state: str) -> None:
    bench = Bench(auto_off_enable=1)
    bench.link(1.0)
    bench.poll(1.0)
    bench.configurator.overrule(KEY, value, 1.5)
    bench.answer(1, 1.75)  # to the question of before
    assert bench.state == state
    assert bench.deadline == (1.5 + ASK if state is WRITTEN else math.inf)


def test_another_connection_begins_again_once_its_link_is_up() -> None:
    bench = Bench(auto_off_enable=1)
    bench.link(1.0)
    bench.configurator.forget()
    assert (bench.state, bench.deadline) == (UNKNOWN, math.inf)


def test_device_that_may_be_another_one_is_asked_anew_and_written_where_it_differs() -> None:
    bench = Bench(auto_off_enable=1)
    now = 0.0
    for answer, state, writes in [(1, AS_WANTED, 0)] * 9 + [(0, WRITTEN, 1), (1, AS_WANTED, 0)]:
        bench.link(now)
        assert bench.state == UNKNOWN
        assert bench.poll(now) == [KEY]
        bench.answer(answer, now + 0.5)
        assert bench.state == state
        assert len(bench.queue.said) == 1 + writes
        bench.link(now + 1.0, up=False)
        now += 2.0


def test_link_that_comes_and_goes_wears_out_no_device_that_takes_nothing() -> None:
    bench = Bench(auto_off_enable=1)
    written: list[object] = []
    for now in range(0, 200, 2):
        bench.link(now)
        bench.poll(now)
        bench.answer(0, now + 0.5)
        written += bench.queue.said[1:]
        bench.link(now + 1.0, up=False)
    assert written == [(KEY, 1)] * MAX_WRITES
    assert bench.state == REFUSED


@pytest.mark.parametrize('forgotten', [False, True])
def test_what_the_user_wrote_instead_outlasts_the_link(forgotten: bool) -> None:
    """Lost alone, or with the port, or by a freeze."""
    bench = Bench(auto_off_enable=1)
    bench.link(0.0)
    bench.configurator.overrule(KEY, 0, 0.5)
    bench.link(1.0, up=False)
    if forgotten:
        bench.configurator.forget()
    bench.link(2.0)
    assert bench.poll(2.0) == []
    bench.answer(0, 2.5)
    assert bench.queue.said == []
    assert bench.state == OVERRULED


def test_interval_is_watched_anew_once_the_link_is_back() -> None:
    bench = watching(500)
    assert bench.watched(JOYSTICK, (0.5, 1.0, 1.5), 3.0) == []
    assert bench.state == AS_WANTED
    bench.link(4.0, up=False)
    bench.link(5.0)
    assert len(bench.watched(JOYSTICK, (6.0, 7.0, 8.0), 8.0)) == 1
    assert bench.state == WRITTEN


# Intervals, which are watched.


@pytest.mark.parametrize(
    ('interval_ms', 'times'),
    [
        (500, (0.5, 1.0, 1.5)),
        (1000, (0.5, 1.5, 2.5)),
        (500, (0.5, 0.5, 1.5, 1.5, 2.5, 2.5)),  # two a read
        (500, (0.5, 1.0, 2.5, 2.5, 2.5)),  # a freeze
        (500, (0.5, 0.5, 0.5, 0.5625, 0.5625, 1.0625, 1.5625)),  # at first what had waited
        (2000, (0.125, 2.125)),  # two are enough, and the first may come at once
        (2000, (0.0, 2.0)),
        (5000, (0.0, 6.0)),  # a fifth off
        (5000, (0.0, 4.0)),
        (0, ()),
    ],
)
def test_interval_that_is_as_wanted_is_left_alone(
    interval_ms: int, times: tuple[float, ...]
) -> None:
    bench = watching(interval_ms)
    end = max(3.0, 4e-3 * interval_ms)
    assert bench.deadline == end
    assert bench.watched(JOYSTICK, times, end) == []
    assert (bench.state, bench.deadline) == (AS_WANTED, math.inf)


@pytest.mark.parametrize(
    ('interval_ms', 'times'),
    [
        (1000, ()),
        (1000, (1.0,)),
        (1000, (0.5, 0.5, 1.5, 1.5, 2.5, 2.5)),  # two a read, of half the interval
        (1000, (0.0, 0.2, 1.2)),  # a fifth of the interval is not at once any more
        (1000, (0.0, 0.125, 0.25, 0.375, 0.5)),
        (5000, (0.0, 6.25)),
        (5000, (0.0, 3.75)),
        (0, (1.0,)),
    ],
)
def test_interval_that_differs_is_written_and_watched_after_a_while(
    interval_ms: int, times: tuple[float, ...]
) -> None:
    bench = watching(interval_ms)
    watch = max(3.0, 4e-3 * interval_ms)
    (written,) = bench.watched(JOYSTICK, times, watch)
    assert written == MessageControl(JOYSTICK, interval_ms > 0, interval_ms or 1000)
    assert (bench.state, bench.deadline) == (WRITTEN, watch + ASK + watch)


@pytest.mark.parametrize(
    ('times', 'state'),
    [
        ((0.5, 0.5, 0.625, 1.5, 1.5, 2.5, 2.5), AS_WANTED),
        ((0.0, 0.2, 1.2), WRITTEN),
        ((0.5, 0.5, 1.0, 1.0, 1.5, 1.5), WRITTEN),
    ],
)
def test_sentences_of_one_position_count_as_one(times: tuple[float, ...], state: str) -> None:
    bench = watching(1000, GPS)
    bench.watched(GPS, times, WATCH)
    assert bench.state == state


def test_what_comes_until_a_write_has_its_effect_does_not_count() -> None:
    bench = watching(1000)
    assert len(bench.watched(JOYSTICK, (0.5, 1.0, 1.5), WATCH)) == 1
    later = (4.0, 4.5, 5.0, 5.5, 6.0, 7.0, 8.0)  # from 6 on they are the new ones
    assert bench.watched(JOYSTICK, later, WATCH + ASK + WATCH) == []
    assert bench.state == AS_WANTED


def test_watch_begins_anew_with_the_link() -> None:
    bench = watching(1000)
    for now in (0.5, 0.75, 1.0):
        bench.configurator.watches[JOYSTICK].heard(now)
    bench.link(1.0, up=False)
    assert bench.deadline == math.inf
    bench.link(10.0)
    assert bench.deadline == 10.0 + WATCH
    assert bench.watched(JOYSTICK, (10.0, 11.0, 12.0), 10.0 + WATCH) == []
    assert bench.state == AS_WANTED


@pytest.mark.parametrize(('kind', 'deadline'), [(GPS, 2.5 + WATCH), (JOYSTICK, WATCH)])
def test_positions_alone_wait_for_a_remote(kind: MessageType, deadline: float) -> None:
    bench = watching(1000, kind)
    assert bench.poll(2.5, remote=False) == []
    assert bench.deadline == deadline


def test_value_is_asked_for_once_and_without_a_remote() -> None:
    bench = Bench(auto_off_enable=1)
    bench.link(0.0)
    assert bench.poll(0.0, remote=False) == [KEY]
    assert bench.poll(0.01, remote=False) == []


def test_position_that_was_judged_needs_no_remote_any_more() -> None:
    bench = watching(1000, GPS)
    assert bench.watched(GPS, (0.5, 1.5, 2.5), WATCH) == []
    bench.poll(5.0, remote=False)
    assert (bench.state, bench.deadline) == (AS_WANTED, math.inf)
