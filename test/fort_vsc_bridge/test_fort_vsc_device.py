# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VSC keeps in EEPROM, by the moment: when it is asked, watched, judged and written."""

import math
from typing import Any

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
        self.configurator.keys[KEY].answered(value, now)

    def poll(self, now: float, *, remote: bool = True) -> list[object]:
        """Return what is sent now."""
        self.queue.said.clear()
        self.configurator.poll(now, remote_connected=remote)
        return list(self.queue.said)


# A step: when, what, and behind => the state, what is sent in it, and when something is due next.
# 'alone' is a poll without a remote.
ASKED_FOR = {'auto_off_enable': 1}
EVERY_SECOND = {'joystick_interval_ms': 1000}
POSITIONS = {'gps_interval_ms': 1000}
BEFORE_3 = math.nextafter(3.0, 0.0)
STATES = {
    'unknown': UNKNOWN,
    'wanted': AS_WANTED,
    'written': WRITTEN,
    'refused': REFUSED,
    'unanswered': UNANSWERED,
    'overruled': OVERRULED,
}
SENT: dict[str, list[Any]] = {
    'nothing': [],
    'ask': [KEY],
    'write': [(KEY, 1)],
    'control': [MessageControl(JOYSTICK, True, 1000)],
}
QUESTIONS = ['poll => unknown ask'] * 4 + ['poll => unanswered ask']
STORIES: dict[str, tuple[dict[str, int], list[str]]] = {
    'nothing is due before the link is up': (ASKED_FOR, ['1e6 poll => unknown nothing never']),
    'an answer to somebody else counts for nothing': (
        ASKED_FOR,
        ['0 answer 0 => unknown nothing'],
    ),
    'a question is repeated until it is answered': (
        ASKED_FOR,
        [
            *('1 up => unknown due 1', '1 poll => unknown ask due 3'),
            *(f'{BEFORE_3} poll => unknown nothing', '3 poll => unknown ask'),
            '3.5 answer 1 => wanted nothing never',
        ],
    ),
    'an answer is looked at after a question only': (
        ASKED_FOR,
        [
            *('0.5 answer 0 => unknown nothing', '1 up', '1 answer 0 => unknown nothing'),
            *('1 poll => unknown ask', '1.5 down => unknown never', '2 up'),
            '2 answer 0 => unknown nothing',
        ],
    ),
    'a write is looked at a while later and refused then': (
        ASKED_FOR,
        [
            *('1 up', '1 poll', '2.5 answer 0 => written write due 4.5'),
            *('3 answer 0 => written nothing', '4.5 poll => written ask'),
            '5 answer 0 => refused nothing never',
        ],
    ),
    'a setting is asked for though it is not answered, at each connection anew': (
        ASKED_FOR,
        [
            *('1 up', *(f'{1 + 2 * n} {step}' for n, step in enumerate(QUESTIONS))),
            *('21 down', '21 forget'),
            *('100 up', *(f'{100 + 2 * n} {step}' for n, step in enumerate(QUESTIONS))),
        ],
    ),
    'a setting that was written is not called unanswered': (
        ASKED_FOR,
        [
            *('1 up', '1 poll', '1.5 answer 0 => written write'),
            *(f'{1.5 + 2 * n} poll => written ask' for n in range(1, 9)),
        ],
    ),
    'what the user writes is looked at a while later if it is wanted': (
        ASKED_FOR,
        [
            '1 up',
            '1 poll',
            '1.5 overrule 1 => written due 3.5',
            '1.75 answer 1 => written due 3.5',
        ],
    ),
    'what the user writes instead is not looked at': (
        ASKED_FOR,
        [
            '1 up',
            '1 poll',
            '1.5 overrule 0 => overruled never',
            '1.75 answer 1 => overruled never',
        ],
    ),
    'it outlasts the link': (
        ASKED_FOR,
        [
            *('0 up', '0.5 overrule 0', '1 down', '2 up', '2 poll => overruled nothing'),
            '2.5 answer 0 => overruled nothing',
        ],
    ),
    'it outlasts the port and a freeze': (
        ASKED_FOR,
        ['0 up', '0.5 overrule 0', '1 down', '1 forget', '2 up', '2 poll => overruled nothing'],
    ),
    'another connection begins again once its link is up': (
        ASKED_FOR,
        ['1 up', '1 forget => unknown never'],
    ),
    'a value is asked for once and without a remote': (
        ASKED_FOR,
        ['0 up', '0 alone => unknown ask', '0.01 alone => unknown nothing'],
    ),
    'an interval is watched anew once the link is back': (
        EVERY_SECOND,
        [
            *('0 up', '0.5 hear', '1.5 hear', '2.5 hear', '4 poll => wanted nothing never'),
            *('4 down', '5 up', '5.5 hear', '6 hear', '6.5 hear', '9 poll => written control'),
        ],
    ),
    'what comes until a write has its effect does not count': (
        EVERY_SECOND,
        [
            *('0 up', '0.5 hear', '1 hear', '1.5 hear', '4 poll => written control due 10'),
            *('4.5 hear', '5 hear', '5.5 hear', '6 hear', '7 hear', '8 hear'),
            '10 poll => wanted nothing',
        ],
    ),
    'a watch begins anew with the link': (
        EVERY_SECOND,
        [
            *('0 up', '0.5 hear', '0.75 hear', '1 hear', '1 down => unknown never'),
            *('10 up => unknown due 14', '10 hear', '11 hear', '12 hear', '14 poll => wanted'),
        ],
    ),
    'positions wait for a remote': (POSITIONS, ['0 up', '2.5 alone => unknown nothing due 6.5']),
    'sticks do not': (EVERY_SECOND, ['0 up', '2.5 alone => unknown nothing due 4']),
    'a position that was judged needs no remote any more': (
        POSITIONS,
        [
            *('0 up', '0.5 hear', '1.5 hear', '2.5 hear', '4 poll => wanted nothing'),
            '5 alone => wanted nothing never',
        ],
    ),
}


@pytest.mark.parametrize('story', STORIES)
def test_story(story: str) -> None:
    wanted, steps = STORIES[story]
    bench = Bench(**wanted)
    for step in steps:
        act, _, expected = step.partition(' => ')
        moment, what, *value = act.split()
        now = float(moment)
        bench.queue.said.clear()
        if what in ('up', 'down'):
            bench.link(now, up=what == 'up')
        elif what in ('poll', 'alone'):
            bench.poll(now, remote=what == 'poll')
        elif what == 'answer':
            bench.answer(int(value[0]), now)
        elif what == 'overrule':
            bench.configurator.keys[KEY].overrule(int(value[0]), now)
        elif what == 'hear':
            for watch in bench.configurator.watches.values():
                watch.heard(now)
        else:
            bench.configurator.look_anew()
        words = iter(expected.split())
        for word in words:
            if word in STATES:
                assert bench.state == STATES[word], step
            elif word in SENT:
                assert bench.queue.said == SENT[word], step
            else:
                due = math.inf if word == 'never' else float(next(words))
                assert bench.deadline == due, step


def test_first_of_several_is_due() -> None:
    assert Bench().deadline == math.inf
    bench = Bench(auto_off_enable=1, joystick_interval_ms=1000)
    bench.link(1.0)
    assert bench.deadline == 1.0
    assert bench.poll(1.0) == [KEY]
    assert bench.deadline == 1.0 + ASK


def watching(interval_ms: int, kind: MessageType = JOYSTICK) -> Bench:
    """Return a bench that watches since 0."""
    bench = Bench(**{NAMES[kind]: interval_ms})
    bench.link(0.0)
    return bench


def test_device_that_may_be_another_one_is_asked_anew_and_written_where_it_differs() -> None:
    bench = Bench(auto_off_enable=1)
    now = 0.0
    for answer, state, writes in [(1, AS_WANTED, 0)] * 9 + [(0, WRITTEN, 1), (1, AS_WANTED, 0)]:
        bench.link(now)
        assert bench.state == UNKNOWN
        assert bench.poll(now) == [KEY]
        bench.answer(answer, now + 0.5)
        assert (bench.state, len(bench.queue.said)) == (state, 1 + writes)
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


GAP, TWO_A_READ = (0.5, 1.5, 2.5), (0.5, 0.5, 1.5, 1.5, 2.5, 2.5)
INTERVALS: list[tuple[MessageType, int, tuple[float, ...], str]] = [
    (JOYSTICK, 500, (0.5, 1.0, 1.5), AS_WANTED),
    (JOYSTICK, 1000, GAP, AS_WANTED),
    (JOYSTICK, 500, TWO_A_READ, AS_WANTED),
    (JOYSTICK, 500, (0.5, 1.0, 2.5, 2.5, 2.5), AS_WANTED),  # a freeze
    (JOYSTICK, 500, (0.5, 0.5, 0.5, 0.5625, 0.5625, 1.0625, 1.5625), AS_WANTED),  # had waited
    (JOYSTICK, 2000, (0.125, 2.125), AS_WANTED),  # two are enough, the first may come at once
    (JOYSTICK, 2000, (0.0, 2.0), AS_WANTED),
    (JOYSTICK, 5000, (0.0, 6.0), AS_WANTED),  # a fifth off
    (JOYSTICK, 5000, (0.0, 4.0), AS_WANTED),
    (JOYSTICK, 0, (), AS_WANTED),
    (JOYSTICK, 1000, (), WRITTEN),
    (JOYSTICK, 1000, (1.0,), WRITTEN),
    (JOYSTICK, 1000, TWO_A_READ, WRITTEN),  # of half the interval
    (JOYSTICK, 1000, (0.0, 0.2, 1.2), WRITTEN),  # a fifth is not at once any more
    (JOYSTICK, 1000, (0.0, 0.125, 0.25, 0.375, 0.5), WRITTEN),
    (JOYSTICK, 5000, (0.0, 6.25), WRITTEN),
    (JOYSTICK, 5000, (0.0, 3.75), WRITTEN),
    (JOYSTICK, 0, (1.0,), WRITTEN),
    # Sentences of one position count as one.
    (GPS, 1000, (0.5, 0.5, 0.625, 1.5, 1.5, 2.5, 2.5), AS_WANTED),
    (GPS, 1000, (0.0, 0.2, 1.2), WRITTEN),
    (GPS, 1000, (0.5, 0.5, 1.0, 1.0, 1.5, 1.5), WRITTEN),
]


@pytest.mark.parametrize(('kind', 'interval_ms', 'times', 'state'), INTERVALS)
def test_interval_is_left_alone_where_it_is_as_wanted_and_else_written(
    kind: MessageType, interval_ms: int, times: tuple[float, ...], state: str
) -> None:
    bench = Bench(**{NAMES[kind]: interval_ms})
    bench.link(0.0)
    watch = max(3.0, 4e-3 * interval_ms)
    if kind is JOYSTICK:  # the first position is waited for longer
        assert bench.deadline == watch
    for now in times:
        bench.configurator.watches[kind].heard(now)
    assert bench.poll(math.nextafter(watch, 0.0)) == []
    written = MessageControl(kind, interval_ms > 0, interval_ms or 1000)
    assert bench.poll(watch) == [written] * (state is WRITTEN)
    due = watch + ASK + watch if state is WRITTEN else math.inf
    assert (bench.state, bench.deadline) == (state, due)
