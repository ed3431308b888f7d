# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every state of an actuator's side of the proofs, and of its mux, with a channel between them.

Property: once proofs are needed, nothing may move on words that are older than the limit, or were
not long ago, nor while a stop of before the limit was not obeyed, whatever plain messages say. A
stop that a proof tells of is obeyed, even if it is over. Once the channel is in order, motion is
possible again.
"""

from __future__ import annotations

import math
from typing import Any

import pytest

from assurance.explorations.test_proof_exploration import (
    LATELY,
    READER,
    SILENCE,
    STEP,
    World,
    WRITERS,
)
from assurance.explorer import Memory, visits_of
from bridge_core.mux_words import MuxWords
from bridge_core.proof import TOGETHER_TIME, Writer

pytestmark = pytest.mark.computes
LIMIT = HOLD = 2 * STEP


class MuxWorld(World):
    """
    As World, but the mux's words are what is heard.

    'plain clear' is a plain message by which it stops nothing and enables, old or new; 'plain
    stop' is the contrary.
    """

    def __init__(self, events: tuple[str, ...]) -> None:
        super().__init__(events)
        self.words = MuxWords('/mux', required=True, age_limit=LIMIT, identity=READER)
        self.words._reader._silence = SILENCE
        self.words._age.hold = HOLD
        self.old_at = -math.inf  # when the words were too old last
        self.reader = self.words._reader
        self.writer = Writer(WRITERS[0], LATELY)
        self.say(True)
        old = {'': SILENCE + STEP, '_second_at': TOGETHER_TIME, '_asked': 4 * STEP}
        old |= {'as_of': 4 * STEP, 'there': 4 * STEP, 'back': 4 * STEP}
        old |= {'_old_at': HOLD, 'old_at': HOLD}
        old |= {'_stopped_at': 4 * STEP, '_disabled_at': 4 * STEP, 'began_at': 4 * STEP}
        apart = ['events', 'memory', 'now', 'damaged', 'repeated', 'unasked']
        apart += ['_pacer', '_worst', '_vouched', '_command_age', 'hold']
        never = ('_second_at', '_stopped_at', '_disabled_at', '_old_at', 'old_at')
        self.memory = Memory(self, old, apart, never=never)

    def step(self, event: str) -> None:
        known = not self.reader.is_doubled(self.now)  # else nothing is trusted, young or old
        if known and -math.inf < self.reader.as_of <= self.now + STEP - LIMIT:
            self.old_at = self.now + STEP
        super().step(event)
        if event in ('plain clear', 'plain stop'):
            self.words.hear_stop(event == 'plain stop', self.now)
            self.words.hear_enable(event == 'plain clear', self.now)
        if self.moves:
            assert self.reader.as_of > self.now - LIMIT, 'it moves on old words'
            assert self.began_at > self.reader.as_of, 'it moves, as a stop was never obeyed'
            assert self.now >= self.old_at + HOLD, 'it moves, as words were old not long ago'

    @property
    def moves(self) -> bool:
        """Nothing here forbids motion."""
        words = self.words
        return not words._stop and words._enable and not words.stops(self.now)

    def listen(self, data: bytes) -> bool | None:
        proven = self.words.hear_proof(data, self.now)
        return None if proven is None else proven.estop

    def arrived(self) -> None:
        """See that motion is possible again over a channel in order, after a twin is gone."""
        super().arrived()
        self.play('', '')
        assert self.moves, 'nothing can move any more'


_LOSSY = ('stop', 'clear', 'blip', 'lost there', 'lost back', 'plain clear', 'plain stop')
SCENES: dict[str, dict[str, Any]] = {
    'lossy': {'events': _LOSSY},
    'late': {'events': (*_LOSSY, 'late there', 'late back')},
    'swapped': {'events': (*_LOSSY, 'swap back', 'twice back')},
    'wrong': {
        'events': (
            'stop',
            'clear',
            'blip',
            'bad back',
            'twin',
            'restart',
            'late back',
            'plain clear',
        )
    },
}
COUNTS = {
    'lossy': (153, 1224),
    'late': (379, 3790),
    'swapped': (187, 1870),
    'wrong': (4660, 41940),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(MuxWorld, SCENES, COUNTS, near=1000)
