# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every state of a reader and a writer of proofs, with a channel that does what channels do.

Property: what the reader takes for as old as ``as_of`` was said then or later, and every stop
that began before it was told. Once the channel is in order, what is said is young again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math
from typing import Any

import pytest

from assurance.explorer import Memory, Remembered, START, visits_of
from bridge_core.proof import Challenge, Proof, Reader, TOGETHER_TIME, Writer

pytestmark = pytest.mark.computes
STEP = 0.125
SILENCE = LATELY = 2 * STEP
ROOM = 2  # messages on the way, each way
READER, OTHER_READER = 1, 2
WRITERS, TWIN = range(11, 16), 20  # identities of writers


@dataclass(slots=True)
class Way:
    """A message on its way."""

    sent_at: float
    asked: float  # -inf: nothing
    writer: int = 0  # of a proof; so all below
    number: int = 0
    stops: int = 0
    estop: bool = False


class World(Remembered):
    """
    A step is a turn of both ends: ask, take what comes, answer, take what comes.

    ``what`` each step may be: 'stop' and 'clear' change what the writer says, 'blip' is both;
    'late there' and 'late back' keep the newest message for the next step, 'lost' ones drop it,
    'twice' ones keep a copy, 'swap' ones let the newest overtake; 'bad back' flips bits, 'twin'
    is another writer of the same name, 'crossed' an answer to another reader; 'restart' gives the
    writer another life.
    """

    def __init__(self, events: tuple[str, ...]) -> None:
        self.events = events
        self.now = START
        self.reader = Reader(READER, SILENCE)
        self.writer = Writer(WRITERS[0], LATELY)
        self.there: list[Way] = []
        self.back: list[Way] = []
        self.says_stop = True
        self.began_at = math.inf  # the oldest stop that the reader was not told
        self.say(True)
        old = {'': SILENCE + STEP, '_second_at': TOGETHER_TIME, '_asked': 4 * STEP}
        old |= {'as_of': 4 * STEP, 'there': 4 * STEP, 'back': 4 * STEP}
        apart = ('events', 'memory', 'now', 'damaged', 'repeated', 'unasked')
        self.memory = Memory(self, old, apart, never=('_second_at',))

    def give(self, memory: Any) -> None:
        super().give(memory)
        asked = self.writer._asked  # in ns: to Memory no moments, that move on with it
        asked.update({who: (what - nanoseconds(STEP), at) for who, (what, at) in asked.items()})

    def possible(self) -> Iterator[str]:
        yield ''
        yield from self.events

    def step(self, event: str) -> None:
        self.now += STEP
        what, _, where = event.partition(' ')
        if what in ('stop', 'blip') and not self.says_stop:
            self.began_at = min(self.began_at, self.now)
        if what in ('stop', 'clear', 'blip'):
            self.say(what != 'clear')
            if what == 'blip':
                self.say(False)
        elif what == 'restart':
            self.writer = Writer(self.unused(), LATELY)
            self.began_at, self.says_stop = min(self.began_at, self.now), True
        self.reader.challenge(self.now)
        for way in self.carry(self.there, Way(self.now, self.now), what * (where == 'there')):
            self.writer.hear(Challenge(READER, nanoseconds(way.asked)).to_bytes(), self.now)
        if what == 'crossed':
            self.writer.hear(Challenge(OTHER_READER, nanoseconds(self.now)).to_bytes(), self.now)
        for way in self.carry(self.back, self.answer(), what * (where == 'back')):
            self.hear(way, spoilt=what == 'bad')
        if what == 'twin':
            self.hear(Way(self.now, self.now, TWIN, 1, 0, False))
        self.renumber()

    def unused(self) -> int:
        used = {self.writer.identity, self.reader.writer, *(way.writer for way in self.back)}
        return min(set(WRITERS) - used)

    def say(self, stop: bool) -> None:
        self.says_stop = stop
        self.writer.say(estop=stop, own_estop=stop, enable=not stop)

    def answer(self) -> Way:
        proof = Proof.from_bytes(self.writer.proof(self.now))
        asked = dict(proof.answers).get(READER)
        when = -math.inf if asked is None else asked / 1e9
        return Way(self.now, when, proof.writer, proof.number, proof.stops, proof.estop)

    def carry(self, queue: list[Way], newest: Way, what: str) -> list[Way]:
        """Return what arrives, in its order."""
        oldest = self.now - ROOM * STEP  # nothing is on its way for longer
        arrives, queue[:] = [way for way in queue if way.sent_at >= oldest], []
        if what == 'late':
            queue[:] = [*arrives[-1:], newest][-ROOM:]
            return arrives[:-1]
        if what == 'swap':
            queue[:] = arrives[-ROOM:]
            return [newest]
        if what == 'twice':
            queue.append(newest)
        return arrives if what == 'lost' else [*arrives, newest]

    def hear(self, way: Way, *, spoilt: bool = False) -> None:
        answers = () if way.asked == -math.inf else ((READER, nanoseconds(way.asked)),)
        numbers = (way.number, way.stops, way.stops)
        frame = Proof(way.writer, *numbers, way.estop, way.estop, not way.estop, 0, answers)
        data = bytearray(frame.to_bytes())
        if spoilt:
            data[len(data) // 2] ^= 0x10
        before = self.reader.as_of
        stops = self.listen(bytes(data))
        if stops is None:
            return
        assert not spoilt, 'damage is believed'
        if way.writer not in (self.writer.identity, self.reader.writer):
            assert stops, 'another writer is no stop'
            assert self.reader.as_of in (before, -math.inf), 'another writer proves an age'
        if way.writer == self.reader.writer:
            self.judge(way, stops=stops)

    def listen(self, data: bytes) -> bool | None:
        """Hear a message; tell whether it is a stop. None: it says nothing new."""
        heard = self.reader.hear(data, self.now)
        if heard is None:
            return None
        assert heard.stopped or not heard.estop
        return heard.stopped

    def judge(self, way: Way, *, stops: bool) -> None:
        if way.writer == self.writer.identity and way.sent_at >= self.began_at:
            assert stops, 'a stop that nobody was told'
            self.began_at = math.inf
        assert self.reader.as_of <= way.sent_at, 'older than it is taken for'

    def renumber(self) -> None:
        """Have numbers and counts come from the same one on, as in every state."""
        asked = self.reader._asked
        while asked and asked[0] < self.now - 2 * ROOM * STEP:
            asked.popleft()  # its answer is not on the way any more
        reader, writer = self.reader, self.writer
        for identity in {writer.identity, reader.writer, *(way.writer for way in self.back)}:
            said = [way for way in self.back if way.writer == identity]
            for name, of_reader in (('number', '_number'), ('stops', '_stops')):
                known = [reader] * (reader.writer == identity)
                ours = [writer] * (writer.identity == identity)
                values = {getattr(way, name) for way in said}
                values |= {getattr(each, of_reader) for each in (*known, *ours)}
                ranks = {value: rank for rank, value in enumerate(sorted(values), 1)}
                for way in said:
                    setattr(way, name, ranks[getattr(way, name)])
                for each in (*known, *ours):
                    setattr(each, of_reader, ranks[getattr(each, of_reader)])
        reader._own_stops, writer._own_stops = reader._stops, writer._stops

    def arrived(self) -> None:
        """See that a channel in order makes it young again, within TOGETHER_TIME of a twin."""
        self.play('clear')
        for _ in range(4):
            self.step('')
        while self.reader.is_doubled(self.now):
            self.step('')
        assert self.reader.age(self.now) <= STEP, 'it stays old'
        assert self.reader.writer == self.writer.identity, 'it believes another one'


def nanoseconds(moment: float) -> int:
    return round(moment * 1e9)


_LOSSY = ('stop', 'clear', 'blip', 'lost there', 'lost back')
SCENES: dict[str, dict[str, Any]] = {
    'lossy': {'events': _LOSSY},
    'late': {'events': (*_LOSSY, 'late there', 'late back')},
    'swapped': {'events': (*_LOSSY, 'swap there', 'swap back', 'twice there', 'twice back')},
    'wrong': {
        'events': (
            'stop',
            'clear',
            'bad back',
            'twin',
            'crossed',
            'restart',
            'lost back',
            'late back',
        )
    },
}
COUNTS = {
    'lossy': (48, 288),
    'late': (134, 1072),
    'swapped': (60, 600),
    'wrong': (4500, 40500),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=1000)
