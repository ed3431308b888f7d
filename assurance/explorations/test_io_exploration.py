# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every state of the session of an I/O box; see assurance/explorer.py."""

from collections.abc import Sequence
import math
from typing import Any

import pytest

from assurance.explorer import visits_of
from assurance.session_world import SessionWorld
from io_bridge.protocol import gpio_frame, gpio_values
from io_bridge.session import Panel, Session, Settings

pytestmark = pytest.mark.computes
SAID = {  # of both channels, the reset button, in answer to the newest question or not
    'ok': (True, True, False),
    'pressed': (False, False, False),
    'half': (True, False, False),
    'button': (True, True, True),
    'late': (True, True, True),  # the answer to another question
    'silent': (),
}
OUTPUTS = {'STOPPED': (True, False), 'ACTIVE': (False, True)}
OFF = (False, False)
APART = ('lost', 'unexpected', '_offered')  # see Memory
NUMBERS = ('_number', 'number', 'question')


class World(SessionWorld[Session]):
    """A box whose inputs are anything, and a mux; an edge is said as EDGE-ok."""

    ANSWER = 1.5 * SessionWorld.STEP
    LINK = 6 * SessionWorld.STEP
    DISCREPANCY = 3 * SessionWorld.STEP
    DEBOUNCE = 2 * SessionWorld.STEP
    STATE = 4 * SessionWorld.STEP
    CALM = {'box': 'ok', 'mux': 'ACTIVE'}

    def __init__(self, reads: Sequence[str] = (), **said: str) -> None:
        settings = Settings(
            transport='gpio',
            reset_line=2,
            outputs=(('red', 5), ('green', 6)),
            poll_rate=1.0 / self.STEP,
            answer_time=self.ANSWER,
            link_timeout=self.LINK,
            discrepancy_time=self.DISCREPANCY,
            debounce=self.DEBOUNCE,
        )
        old = {
            'asked_at': self.LINK,
            'heard_at': self.LINK,
            'apart_since': self.DISCREPANCY,
            '_disagree_since': self.DISCREPANCY,
            'released_at': self.DEBOUNCE,
            '_released_at': self.DEBOUNCE,
            'state_at': self.STATE,
            'free_at': self.STEP,
            '_horn_until': self.STEP,
            '': self.LINK,
        }
        self.question = 60_000  # none was asked yet; 0 would be an edge
        super().__init__(
            Session(settings), said, reads=reads, old=old, apart=APART, unnamed=NUMBERS
        )
        self.asked_at = -math.inf  # the question that waits for its answer; -inf: none
        self.channels: tuple[bool, ...] | None = None
        self.apart_since = self.released_at = math.inf
        self.faulty = False
        self.state, self.state_at = '', -math.inf
        self.written: tuple[bool, ...] = OFF
        self.button: bool | None = None

    def sound(self) -> bool:
        """Tell whether both channels have said released for long enough, and lately."""
        steady = self.now - self.released_at >= self.DEBOUNCE
        return self.vouched(self.LINK) and steady and not self.is_faulty()

    def is_faulty(self) -> bool:
        return self.faulty or self.now - self.apart_since >= self.DISCREPANCY

    def wanted(self) -> tuple[bool, ...]:
        return OUTPUTS.get(self.state, OFF) if self.now - self.state_at < self.STATE else OFF

    def lapse(self) -> None:
        if self.heard_at is not None and self.now - self.heard_at >= self.LINK:
            self.stop_said, self.heard_at = True, None

    def step(self, event: str) -> None:
        if event in ('unplug', 'plug', 'freeze', 'overflow'):
            self.faulty, self.channels = self.faulty or self.fails_now(event), None
            self.apart_since = self.released_at = math.inf
        super().step(event)

    def fails_now(self, event: str) -> bool:
        """Tell whether a fault has been there by the time of this step."""
        takes = self.STEP * (4 if event == 'freeze' else 1)
        return self.now + takes - self.apart_since >= self.DISCREPANCY

    def hear(self, said: Sequence[str]) -> None:
        frames = []
        for each in said:
            edge, _, what = each.rpartition('-')
            if not SAID[what]:
                continue
            answers = not edge and what != 'late' and self.now - self.asked_at < self.ANSWER
            number = 0 if edge else self.question + (what == 'late')
            frames.append(gpio_frame(b'I', number, SAID[what]))
            if edge or answers:
                self.note(SAID[what])
            if answers:
                self.heard_at, self.asked_at = self.asked_at, -math.inf
        self.keep(self.session.receive(b''.join(frames), self.now))

    def note(self, values: tuple[bool, ...]) -> None:
        """Note what the channels say."""
        self.faulty = self.is_faulty()
        before, self.channels = self.channels, values[:2]
        if self.channels == before:
            return
        if not any(self.channels):
            self.faulty = False
        self.released_at = self.now if all(self.channels) else math.inf
        if all(self.channels) or not any(self.channels):
            self.apart_since = math.inf
        elif math.isinf(self.apart_since):
            self.apart_since = self.now
        self.stop_said |= not all(self.channels)

    def ask(self, name: str, what: str) -> None:
        if what != 'silent':
            self.state, self.state_at = what, self.now
            self.session.set_state(what, self.now)

    def keep(self, output: tuple[list[Any], list[Any]]) -> None:
        super().keep(output)
        for event in output[0]:
            if isinstance(event, Panel):
                self.button = event.reset
        for frame in output[1]:
            kind, number, values = gpio_values(frame, 2)
            assert math.isinf(self.asked_at) or self.now - self.asked_at >= self.ANSWER, 'two'
            if kind == b'R':
                self.question, self.asked_at = number, self.now
            else:
                assert values == self.wanted(), f'{values} in {self.state}'
                self.written = values
                self.keep(self.session.receive(gpio_frame(b'W', number), self.now))

    def judge(self) -> None:
        assert self.verdict.estop == (not self.sound()), f'{self.doing}: {self.verdict}'
        assert self.verdict.own_estop == self.verdict.estop, 'there is no echo'
        lively = self.open and self.heard_at is not None
        assert lively or self.button is None, 'a button that nobody hears'
        if not self.verdict.estop:
            assert self.session.deadline() <= (self.heard_at or 0.0) + self.LINK, 'slept'

    def revive(self) -> None:
        self.play('box pressed', '', 'box ok', *[''] * 4, 'box button', '')
        assert not self.verdict.estop, 'no way out of a stop'
        assert self.button, 'the button does not come'
        assert self.written == OUTPUTS['ACTIVE'], 'outputs do not come'


SCENES: dict[str, dict[str, Any]] = {
    'contacts': {
        'box': 'ok pressed half silent',
        'mux': 'ACTIVE',
        'reads': ('EDGE-pressed EDGE-ok', 'EDGE-half EDGE-ok', 'ok EDGE-half', 'late ok'),
    },
    'mux': {
        'box': 'ok silent late',
        'mux': 'ACTIVE STOPPED silent',
    },
}
COUNTS: dict[str, tuple[int, int]] = {'contacts': (2762, 30246), 'mux': (14318, 111400)}
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=200)
