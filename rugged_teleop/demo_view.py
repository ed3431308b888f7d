"""
The live view: sticks, e-stops, the mux and its reasons, the drive's wire, the motors; keys steer.

``Hands`` turns keys into commands and ``picture`` turns a snapshot into lines; neither needs a
terminal. ``live`` joins them to one.
"""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Iterator
import contextlib
from dataclasses import dataclass
from dataclasses import field
import os
import select
import shutil
import sys
import termios
import textwrap
import time
import tty
from typing import Any

from esi_drive_bridge.protocol import Command
from rugged_teleop.demo_stage import packets_in
from rugged_teleop.demo_stage import Stage

PERIOD = 0.1
NUDGE = 0.2  # of full deflection, a key
_BAR = 20  # characters of a full bar
_FULL_RPM = 2000.0
_RECENT = 0.5  # s; older bytes are not shown as the newest
_KEYS = (
    'arrows  left stick; c centres it       d  deadman, held or released',
    'r  reset      e  clear drive errors    space  e-stop of the remote, press or release',
    't  trip       f  fault in the drive    a  acknowledge a stop on the remote',
    'u  unplug or plug the VSC              w  wired e-stop of the VSC      q  quit',
)

_ARROWS = {'A': 'up', 'B': 'down', 'C': 'right', 'D': 'left'}
# ANSI control sequences, which every terminal of today knows.
_ENTER, _LEAVE = '\x1b[?1049h\x1b[?25l', '\x1b[?25h\x1b[?1049l'  # own screen, no cursor
_HOME, _END_OF_LINE, _BLANK_REST = '\x1b[H', '\x1b[K\r\n', '\x1b[J'

Say = Callable[[str, str], None]  # 'vsc', 'drive' or 'service'; command or name


@dataclass(slots=True)
class Hands:
    """
    The operator's hands on a remote without springs: a terminal tells of no key that is let go.

    :param say: where commands go; may raise ValueError.
    """

    say: Say
    sticks: dict[str, float] = field(default_factory=lambda: {'left_x': 0.0, 'left_y': 0.0})
    switches: dict[str, bool] = field(default_factory=dict)
    leaving: bool = False

    def press(self, key: str) -> None:
        """Do what the key means. :raises ValueError: what the device answers to it."""
        nudges = {
            'up': ('left_y', NUDGE),
            'down': ('left_y', -NUDGE),
            'left': ('left_x', -NUDGE),
            'right': ('left_x', NUDGE),
        }
        switches = {
            'd': ('vsc', 'button left_down 1', 'button left_down 0'),
            ' ': ('vsc', 'estop remote on', 'estop remote off'),
            'w': ('vsc', 'estop vsc on', 'estop vsc off'),
            'u': ('vsc', 'unplug', 'plug'),
        }
        plain = {
            'a': [('vsc', 'ack'), ('vsc', 'mode operational')],
            'f': [('drive', 'fault a overcurrent pulse')],
            'r': [('service', 'reset')],
            'e': [('service', 'clear_errors')],
            't': [('service', 'trip')],
        }
        if key in nudges:
            self._move(*nudges[key])
        elif key == 'c':
            for name in self.sticks:
                self._move(name, -self.sticks[name])
        elif key in switches:
            target, on, off = switches[key]
            self.say(target, off if self.switches.get(key) else on)
            self.switches[key] = not self.switches.get(key)
        elif key == 'q':
            self.leaving = True
        for target, command in plain.get(key, ()):
            self.say(target, command)

    def _move(self, name: str, by: float) -> None:
        value = round(min(max(self.sticks[name] + by, -1.0), 1.0), 2)
        self.sticks[name] = value
        self.say('vsc', f'stick {name} {value}')


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything that the picture shows, taken at one moment."""

    vsc: dict[str, Any]  # as the simulator describes itself
    drive: dict[str, Any]
    axes: tuple[float, ...]  # of Joy
    buttons: tuple[int, ...]
    estops: dict[str, bool | None]  # None: not heard lately
    state: str
    owner: str
    inhibits: tuple[str, ...]
    velocities: dict[str, float]  # rad/s
    to_drive: tuple[bytes, Command | None]
    from_drive: bytes
    note: str = ''


def take(stage: Stage, note: str = '') -> Snapshot:
    """Return what there is to see now."""
    watcher, now = stage.watcher, time.monotonic()
    received = stage.drive.received(now - _RECENT)
    packets = packets_in(received, 0.0)
    sent = stage.drive.sent(now - _RECENT)
    values = watcher.values
    return Snapshot(
        vsc=stage.vsc.describe(),
        drive=stage.drive.describe(),
        axes=watcher.axes,
        buttons=watcher.buttons,
        estops={
            name: value if now - at < _RECENT else None
            for name, (at, value) in watcher.estops.items()
        },
        state=watcher.state,
        owner=values.get('owner', ''),
        inhibits=tuple(watcher.inhibits),
        velocities=watcher.velocities,
        to_drive=(
            received[-1].data if received else b'',
            packets[-1].command if packets else None,
        ),
        from_drive=sent[-1].data if sent else b'',
        note=note,
    )


def picture(seen: Snapshot, width: int = 100) -> list[str]:
    """Return the lines of the view, none longer than ``width``."""
    lines = [
        'rugged_teleop demo: simulated remote and drive, real nodes',
        '',
        *_remote_lines(seen),
        '',
        'e-stops  ' + '   '.join(f'{n} {_estop_word(v)}' for n, v in seen.estops.items()),
        f'mux      {seen.state or "not heard yet"}, owner {seen.owner or "none"}',
    ]
    for text in seen.inhibits or ('nothing holds it back',):
        lines += textwrap.wrap(text, width, initial_indent='         ', subsequent_indent=13 * ' ')
    lines += ['', *_wire_lines(seen), '', *_motor_lines(seen), '', f'>        {seen.note}', '']
    return [line[:width] for line in (*lines, *_KEYS)]


def _remote_lines(seen: Snapshot) -> list[str]:
    vsc = seen.vsc
    plugged = 'plugged in' if vsc['plugged'] else 'UNPLUGGED'
    pressed = [name for name in ('remote', 'wired') if vsc[f'{name}_estop']]
    sticks = vsc['sticks']
    held = 'HELD' if 'left_down' in vsc['buttons'] else 'released'
    axes = ' '.join(f'{axis:+.2f}' for axis in seen.axes) or 'none'
    return [
        f'remote   {plugged}, mode {vsc["mode"]}, e-stop pressed: {", ".join(pressed) or "none"}',
        f'         left stick x {sticks["left_x"]:+.2f} y {sticks["left_y"]:+.2f}, deadman {held}',
        f'Joy      axes {axes}   buttons {"".join(map(str, seen.buttons)) or "none"}',
    ]


def _wire_lines(seen: Snapshot) -> list[str]:
    data, command = seen.to_drive
    words = 'no packets' if command is None else _command_words(command)
    return [
        f'to drive    {data.hex(" ") or "nothing"}',
        f'            {words}',
        f'from drive  {seen.from_drive.hex(" ") or "nothing"}',
    ]


def _command_words(command: Command) -> str:
    return '   '.join(
        f'{letter}: {"enable" if axis.enable else "disable"} {axis.mode.name.lower()} {axis.value}'
        for letter, axis in zip('AB', command.axes, strict=False)
    )


def _motor_lines(seen: Snapshot) -> list[str]:
    drive = seen.drive
    lines = []
    for number, (letter, rpm) in enumerate(zip('AB', drive['rpm'], strict=False)):
        state = 'enabled' if drive['enabled'][number] else 'disabled'
        errors = ', '.join(drive['errors'][number])
        lines.append(f'motor {letter}  [{_bar(rpm)}] {rpm:+7.0f} rpm  {state} {errors}'.rstrip())
    speeds = ', '.join(f'{name} {value:+.2f}' for name, value in seen.velocities.items())
    return [*lines, f'joints   {speeds or "not heard"} rad/s']


def _bar(rpm: float) -> str:
    length = min(round(abs(rpm) / _FULL_RPM * _BAR), _BAR)
    left, right = (length, 0) if rpm < 0 else (0, length)
    return f'{"#" * left:>{_BAR}}|{"#" * right:<{_BAR}}'


def _estop_word(value: bool | None) -> str:
    return {True: 'STOP', False: 'clear', None: 'silent (STOP)'}[value]


def keys_in(data: bytes) -> list[str]:
    """Return the keys that a terminal's bytes mean: characters, and 'up' and the like."""
    text = data.decode(errors='ignore')
    found = []
    while text:
        arrow = text[:2] in ('\x1b[', '\x1bO') and _ARROWS.get(text[2:3])
        found.append(arrow or text[0])
        text = text[3:] if arrow else text[1:]
    return found


def live(stage: Stage) -> bool:
    """Show the view until 'q' is pressed. Tell whether all went well."""
    with _full_screen(sys.stdin.fileno()):
        _Terminal(stage, sys.stdin.fileno()).run()
    return True


@contextlib.contextmanager
def _full_screen(keyboard: int) -> Iterator[None]:
    """Give keys at once and unseen, on a screen of its own; put all back afterwards."""
    before = termios.tcgetattr(keyboard)
    print(_ENTER, end='', flush=True)
    try:
        tty.setcbreak(keyboard)
        yield
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
        print(_LEAVE, end='', flush=True)


class _Terminal:
    """The view on a terminal."""

    def __init__(self, stage: Stage, keyboard: int) -> None:
        self._stage = stage
        self._keyboard = keyboard
        self._hands = Hands(self._say)
        self._note = 'wait until both e-stops are clear, then press r, d and an arrow'

    def run(self) -> None:
        """Draw and obey until the user leaves. :raises DemoError: the stack has ended."""
        self._say('vsc', 'mode operational')
        while not self._hands.leaving:
            self._stage.check()
            self._draw()
            if select.select([self._keyboard], [], [], PERIOD)[0]:
                data = os.read(self._keyboard, 1024)
                for key in keys_in(data) or ['q']:  # no data: the terminal is gone
                    self._press(key)

    def _press(self, key: str) -> None:
        try:
            self._hands.press(key)
        except ValueError as error:
            self._note = str(error)

    def _draw(self) -> None:
        width, height = shutil.get_terminal_size()
        lines = picture(take(self._stage, self._note), width - 1)[: height - 1]
        text = ''.join(f'{line}{_END_OF_LINE}' for line in lines)
        print(f'{_HOME}{text}{_BLANK_REST}', end='', flush=True)

    def _say(self, target: str, command: str) -> None:
        if target == 'service':
            self._stage.watcher.ask(command, self._on_reply)
            return
        device = self._stage.vsc if target == 'vsc' else self._stage.drive
        device.apply(command)
        self._note = f'{target}: {command}'

    def _on_reply(self, success: bool, message: str) -> None:
        self._note = message if success else f'refused: {message}'
