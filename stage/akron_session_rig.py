# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What tests of the Akron session share: bytes by hand and from the manual, a session's time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from akron_can_bridge.protocol import Axis, BasicJoystick, ExtendedJoystick, Status
from akron_can_bridge.session import Handover, Request, Session, Settings
from bridge_core.j1939 import CanFrame
from bridge_core.mux_words import MuxWords
from bridge_core.session import RETRY
from stage.session_rig import SessionBench

OURS, UNIT = 0x38, 0x80
PIN = '1032AE100801035'
SLOT = 0.02
COMMAND_LIMIT, ESTOP_LIMIT, LINK_LIMIT = 0.15, 0.25, 0.3
COAST = 1.0


def ef(data: str, source: int = UNIT, destination: int = 0xFF) -> CanFrame:
    """Return a message of PGN EF00."""
    return CanFrame(0x18EF0000 | destination << 8 | source, bytes.fromhex(data))


def name(data: str, source: int) -> CanFrame:
    """Return a claimed address, PGN 60928."""
    return CanFrame(0x18EEFF00 | source, bytes.fromhex(data))


def moved(frame: CanFrame, source: int) -> CanFrame:
    """Return the same frame from another address."""
    return CanFrame(frame.identifier & ~0xFF | source, frame.data)


def faults(bits: int, pcode: int = 0) -> CanFrame:
    return ef(f'02{bits:08X}{pcode:04X}', destination=OURS)


def joystick(data: str = '0100010000000000', source: int = 0x33, pgn: int = 0xFDD6) -> CanFrame:
    """Return PGN 64982 or 64983; the default is neutral."""
    return CanFrame(0x0C000000 | pgn << 8 | source, bytes.fromhex(data))


# The manual's examples.
ANNOUNCED = ef('FF83150226021A0B')
NAME = name('0B1AC22800420090', UNIT)
POSITION = ef('011D940371000041')
OUTPUTS = ef('83C051')  # enable is asserted
OSCILLATES = ef('81FED401C280')
STANDS = ef('81FED401C200')
# By hand from them.
OTHER_PIN = '1032AE100801036'
OTHER_ANNOUNCED = ef('FF83150226021A0C', 0x81)
NOT_ENABLED = ef('834051')
OPERATIONAL_ERROR = ef('011D940371000045')
NO_FAULTS = ef('02000000000000', destination=OURS)
VERSIONS = tuple(
    ef(data, destination=OURS) for data in ('03010B02040206', '040D1C000E0204', '050398690E0204')
)

NEUTRAL = bytes.fromhex('0100010000000000')
PAUSE = bytes.fromhex('0100010000000400')  # switch 7
NO_TARGETS = bytes.fromhex('FFFFFFFFFFFF0000')
MOVING = bytes.fromhex('107D046400100000')  # the manual's: 50 % right, 40 % back, switch 2
REST = (BasicJoystick(Axis.of(0), Axis.of(0)), ExtendedJoystick())
MOVE = (
    BasicJoystick(Axis.of(500), Axis.of(-400), (Status.OFF, Status.ON, *(Status.OFF,) * 10)),
    ExtendedJoystick(),
)
DEPLOY = (  # by switch 8, and on by itself
    BasicJoystick(Axis.of(0), Axis.of(0), tuple(Status(n == 8) for n in range(1, 13))),
    ExtendedJoystick(),
)
OSCILLATE = (  # by switch 4, and on by itself
    BasicJoystick(Axis.of(0), Axis.of(0), tuple(Status(n == 4) for n in range(1, 13))),
    ExtendedJoystick(),
)
WATER = (  # switch 3, that moves nothing
    BasicJoystick(Axis.of(0), Axis.of(0), tuple(Status(n == 3) for n in range(1, 13))),
    ExtendedJoystick(),
)
COMMANDS = {
    'rest': REST,
    'move': MOVE,
    'water': WATER,
    'deploy': DEPLOY,
    'oscillate': OSCILLATE,
}
FRAMES = {  # by what a script calls them; `stick` is neutral, `right` is held to the right
    'unit': ANNOUNCED,
    'outputs': OUTPUTS,
    'well': NO_FAULTS,
    'other': OTHER_ANNOUNCED,
    'oscillates': OSCILLATES,
    'stands': STANDS,
    'aims': ef('83D051'),
    'thief': name('0100000000000000', UNIT),
    'disabled': NOT_ENABLED,
    'stick': joystick(),
    'right': joystick('107D010000000000'),
    'back': joystick('0100046400000000'),
    'broken': joystick('127D010000000000'),
    'setup': ef('46', destination=OURS),
    'tool': ef('46', destination=0x05),
    'permits': ef('A1000F', 0x05, UNIT),
}
E = TypeVar('E')


class Bench(SessionBench[Session]):
    """A session at address 38 with everyone that it hears."""

    def __init__(self, *, mux: MuxWords | None = None, **options: Any) -> None:
        super().__init__(Session(Settings(**options), mux))
        self.refuses: Callable[[CanFrame], bool] = lambda frame: False  # the line, so busy is it

    def _keep(self, output: tuple[list[Any], list[Any]]) -> list[Any]:
        events, frames = output
        taken = [frame for frame in frames if not self.refuses(frame)]
        if len(taken) < len(frames):
            self._retry_at = self.now + RETRY
        return super()._keep((events, taken))

    def open(self, before: Handover | None = None) -> list[Any]:
        """Open the port as the node does."""
        found = super().open()
        self.session.take_over(before, False, self.now)
        return found + self.poll()

    def hear_unit(self) -> list[Any]:
        """Hear what a sound unit broadcasts every 100 ms."""
        return self.take(OUTPUTS, POSITION)

    def find_unit(self, before: Handover | None = None) -> Bench:
        """Open the port, find the unit, get its faults: no stop any more."""
        self.open(before)
        self.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
        return self

    def command(self, command: tuple[Any, Any] = REST) -> list[Any]:
        self.session.set_command(*command, self.now)
        return self.poll()

    def estop_in(self, value: bool) -> list[Any]:
        self.session.set_estop(value, self.now)
        return self.poll()

    def run(
        self,
        seconds: float,
        command: tuple[Any, Any] | None = None,
        *,
        estop: bool | None = False,
        unit: bool = True,
    ) -> list[Any]:
        """Let all that keeps coming come every 20 ms; None: it does not."""
        before = len(self.events)
        for _ in range(round(seconds / SLOT)):
            self.wait(SLOT)
            if unit:
                self.hear_unit()
            if estop is not None:
                self.estop_in(estop)
            if command is not None:
                self.command(command)
        return self.events[before:]

    def moving(self) -> Bench:
        """Have the unit found and moved."""
        self.find_unit()
        self.run(0.1, REST)
        self.run(0.1, MOVE)
        assert self.joystick_frames()[-1] == MOVING
        return self

    def play(self, script: str) -> Bench:
        """
        Carry out a script of steps, divided by ';'; return itself.

        - ``0.5 move stop``: run so many seconds, with a command or without one; ``stop`` and
          ``silent`` are of the e-stop input, ``gone`` of the unit.
        - ``do move``: command once; ``refuse``: one without sense. ``estop``, ``clear``: of the
          e-stop input, once; ``blink``: both at once.
        - ``say right@34 unit``: these FRAMES come, from their own sender or from an address;
          so does a message of PGN EF00, ``83C051``.
          ``says stands``: what the unit says besides, from now on. ``turn``, ``stand``.
        - ``wait 0.5``: hear nothing. ``late 0.5``: do not even look.
        - ``find``, ``open``, ``close``, ``lost``: the unit; the port; what was heard.
        - ``told``, ``told on``, ``told lost``: that there was no session before, or one, or one
          whose wire was lost.
        - ``ask enter_setup``, ``directions 9``, ``limit``: of the session.
        - ``mark``: forget what was sent and told.
        """
        for step in filter(None, map(str.strip, script.split(';'))):
            verb, *rest = step.split()
            if verb[0].isdecimal():
                self._run(float(verb), rest)
            else:
                self._step(verb, rest)
        return self

    def _run(self, seconds: float, words: list[str]) -> None:
        command = next((COMMANDS[word] for word in words if word in COMMANDS), None)
        estop = None if 'silent' in words else 'stop' in words
        self.run(seconds, command, estop=estop, unit='gone' not in words)

    def _step(self, verb: str, rest: list[str]) -> None:
        session = self.session
        steps: dict[str, Callable[..., Any]] = {
            'do': lambda name: session.set_command(*COMMANDS[name], self.now),
            'refuse': lambda: session.refuse_command('axis 0 is nan', self.now),
            'estop': lambda: session.set_estop(True, self.now),
            'clear': lambda: session.set_estop(False, self.now),
            'blink': self._blink,
            'say': lambda *names: self.take(*map(_frame, names)),
            'wait': lambda seconds: self.wait(float(seconds)),
            'find': self.find_unit,
            'open': lambda: SessionBench.open(self),
            'close': self.close,
            'told': self._told,
            'lost': lambda: session.interrupted('messages were lost', self.now),
            'ask': lambda name: session.request(Request(name), self.now),
            'directions': lambda number: session.set_directions(int(number), self.now),
            'limit': lambda: session.limit_directions(self.now),
        }
        if verb in steps:
            steps[verb](*rest)
            self.poll()
        elif verb == 'mark':
            self.sent.clear()
            self.events.clear()
        elif verb == 'late':
            self.now += float(rest[0])
        else:
            self._tell(verb, rest)

    def _told(self, before: str = '') -> None:
        handover = Handover() if before else None
        self.session.take_over(handover, before == 'lost', self.now)

    def _blink(self) -> None:
        for value in (True, False):
            self.session.set_estop(value, self.now)

    def _tell(self, verb: str, rest: list[str]) -> None:
        """Have the unit do something else from now on."""
        raise ValueError(f'{verb} is no step: {rest}')

    def frames(self, identifier: int, since: float = 0.0) -> list[bytes]:
        """Return the data of what was sent with this identifier."""
        return [f.data for at, f in self.sent if at >= since and f.identifier == identifier]

    def joystick_frames(self, since: float = 0.0, source: int = OURS) -> list[bytes]:
        return self.frames(0x0CFDD600 | source, since)

    def asked(self, since: float = 0.0, unit: int = UNIT) -> list[str]:
        """Return what was sent to the unit on PGN EF00, in hexadecimal."""
        return [data.hex().upper() for data in self.frames(0x18EF0000 | unit << 8 | OURS, since)]

    def all_neutral(self, since: float) -> bool:
        """Tell whether all joystick frames from a moment on are neutral, and there are some."""
        return set(self.joystick_frames(since)) == {NEUTRAL}


class Turning(Bench):
    """A session whose unit turns to the right while ``turns``, ``speed`` degrees a second."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.turns = False
        self.speed = 5.0
        self.elevation = '0371'
        self.says: list[CanFrame] = []  # besides its position and its outputs
        self._tenths = 0.0

    def hear_unit(self) -> list[Any]:
        self._tenths += self.turns * self.speed * 10.0 * SLOT
        place = f'01{int(self._tenths + 1e-6):03X}4{self.elevation}000041'
        return self.take(OUTPUTS, ef(place), *self.says)

    def _tell(self, verb: str, rest: list[str]) -> None:
        if verb in ('turn', 'stand'):
            self.turns = verb == 'turn'
        elif verb == 'says':
            self.says = list(map(_frame, rest))
        else:
            super()._tell(verb, rest)

    def ready(self, before: Handover | None = None) -> Turning:
        """Have the unit found, at rest for long."""
        self.find_unit(before)
        self.run(2.0, REST)
        assert not self.session.estop
        return self


def oscillating(**options: Any) -> Turning:
    """Return one whose unit oscillates as it was asked to, and is to be paused by a stop."""
    given = {'automatic_motion': True, 'button_switches': (4,), 'pause_on_stop': True, **options}
    bench = Turning(**given)
    bench.says = [STANDS]
    bench.ready()
    bench.run(0.1, OSCILLATE)
    bench.turns, bench.says = True, [OSCILLATES]
    bench.run(1.0, REST)
    assert not bench.session.estop
    return bench


def _frame(word: str) -> CanFrame:
    what, _, source = word.partition('@')
    frame = FRAMES.get(what) or ef(what)
    return moved(frame, int(source, 16)) if source else frame


def permission(bench: Bench) -> str:
    """Return the last A1 that was sent."""
    return [data.hex().upper() for data in bench.frames(0x18EF8038) if data[0] == 0xA1][-1]


def of(kind: type[E], events: list[Any]) -> list[E]:
    return [event for event in events if isinstance(event, kind)]
