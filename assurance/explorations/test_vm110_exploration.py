# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every state of the VM-110's session that decides about a stop; see assurance/explorer.py."""

from collections.abc import Sequence
import math
from typing import Any

import pytest

from assurance.explorer import START, visits_of
from assurance.session_world import SessionWorld
from bridge_core.framing import Datagram
from stage.vm110_rig import DEFLECTED, EXTERNAL, NOBODY, STOPPED, STOPPED_RU
from vm110_bridge.protocol import PeriodicInput
from vm110_bridge.session import Session, Settings, Sticks
from vm110_bridge.session.sender import DOUBLED_TIME
from vm110_bridge.session.serials import WINDOW
from vm110_bridge.session.stops import StopJudge
from vm110_bridge.simulator import build_packet, build_vrpi

pytestmark = pytest.mark.computes
OURS, OTHER = 7, 8
TWIN = '192.0.2.9:5825'  # sends as OURS
SERIAL = 1000  # of the newest packet, in every state
CLEAN = ('ok', 'nobody')
OPEN = ('stopped', 'external')  # the base unit holds its relays open by itself
SAID = {
    'ok': DEFLECTED,
    'nobody': NOBODY,
    'stopped': build_vrpi(bu_state=STOPPED),
    'remote': build_vrpi(ru_state=STOPPED_RU),
    'external': EXTERNAL,
    'strange': build_vrpi(bu_state=0x77),
}
PERIODIC = (*SAID, 'late', 'latestopped', 'copy')  # VRPI of the base unit's ID
STOP = PeriodicInput.from_bytes(SAID['stopped'])
LEAST_SILENCE, ECHO = 1.5, 0.5  # s without VRPO until the BU says so; until it is heard
APART = (  # see Memory
    '_others', 'refused', 'delivered', 'repeats', 'bad_crc_at', 'other_crc_at', 'other_layout_at',
    '_looped_back_at', 'foreign', 'lost', 'repeated', 'reordered', 'restarts', '_serial',
    'dropped_commands', '_known', '_missed', '_resumed_at', 'no_origin_at',
    '_armed_at', '_taken_at', '_offered', 'moves', 'doubles', 'second', '_told',
    '_lateness',
)  # fmt: skip


class World(SessionWorld[Session]):
    """A base unit that says anything, and somebody who asks to withhold VRPO."""

    STEP = 0.25
    LINK = HOLD = 2 * STEP
    CALM = {'hold': 'go', 'bu': 'ok'}

    def __init__(self, reads: Sequence[str] = (), **said: str) -> None:
        settings = Settings(
            link_timeout=self.LINK,
            line_age_limit=0.0,  # test_vm110_lateness.py
            output_period=self.STEP / 2,
            hold_output_timeout=self.HOLD,
            crc='mpeg2',
            bu_id=OURS,
        )
        silence = ('output_at', '_output_at', '_silence', '_run_start', '_run_at')
        old = {'': self.LINK, **dict.fromkeys(silence, LEAST_SILENCE)}
        old |= dict.fromkeys(('doubled_at', 'doubled_until'), DOUBLED_TIME)
        super().__init__(Session(settings), said, reads=reads, old=old, apart=APART)
        self.serial = SERIAL
        self.said = ''  # by the newest VRPI
        self.late = False  # a stop that it has overtaken came since
        self.asked, self.asked_at = '', -math.inf
        self.output_at = START  # of the last VRPO
        self.withheld_at = (
            -math.inf
        )  # when a hold went on for so long that the BU may have said so
        self.moving = False
        self.believed: str | None = None  # whose VRPI count
        self.doubled_at = -math.inf  # when both were heard last

    def packet(self, what: str) -> bytes:
        """Return what the base unit sends; every other number is left for one that comes late."""
        if what in SAID:
            self.serial += 2
            return build_packet('VRPI', SAID[what], self.serial, OURS)
        if what.startswith('twin'):
            return Datagram(self.packet(what.removeprefix('twin')), TWIN)
        if what in ('late', 'latestopped'):
            late = SAID['stopped' if what == 'latestopped' else 'ok']
            first = self.session.origin.serials._newest is None
            return build_packet('VRPI', late, self.serial - (not first), OURS)
        if what == 'copy':
            return build_packet('VRPI', SAID['ok'], self.serial, OURS)
        if what == 'command':
            self.serial += 2
            return build_packet('VRCI', bytes(22), self.serial, OURS)
        if what == 'other':
            return build_packet('VRPI', SAID['ok'], self.serial + 2, OTHER)
        return build_packet('VRPI', SAID['ok'], self.serial + 2, OURS)[:-1] + b'\0'

    def holds(self) -> bool:
        """Tell whether VRPO are to be withheld."""
        silent = self.now - self.asked_at >= self.HOLD
        return self.asked == 'hold' or (self.asked == 'go' and silent)

    def lapse(self) -> None:
        if self.holds() and self.now - self.output_at >= LEAST_SILENCE:
            self.withheld_at = self.now
        elif self.said != 'external' and self.now - self.withheld_at >= ECHO:
            self.withheld_at = -math.inf

    def hear(self, said: Sequence[str]) -> None:
        self.stop_said = self.heard_at is not None and self.now - self.heard_at >= self.LINK
        for what in said:
            if what == 'silent':
                continue
            before = self.session.origin.serials._newest
            overtaken = self.session.origin.serials._recent[1:2]
            self.keep(self.session.receive(self.packet(what), self.now))
            if not self.counts(what):
                continue
            what = what.removeprefix('twin')
            if before is None:  # the first of all numbers is new
                what = {'late': 'ok', 'copy': 'ok', 'latestopped': 'stopped'}.get(what, what)
            if what in SAID:
                self.said, self.late, self.heard_at = what, False, self.now
                self.stop_said |= what not in CLEAN
            elif what == 'latestopped' and overtaken != [STOP]:
                self.late = self.stop_said = True

    def counts(self, what: str) -> bool:
        """Tell whether this is of the sender that is believed, as it is from now on if it may."""
        said_by, said = ('twin' if what.startswith('twin') else ''), what.removeprefix('twin')
        if said not in PERIODIC:
            return said_by == self.believed
        if self.believed is None or self.silent():
            self.believed = said_by
        elif said_by != self.believed:
            self.doubled_at, self.stop_said = self.now, True
        return said_by == self.believed

    def silent(self) -> bool:
        return self.heard_at is None or self.now - self.heard_at >= self.LINK

    def doubled(self) -> bool:
        return self.now - self.doubled_at < DOUBLED_TIME

    def ask(self, name: str, what: str) -> None:
        if what in ('go', 'hold'):
            self.session.set_hold_output(what == 'hold', self.now)
            self.asked, self.asked_at = what, self.now

    def judge(self) -> None:
        verdict, vouched = self.verdict, self.vouched(self.LINK)
        clean = vouched and self.said in CLEAN and not self.doubled()
        assert verdict.estop or (clean and not self.late), f'released by {self.said}: {verdict}'
        assert not verdict.estop or not clean or self.late, f'a stop of nobody: {verdict}'
        self.judge_output(vouched)
        if verdict.estop and not verdict.own_estop:
            assert vouched, 'an echo of nobody'
            assert self.said == 'external', f'an echo in spite of {self.said}'
            assert not self.late, 'an echo in spite of a late stop'
            assert not self.doubled(), 'an echo in spite of two'
            assert self.withheld_at > -math.inf, 'an echo of what nobody asked'
        if not verdict.estop:
            assert self.session.deadline() <= (self.heard_at or 0.0) + self.LINK, 'slept'
        for event in self.events:
            if isinstance(event, Sticks):
                self.moving = any(event.axes)
        assert not (self.moving and (verdict.estop or self.said != 'ok')), 'sticks count'
        self.renumber()

    def judge_output(self, vouched: bool) -> None:
        """See that no VRPO goes while somebody asks to withhold them, but for one reason."""
        sent = any(frame.startswith(b'VRPO') for frame in self.frames)
        by_itself = vouched and self.said in OPEN and self.verdict.own_estop
        assert not (sent and self.holds()) or by_itself, f'VRPO in spite of {self.asked}'
        if sent:
            self.output_at = self.now

    def renumber(self) -> None:
        """Have numbers come from the same one on, as in every state."""
        serials = self.session.origin.serials
        if serials._newest is not None:
            change = SERIAL - self.serial
            serials._newest += change
            serials._run_newest += change
            serials._seen &= 0b111
            serials._recent[2:] = [None] * (WINDOW - 2)  # no word has their numbers
            serials._length = min(serials._length, 3)
            if not serials._run_length:
                serials._run_newest, serials._run_start, serials._run_at = 0, 0.0, 0.0
        self.serial = SERIAL
        if not self.open:
            self.session._stops, self.output_at = StopJudge(self.now), self.now  # as opening does

    def revive(self) -> None:
        while self.doubled():
            self.step('')
        assert not self.verdict.estop, 'no way out of a stop'
        assert self.moving, 'the sticks do not come'
        assert self.output_at == self.now, 'VRPO do not go'


SCENES: dict[str, dict[str, Any]] = {
    'device': {
        'bu': ' '.join((*SAID, 'silent')),
        'hold': 'silent',
        'reads': ('ok stopped', 'stopped ok'),
    },
    'noise': {
        'bu': 'ok other command silent',
        'hold': 'silent',
        'reads': ('late', 'ok latestopped', 'ok copy', 'damaged', 'damaged stopped'),
    },
    'echo': {
        'bu': 'ok external',
        'hold': 'go hold',
    },
    'twin': {
        'bu': 'ok twinok silent',
        'hold': 'silent',
        'reads': ('ok twinok', 'twinstopped ok'),
    },
}
COUNTS: dict[str, tuple[int, int]] = {
    'device': (2430, 26606),
    'noise': (5558, 65954),
    'echo': (4216, 28906),
    'twin': (53200, 386832),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=200)
