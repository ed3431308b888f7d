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
from esi_drive_bridge.session import AxesVerdict, Session
from stage.esi_drive_rig import axes, fields, IDLE, make_settings, RUNNING, status

pytestmark = pytest.mark.computes
# What the drive says of A and B: 1 enabled, 2 an error.
STATES = {
    'idle': (0, 0),
    'running': (1, 1),
    'half': (1, 0),
    'fault': (2, 0),
    'fault_b': (1, 2),
}
SAID = {
    **{name: status(*state) for name, state in STATES.items()},
    'damaged': RUNNING[:-1] + bytes((RUNNING[-1] ^ 1,)),
    'cut': RUNNING[:7],
    'silent': b'',
}
assert (SAID['idle'], SAID['running']) == (IDLE, RUNNING)
NONE = None, None
COMMANDS: dict[str, tuple[float | None, ...]] = {  # of A and B
    'rest': (0, 0),
    'run': (8, -4),
    'back': (-8, 4),
    'bad': (math.nan, math.nan),
    'alone': (8, None),
    'bad_b': (8, math.nan),
}
GROWTH = 4  # counts a packet
APART = (  # see Memory
    '_reported_at', '_sent_at', '_gap_at', '_saturated', 'clears', '_offered',
    'refused_commands', 'saturations', '_gap', '_own_gap', '_astray_since', 'span',
)  # fmt: skip


class Log:
    """What axes that are enabled together may do, by what was said."""

    def __init__(self, numbers: Sequence[int], enables: Sequence[str]) -> None:
        self.numbers = tuple(numbers)
        self.enables = tuple(enables)  # inputs that must all be true
        self.asked: tuple[float | None, ...] = NONE  # of A and B
        self.asked_at = -math.inf  # a command that makes sense
        self.armed = False  # enable was false while all else held, and all holds since
        self.may = False  # it has risen since
        self.may_since = -math.inf
        self.told = False  # a packet that went out has said so since
        self.ran = False  # the drive was enabled since
        self.rested = False  # and got a packet at rest since
        self.packet = (False, False, 0)  # the newest that went out, of the first axis
        self.offered = False  # the newest says enable, whether it went out or not
        self.disabled_at = -math.inf  # since when packets say so

    def fail(self) -> None:
        self.may = self.armed = self.told = self.ran = self.rested = False
        self.may_since = -math.inf

    def says(self, said: str, bit: int) -> list[bool]:
        """Return of each axis what the drive says."""
        return [bool(STATES.get(said, (0, 0))[number] & bit) for number in self.numbers]


class World(SessionWorld[Session]):
    """A drive that says anything, a mux that asks for anything, and a line that may be busy."""

    LINK, ENABLE = 3 * SessionWorld.STEP, 4 * SessionWorld.STEP
    FRESH = 2 * SessionWorld.STEP
    MODE = Mode.VELOCITY
    AXES_ENABLE = 'together'
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
            axes_enable=self.AXES_ENABLE,
            command_rate=1.0 / self.STEP,
            command_timeout=self.FRESH,
            link_timeout=self.LINK,
            enable_timeout=self.ENABLE,
            clear_timeout=self.ENABLE,
        )
        old = {'': self.ENABLE, '_at': self.STEP}
        old |= dict.fromkeys(('_until', '_waits_until', '_next_send'), 0.0)
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
            unnamed=('status', '_status', '_next_send'),
        )
        self.clears = clears
        self.said = ''  # by the newest status
        self.logs = self.make_logs()
        self.asked = {'estop': '', 'enable': '', 'enable_a': '', 'enable_b': ''}
        self.asked_at: dict[str, float] = dict.fromkeys(self.asked, -math.inf)

    def make_logs(self) -> list[Log]:
        return [Log((0, 1), ['enable'])]

    def possible(self) -> Iterator[str]:
        yield from super().possible()
        if self.clears:
            yield 'clear'

    def step(self, event: str) -> None:
        if event == 'clear':
            self.session.clear_errors(self.now)
        elif event == 'plug':
            for log in self.logs:
                log.disabled_at = -math.inf
        super().step('' if event == 'clear' else event)

    def fresh(self, *names: str) -> bool:
        return all(self.now - self.asked_at[name] < self.FRESH for name in names)

    def disobeys(self, log: Log) -> bool:
        return any(log.says(self.said, 1)) and self.now - log.disabled_at >= self.ENABLE

    def sound(self, *logs: Log) -> bool:
        """Tell whether the drive demands no stop of these axes."""
        faulty = any(any(log.says(self.said, 2)) for log in logs)
        return self.vouched(self.LINK) and not faulty and not any(map(self.disobeys, self.logs))

    def allowed(self, log: Log) -> bool:
        """Tell whether all but command and enable hold."""
        return self.sound(log) and self.fresh('estop') and self.asked['estop'] == 'clear'

    def lapse(self) -> None:
        self.watch()
        for log in self.logs:
            waits = log.may and not log.ran
            if waits and log.offered and self.now - log.may_since >= self.ENABLE + self.FRESH:
                log.fail()

    def watch(self) -> None:
        """Note what holds no more."""
        for log in self.logs:
            commanded = self.now - log.asked_at < self.FRESH
            lost = log.may and log.offered and not commanded
            if not (self.allowed(log) and self.fresh(*log.enables)) or lost:
                log.fail()

    def hear(self, said: Sequence[str]) -> None:
        self.stop_said = self.heard_at is not None and self.now - self.heard_at >= self.LINK
        told = [log.told for log in self.logs]
        data = b''.join(self.packet_of(each) for each in said)
        self.keep(self.session.receive(data, self.now))
        for each in said:
            if each not in STATES:
                continue
            self.said, self.heard_at = each, self.now
            for log in self.logs:
                if log.ran and not all(log.says(each, 1)):
                    log.fail()
            self.watch()
            for log, was_told in zip(self.logs, told, strict=True):
                log.ran |= was_told and log.offered and log.may and all(log.says(each, 1))
                if log.ran:
                    log.may_since = -math.inf
        self.stop_said |= any(each in ('fault', 'fault_b') for each in said)

    def packet_of(self, said: str) -> bytes:
        """Return what the drive sends."""
        return SAID[said]

    def keep(self, output: tuple[list[Any], list[Any]]) -> None:
        events, frames = output
        for frame in frames:
            for log in self.logs:
                log.offered = fields(frame)[log.numbers[0]][0]
                log.told |= log.offered and not self.busy
        super().keep((events, [] if self.busy else frames))

    @property
    def busy(self) -> bool:
        return self.doing['line'] == 'busy'

    def ask(self, name: str, what: str) -> None:
        both = {'blip': ['stop', 'clear'], 'gap': ['lost', 'clear'], 'edge': ['false', 'true']}
        for each in both.get(what, [what]):
            if each == 'silent':
                continue
            if name.startswith('enable'):
                self.ask_enable(name, each)
            else:
                getattr(self, f'ask_{name}')(each)

    def ask_line(self, what: str) -> None:
        """Ask nothing: see keep."""

    def ask_estop(self, what: str) -> None:
        if what == 'lost':
            self.session.distrust(what, self.now)
            for log in self.logs:
                log.fail()
            return
        self.session.set_estop(what == 'stop', self.now)
        self.asked['estop'], self.asked_at['estop'] = what, self.now
        self.watch()

    def ask_command(self, what: str) -> None:
        values = COMMANDS[what]
        try:
            self.session.set_command(values, self.now)
        except ValueError:
            assert math.nan in values
        for log in self.logs:
            own = [values[number] for number in log.numbers]
            if None not in own:
                log.asked = values
                log.asked_at = -math.inf if math.nan in own else self.now
        self.watch()

    def ask_enable(self, name: str, what: str) -> None:
        if name == 'enable':
            self.session.set_enable(what == 'true', self.now)
        else:
            self.session.set_axis_enable('ab'.index(name[-1]), what == 'true', self.now)
        self.asked[name], self.asked_at[name] = what, self.now
        for log in self.logs:
            if name not in log.enables:
                continue
            if any(self.asked[each] != 'true' for each in log.enables):
                log.fail()
                log.armed = self.allowed(log) and self.fresh(*log.enables)
            elif log.armed:
                log.may, log.armed, log.may_since = True, False, self.now

    def judge(self) -> None:
        self.watch()
        if self.heard_at is None or self.now - self.heard_at >= self.LINK:
            self.said, self.heard_at = '', None
        verdict = self.verdict
        assert verdict.estop == (not self.sound(*self.logs)), f'after {self.said}: {verdict}'
        if isinstance(verdict, AxesVerdict):
            assert verdict.axes == tuple(not self.sound(log) for log in self.logs)
        fresh = self.heard_at is not None and self.now - self.heard_at < self.LINK
        enabled = self.open and fresh and self.said == 'running'
        assert self.session.enabled == enabled, 'enabled'
        if not verdict.estop:
            assert self.session.deadline() <= (self.heard_at or 0.0) + self.LINK, 'slept'
        assert self.frames or self.quiet(), 'no packet'
        for frame in self.frames:
            self.judge_frame(frame)
            for log in self.logs:
                enables = fields(frame)[log.numbers[0]][0]
                log.disabled_at = math.inf if enables else min(log.disabled_at, self.now)

    def quiet(self) -> bool:
        """Tell whether no packet may go out."""
        return self.busy or not self.open

    def judge_frame(self, frame: bytes) -> None:
        """See that a packet keeps to what is allowed; the newest one is of this moment."""
        for log in self.logs:
            said = [fields(frame)[number] for number in log.numbers]
            assert len({each[:2] for each in said}) == 1, 'the axes are told different things'
            self.judge_axis(log, *said[0])
            log.packet = said[0]

    def judge_axis(self, log: Log, enable: bool, clear: bool, value: int) -> None:
        if enable:
            assert log.may, f'enable, after {self.asked}, {self.said}'
            assert not clear
        if value:
            asked = log.asked[log.numbers[0]] or 0
            assert enable, 'motion without enable'
            assert log.ran, 'motion before the drive is enabled'
            assert log.rested, 'the first packet after it is not at rest'
            was = max(log.packet[2] * math.copysign(1, value), 0)
            assert abs(value) <= was + GROWTH, 'a step'
            assert value * asked > 0, 'a direction that nobody asks for now'
            assert abs(value) <= max(abs(asked), was), 'more than is asked'
        log.rested |= log.ran and enable

    def revive(self) -> None:
        self.play('', '', 'enable true', '', 'drive running', '', '')
        for log in self.logs:
            assert log.packet[2], f'no way to motion: {self.session.inhibits(self.now)}'


class EachWorld(World):
    """
    The two axes apart: what is said of one leaves the other alone.

    Nothing happens to port and process here: World has that.
    """

    AXES_ENABLE = 'each'
    CALM = {**World.CALM, 'enable_a': 'true', 'enable_b': 'true'}

    def __init__(self, **said: Any) -> None:
        super().__init__(**{**said, 'enable_a': 'true', 'enable_b': said.get('enable_b', 'true')})

    def possible(self) -> Iterator[str]:
        apart = ('stall', 'unplug', 'plug', 'freeze', 'overflow')
        yield from (event for event in super().possible() if event not in apart or not self.open)

    def make_logs(self) -> list[Log]:
        return [Log((number,), ['enable', f'enable_{"ab"[number]}']) for number in (0, 1)]


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
    'drive': (34182, 397674),
    'mux': (14827, 151431),
    'silence': (12580, 102846),
    'one read': (34775, 599105),
    'busy': (14865, 124503),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=200)
EACH_SCENES: dict[str, dict[str, Any]] = {
    'one axis': {
        'drive': 'idle running half fault_b',
        'estop': 'clear stop',
        'command': 'run',
        'enable': 'false true',
    },
    'one command': {
        'drive': 'idle running',
        'estop': 'clear',
        'command': 'run alone bad_b',
        'enable': 'false true',
    },
    'two enables': {
        'drive': 'idle running',
        'estop': 'clear',
        'command': 'run',
        'enable': 'false true',
        'enable_b': 'true false silent',
    },
    'one cleared': {
        'drive': 'idle fault_b running',
        'estop': 'clear',
        'command': 'run',
        'enable': 'false true',
        'clears': True,
    },
}
EACH_COUNTS: dict[str, tuple[int, int]] = {
    'one axis': (6782, 40958),
    'one command': (4968, 24978),
    'two enables': (8619, 43253),
    'one cleared': (3037, 15223),
}
test_each_axis_near_the_start, test_each_axis = visits_of(
    EachWorld, EACH_SCENES, EACH_COUNTS, near=200
)
