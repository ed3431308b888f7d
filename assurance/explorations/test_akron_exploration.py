# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every state of the Akron session that decides about a stop or a joystick frame; see explorer."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

import pytest

from akron_can_bridge.session import Session, Settings
from assurance.explorer import visits_of
from assurance.session_world import SessionWorld
from bridge_core.j1939 import CanFrame
from stage.akron_session_rig import (
    ANNOUNCED,
    ef,
    faults,
    joystick,
    MOVE,
    MOVING,
    NEUTRAL,
    NO_FAULTS,
    NOT_ENABLED,
    OTHER_ANNOUNCED,
    OURS,
    OUTPUTS,
    PIN,
    POSITION,
    REST,
    UNIT,
    VERSIONS,
)

pytestmark = pytest.mark.computes
SAID = {
    'ok': (OUTPUTS, POSITION),
    'mute': (POSITION,),  # heard, and nothing of its outputs
    'disabled': (NOT_ENABLED, POSITION),
    'fault': (OUTPUTS, POSITION, faults(2)),
    'foreign': (OUTPUTS, POSITION, joystick()),
    'elsewhere': (OTHER_ANNOUNCED,),
    'malformed': (ef('83'),),
    'silent': (),
}
STICK, PERMISSION = 0x0CFDD600 | OURS, 0x18EF0000 | UNIT << 8 | OURS
PERMITTED = 0.3  # s for which a permission holds at the unit
FOREIGN = 1.0  # s for which a foreign joystick is a stop
APART = (  # see Memory
    'refused', 'moves', 'other_frames', '_stream', '_names', 'motion', 'asked_until',
    '_automatic_until', '_due', '_asked_at', '_reported', 'oscillation', 'presses',
    '_misfit', '_misfit_heard',
)  # fmt: skip


class World(SessionWorld[Session]):
    """A unit that says anything, and a mux that asks for anything."""

    LINK = FRESH = 2 * SessionWorld.STEP
    CALM = {'unit': 'ok', 'estop': 'clear', 'stick': 'rest'}
    APART: Sequence[str] = APART
    OPTIONS: Mapping[str, Any] = {'soe_permissive': True}
    OLD: Mapping[str, float] = {}
    UNNAMED: Sequence[str] = ()
    NEVER: Sequence[str] = ()
    STICKS: Mapping[str, tuple[tuple[Any, Any], bytes]] = {
        'rest': (REST, NEUTRAL),
        'move': (MOVE, MOVING),
    }

    def __init__(self, reads: Sequence[str] = (), **said: str) -> None:
        settings = Settings(
            device_pin=PIN,
            link_timeout=self.LINK,
            command_timeout=self.FRESH,
            estop_in_timeout=self.FRESH,
            answer_timeout=4 * self.STEP,
            **self.OPTIONS,
        )
        old = {
            '': FOREIGN,
            'heard_at': self.LINK,
            'permitted_at': PERMITTED,
            'asked_at': self.FRESH,
            'stick_at': self.FRESH,
            **self.OLD,
        }
        super().__init__(
            Session(settings),
            said,
            reads=reads,
            old=old,
            apart=self.APART,
            unnamed=self.UNNAMED,
            never=self.NEVER,
        )
        self.session.take_over(None, False, self.now)
        self.known: dict[str, Any] = {}  # what the unit said: when, or what
        self.foreign_at = -math.inf
        self.asked, self.asked_at = '', -math.inf  # of the e-stop input
        self.stick, self.stick_at = '', -math.inf
        self.may = False  # the stick was at rest while all else held, and all holds since
        self.permitted_at = -math.inf  # by the newest permission, if it gives any
        self.play('plug')
        for frame in VERSIONS:
            self.session.receive(frame, self.now)
        self.play('unplug')

    def sound(self) -> bool:
        """Tell whether the unit is known to demand no stop."""
        lately = self.now - self.known.get('outputs', -math.inf) < self.LINK
        well = lately and self.known.get('enabled') and self.known.get('faults') == 'none'
        return self.vouched(self.LINK) and bool(well) and self.now - self.foreign_at >= FOREIGN

    def clear(self) -> bool:
        """Tell whether neither the unit nor the e-stop input demands a stop."""
        heard = self.now - self.asked_at < self.FRESH and self.asked == 'clear'
        return self.sound() and heard

    def lapse(self) -> None:
        if not self.open or self.heard_at is None:
            self.known.clear()
            self.foreign_at = -math.inf
        elif self.now - self.heard_at >= self.LINK:
            self.known.clear()
            self.stop_said = True
        self.watch()

    def watch(self) -> None:
        """Note what holds no more."""
        self.may &= self.clear() and self.now - self.stick_at < self.FRESH and self.stick != 'bad'

    def hear(self, said: Sequence[str]) -> None:
        for each in said:
            for frame in (*self.answers(each), *SAID[each]):
                self.keep(self.session.receive(frame, self.now))
            if each in ('elsewhere', 'malformed', 'silent'):
                continue
            self.heard_at = self.now
            if each != 'mute':
                self.known['outputs'], self.known['enabled'] = self.now, each != 'disabled'
            if each in ('ok', 'foreign', 'fault'):
                self.known['faults'] = 'one' if each == 'fault' else 'none'
            if each == 'foreign':
                self.foreign_at = self.now
            self.stop_said |= each in ('disabled', 'fault', 'foreign')
            self.watch()

    def answers(self, what: str) -> list[CanFrame]:
        """Return what a unit is asked for until it has said so."""
        session = self.session
        if what in ('elsewhere', 'malformed', 'silent'):
            return []
        frames = [ANNOUNCED] * (session.finder.address is None)
        well = session.unit.faults is not None and not session.unit.faults.faults
        return frames + [NO_FAULTS] * (what in ('ok', 'foreign') and not well)

    def ask(self, name: str, what: str) -> None:
        if name == 'estop':
            for each in {'blip': ['stop', 'clear'], 'silent': []}.get(what, [what]):
                self.session.set_estop(each == 'stop', self.now)
                self.asked, self.asked_at = each, self.now
                self.watch()
        elif what == 'bad':
            self.session.refuse_command('bad', self.now)
            self.stick = what
            self.watch()
        elif what != 'silent':
            self.session.set_command(*self.STICKS[what][0], self.now)
            self.stick, self.stick_at = what, self.now
            self.may |= what == 'rest' and self.clear()
            self.watch()

    def judge(self) -> None:
        self.watch()
        assert self.verdict.estop or self.sound(), f'released by {self.doing}, {self.known}'
        assert self.verdict.own_estop == self.verdict.estop, 'there is no echo'
        if not self.verdict.estop:
            assert self.session.deadline() <= (self.heard_at or 0.0) + self.LINK, 'slept'
        sticks = [frame.data for frame in self.frames if frame.identifier == STICK]
        assert sticks or not self.open, 'no joystick frame'
        for data in sticks:
            assert data in {frame for _, frame in self.STICKS.values()}
        if sticks and sticks[-1] != NEUTRAL:
            assert self.may, f'motion: {self.asked}, {self.stick}, {self.known}'
            assert sticks[-1] == self.STICKS[self.stick][1], 'motion that nobody asks for now'
        for frame in self.frames:
            if frame.identifier == PERMISSION and frame.data[0] == 0xA1:
                self.permitted_at = self.now if any(frame.data[1:]) else -math.inf
        permitted = self.open and self.now - self.permitted_at < PERMITTED
        addressed = self.session.finder.address is not None  # else the unit forgets by itself
        assert not (permitted and addressed) or self.clear(), 'permitted in spite of a stop'

    def revive(self) -> None:
        self.play(*[''] * 8, 'stick move', '')
        assert not self.verdict.estop, 'no way out of a stop'
        data = [frame.data for frame in self.frames if frame.identifier == STICK]
        assert data == [MOVING], f'no way to motion: {self.session.inhibits(self.now)}'


SCENES: dict[str, dict[str, Any]] = {
    'unit': {
        'unit': 'ok mute disabled fault malformed silent',
        'estop': 'clear',
        'stick': 'rest move',
        'reads': ('ok disabled', 'disabled ok', 'ok fault', 'fault ok', 'malformed ok'),
    },
    'neighbours': {
        'unit': 'ok foreign silent',
        'estop': 'clear',
        'stick': 'rest',
        'reads': ('elsewhere', 'ok foreign'),
    },
    'mux': {
        'unit': 'ok silent',
        'estop': 'clear stop silent',
        'stick': 'rest move',
    },
    'commands': {
        'unit': 'ok disabled',
        'estop': 'clear blip',
        'stick': 'rest move bad silent',
    },
}
COUNTS: dict[str, tuple[int, int]] = {
    'unit': (13172, 183200),
    'neighbours': (4401, 33549),
    'mux': (18051, 143541),
    'commands': (29935, 264974),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=100)
