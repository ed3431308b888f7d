# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every state of the ESI drive's session and its gate to the motor; see assurance/explorer.py."""

from collections.abc import Iterator, Sequence
import math
from typing import Any

import pytest

from assurance.explorer import visits_of
from assurance.session_world import SessionWorld
from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.session import Session
from stage.esi_drive_rig import axes, fields, IDLE, make_settings, RUNNING, status

pytestmark = pytest.mark.computes
SAID = {
    'idle': IDLE,
    'running': RUNNING,
    'half': status(1, 0),
    'fault': status(2, errors=1),
    'damaged': RUNNING[:-1] + bytes((RUNNING[-1] ^ 1,)),
    'cut': RUNNING[:7],
    'silent': b'',
}
VALID = ('idle', 'running', 'half', 'fault')
COMMANDS = {'rest': 0, 'run': 8, 'back': -8}
GROWTH = 4  # counts a packet
APART = (  # see Memory
    '_reported_at', '_sent_at', '_gap_at', '_saturated', 'clears',
    'refused_commands', 'saturations', '_gap', '_own_gap', '_astray_since', '_before',
)  # fmt: skip


class World(SessionWorld[Session]):
    """A drive that says anything, a mux that asks for anything, and a line that may be busy."""

    LINK, ENABLE = 3 * SessionWorld.STEP, 4 * SessionWorld.STEP
    FRESH = 2 * SessionWorld.STEP
    MODE = Mode.VELOCITY
    CALM = {'drive': 'idle', 'estop': 'clear', 'command': 'run', 'enable': 'false', 'line': 'free'}

    def __init__(
        self,
        reads: Sequence[str] = (),
        *,
        clears: bool = False,
        line: str = 'free',
        **said: str,
    ) -> None:
        settings = make_settings(
            axes=axes(self.MODE, slew_limit=GROWTH / self.STEP),
            command_rate=1.0 / self.STEP,
            command_timeout=self.FRESH,
            link_timeout=self.LINK,
            enable_timeout=self.ENABLE,
            clear_timeout=self.ENABLE,
        )
        old = {'': self.ENABLE, '_at': self.STEP, '_until': 0.0, '_next_send': 0.0}
        old |= {
            'heard_at': self.LINK,
            'asked_at': self.FRESH,
            'may_since': self.ENABLE + self.FRESH,
        }
        super().__init__(
            Session(settings),
            {**said, 'line': line},
            reads=reads,
            old=old,
            apart=APART,
            unnamed=('status', '_next_send'),
        )
        self.clears = clears
        self.said = ''  # by the newest status
        self.asked: dict[str, str] = {'estop': '', 'command': '', 'enable': ''}
        self.asked_at: dict[str, float] = dict.fromkeys(self.asked, -math.inf)
        self.armed = False  # enable was false while all else held, and all holds since
        self.may = False  # it has risen since
        self.may_since = -math.inf
        self.told = False  # a packet that went out has said so since
        self.ran = False  # the drive was enabled since
        self.rested = False  # and got a packet at rest since
        self.packet = (False, False, 0)  # the newest that went out, of axis A
        self.enables = False  # the newest says so, whether it went out or not
        self.disabled_at = -math.inf  # since when packets say so

    def possible(self) -> Iterator[str]:
        yield from super().possible()
        if self.clears:
            yield 'clear'

    def step(self, event: str) -> None:
        if event == 'clear':
            self.session.clear_errors(self.now)
        elif event == 'plug':
            self.disabled_at = -math.inf
        super().step('' if event == 'clear' else event)

    def fresh(self, name: str) -> bool:
        return self.now - self.asked_at[name] < self.FRESH

    def sound(self) -> bool:
        """Tell whether the drive demands no stop."""
        disobeys = self.said in ('running', 'half') and self.now - self.disabled_at >= self.ENABLE
        return self.vouched(self.LINK) and self.said != 'fault' and not disobeys

    def allowed(self) -> bool:
        """Tell whether all but command and enable hold."""
        return self.sound() and self.fresh('estop') and self.asked['estop'] == 'clear'

    def fail(self) -> None:
        self.may = self.armed = self.told = self.ran = self.rested = False
        self.may_since = -math.inf

    def lapse(self) -> None:
        self.watch()
        waits = self.may and not self.ran
        if waits and self.enables and self.now - self.may_since >= self.ENABLE + self.FRESH:
            self.fail()

    def watch(self) -> None:
        """Note what holds no more."""
        commanded = self.fresh('command') and self.asked['command'] in COMMANDS
        lost = self.may and self.enables and not commanded
        if not (self.allowed() and self.fresh('enable')) or lost:
            self.fail()

    def hear(self, said: Sequence[str]) -> None:
        self.stop_said = self.heard_at is not None and self.now - self.heard_at >= self.LINK
        told = self.told
        data = b''.join(self.packet_of(each) for each in said)
        self.keep(self.session.receive(data, self.now))
        for each in said:
            if each in VALID:
                self.said, self.heard_at = each, self.now
                if self.ran and each != 'running':
                    self.fail()
                self.watch()
                self.ran |= told and self.enables and self.may and each == 'running'
                if self.ran:
                    self.may_since = -math.inf
        self.stop_said |= 'fault' in said

    def packet_of(self, said: str) -> bytes:
        """Return what the drive sends."""
        return SAID[said]

    def keep(self, output: tuple[list[Any], list[Any]]) -> None:
        events, frames = output
        for frame in frames:
            self.enables = fields(frame)[0][0]
            self.told |= self.enables and not self.busy
            if self.busy:
                self.session.refused(frame, self.now)
        super().keep((events, [] if self.busy else frames))

    @property
    def busy(self) -> bool:
        return self.doing['line'] == 'busy'

    def ask(self, name: str, what: str) -> None:
        both = {'blip': ['stop', 'clear'], 'gap': ['lost', 'clear'], 'edge': ['false', 'true']}
        for each in both.get(what, [what]):
            if each != 'silent':
                getattr(self, f'ask_{name}')(each)

    def ask_line(self, what: str) -> None:
        """Ask nothing: see keep."""

    def ask_estop(self, what: str) -> None:
        if what == 'lost':
            self.session.distrust(what, self.now)
            self.fail()
            return
        self.session.set_estop(what == 'stop', self.now)
        self.asked['estop'], self.asked_at['estop'] = what, self.now
        self.watch()

    def ask_command(self, what: str) -> None:
        value = COMMANDS.get(what, math.nan)
        try:
            self.session.set_command((value, -value / 2.0), self.now)
        except ValueError:
            assert what == 'bad'
        self.asked['command'], self.asked_at['command'] = what, self.now
        self.watch()

    def ask_enable(self, what: str) -> None:
        self.session.set_enable(what == 'true', self.now)
        self.asked['enable'], self.asked_at['enable'] = what, self.now
        if what == 'false':
            self.fail()
            self.armed = self.allowed()
        elif self.armed:
            self.may, self.armed, self.may_since = True, False, self.now

    def judge(self) -> None:
        self.watch()
        if self.heard_at is None or self.now - self.heard_at >= self.LINK:
            self.said, self.heard_at = '', None
        verdict = self.verdict
        assert verdict.estop == (not self.sound()), f'after {self.said}: {verdict}'
        fresh = self.heard_at is not None and self.now - self.heard_at < self.LINK
        enabled = self.open and fresh and self.said == 'running'
        assert self.session.enabled == enabled, 'enabled'
        if not verdict.estop:
            assert self.session.deadline() <= (self.heard_at or 0.0) + self.LINK, 'slept'
        assert self.frames or self.quiet(), 'no packet'
        for frame in self.frames:
            self.judge_frame(frame)
            enables = fields(frame)[0][0]
            self.disabled_at = math.inf if enables else min(self.disabled_at, self.now)

    def quiet(self) -> bool:
        """Tell whether no packet may go out."""
        return self.busy or not self.open

    def judge_frame(self, frame: bytes) -> None:
        """See that a packet keeps to what is allowed; the newest one is of this moment."""
        a, b = fields(frame)
        enable, clear, value = a
        assert a[:2] == b[:2], 'the axes are told different things'
        if enable:
            assert self.may, f'enable, after {self.asked}, {self.said}'
            assert not clear
        if value:
            asked = COMMANDS.get(self.asked['command'], 0)
            assert enable, 'motion without enable'
            assert self.ran, 'motion before the drive is enabled'
            assert self.rested, 'the first packet after it is not at rest'
            was = max(self.packet[2] * math.copysign(1, value), 0)
            assert abs(value) <= was + GROWTH, 'a step'
            assert value * asked > 0, 'a direction that nobody asks for now'
            assert abs(value) <= max(abs(asked), was), 'more than is asked'
        self.rested |= self.ran and enable
        self.packet = a

    def revive(self) -> None:
        self.play('', '', 'enable true', '', 'drive running', '', '')
        assert self.packet[2] > 0, f'no way to motion: {self.session.inhibits(self.now)}'


SCENES: dict[str, dict[str, Any]] = {
    'drive': {
        'drive': 'idle running half fault cut silent',
        'estop': 'clear stop',
        'command': 'run',
        'enable': 'false true',
    },
    'mux': {
        'drive': 'idle running',
        'estop': 'clear stop gap',
        'command': 'run back',
        'enable': 'false true silent',
    },
    'silence': {
        'drive': 'idle running',
        'estop': 'clear silent',
        'command': 'run silent',
        'enable': 'false true',
    },
    'one read': {
        'drive': 'idle running damaged fault',
        'estop': 'clear blip',
        'command': 'run bad',
        'enable': 'false true edge',
        'reads': ('running fault', 'fault running', 'cut running', 'running idle', 'idle running'),
        'clears': True,
    },
    'busy': {
        'drive': 'idle running',
        'estop': 'clear',
        'command': 'run back',
        'enable': 'false true',
        'line': 'free busy',
    },
}
COUNTS: dict[str, tuple[int, int]] = {
    'drive': (9457, 110718),
    'mux': (14815, 151315),
    'silence': (7336, 61198),
    'one read': (34775, 599105),
    'busy': (8341, 69323),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=200)
