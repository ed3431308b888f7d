# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every state of the VSC's session that decides about a stop; see assurance/explorer.py."""

from collections.abc import Iterator, Mapping, Sequence
import math
from typing import Any

import pytest

from assurance.explorer import visits_of
from assurance.session_world import SessionWorld
from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.protocol import CanWire, HidWire, MessageType, SerialWire, Wire
from fort_vsc_bridge.session import Session, Settings, Sticks
from fort_vsc_bridge.session.line_age import AGE_KEY, LATE_TIME
from fort_vsc_bridge.simulator import build_frame
from stage.fort_vsc_rig import CLEAR, DEFLECTED, heartbeat, SRC, STOP, USER
from stage.vsc_on_can import ALL_STICKS, frame, heartbeat as heartbeat_on_can

pytestmark = pytest.mark.computes
LINK = ASKED = 2 * SessionWorld.STEP
ECHO = 0.5  # s that the VSC may take to answer our heartbeat
QUESTION = build_frame(0x32, bytes((AGE_KEY,)))
ANSWER = build_frame(0x30, bytes((AGE_KEY, 0, 0, 0, 0)))
TRANSITION = 3 * SessionWorld.STEP  # of a mode that is none of table 12
SAID = {
    'ok': heartbeat(),
    'src': heartbeat(estop=SRC),
    'user': heartbeat(estop=USER),
    'both': heartbeat(estop=SRC | USER),
    'unlinked': heartbeat(mode=0),
    'strange': heartbeat(mode=99),
    'damaged': heartbeat()[:-1] + b'\0',
    'half': heartbeat()[:5],
    'garbage': b'\xaa\x55\x20\x00',
    'silent': b'',
}
VALID = ('ok', 'src', 'user', 'both', 'unlinked', 'strange')
APART = (  # see Memory
    '_settled_at', '_rejected_lately', '_looped_back_lately', 'rejected', '_offered',
    '_asked_at', '_heard_at', '_connected_at', '_identity',
)  # fmt: skip


class World(SessionWorld[Session]):
    """
    A VSC that says anything, with sticks deflected, and somebody who asks for its stop.

    The line to it may be busy.
    """

    CALM = {'estop': 'go', 'vsc': 'ok', 'sticks': 'deflected', 'line': 'free'}
    WIRE: Wire = SerialWire()
    SAID: Mapping[str, Any] = SAID

    def __init__(self, reads: Sequence[str] = (), *, line: str = 'free', **said: str) -> None:
        settings = Settings(
            wire=self.WIRE,
            link_timeout=LINK,
            heartbeat_rate=8.0,
            software_estop_timeout=ASKED,
            transition_time=TRANSITION,
        )
        old = {
            '': LINK,
            '_strange_since': TRANSITION,
            'strange_since': TRANSITION,
            '_released_at': ECHO,
            'released_at': ECHO,
            '_free_at': 0.0,
        }
        super().__init__(
            Session(settings),
            {**said, 'line': line},
            reads=reads,
            old=old,
            apart=APART,
            unnamed=('_newest',),
        )
        self.said = ''  # by the newest heartbeat
        self.asked, self.asked_at = '', -math.inf  # the stop that is asked for
        self.sent = CLEAR  # what the VSC has heard last
        self.released_at = -math.inf  # we sent no stop any more
        self.owed = False  # the VSC has not heard of a stop that was asked for
        self.spoke = False  # the line has carried something
        self.strange_since = math.inf  # modes outside table 12 were said
        self.ours = False  # a stop of the USER may be our doing
        self.moving = False  # the newest sticks are not neutral

    def hear(self, said: Sequence[str]) -> None:
        self.stop_said = self.heard_at is not None and self.now - self.heard_at >= LINK
        for read in self.reads_of(said):
            self.keep(self.session.receive(read, self.now))
        for each in said:
            if each in VALID:
                self.said, self.heard_at = each, self.now
                self.note_user('user' in each or each == 'both')
                strange = each in ('unlinked', 'strange')
                self.strange_since = min(self.strange_since, self.now) if strange else math.inf
                self.stop_said |= each != 'ok'

    def reads_of(self, said: Sequence[str]) -> list[Any]:
        """Return what the port hands out at once."""
        sticks = DEFLECTED if self.doing['sticks'] == 'deflected' else b''
        return [b''.join(self.SAID[each] for each in said) + sticks]

    def note_user(self, stop: bool) -> None:
        """Note whose doing a stop of the USER may be."""
        if not stop and self.sent == CLEAR and self.now - self.released_at >= ECHO:
            self.ours = False

    def ask(self, name: str, what: str) -> None:
        if what in ('go', 'stop'):
            self.session.set_software_estop(what == 'stop', self.now)
            self.asked, self.asked_at = what, self.now

    def keep(self, output: tuple[list[Any], list[Any]]) -> None:
        events, frames = output
        frames = [] if self.busy else frames
        super().keep((events, frames))
        for each in frames:
            if each == STOP and self.sent == CLEAR:
                self.ours = True
            elif each == CLEAR and self.sent == STOP:
                self.released_at = self.now
            self.owed &= each != STOP
            self.spoke = True
            self.sent = each

    @property
    def busy(self) -> bool:
        return self.doing['line'] == 'busy'

    def judge(self) -> None:
        verdict, vouched = self.verdict, self.vouched(LINK)
        assert verdict.estop == (not vouched or self.said != 'ok'), f'estop: {verdict}'
        wanted = self.asked and (self.asked == 'stop' or self.now - self.asked_at >= ASKED)
        assert self.WIRE.carries(MessageType.HOST_HEARTBEAT) or not self.frames, 'who hears it?'
        if self.open and not self.busy and self.WIRE.carries(MessageType.HOST_HEARTBEAT):
            assert self.frames, 'no host heartbeat'
            assert self.sent == STOP or not wanted, f'host heartbeat: {self.frames}'
            assert not self.owed, 'the VSC never hears of a stop'
        self.owed |= bool(wanted and self.sent == CLEAR)
        self.owed |= bool(self.asked) and self.spoke and not self.open
        lasting = self.now - self.strange_since >= TRANSITION
        if vouched and self.said in ('unlinked', 'strange'):
            assert verdict.own_estop is lasting, 'whose is a mode outside table 12?'
        elif verdict.estop and not verdict.own_estop:
            assert vouched, 'an echo of nobody'
            assert self.said == 'user', f'an echo in spite of {self.said}'
            assert self.ours, 'an echo of what nobody asked'
        if not vouched and not self.session.link_up:
            self.said = ''
        if not verdict.estop:
            assert self.session.deadline() <= (self.heard_at or 0.0) + LINK, 'the end is slept'
        for event in self.events:
            if isinstance(event, Sticks):
                self.moving = any(event.axes) or any(event.buttons)
        assert not (self.moving and verdict.estop), 'sticks count in spite of a stop'

    def revive(self) -> None:
        assert not self.verdict.estop, 'no way out of a stop'
        assert self.moving, 'the sticks do not come'
        assert self.sent == CLEAR, 'a stop that nobody asks for goes on'


class CanWorld(World):
    """A VSC on CAN, which hears no heartbeat of ours; its sticks come in four frames."""

    CALM = {**World.CALM, 'estop': 'silent'}
    WIRE = CanWire(heartbeat_rate=math.inf)  # two of them: test_fort_vsc_can.py
    SAID = {
        'ok': heartbeat_on_can(),
        'src': heartbeat_on_can(estop=SRC),
        'user': heartbeat_on_can(estop=USER),
        'unlinked': heartbeat_on_can(mode=0),
        'strange': heartbeat_on_can(mode=99),
        'damaged': CanFrame(heartbeat_on_can().identifier, heartbeat_on_can().data[:5]),
        'foreign': CanFrame(heartbeat_on_can().identifier + 1, heartbeat_on_can().data),
        'silent': None,
    }
    STICKS = {
        'none': (),
        'deflected': ALL_STICKS,
        'left': ALL_STICKS[:2],
        'zeroed': [frame(name, bytes(8)) for name in ('left_basic', 'right_basic')],
    }

    def __init__(self, reads: Sequence[str] = (), **said: str) -> None:
        self.whole_at = -math.inf  # all four frames came
        super().__init__(reads, **said)

    def reads_of(self, said: Sequence[str]) -> list[Any]:
        sticks = self.doing['sticks']
        if sticks == 'deflected':
            self.whole_at = self.now
        frames = (*(self.SAID[each] for each in said), *self.STICKS[sticks])
        return [each for each in frames if each is not None]

    def judge(self) -> None:
        super().judge()
        moving = [e for e in self.events if isinstance(e, Sticks) and any((*e.axes, *e.buttons))]
        assert not moving or self.now - self.whole_at < LINK, 'of sticks that come in part'


class HidWorld(World):
    """A remote on USB, whose report has sticks and stop."""

    CALM = {**World.CALM, 'estop': 'silent'}
    WIRE = HidWire()
    SAID = {
        'ok': b'\x09\0',
        'src': b'\x09\1',
        'user': b'\x09\x40',
        'unlinked': b'\0\0',
        'strange': b'\x63\0',
        'damaged': b'\x09',
        'long': b'\x09\0\0',
    }

    def reads_of(self, said: Sequence[str]) -> list[Any]:
        sticks = b'\5\7' if self.doing['sticks'] == 'deflected' else b'\0\0'
        return [sticks + b'\0\0\0\0\x08' + self.SAID[e] for e in said if e != 'silent']


class FarWire(SerialWire):
    """A serial server, and a VSC that says one heartbeat a step."""

    INTERVAL = SessionWorld.STEP


class FarWorld(SessionWorld[Session]):
    """
    A VSC that is well, behind a serial server that hands on what it says up to 5 steps late.

    It may answer no question. Whatever it says was said when it was said, and not when it comes.
    """

    CALM = {'vsc': 'ok', 'steps': '0', 'answers': 'yes'}
    LIMIT = 4 * SessionWorld.STEP  # line_age_limit
    PATIENCE = 4 * SessionWorld.STEP  # less than the longest delay
    FIRST_PATIENCE = 14 * SessionWorld.STEP

    def __init__(self, reads: Sequence[str] = (), **said: str) -> None:
        del reads
        settings = Settings(
            wire=FarWire(network=True),
            link_timeout=LINK,
            line_age_limit=self.LIMIT,
            heartbeat_rate=8.0,
        )
        lately = self.LIMIT + 2 * self.STEP
        old = {'': lately, '_asked': self.FIRST_PATIENCE, 'under_way': lately, '_free_at': 0.0}
        apart = (*APART, '_judgement', '_pacer', '_stop', 'heard_at')
        super().__init__(Session(settings), said, old=old, apart=apart, unnamed=('_newest',))
        self.session._line.PATIENCE = self.PATIENCE  # type: ignore[union-attr]
        self.session._line.FIRST_PATIENCE = self.FIRST_PATIENCE  # type: ignore[union-attr]
        self.under_way: list[tuple[bytes, float]] = []  # what the VSC said, and when
        self.spoke_at = self.now
        self.said_at = -math.inf  # the newest heartbeat that came

    def possible(self) -> Iterator[str]:
        return (each for each in super().possible() if each not in ('stall', 'overflow'))

    def lapse(self) -> None:
        while self.spoke_at < self.now:
            self.spoke_at += self.STEP
            if self.doing['vsc'] == 'ok':
                self.under_way.append((heartbeat(), self.spoke_at))

    def hear(self, said: Sequence[str]) -> None:
        frames = b''
        for each, at in self.come():
            frames += each
            if each == heartbeat():
                self.said_at, self.heard_at = at, self.now
        self.keep(self.session.receive(frames, self.now))

    def come(self) -> list[tuple[bytes, float]]:
        """Return what has come by now, and forget it."""
        latest = self.now - int(self.doing['steps']) * self.STEP
        come = [each for each in self.under_way if each[1] <= latest]
        del self.under_way[: len(come)]
        return come

    def ask(self, name: str, what: str) -> None:
        pass

    def keep(self, output: tuple[list[Any], list[Any]]) -> None:
        super().keep(output)
        if self.doing['answers'] == 'yes':
            self.under_way += [(ANSWER, self.now)] * output[1].count(QUESTION)

    def judge(self) -> None:
        if self.interrupted_at == self.now:
            self.come()
        if not self.open:
            self.under_way.clear()
        session, now = self.session, self.now
        if session.link_up:
            assert session.as_of(now) <= self.said_at, 'it is older than the session says'
        assert self.verdict.estop or session.link_up, 'clear by a silent VSC'
        known = session.as_of(now) > -math.inf
        young = now - self.said_at < self.LIMIT
        assert self.verdict.estop or young or not known, 'clear by old words'

    def revive(self) -> None:
        steps = round((self.FIRST_PATIENCE + LATE_TIME + 2.0) / self.STEP)
        while self.verdict.estop or self.session.as_of(self.now) == -math.inf:
            assert (steps := steps - 1), 'no way out of a stop'
            self.step('')


def world_on(wire: str = 'serial', **scene: Any) -> SessionWorld[Session]:
    kinds: dict[str, type[SessionWorld[Session]]] = {
        'serial': World,
        'can': CanWorld,
        'hid': HidWorld,
        'far': FarWorld,
    }
    return kinds[wire](**scene)


SCENES: dict[str, dict[str, Any]] = {
    'device': {
        'vsc': ' '.join(SAID),
        'sticks': 'none deflected',
        'estop': 'silent',
        'reads': ('ok src', 'src ok', 'half ok', 'damaged src', 'garbage ok'),
    },
    'echo': {
        'vsc': 'ok user both silent',
        'sticks': 'none',
        'estop': 'silent go stop',
        'reads': ('ok user', 'user ok'),
    },
    'busy': {
        'vsc': 'ok user',
        'sticks': 'none',
        'estop': 'silent go stop',
        'line': 'free busy',
    },
    'far': {
        'wire': 'far',
        'vsc': 'ok',
        'steps': '0 5',
        'answers': 'yes no',
    },
    'can': {
        'wire': 'can',
        'vsc': ' '.join(CanWorld.SAID),
        'sticks': ' '.join(CanWorld.STICKS),
        'estop': 'silent',
        'reads': ('ok src', 'src ok', 'damaged ok', 'foreign user'),
    },
    'hid': {
        'wire': 'hid',
        'vsc': ' '.join([*HidWorld.SAID, 'silent']),
        'sticks': 'none deflected',
        'estop': 'silent',
        'reads': ('ok src', 'src ok', 'damaged ok', 'long src'),
    },
}
COUNTS: dict[str, tuple[int, int]] = {
    'device': (2005, 37664),
    'echo': (6242, 62088),
    'busy': (9393, 73397),
    'far': (71139, 322051),
    'can': (19175, 355145),
    'hid': (524, 8104),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(world_on, SCENES, COUNTS, near=200)
