# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Mux, reset button and whoever publishes on its topic, in every state; see assurance/explorer.py.

The mux's own callback hears the button, with the watch of its publishers, and resets the arbiter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
import math
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest
from std_msgs.msg import Bool

from assurance.explorations.test_safety_mux_exploration import (
    CLEAR,
    Memory as ArbiterMemory,
    STEP,
    TIMEOUT,
)
from assurance.explorer import Memory, Remembered, START, visits_of
from bridge_core import clock, publishers
from bridge_core.publishers import PublisherWatch
from safety_mux import button
from safety_mux.arbiter import Arbiter
from safety_mux.button import ResetButton
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.listening import ButtonTopic
from safety_mux.protocol import OperatorSample, Reply, State
from safety_mux.settings import EStopSource, MuxConfig, Operator

pytestmark = pytest.mark.computes
STALE, LONGEST = 2 * STEP, 4 * STEP  # of the button's messages, of a press
LIVE = 4 * STEP  # for which a publisher may be alive
SETTLING, WINDOW = 2 * STEP, 4 * STEP
FORGOTTEN = 3 * STEP  # by the arbiter
QUIET = 10  # steps, longer than anything is remembered
FAR = 1000  # messages that the other publisher is ahead
REST = OperatorSample(neutral=True, deadman=False, demand=(0.0,))
CONFIG = MuxConfig(
    joints=1,
    sources=(EStopSource('source', TIMEOUT),),
    operators=(Operator('operator', 1, TIMEOUT),),
    clear_time=CLEAR,
    stall_limit=TIMEOUT,
    reset_silence=0.0,
)


class Mux:
    """What of the mux hears the button."""

    hear_button = ButtonTopic.on_message
    _trouble = ButtonTopic._trouble
    _node = SimpleNamespace(get_logger=lambda: SimpleNamespace(info=lambda text: None))

    def __init__(self, world: World) -> None:
        self.world = world
        self._button = ResetButton()
        self._button._watchdog.timeout = STALE
        self._watch = PublisherWatch(WINDOW, SETTLING)
        self._arbiter = world.arbiter
        self._last_state = State.STOPPED
        self._refused_reset: Any = None

    def _stopped(self) -> bool:
        return self._last_state is State.STOPPED

    def _stopped_at(self) -> float:
        return max(self._arbiter.transition.at, self._arbiter.clear_since)

    def _refuse(self, now: float, why: str) -> None:
        self._refused_reset = now, why

    def _reset(self) -> Reply:
        was = self._arbiter.state
        reply = self._arbiter.reset(self.world.now)
        self.world.reset = reply.ok and was is State.STOPPED
        return reply


class World(Remembered):
    """
    A button that says in each step whether it is pressed, a stop source, and the mux.

    A step is one of: nothing new (''), 'WHO WHAT' (says something else from now on), 'bounce' (the
    button says the other thing, and at once again what it said), 'lost' (its message does not
    arrive), 'restart' (its publisher begins anew), 'other up' and 'other down' (of a second one).
    """

    def __init__(self, events: str = '', **words: str) -> None:
        self.now = START
        self.events = tuple(events.replace('-', ' ').split(','))
        self.words = {name: each.split() for name, each in words.items()}
        self.doing = {'button': 'up', 'source': 'clear'}
        self.number = FAR
        self.said = 'up'
        self.heard_at = -math.inf
        self.free_at = -math.inf  # the button was last heard to be up, before this press
        self.pressed_at = -math.inf
        self.wrong_at = START  # the last moment of which no press may be
        limiter = JointLimiter([JointLimit(1.0, 1.0 / STEP, 0.5 / STEP)], max_dt=1.0)
        self.arbiter = Arbiter(CONFIG, limiter, self.now)
        self.source_at = START  # the source was heard
        self.reset = False  # the mux, by the last message
        self.mux: Any = Mux(self)
        self.memory = Memory(self, OLD, APART)
        self.naming = Memory(self, OLD, (*APART, 'arbiter', '_arbiter'), SAID_AGAIN)
        self.of_arbiter = ArbiterMemory(self.arbiter, FORGOTTEN)
        self.step('')

    def possible(self) -> Iterator[str]:
        yield ''
        yield from self.events if self.doing['button'] != 'silent' else ()
        for name, words in self.words.items():
            yield from (f'{name} {what}' for what in words if what != self.doing[name])

    def step(self, event: str) -> None:
        limits = patch.multiple(button, LONGEST=LONGEST)
        with (
            limits,
            patch.object(clock, 'now', lambda: self.now),
            patch.object(publishers, '_LIVE', LIVE),
        ):
            self.take_step(event)
        self.count_anew()

    def take_step(self, event: str) -> None:
        self.now += STEP
        name, _, what = event.partition(' ')
        if name in self.doing:
            self.doing[name] = what
        if name == 'restart':
            self.number = 0
            self.wrong_at = self.now
        if name == 'other':
            self.wrong_at = self.now
            self.hear(what, self.number + FAR)
        self.number += self.doing['button'] != 'silent'
        if event == 'lost':
            self.wrong_at = self.now
        elif self.doing['button'] != 'silent':
            said = self.doing['button']
            both = ('up' if said == 'down' else 'down', said) if event == 'bounce' else (said,)
            for n, each in enumerate(both):
                self.number += n
                self.hear(each, self.number)
        if self.doing['source'] != 'silent':
            self.source_at = self.now
            self.arbiter.estop_message('source', self.doing['source'] == 'stop', self.now)
        self.arbiter.operator_sample('operator', REST, self.now)
        decision = self.arbiter.tick(self.now)
        stops = self.doing['source'] == 'stop' or self.now - self.source_at >= TIMEOUT
        if stops or decision.state is not State.STOPPED:
            self.wrong_at = self.now
        self.mux._last_state = decision.state
        self.changed_at = self.arbiter.transition.at
        self.mux._watch.counted(1)

    def hear(self, said: str, number: int) -> None:
        """Have the mux hear a message, and judge what comes of it."""
        if self.now - self.heard_at >= STALE:
            self.wrong_at = self.now
        if said == 'down' and self.said == 'up':
            self.free_at, self.pressed_at = self.heard_at, self.now
        self.reset = False
        was, self.said, self.heard_at = self.said, said, self.now
        self.mux.hear_button(Bool(data=said == 'down'), {'publication_sequence_number': number})
        if self.reset:
            assert (was, said) == ('down', 'up'), 'a reset that is no release'
            assert self.wrong_at <= self.free_at, 'a reset by a press that something is wrong with'
            assert STEP <= self.now - self.pressed_at <= LONGEST, 'a press of another length'

    def arrived(self) -> None:
        """Once all are in order, a press resets a mux that is stopped."""
        self.doing = {'button': 'up', 'source': 'clear'}
        self.play(*[''] * QUIET)
        if self.arbiter.state is State.STOPPED:
            self.play('button down', '', 'button up')
        assert self.arbiter.state is not State.STOPPED, f'no way out: {self.mux._refused_reset}'

    def count_anew(self) -> None:
        """Forget what decides nothing, and have the newest number as ever: so states end."""
        pressed, stale = self.mux._button, self.now - self.heard_at >= STALE
        if self.said == 'up':  # what was of a press decides nothing any more
            pressed._since, pressed._fault, pressed.free_at = 0.0, '', -math.inf
            self.pressed_at = self.free_at = -math.inf
        elif pressed._fault or stale:  # nor does more of one that does not count
            pressed._since, pressed._fault = 0.0, 'wrong'
        since = self.heard_at if self.said == 'up' else self.free_at
        if self.wrong_at <= since or stale:
            self.wrong_at = -math.inf
        else:
            self.wrong_at = self.now if self.said == 'up' else self.pressed_at
        if self.changed_at <= since or stale:
            self.changed_at = -math.inf
        watch, more = self.mux._watch, FAR - self.number
        self.number = FAR
        watch._last = self.counted_anew(watch._last, more)
        watch._former = self.counted_anew(watch._former, more)
        if watch._former is not None and self.now - watch._former[1] > LIVE:
            watch._former = None

    def counted_anew(self, last: tuple[int, float] | None, more: int) -> tuple[int, float] | None:
        if last is None:
            return None
        number, at = last[0] + more, last[1]
        return (number if self.now - at <= LIVE else max(number, FAR - 2)), at

    def key(self) -> tuple[Any, ...]:
        return self.naming.key() + self.of_arbiter.key(self.now)

    def give(self, memory: Any) -> None:
        super().give(memory)
        last = self.arbiter.transition
        self.arbiter.transition = replace(last, at=self.changed_at)


APART = (
    *('memory', 'naming', 'of_arbiter', 'now', 'words', 'events', 'config', 'transition'),
    *('reset', '_refused_reset'),
)
SAID_AGAIN = ('heard_at', 'free_at', 'pressed_at', 'source_at')
OLD = {'': LONGEST + STALE, '_heard_at': STALE, 'source_at': TIMEOUT, '_last': LIVE}  # see Memory
SCENES: dict[str, dict[str, str]] = {
    'sources': {
        'events': 'bounce,lost',
        'button': 'up down silent',
        'source': 'clear stop silent',
    },
    'publishers': {
        'events': 'lost,restart,other-up,other-down',
        'button': 'up down',
        'source': 'clear stop',
    },
}
COUNTS: dict[str, tuple[int, int]] = {
    'sources': (3087, 19989),
    'publishers': (12458, 87206),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=200)
