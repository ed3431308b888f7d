# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every state in which the Akron session judges motion by itself, or pauses it; see explorer."""

from collections.abc import Iterator, Mapping, Sequence
import math
from typing import Any

import pytest

from assurance.explorations.test_akron_exploration import FOREIGN, STICK, World as AkronWorld
from assurance.explorer import visits_of
from stage.akron_session_rig import (
    ef,
    joystick,
    MOVING,
    NEUTRAL,
    OSCILLATE,
    OSCILLATES,
    OURS,
    OUTPUTS,
    PAUSE,
    STANDS,
)

pytestmark = pytest.mark.computes
STARTING = bytes.fromhex('0100010000010000')  # switch 4
ANGLES = (ef('0100040371000041'), ef('010A040371000041'))  # a degree apart
LIMITS = (STANDS, OSCILLATES)
# What type 81 tells, and whether the angles change. A hand on the unit's own switches is 'turns',
# or where a unit says "oscillating" in a pause, 'oscillates'; it comes and goes as it likes.
TURNING = ('turns', 'oscillates', 'crowded')
OSCILLATING = ('oscillates', 'crowded', 'paused')
HOLD = 0.5  # s after its last step for which a unit counts as moving


class World(AkronWorld):
    """A unit that moves or not, and oscillates or not, whatever is asked of it."""

    STEP = 0.25
    LINK = FRESH = 2 * STEP
    COAST = 3 * STEP
    CALM = {'unit': 'still', 'estop': 'clear', 'stick': 'rest'}
    APART: Sequence[str] = (
        'refused', 'moves', 'other_frames', '_stream', '_names', '_due', '_asked_at',
        '_reported', 'presses',
    )  # fmt: skip
    OLD: Mapping[str, float] = {
        **dict.fromkeys(('_press_until', '_asked_until'), 0.0),
        **dict.fromkeys(('over_at', 'run_at', 'began_at', 'starting_at'), COAST),
        **dict.fromkeys(('asked_until', 'pushed_until', '_automatic_until', 'taken_at'), COAST),
        **dict.fromkeys(('pressed_at', '_pressed_at'), COAST),
    }
    # It tells of its faults unasked; and why one does not listen is words.
    UNNAMED = ('_faults_at', '_interruption')
    NEVER: Sequence[str] = (
        *('pushed_until', 'run_at', 'taken_at', 'asked_until', 'starting_at'),
        *('_automatic_until', 'began_at', '_asked_until', '_press_until'),
        *('interrupted_at', '_interrupted_at'),
    )
    OPTIONS: Mapping[str, Any] = {'coast_time': COAST, 'automatic_motion': True}
    STICKS = {**AkronWorld.STICKS, 'oscillate': (OSCILLATE, STARTING)}

    def __init__(self, reads: Sequence[str] = (), **said: str) -> None:
        self.side = False  # of its two angles
        self.seen = False  # an angle, since all was forgotten
        self.steps: tuple[float, ...] = ()  # the last two moments of steps, of a run
        self.run_at = -math.inf  # when it began
        self.oscillates: bool | None = None  # as it said last
        self.pushed_until = -math.inf  # until when our frames ask for motion
        self.starting_at = -math.inf  # when they last asked it to oscillate
        self.by_itself = False  # our frames asked for such motion since the last stop
        self.taken_at = -math.inf  # when a stop took that back
        self.over_at = -math.inf  # when the last stop ended
        self.is_ours = self.lied = False
        self.pressed_at = -math.inf  # for the oscillation that it tells of
        super().__init__(reads, **said)
        self.session.drive.said.timeout = HOLD  # steps are longer than what a unit remembers

    def key(self) -> tuple[Any, ...]:
        """Name the state, without a run that is over."""
        motion, began_at = self.session.motion, self.session.motion.began_at
        if self.now >= motion.ends_at:
            motion.began_at = -math.inf
        key = super().key()
        motion.began_at = began_at
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
            self.seen, self.steps, self.oscillates = False, (), None
        if not self.vouched(self.LINK):
            self.is_ours, self.oscillates, self.pressed_at = False, None, -math.inf
        if self.steps and self.now - self.steps[-1] >= HOLD:
            self.steps = ()
        if not self.steps:
            self.run_at = -math.inf
        super().lapse()

    def hear(self, said: Sequence[str]) -> None:
        for each in said:
            turns = each in TURNING
            self.side ^= turns
            if each == 'crowded':
                self.keep(self.session.receive(joystick(), self.now))
                self.foreign_at, self.stop_said = self.now, True
                self.is_ours, self.pressed_at = False, -math.inf
            self.note_oscillation(each in OSCILLATING)
            frames = (*self.answers('ok'), OUTPUTS, ANGLES[self.side], LIMITS[each in OSCILLATING])
            for frame in frames:
                self.keep(self.session.receive(frame, self.now))
            self.heard_at = self.known['outputs'] = self.now
            self.known['enabled'], self.known['faults'] = True, 'none'
            if turns and self.seen:
                self.note_step()
            self.seen = True
            self.watch()

    def note_oscillation(self, oscillates: bool) -> None:
        """Note what type 81 tells, and whose it is: of 'oscillating' that follows our switch."""
        asked = self.now - self.starting_at < self.COAST and self.now - self.foreign_at >= FOREIGN
        begins = self.oscillates is False and asked
        self.is_ours = oscillates and (self.is_ours or begins)
        self.pressed_at = self.pressed_at if oscillates else -math.inf
        told_on = math.isfinite(self.pressed_at) and self.now - self.pressed_at >= self.COAST
        self.lied |= told_on
        self.oscillates = oscillates

    def watch(self) -> None:
        super().watch()
        if self.clear() and not self.verdict.estop:
            self.over_at = min(self.over_at, self.now)
        elif self.over_at < math.inf:  # or it began anew in this step
            self.over_at = math.inf

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
        starts = STARTING in sticks
        pushing = bool(sticks) and sticks[-1] in (MOVING, STARTING)
        if pushing or self.pushed_until == math.inf:
            self.pushed_until = math.inf if pushing else self.now
        if starts:
            self.starting_at = self.now
        if MOVING in sticks or self.now - self.foreign_at < FOREIGN:
            self.is_ours, self.starting_at, self.pressed_at = False, -math.inf, -math.inf
        self.by_itself |= starts
        if self.over_at == math.inf and self.by_itself:
            self.by_itself, self.taken_at = False, self.now
        said = any('though nobody asks' in reason for reason in self.session.verdict.reasons)
        assert said == self.unasked() or not self.vouched(self.LINK), 'whether it moves by itself'

    def judge_press(self, pressed: bool) -> None:
        assert not pressed, 'a switch that nobody asked for'

    def revive(self) -> None:
        super().revive()
        self.play('stick rest', 'stick oscillate', 'unit oscillates', 'stick rest', *[''] * 8)
        assert not self.verdict.estop, 'no oscillation that was asked for'
        self.play('estop stop', '', '')


class Pausing(World):
    """One whose integrator says that type 81 tells of no oscillation while it is paused."""

    OPTIONS = {**World.OPTIONS, 'button_switches': (4,), 'pause_on_stop': True}

    def judge_press(self, pressed: bool) -> None:
        """Check that a press pauses what we began, and nothing else can explain."""
        if not pressed:
            return
        assert self.now <= self.over_at, 'switch 7 without a stop'
        assert self.oscillates, 'it does not tell so'
        assert self.heard_at == self.now, 'it does not tell so now'
        assert self.is_ours, 'somebody else began it, or may have paused it since'
        assert not self.lied, 'it tells of no pause'
        assert len(self.steps) > 1, 'one step is no motion'
        self.is_ours, self.pressed_at = False, self.now

    def revive(self) -> None:
        super().revive()
        assert (self.pressed_at > -math.inf) is not self.lied, 'an oscillation goes on in a stop'


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
        'stick': 'rest oscillate',
    },
    'together': {
        'unit': 'still turns oscillates paused',
        'estop': 'clear stop',
        'stick': 'rest move oscillate',
    },
}
# States, and steps between them.
COUNTS: dict[str, tuple[int, int]] = {
    'stops': (234, 1554),
    'sticks': (1244, 8356),
    'neighbours': (1694, 11378),
    'together': (4934, 47768),
}
PAUSING_COUNTS: dict[str, tuple[int, int]] = {
    'sticks': (1260, 8468),
    'neighbours': (1694, 11378),
    'together': (16148, 156488),
}
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=100)
test_every_pause_near_the_start, test_every_pause = visits_of(
    Pausing, {name: SCENES[name] for name in PAUSING_COUNTS}, PAUSING_COUNTS, near=100
)
