# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Every state in which the Akron session judges motion by itself, or pauses it; see explorer."""

from collections.abc import Iterator, Sequence
import math
from typing import Any

import pytest

from test.akron_session_rig import (
    DEPLOY,
    ef,
    joystick,
    MOVING,
    NEUTRAL,
    OSCILLATE,
    OSCILLATES,
    OURS,
    OUTPUTS,
    PAUSE,
    REST,
)
from test.explorer import check, explore, visits_of
from test.test_akron_exploration import FOREIGN, STICK, World as AkronWorld

pytestmark = pytest.mark.computes
STARTING = bytes.fromhex('0100010000010000')  # switch 4
DEPLOYING = bytes.fromhex('0100010000000100')  # switch 8
ANGLES = (ef('0100040371000041'), ef('010A040371000041'))  # a degree apart
LIMITS = (ef('81FED401C200'), OSCILLATES)
TURNING = ('turns', 'oscillates', 'crowded')
OSCILLATING = ('oscillates', 'crowded', 'paused')
HOLD = 0.5  # s after its last step for which a unit counts as moving
PRESS = 0.2  # s for which switch 7 is held


# Of travels: they decide nothing where none begins.
OF_TRAVELS = ('_heard_at', '_still_since')


class World(AkronWorld):
    """A unit that moves or not, and oscillates or not, whatever is asked of it."""

    STEP = 0.25
    LINK = FRESH = 2 * STEP
    COAST = 3 * STEP
    CALM = {'unit': 'still', 'estop': 'clear', 'stick': 'rest'}
    APART: Sequence[str] = (
        'refused', 'moves', 'other_frames', '_stream', '_names', '_due', '_asked_at',
        '_handover', '_before', '_measured', *OF_TRAVELS,
    )  # fmt: skip
    OLD = {
        '_pause_until': 0.0,
        **dict.fromkeys(('_stopped_at', 'stop_at', 'over_at', 'run_at', 'began_at'), COAST),
        **dict.fromkeys(('asked_until', 'pushed_until', '_automatic_until', 'taken_at'), COAST),
        **dict.fromkeys(('steered_until', 'steered'), COAST + 2 * HOLD),
        'pressed_at': PRESS,
    }
    # It tells of its faults unasked; and why one does not listen is words.
    UNNAMED = ('_faults_at', '_interruption')
    NEVER: Sequence[str] = (
        *('pushed_until', 'run_at', 'taken_at', 'steered', 'stop_at', 'pressed_at', 'asked_until'),
        *('_automatic_until', 'began_at', 'runs_since', 'steered_until', '_stopped_at'),
        *('interrupted_at', '_interrupted_at'),
    )
    OPTIONS = {'coast_time': COAST, 'automatic_motion': True}
    STICKS = {**AkronWorld.STICKS, 'oscillate': (OSCILLATE, STARTING)}

    def __init__(self, reads: Sequence[str] = (), **said: str) -> None:
        self.side = False  # of its two angles
        self.seen = False  # an angle, since all was forgotten
        self.steps: tuple[float, ...] = ()  # the last two moments of steps, of a run
        self.run_at = -math.inf  # when it began
        self.oscillates = False
        self.pushed_until = -math.inf  # until when our frames ask for motion
        self.steered = -math.inf
        self.by_itself = False  # our frames asked for such motion since the last stop
        self.taken_at = -math.inf  # when a stop took that back
        self.stop_at = -math.inf  # when the last stop began
        self.over_at = -math.inf  # and ended
        self.pressed_at = -math.inf
        self.presses = 0  # in this stop
        super().__init__(reads, **said)

    def key(self) -> tuple[Any, ...]:
        """Name the state, without what decides nothing in it."""
        session, motion, drive = self.session, self.session.motion, self.session.drive
        nameless: list[tuple[Any, str, float]] = []  # and what stands there for any value
        if not motion.moving(self.now):
            nameless += [(motion, 'runs_since', -math.inf)]
            if self.now >= motion.ends_at:  # or the step before may have been the first
                nameless += [(motion, 'began_at', -math.inf)]
            if self.now >= drive.steered_until + self.COAST:
                nameless += [(drive, 'steered_until', -math.inf)]
        if not session._travels:
            nameless += [(session, '_travel_at', -math.inf)]
            if self.now >= motion.ends_at:
                nameless += [(motion, '_stepped_at', -math.inf)]
        if self.now >= session._pause_until:
            nameless += [(session, '_stopped_at', -math.inf)]
        stood = motion._heard_at - motion._still_since
        if self.now >= motion._heard_at + HOLD or not stood < HOLD:
            stood = HOLD * (self.now < motion._heard_at + HOLD)
            nameless += [(motion, '_still_since', motion._heard_at - stood)]
        values = [getattr(each, name) for each, name, _ in nameless]
        for each, name, value in nameless:
            setattr(each, name, value)
        key = super().key()
        for (each, name, _), value in zip(nameless, values, strict=True):
            setattr(each, name, value)
        return key

    def sound(self) -> bool:
        return super().sound() and not self.unasked()

    def unasked(self) -> bool:
        """Tell whether the unit has moved for long though nobody asks for it."""
        asked_until = max(self.run_at, self.pushed_until, self.taken_at)
        moves = len(self.steps) > 1
        return moves and not self.by_itself and self.now >= asked_until + self.COAST

    def possible(self) -> Iterator[str]:
        return (step for step in super().possible() if step != 'overflow')  # as a freeze

    def lapse(self) -> None:
        if self.heard_at is None:
            self.seen, self.steps, self.oscillates = False, (), False
        if self.steps and self.now - self.steps[-1] >= HOLD:
            self.steps = ()
        if not self.steps:
            self.run_at = -math.inf
        super().lapse()

    def hear(self, said: Sequence[str]) -> None:
        for each in said:
            oscillates, turns = each in OSCILLATING, each in TURNING
            self.side ^= turns
            if each == 'crowded':
                self.keep(self.session.receive(joystick(), self.now))
                self.foreign_at, self.stop_said = self.now, True
            frames = (*self.answers('ok'), OUTPUTS, LIMITS[oscillates], ANGLES[self.side])
            for frame in frames:
                self.keep(self.session.receive(frame, self.now))
            self.heard_at = self.known['outputs'] = self.now
            self.known['enabled'], self.known['faults'] = True, 'none'
            self.oscillates = oscillates
            if turns and self.seen:
                self.note_step()
            self.seen = True
            self.watch()

    def watch(self) -> None:
        super().watch()
        if self.clear() and not self.verdict.estop:
            self.over_at = min(self.over_at, self.now)
        elif self.over_at < math.inf:  # or it began anew in this step
            self.stop_at, self.over_at, self.presses = self.now, math.inf, 0

    def note_step(self) -> None:
        if not self.steps:
            self.run_at = self.now
        if self.now not in self.steps:
            self.steps = (*self.steps[-1:], self.now)

    def judge(self) -> None:
        sticks = [frame.data for frame in self.frames if frame.identifier == STICK]
        still = joystick(NEUTRAL.hex(), OURS)  # what a press is, but for its switch
        self.frames = [still if frame.data == PAUSE else frame for frame in self.frames]
        super().judge()
        self.judge_press(PAUSE in sticks)
        starts = STARTING in sticks or DEPLOYING in sticks
        pushing = bool(sticks) and sticks[-1] in (MOVING, STARTING, DEPLOYING)
        if pushing or self.pushed_until == math.inf:
            self.pushed_until = math.inf if pushing else self.now
        steering = MOVING in sticks[-1:]
        if steering or self.steered == math.inf:
            self.steered = math.inf if steering else self.now
        self.by_itself |= starts
        if self.over_at == math.inf and self.by_itself:
            self.by_itself, self.taken_at = False, self.now
        said = any('though nobody asks' in reason for reason in self.session.verdict.reasons)
        assert said == self.unasked() or not self.vouched(self.LINK), 'whether it moves by itself'

    def judge_press(self, pressed: bool) -> None:
        """Check that a press pauses what surely runs, and never resumes what is paused."""
        if not pressed or self.now - self.pressed_at < PRESS:
            return
        self.pressed_at = self.now
        self.presses += 1
        assert self.now <= self.over_at, 'switch 7 without a stop'
        assert self.presses == 1, 'switch 7 twice in a stop'
        assert self.oscillates, 'nothing oscillates'
        assert self.now - self.foreign_at >= FOREIGN, 'whose switch is pressed, too?'
        assert len(self.steps) > 1, 'one step is no motion'
        assert self.steps[0] > self.stop_at, 'it may have been paused since'
        assert self.steps[0] >= self.steered + self.COAST, 'it may coast'

    def revive(self) -> None:
        super().revive()
        self.play('stick rest', 'stick oscillate', 'unit oscillates', 'stick rest', *[''] * 8)
        assert not self.verdict.estop, 'no oscillation that was asked for'
        self.play('estop stop', '', '')
        assert self.presses == 1, 'an oscillation goes on in a stop'


SCENES: dict[str, dict[str, Any]] = {
    'stops': {
        'unit': 'still oscillates paused',
        'estop': 'clear stop',
        'stick': 'rest',
    },
    'sticks': {
        'unit': 'still turns',
        'estop': 'clear',
        'stick': 'rest move oscillate',
    },
    'neighbours': {
        'unit': 'still oscillates crowded',
        'estop': 'clear',
        'stick': 'rest',
    },
    'together': {
        'unit': 'still turns oscillates paused',
        'estop': 'clear stop',
        'stick': 'rest move oscillate',
    },
}
COUNTS: dict[str, tuple[int, int]] = {
    'stops': (2752, 18577),
    'sticks': (5291, 35508),
    'neighbours': (2936, 17075),
    'together': (55428, 538655),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=100)


class Sent(World):
    """
    A unit that is sent somewhere, and says all along that it oscillates, as when that is paused.

    Motion is the travel where it begins within ``coast_time`` of asking, until it has stood.
    """

    CALM = {'unit': 'paused', 'estop': 'clear', 'stick': 'rest'}
    APART = tuple(name for name in World.APART if name not in OF_TRAVELS)
    OLD = {
        **World.OLD,
        'turned_at': HOLD,
        '_heard_at': HOLD,
        '_still_since': 2 * HOLD,
        'sent_at': World.COAST,
        '_travel_at': World.COAST + HOLD,
    }
    STICKS = {'rest': (REST, NEUTRAL), 'deploy': (DEPLOY, DEPLOYING)}

    def __init__(self, reads: Sequence[str] = (), **said: str) -> None:
        self.travels = self.crept = False
        self.sent_at = -math.inf  # somewhere, last
        self.turned_at = -math.inf  # heard or not
        super().__init__(reads, **said)

    def hear(self, said: Sequence[str]) -> None:
        super().hear([each for each in said if each != 'unheard'])

    def judge(self) -> None:
        if self.crept or self.doing['unit'] in ('oscillates', 'unheard'):
            self.turned_at = self.now
            self.travels |= self.now - self.sent_at < self.COAST
        elif self.now - max(self.turned_at, self.sent_at + self.COAST - HOLD) >= HOLD:
            self.travels = False
        super().judge()
        if any(frame.data == DEPLOYING for frame in self.frames if frame.identifier == STICK):
            self.sent_at = self.now
            self.travels |= self.turned_at == self.now

    def judge_press(self, pressed: bool) -> None:
        super().judge_press(pressed)
        assert not (pressed and self.travels), 'a travel is no oscillation'

    def revive(self) -> None:
        self.play(*[''] * 8, 'unit oscillates', '', 'estop stop', '', '')
        assert self.presses == 1, 'an oscillation goes on in a stop'


class Creeping(Sent):
    """One that may begin with 'creep': it turns, and not so far yet that it could be seen."""

    def possible(self) -> Iterator[str]:
        yield from super().possible()
        if self.open and self.doing['unit'] == 'paused' and self.now - self.turned_at >= HOLD:
            yield 'creep'

    def step(self, event: str) -> None:
        self.crept = event == 'creep'
        super().step('' if self.crept else event)


SENT = {'unit': 'paused oscillates unheard', 'estop': 'clear stop', 'stick': 'rest deploy'}


@pytest.mark.parametrize('most', [100, pytest.param(math.inf, marks=pytest.mark.proof)])
def test_no_stop_takes_a_travel_for_an_oscillation(most: float) -> None:
    check(Sent(**SENT), 'here.Sent(**here.SENT)', (35342, 275467), most)


@pytest.mark.parametrize('most', [100, pytest.param(10_000, marks=pytest.mark.proof)])
def test_nor_one_that_begins_unseen(most: int) -> None:
    """There are more states than anybody has waited for."""
    explore(Creeping(**SENT), 'here.Creeping(**here.SENT)', most)
