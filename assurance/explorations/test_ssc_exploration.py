# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every state of the SSC's session and its gate to the servos; see assurance/explorer.py."""

from collections.abc import Sequence
import math
import struct
from typing import Any

import pytest

from assurance.explorer import visits_of
from assurance.session_world import SessionWorld
from ssc_bridge.channels import AxisInput, Failsafe, Servo
from ssc_bridge.session import Session, Settings, Sticks
from stage.ssc_rig import build_frame, configuration, INPUTS, OUTPUTS, status, words

pytestmark = pytest.mark.computes
STICKS = build_frame(13, words([2000] * INPUTS))
STRANGE = build_frame(13, words([2000] * (INPUTS - 1)))  # not as many as are set up
SAID = {
    'ok': (status(), configuration(), STICKS),
    'unread': (status(),),  # its configuration does not come
    'signal': (status('no signal'), configuration(), STICKS),
    'reset': (status(available=True),),
    'strange': (status(), STRANGE),
    'cut': (status()[:4],),
    'damaged': (status()[:-1] + b'\0',),
    'silent': (),
}
PAN = Servo(name='pan', channel=1, min_us=1000, centre_us=1500, max_us=2000)
RATE = 200  # µs a step
TILT = Servo(
    name='tilt',
    channel=2,
    min_us=1000,
    max_us=2000,
    rate_us_per_s=RATE / SessionWorld.STEP,
    failsafe=Failsafe.PULSE,
    failsafe_us=1100,
)
POSITIONS = {'up': 1.0, 'down': -1.0}
APART = (  # see Memory
    'mismatches', 'unchecked', 'limited', 'refused_commands', 'looped_back', 'echo',
    '_poller', '_aux_inputs', '_aux_outputs', '_channels', '_offered', '_settled_at',
)  # fmt: skip


class World(SessionWorld[Session]):
    """A device that says anything, and a mux that asks for anything."""

    LINK = FRESH = 2 * SessionWorld.STEP
    CALM = {'ssc': 'ok', 'estop': 'clear', 'servo': 'up'}

    def __init__(self, reads: Sequence[str] = (), **said: str) -> None:
        rate = 1.0 / self.STEP
        settings = Settings(
            link_timeout=self.LINK,
            command_timeout=self.FRESH,
            command_rate=rate,
            poll_rates=(rate, *[0.0] * 4),
            servos=(PAN, TILT),
            axes=(AxisInput('x', 3),),
        )
        old = {'': self.LINK, '_stepped': self.STEP}
        super().__init__(Session(settings), said, reads=reads, old=old, apart=APART)
        self.channels = self.session.outputs._channels[:2]  # all others are never commanded
        self.status = self.available = ''  # of the newest status
        self.read = self.doubted = False  # the configuration was; a message contradicted it since
        self.asked, self.asked_at = '', -math.inf  # of the e-stop input
        self.command, self.commanded_at = '', -math.inf  # one that counts
        self.pulses: tuple[int, ...] | None = None  # that went out last
        self.owed = False  # the next message is the failsafe: after a stop, or a closed port
        self.moving = False

    def sound(self) -> bool:
        """Tell whether the device demands no stop."""
        clear = self.status == 'ok' and self.read and not self.doubted
        return self.vouched(self.LINK) and clear

    def lapse(self) -> None:
        if self.heard_at is None or self.now - self.heard_at >= self.LINK:
            self.stop_said = self.heard_at is not None
            self.heard_at, self.read, self.available = None, False, ''
            self.doubted = False
        self.watch()

    def watch(self) -> None:
        """Forget a command as soon as anything is missing."""
        if not self.allowed():
            self.stop()
        elif self.now - self.commanded_at >= self.FRESH:
            self.command = ''

    def allowed(self) -> bool:
        heard = self.now - self.asked_at < self.FRESH and self.asked == 'clear'
        return self.sound() and heard

    def stop(self) -> None:
        self.owed |= bool(self.command) and self.pulses is not None
        self.command = ''

    def hear(self, said: Sequence[str]) -> None:
        stop_said = self.stop_said
        self.keep(self.session.receive(b''.join(b''.join(SAID[e]) for e in said), self.now))
        for each in said:
            if each in ('cut', 'damaged', 'silent'):
                continue
            self.heard_at = self.now
            self.status = each if each == 'signal' else 'ok'
            if each == 'reset' and self.available == 'no':
                self.read = self.doubted = False
            self.available = 'yes' if each == 'reset' else 'no'
            if each in ('ok', 'signal'):
                self.read, self.doubted = True, False
            if each == 'strange' and self.read:
                self.read, self.doubted = False, True
            stop_said |= not self.sound()
            self.watch()
        self.stop_said = stop_said

    def ask(self, name: str, what: str) -> None:
        if name == 'estop':
            for each in {'blip': ['stop', 'clear'], 'silent': []}.get(what, [what]):
                self.session.set_estop(each == 'stop', self.now)
                self.asked, self.asked_at = each, self.now
                self.watch()
        elif what == 'bad':
            with pytest.raises(ValueError, match='nan'):
                self.session.set_servos({'pan': math.nan}, self.now)
            self.stop()
        elif what != 'silent':
            self.session.set_servos(dict.fromkeys(('pan', 'tilt'), POSITIONS[what]), self.now)
            self.watch()
            if self.allowed():
                self.command, self.commanded_at = what, self.now

    def keep(self, output: tuple[list[Any], list[Any]]) -> None:
        super().keep(output)
        for frame in output[1]:
            self.session.sent(frame, self.now)
            if frame[2] == 20:
                before, self.pulses = self.pulses, struct.unpack(f'>{OUTPUTS}H', frame[4:-2])
                self.judge_pulses(self.pulses, before)
        if output[1] and self.session.deadline() == -math.inf:
            self.keep(self.session.poll(self.now))  # what was sent is told at once

    def judge_pulses(self, pulses: tuple[int, ...], before: tuple[int, ...] | None) -> None:
        """See that servos do what is asked, or else what is safe."""
        self.watch()
        pan, tilt, *others = pulses
        assert not any(others), 'an output that nobody commands'
        if self.owed:  # what was asked for before this message is forgotten
            self.owed, self.command = False, ''
        if not self.command:
            assert (pan, tilt) == (0, TILT.failsafe_us), f'no failsafe: {pan}, {tilt}'
            return
        goal = 2000 if self.command == 'up' else 1000
        assert pan == goal, f'pan at {pan}, asked for {self.command}'
        if before is not None:
            least, most = sorted((before[1], goal))
            assert least <= tilt <= most, f'tilt at {tilt}, away from {goal}'
            assert abs(tilt - before[1]) <= 2 * RATE, 'a step'

    def judge(self) -> None:
        self.watch()
        assert self.verdict.estop == (not self.sound()), f'{self.status}: {self.verdict}'
        assert self.verdict.own_estop == self.verdict.estop, 'there is no echo'
        if not self.verdict.estop:
            assert self.session.deadline() <= (self.heard_at or 0.0) + self.LINK, 'slept'
        if not self.open:
            self.owed |= self.pulses is not None
            self.pulses = None
        elif self.pulses is not None and not self.command:
            assert self.pulses[:2] == (0, TILT.failsafe_us), 'what was asked is still out'
        for event in self.events:
            if isinstance(event, Sticks):
                self.moving = any(event.axes)
        assert not (self.moving and self.verdict.estop), 'sticks count in spite of a stop'

    def revive(self) -> None:
        self.play('', '', '')
        assert not self.verdict.estop, 'no way out of a stop'
        assert self.pulses is not None, f'no way to motion: {self.session.inhibits(self.now)}'
        assert self.pulses[0] == 2000, f'no way to motion: {self.session.inhibits(self.now)}'
        assert self.moving, 'the sticks do not come'


SCENES: dict[str, dict[str, Any]] = {
    'device': {
        'ssc': ' '.join(SAID),
        'estop': 'clear',
        'servo': 'up',
        'reads': ('ok signal', 'signal ok', 'cut ok', 'ok reset', 'ok strange', 'strange ok'),
    },
    'mux': {
        'ssc': 'ok silent',
        'estop': 'clear stop silent',
        'servo': 'silent up',
    },
    'commands': {
        'ssc': 'ok signal',
        'estop': 'clear blip',
        'servo': 'silent up down bad',
    },
}
COUNTS: dict[str, tuple[int, int]] = {
    'device': (4209, 66410),
    'mux': (4153, 34055),
    'commands': (11161, 96012),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=200)
