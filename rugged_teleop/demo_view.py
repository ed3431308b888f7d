"""
The live view: remotes, e-stops, the mux and its reasons, the wires, what moves; keys steer.

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
from rugged_teleop.demo_further import turns_in
from rugged_teleop.demo_stage import packets_in
from rugged_teleop.demo_stage import Stage
from rugged_teleop.ports import DevicePort

PERIOD = 0.1
NUDGE = 0.2  # of full deflection, a key
_BAR = 20  # characters of a full bar
_FULL_RPM = 2000.0
_RECENT = 0.5  # s; older bytes are not shown as the newest
_KEYS = (
    'FORT    arrows  stick; c centres it     d  deadman    space  e-stop    a  acknowledge',
    '        w  wired e-stop of the VSC      u  unplug or plug the VSC',
    'VM-110  i j k l  stick; x centres it    b  deadman    s  stop switch   m  arm   n  disarm',
    'SSC     4 8 2 6  stick; 5 centres it    0  deadman    9  power of the RC receiver',
    'monitor g y v h  right stick of FORT; z centres it',
    'mux     r  reset      t  trip           drive  f  fault   e  clear errors    q  quit',
)
_NUDGES = {  # which stick of whom, and how far
    'up': ('vsc', 'stick left_y', NUDGE),
    'down': ('vsc', 'stick left_y', -NUDGE),
    'left': ('vsc', 'stick left_x', -NUDGE),  # the VSC counts to the right
    'right': ('vsc', 'stick left_x', NUDGE),
    'i': ('unit', 'stick 1 2', NUDGE),
    'k': ('unit', 'stick 1 2', -NUDGE),
    'j': ('unit', 'stick 1 1', NUDGE),
    'l': ('unit', 'stick 1 1', -NUDGE),
    '8': ('ssc', 'channel 3', NUDGE),
    '2': ('ssc', 'channel 3', -NUDGE),
    '4': ('ssc', 'channel 2', -NUDGE),  # reversed, as the bridge's defaults have it
    '6': ('ssc', 'channel 2', NUDGE),
    'y': ('vsc', 'stick right_y', NUDGE),
    'v': ('vsc', 'stick right_y', -NUDGE),
    'g': ('vsc', 'stick right_x', -NUDGE),
    'h': ('vsc', 'stick right_x', NUDGE),
}
_CENTRES = {  # whose, and how the words of its sticks begin
    'c': ('vsc', 'stick left'),
    'x': ('unit', 'stick'),
    '5': ('ssc', 'channel'),
    'z': ('vsc', 'stick right'),
}
_SWITCHES = {  # whose, what switches on, what off
    'd': ('vsc', 'button left_down 1', 'button left_down 0'),
    ' ': ('vsc', 'estop remote on', 'estop remote off'),
    'w': ('vsc', 'estop vsc on', 'estop vsc off'),
    'u': ('vsc', 'unplug', 'plug'),
    'b': ('unit', 'switch 1 1 1', 'switch 1 1 0'),
    's': ('unit', 'stop 1 on', 'stop 1 off'),
    '0': ('ssc', 'channel 4 2000', 'channel 4 1000'),
    '9': ('ssc', 'receiver off', 'receiver on'),
}
_PLAIN = {
    'a': [('vsc', 'ack'), ('vsc', 'mode operational')],
    'm': [('unit', 'arm 1')],
    'n': [('unit', 'disarm')],
    'f': [('drive', 'fault a overcurrent pulse')],
    'r': [('service', 'reset')],
    'e': [('service', 'clear_errors')],
    't': [('service', 'trip')],
}

_ARROWS = {'A': 'up', 'B': 'down', 'C': 'right', 'D': 'left'}
# ANSI control sequences, which every terminal of today knows.
_ENTER, _LEAVE = '\x1b[?1049h\x1b[?25l', '\x1b[?25h\x1b[?1049l'  # own screen, no cursor
_HOME, _END_OF_LINE, _BLANK_REST = '\x1b[H', '\x1b[K\r\n', '\x1b[J'

Say = Callable[[str, str], None]  # a device of the stage, or 'service'; command or name


@dataclass(slots=True)
class Hands:
    """
    The operators' hands on remotes without springs: a terminal tells of no key that is let go.

    :param say: where commands go; may raise ValueError.
    """

    say: Say
    sticks: dict[tuple[str, str], float] = field(default_factory=dict)  # that were ever moved
    switches: dict[str, bool] = field(default_factory=dict)
    leaving: bool = False

    def press(self, key: str) -> None:
        """Do what the key means. :raises ValueError: what the device answers to it."""
        if key in _NUDGES:
            target, stick, by = _NUDGES[key]
            self._move(target, stick, self.sticks.get((target, stick), 0.0) + by)
        elif key in _CENTRES:
            whose, words = _CENTRES[key]
            for target, stick in self.sticks:
                if target == whose and stick.startswith(words):
                    self._move(target, stick, 0.0)
        elif key in _SWITCHES:
            target, on, off = _SWITCHES[key]
            self.say(target, off if self.switches.get(key) else on)
            self.switches[key] = not self.switches.get(key)
        elif key == 'q':
            self.leaving = True
        for target, command in _PLAIN.get(key, ()):
            self.say(target, command)

    def _move(self, target: str, stick: str, to: float) -> None:
        value = round(min(max(to, -1.0), 1.0), 2)
        self.sticks[target, stick] = value
        self.say(target, f'{stick} {1500 + round(500 * value) if target == "ssc" else value}')


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything that the picture shows, taken at one moment."""

    vsc: dict[str, Any]  # as the simulator describes itself
    unit: dict[str, Any]
    ssc: dict[str, Any]
    monitor: dict[str, Any]
    turns: bool | None  # what the monitor was told last; None: nothing lately
    drive: dict[str, Any]
    axes: tuple[float, ...]  # of FORT's Joy
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
    frames = turns_in(stage.monitor.received(now - _RECENT))
    values = watcher.values
    return Snapshot(
        vsc=stage.vsc.describe(),
        unit=stage.unit.describe(),
        ssc=stage.ssc.describe(),
        monitor=stage.monitor.describe(),
        turns=frames[-1][1] if frames else None,
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


def picture(seen: Snapshot, width: int = 100, height: int = 50) -> list[str]:
    """Return the lines of the view, none longer than ``width``; tight where there are too many."""
    lines = [
        'rugged_teleop demo: simulated devices, real nodes',
        '',
        *_vsc_lines(seen),
        *_unit_lines(seen.unit),
        _ssc_line(seen.ssc),
        '',
        'e-stops  ' + '   '.join(f'{n} {_estop_word(v)}' for n, v in seen.estops.items()),
        f'mux      {seen.state or "not heard yet"}, owner {seen.owner or "none"}',
    ]
    for text in seen.inhibits or ('nothing holds it back',):
        lines += textwrap.wrap(text, width, initial_indent='         ', subsequent_indent=13 * ' ')
    lines += ['', *_wire_lines(seen), '', *_motor_lines(seen), _monitor_line(seen)]
    lines += ['', f'>        {seen.note}', '', *_KEYS]
    if len(lines) > height:
        lines = [line for line in lines if line]
    return [line[:width] for line in lines]


def _vsc_lines(seen: Snapshot) -> list[str]:
    vsc = seen.vsc
    plugged = 'plugged in' if vsc['plugged'] else 'UNPLUGGED'
    pressed = [name for name in ('remote', 'wired', 'host') if vsc[f'{name}_estop']]
    chain = 'closed' if vsc['master_enable'] else 'OPEN'
    sticks = vsc['sticks']
    held = 'HELD' if 'left_down' in vsc['buttons'] else 'released'
    axes = ' '.join(f'{axis:+.2f}' for axis in seen.axes) or 'none'
    return [
        f'FORT     {plugged}, mode {vsc["mode"]}, e-stop by {", ".join(pressed) or "none"}, '
        f'Master Enable {chain}',
        f'         left stick x {sticks["left_x"]:+.2f} y {sticks["left_y"]:+.2f}, deadman {held}',
        f'         Joy axes {axes}   buttons {"".join(map(str, seen.buttons)) or "none"}',
    ]


def _unit_lines(unit: dict[str, Any]) -> list[str]:
    remote = unit['remotes']['1']
    armed = 'armed' if unit['armed'] == '1' else 'not armed'
    switch = 'PRESSED' if 'stopped' in remote['on'] else 'released'
    turn, forward = remote['sticks'][:2]
    held = 'HELD' if remote['switches'][0] else 'released'
    chain = 'closed' if unit['relays_closed'] else 'OPEN'
    return [
        f'VM-110   {unit["state"]}, remote 1 {armed}, stop switch {switch}, relays {chain}',
        f'         stick x {turn:+.2f} y {forward:+.2f}, deadman {held}',
    ]


def _ssc_line(ssc: dict[str, Any]) -> str:
    turn, forward, deadman = (us or 0 for us in ssc['inputs_us'][1:4])
    held = 'HELD' if deadman > 1500 else 'released'
    power = 'on' if ssc['receiver'] else 'OFF'
    return (
        f'SSC      receiver {power}, command channel {ssc["command_state"]}, '
        f'stick x {turn} y {forward}, deadman {held}, throttle {ssc["outputs_us"][0]} us'
    )


def _monitor_line(seen: Snapshot) -> str:
    told = {True: 'turn', False: 'neutral', None: 'nothing'}[seen.turns]
    turned, raised = seen.monitor['rotation_deg'], seen.monitor['elevation_deg']
    moves = 'moves' if seen.monitor['moving'] else 'still'
    return f'monitor  rotation {turned:+.1f} elevation {raised:+.1f} degrees, told {told}, {moves}'


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
        self._note = 'press a; when the VSC and the drive are clear, press r, d and an arrow'

    def run(self) -> None:
        """Draw and obey until the user leaves. :raises DemoError: the stack has ended."""
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
        lines = picture(take(self._stage, self._note), width - 1, height - 1)[: height - 1]
        text = ''.join(f'{line}{_END_OF_LINE}' for line in lines)
        print(f'{_HOME}{text}{_BLANK_REST}', end='', flush=True)

    def _say(self, target: str, command: str) -> None:
        if target == 'service':
            self._stage.watcher.ask(command, self._on_reply)
            return
        device: DevicePort = getattr(self._stage, target)
        device.apply(command)
        self._note = f'{target}: {command}'

    def _on_reply(self, success: bool, message: str) -> None:
        self._note = message if success else f'refused: {message}'
