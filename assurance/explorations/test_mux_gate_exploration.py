# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every state of an actuator's gate and its mux, with a network between them.

Property: nothing goes out on what the mux has taken back for longer than the limit, however late
or lost its words are; a stop or a fall of enable that came and went is never missed; the gate
opens by an edge alone that came after it was shut. Once the network is in order, an edge opens it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, TypeVar

import pytest

from assurance.explorer import Memory, Remembered, START, visits_of
from bridge_core.actuator import ActuatorSession
from bridge_core.framing import Counters
from bridge_core.gate import Gate, Policy, State
from bridge_core.mux_words import MuxWords
from bridge_core.proof import Proof, Reader
from bridge_core.reasons import Coded
from bridge_core.session import Asked, Verdict

pytestmark = pytest.mark.computes
STEP = 0.125
LIMIT = 2 * STEP
SILENCE = 4 * STEP  # of the gate's inputs
LATE = 3  # steps that a late message takes
READER, WRITER = 1, 7


@dataclass(slots=True)
class Said:
    """What the mux said at a moment. :param asked: it returns this challenge; -inf: none."""

    at: float
    estop: bool
    enable: bool
    number: int
    stops: int
    falls: int
    asked: float

    def proof(self) -> bytes:
        answers = () if self.asked == -math.inf else ((READER, round(self.asked * 1e9)),)
        numbers = (self.number, self.stops, self.falls)
        flags = (self.estop, not self.enable, self.enable)
        return Proof(WRITER, *numbers, *flags, 0, answers).to_bytes()


def carried(queue: list[SaidT], newest: SaidT, way: str) -> list[SaidT]:
    """Return what arrives, in its order."""
    queue.append(replace(newest))
    arrives, queue[:] = (queue[:-LATE], queue[-LATE:]) if way == 'late' else (list(queue), [])
    return [] if way == 'cut' else arrives


def renumber(reader: Reader, ways: Sequence[Said], now: float) -> None:
    """Have numbers and counts come from the same one on, as in every state."""
    for name, of_reader in (('number', '_number'), ('stops', '_stops'), ('falls', '_own_stops')):
        values = {getattr(said, name) for said in ways} | {getattr(reader, of_reader)}
        ranks = {value: rank for rank, value in enumerate(sorted(values), 1)}
        for said in ways:
            setattr(said, name, ranks[getattr(said, name)])
        setattr(reader, of_reader, ranks[getattr(reader, of_reader)])
    asked = reader._asked
    while asked and asked[0] < now - (LATE + 1) * STEP:
        asked.popleft()


SaidT = TypeVar('SaidT', bound=Said)


class NoDecoder:
    """Of a line that says nothing."""

    deadline = math.inf
    held_up = 0.0
    counters = Counters()

    def feed(self, data: bytes, now: float) -> list[bytes]:
        return []

    def poll(self, now: float) -> list[bytes]:
        return []

    def reset(self) -> None: ...


class Actuator(ActuatorSession[bytes, bytes, Any]):
    """One gate with the three inputs; its device is always well."""

    def __init__(self, *, required: bool) -> None:
        words = MuxWords('/mux', required=required, age_limit=LIMIT, identity=READER)
        words._age.hold = 0.0  # it is in the world of test_mux_words_exploration
        super().__init__(NoDecoder(), 1.0, words)  # type: ignore[arg-type]
        self.gate = Gate(Policy(stop=SILENCE, enable=SILENCE, command=SILENCE))
        self.was_shut = False  # since the world has looked

    def _obey_stop(self, value: bool, now: float) -> None:
        self.gate.hear_stop(value, now)
        self._refresh(now)

    def _obey_enable(self, value: bool | None, now: float, *, fell: bool = False) -> None:
        value = None if fell and self.gate.state is State.SHUT else value
        self.gate.hear_enable(value, now, self.mux.stops(now))
        self._refresh(now)

    def set_enable(self, value: bool, now: float) -> None:
        self._expire(now)
        self._obey_enable(self.mux.hear_enable(value, now), now)

    def _follow(self, now: float) -> None:
        self.gate.watch(now, self.mux.stops(now))
        self.was_shut |= self.gate.state is State.SHUT

    def _expires_at(self) -> float:
        return min(super()._expires_at(), self.gate.deadline)

    def _take(self, message: bytes, now: float) -> None: ...

    def _verdict(self, now: float) -> Verdict:
        return Verdict()

    def _judge(self, now: float) -> Verdict:
        return Verdict()

    def _silence(self, now: float) -> Coded:
        return self.CLOSED


class World(Remembered):
    """
    A step: the mux speaks, it answers a challenge, and what arrives is heard.

    :param ways: what the ways of plain messages and of proofs may become. :param says: what the
        mux may do; 'blip' is a stop, 'dip' a fall of enable that is over before it was heard.
    """

    def __init__(self, *, plain: str, proofs: str, says: str, required: bool = False) -> None:
        self.now = START
        self.words = {'plain': plain.split(), 'proofs': proofs.split()}
        self.says = says.split()
        self.ways = dict.fromkeys(self.words, 'joined')
        self.queues: dict[str, list[Said]] = {'plain': [], 'proofs': []}
        self.session = Actuator(required=required)
        self.session.opened(self.now)
        self.mux = Said(self.now, True, False, 1, 0, 0, -math.inf)
        self.rose_at = self.fell_at = self.now
        self.owed_at = math.inf  # since when what goes out is taken back
        never = ('_stopped_at', '_disabled_at', '_old_at')
        old = {'': SILENCE, 'at': (LATE + 1) * STEP, '_old_at': 0.0}
        apart = (
            *('memory', 'words', 'says', 'counters', 'damaged', 'repeated', 'unasked'),
            *('last_stop', '_worst', '_worst_before', '_worst_since', '_pacer', '_interrupted_at'),
            *('_heard_at', '_second_at', 'hold'),
        )
        unnamed = ('_quiet_until', '_stepped_at')
        self.memory = Memory(self, old, apart, unnamed, never)

    def possible(self) -> Iterator[str]:
        yield ''
        yield from self.says
        for name, words in self.words.items():
            yield from (f'{name} {way}' for way in words if way != self.ways[name])

    def step(self, event: str) -> None:
        self.now += STEP
        session, was_open = self.session, self.session.gate.is_open
        name, _, what = event.partition(' ')
        if name in self.ways:
            self.ways[name] = what
        else:
            self.speak(event)
        session.was_shut = False
        asked = session.mux.ask(self.now)
        assert isinstance(asked, Asked)
        self.mux.asked, self.mux.at = self.now, self.now
        self.mux.number += 1
        for said in self.carry('plain'):
            session.set_estop(said.estop, self.now)
            session.set_enable(said.enable, self.now)
        for said in self.carry('proofs'):
            session.hear_proof(said.proof(), self.now)
        session._expire(self.now)
        session.gate.hear_command(self.now, session.mux.stops(self.now), neutral=False)
        session.gate.proceed(self.now)
        session.poll(self.now)
        self.judge(was_open=was_open)
        self.renumber()

    def speak(self, event: str) -> None:
        mux, enabled = self.mux, self.mux.enable
        if event in ('stop', 'blip'):
            mux.stops += not mux.estop
            mux.estop, mux.enable = event == 'stop', False
            self.fell_at = self.now
        elif event == 'clear':
            mux.estop = False
        elif event in ('disable', 'dip'):
            mux.enable = False
        elif event == 'enable' and not mux.estop and not enabled:
            mux.enable, self.rose_at = True, self.now
        if enabled and not mux.enable:
            mux.falls, self.fell_at = mux.falls + 1, self.now
        if event == 'dip' and enabled:
            mux.enable, self.rose_at = True, self.now

    def carry(self, name: str) -> list[Said]:
        """Return what arrives, in its order."""
        return carried(self.queues[name], self.mux, self.ways[name])

    def judge(self, *, was_open: bool) -> None:
        session, now = self.session, self.now
        is_open = session.gate.is_open
        if was_open and self.fell_at == now:
            self.owed_at = min(self.owed_at, now)
        if session.was_shut or not was_open:
            self.owed_at = math.inf
        if not is_open:
            return
        if session.was_shut or not was_open:
            assert self.rose_at >= now - LIMIT - 2 * STEP, 'it opens without an edge'
            if not self.mux.enable:
                self.owed_at = self.fell_at
        if session.mux.is_proven:
            assert now - self.owed_at < LIMIT + STEP, 'it goes by what was taken back'

    def renumber(self) -> None:
        """Have numbers and counts come from the same one on, as in every state."""
        for said in self.queues['plain']:
            said.number = said.stops = said.falls = 0
        renumber(self.session.mux._reader, [self.mux, *self.queues['proofs']], self.now)

    def arrived(self) -> None:
        """See that a network in order, and an edge, open it."""
        self.play('plain joined', 'proofs joined', 'clear', 'disable', *4 * ('',))
        self.play('enable', *3 * ('',))
        assert self.session.gate.is_open, self.session.gate.reasons(
            self.now, self.session.mux.stops(self.now)
        )


_ALL = 'stop clear enable disable'
SCENES: dict[str, dict[str, Any]] = {
    'late': {'plain': 'joined late', 'proofs': 'joined late', 'says': _ALL, 'required': True},
    'lost': {'plain': 'joined cut', 'proofs': 'joined cut', 'says': f'{_ALL} blip dip'},
    'both': {
        'plain': 'joined late cut',
        'proofs': 'joined late cut',
        'says': 'stop clear enable blip',
        'required': True,
    },
}
COUNTS = {
    'late': (8056, 56392),
    'lost': (16752, 150768),
    'both': (90421, 813789),
}  # states, and steps
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=300)
