# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The live view: remotes, e-stops, the mux and its reasons, the wires, what moves; keys steer.

``Keyboard`` turns keys into commands and ``picture`` a stage into lines; neither needs a terminal.
``live`` joins them to one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
import os
import re
import select
import shutil
import sys
import termios
import textwrap
import time
import tty
from typing import Any

from demo.actuators import turns_in
from demo.stage import DemoStage, ESTOPS
from stage.devices import CLEAR_ERRORS, END_TRIP, Packet, RESET, TRIP

PERIOD = 0.1
_SPIN = 0.01  # s, at most, between two looks for a key
NUDGE = 0.2  # of full deflection, a key
_BAR = 20  # characters of a full bar
_FULL_RPM = 2000.0
_RECENT = 0.5  # s; older bytes are not shown as the newest
_KEYS = (
    'FORT    arrows  stick, c centre    d  deadman   space  e-stop   a  acknowledge',
    '        w  wired e-stop of the VSC    u  unplug or plug the VSC',
    'VM-110  i j k l  stick, x centre  b  deadman   s  stop switch  m  arm  n  disarm',
    'SSC     4 8 2 6  stick, 5 centre   0  deadman   9  power of the RC receiver',
    'monitor g y v h  right stick of FORT, z centre',
    'mux     r  reset   t  trip    drive  f  fault   e  clear errors    q  quit',
)
_STICKS = {  # whose, and which; the keys for more, for less and for its centre
    ('vsc', 'stick left_y'): ('up', 'down', 'c'),
    ('vsc', 'stick left_x'): ('right', 'left', 'c'),  # the VSC counts to the right
    ('unit', 'stick 1 2'): ('i', 'k', 'x'),
    ('unit', 'stick 1 1'): ('j', 'l', 'x'),
    ('ssc', 'channel 3'): ('8', '2', '5'),
    ('ssc', 'channel 2'): ('6', '4', '5'),  # reversed, as the bridge's defaults have it
    ('vsc', 'stick right_y'): ('y', 'v', 'z'),
    ('vsc', 'stick right_x'): ('h', 'g', 'z'),
}
_SWITCHES = {  # whose, what switches on, what off
    'd': ('vsc', 'button left_down 1', 'button left_down 0'),
    ' ': ('vsc', 'estop remote on', 'estop remote off'),
    'w': ('vsc', 'estop vsc on', 'estop vsc off'),
    'u': ('vsc', 'unplug', 'plug'),
    't': ('service', TRIP, END_TRIP),
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
    'r': [('service', RESET)],
    'e': [('service', CLEAR_ERRORS)],
}
_KNOWN = {key for keys in _STICKS.values() for key in keys} | {*_SWITCHES, *_PLAIN, 'q'}

# The mux's states, as ANSI colours: red, yellow, green. The word says it too.
_COLOURS = {'STOPPED': 31, 'STOPPING': 31, 'READY': 33, 'ACTIVE': 32}
_STATE = re.compile(rf'(?<=^mux      )({"|".join(_COLOURS)})\b')
_ESTOP = {True: 'STOP', False: 'clear', None: 'silent (STOP)'}
_CHAIN = {True: 'closed', False: 'OPEN'}
_HELD = {True: 'HELD', False: 'released'}
_MODES = ('torque', 'velocity', 'position', 'no mode')  # of an axis: bits 2 and 3 of its flags
_DEVICES = ('vsc', 'unit', 'ssc', 'monitor', 'drive')
_ARROWS = {'A': 'up', 'B': 'down', 'C': 'right', 'D': 'left'}
# ANSI control sequences, which every terminal of today knows.
_ENTER, _LEAVE = '\x1b[?1049h\x1b[?25l', '\x1b[?25h\x1b[?1049l'  # own screen, no cursor
_HOME, _END_OF_LINE, _BLANK_REST = '\x1b[H', '\x1b[K\r\n', '\x1b[J'


@dataclass(slots=True)
class Keyboard:
    """The hands on the remotes, which have no springs: a terminal reports no key's release."""

    say: Callable[[str, str], None]  # a device of the stage, or 'service'; command or name
    sticks: dict[tuple[str, str], float] = field(default_factory=dict)  # that were ever moved
    switches: dict[str, bool] = field(default_factory=dict)
    leaving: bool = False

    def press(self, key: str) -> None:
        """Do what the key means. :raises ValueError: what the device answers to it."""
        for stick, (more, less, centre) in _STICKS.items():
            if key in (more, less):
                self._move(stick, self.sticks.get(stick, 0.0) + (NUDGE if key == more else -NUDGE))
            elif key == centre and stick in self.sticks:
                self._move(stick, 0.0)
        if key in _SWITCHES:
            target, on, off = _SWITCHES[key]
            self.say(target, off if self.switches.get(key) else on)
            self.switches[key] = not self.switches.get(key)
        self.leaving |= key == 'q'
        if key not in _KNOWN:
            raise ValueError(f'{key!r} is no key of the demo; those below are')
        for target, command in _PLAIN.get(key, ()):
            self.say(target, command)

    def _move(self, stick: tuple[str, str], to: float) -> None:
        self.sticks[stick] = value = round(min(max(to, -1.0), 1.0), 2)
        target, command = stick
        self.say(target, f'{command} {1500 + round(500 * value) if target == "ssc" else value}')


def picture(stage: DemoStage, note: str, width: int = 100, height: int = 50) -> list[str]:
    """
    Return the lines of the view, none longer than ``width``.

    Where there are too many for ``height``, blank ones go first, then those above the keys.
    """
    vsc, unit, ssc, monitor, drive = (getattr(stage, name).describe() for name in _DEVICES)
    since, status = time.monotonic() - _RECENT, stage.values
    received, sent = stage.drive.received(since)[-1:], stage.drive.sent(since)[-1:]
    turns = [turns for _, turns in turns_in(stage.monitor.received(since))][-1:]
    remote, sticks, joints = unit['remotes']['1'], vsc['sticks'], stage.relay.joints
    pressed = ', '.join(by for by in ('remote', 'wired', 'host') if vsc[f'{by}_estop']) or 'none'
    axes = ' '.join(f'{axis:+.2f}' for axis in stage.axes) or 'none'
    buttons = ''.join(map(str, stage.relay.joy.buttons)) or 'none'
    turn, forward, deadman = (us or 0 for us in ssc['inputs_us'][1:4])
    speeds = ', '.join(map('{} {:+.2f}'.format, joints.name, joints.velocity)) or 'not heard'
    estops = (f'{name} {_ESTOP[stage.estop(node, _RECENT)]}' for name, node in ESTOPS.items())
    inhibits = [text for key, text in status.items() if key.startswith('inhibit')]
    lines = [
        f'{stage.page_address or "rugged_teleop demo"}   elsewhere: '
        f'ROS_DOMAIN_ID={os.environ.get("ROS_DOMAIN_ID", 0)} ros2 topic echo /safety_mux/state',
        '',
        f'FORT     {"plugged in" if vsc["plugged"] else "UNPLUGGED"}, mode {vsc["mode"]}, '
        f'e-stop by {pressed}, Master Enable {_CHAIN[vsc["master_enable"]]}',
        f'         left stick x {sticks["left_x"]:+.2f} y {sticks["left_y"]:+.2f}, '
        f'deadman {_HELD["left_down" in vsc["buttons"]]}',
        f'         Joy axes {axes}   buttons {buttons}',
        f'VM-110   {unit["state"]}, remote 1 {"armed" if unit["armed"] == "1" else "not armed"}, '
        f'stop switch {"PRESSED" if "stopped" in remote["on"] else "released"}, '
        f'relays {_CHAIN[unit["relays_closed"]]}',
        f'         stick x {remote["sticks"][0]:+.2f} y {remote["sticks"][1]:+.2f}, '
        f'deadman {_HELD[bool(remote["switches"][0])]}',
        f'SSC      receiver {"on" if ssc["receiver"] else "OFF"}, '
        f'command channel {ssc["command_state"]}, stick x {turn} y {forward}, '
        f'deadman {_HELD[deadman > 1500]}, throttle {ssc["outputs_us"][0]} us',
        '',
        f'e-stops  {"   ".join(estops)}',
        f'mux      {status.get("state", "not heard yet")}, owner {status.get("owner", "none")}',
        *_wrapped(inhibits or ['nothing holds it back'], width),
        '',
        *map(_motor_line, 'AB', drive['rpm'], drive['enabled'], drive['errors']),
        *([f'drive    {stage.relay.drive_says}'] if stage.relay.drive_says else []),
        f'joints   {speeds} rad/s',
        f'monitor  rotation {monitor["rotation_deg"]:+.1f} elevation '
        f'{monitor["elevation_deg"]:+.1f} degrees, '
        f'command {"nothing" if not turns else "turn" if turns[0] else "neutral"}, '
        f'{"moves" if monitor["moving"] else "still"}',
        '',
        f'to drive    {received[0].data.hex(" ") if received else "nothing"}',
        f'            {_command(stage.drive.packets(since)[-1:])}',
        f'from drive  {sent[0].data.hex(" ") if sent else "nothing"}',
        '',
    ]
    keys = [f'>        {note}', '', *_KEYS]
    if len(lines) + len(keys) > height:
        lines, keys = [line for line in lines if line], [line for line in keys if line]
        lines = lines[: max(0, height - len(keys))]
    return [line[:width] for line in (*lines, *keys)]


def coloured(line: str) -> str:
    """Return a line with the mux's state in its colour, unless NO_COLOR is set."""
    if os.environ.get('NO_COLOR'):
        return line
    return _STATE.sub(lambda found: f'\x1b[{_COLOURS[found[0]]};1m{found[0]}\x1b[0m', line)


def _wrapped(texts: list[str], width: int) -> list[str]:
    wrap = partial(textwrap.wrap, initial_indent=9 * ' ', subsequent_indent=13 * ' ')
    return [line for text in texts for line in wrap(text, width)]


def _command(packets: list[Packet]) -> str:
    words = (
        f'{letter}: {"enable" if flags & 1 else "disable"} {_MODES[flags >> 2 & 3]} {value}'
        for packet in packets
        for letter, flags, value in zip('AB', packet.flags, packet.values, strict=True)
    )
    return '   '.join(words) or 'no packets'


def _motor_line(letter: str, rpm: float, enabled: bool, errors: list[str]) -> str:
    state = 'enabled' if enabled else 'disabled'
    return f'motor {letter}  [{_bar(rpm)}] {rpm:+7.0f} rpm  {state} {", ".join(errors)}'.rstrip()


def _bar(rpm: float) -> str:
    length = min(round(abs(rpm) / _FULL_RPM * _BAR), _BAR)
    left, right = (length, 0) if rpm < 0 else (0, length)
    return f'{"#" * left:>{_BAR}}|{"#" * right:<{_BAR}}'


def keys_in(data: bytes) -> list[str]:
    """Return the keys that a terminal's bytes mean: characters, and 'up' and the like."""
    found = re.findall(r'\x1b[\[O]([A-D])|([\s\S])', data.decode(errors='ignore'))
    return [_ARROWS.get(arrow, key) for arrow, key in found]


def live(stage: DemoStage) -> None:
    """Show the view until 'q' is pressed: keys at once and unseen, on a screen of its own."""
    keyboard = sys.stdin.fileno()
    before = termios.tcgetattr(keyboard)
    print(_ENTER, end='', flush=True)
    try:
        tty.setcbreak(keyboard)
        _Terminal(stage, keyboard).run()
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
        print(_LEAVE, end='', flush=True)


class _Terminal:
    """The view on a terminal."""

    def __init__(self, stage: DemoStage, keyboard: int) -> None:
        self._stage = stage
        self._keyboard = keyboard
        self._keys = Keyboard(self._say)
        self._note = 'press a; when the VSC and the drive are clear, press r, d and an arrow'

    def run(self) -> None:
        """Draw and obey until the user leaves. :raises DemoError: the stack has ended."""
        while not self._keys.leaving:
            self._stage.check()
            self._draw()
            end = time.monotonic() + PERIOD
            while not (pressed := self._is_pressed()) and time.monotonic() < end:
                self._stage.observer.spin(_SPIN)
            if pressed:
                data = os.read(self._keyboard, 1024)
                for key in keys_in(data) or ['q']:  # no data: the terminal is gone
                    self._press(key)

    def _is_pressed(self) -> bool:
        return select.select([self._keyboard], [], [], 0.0)[0] != []

    def _press(self, key: str) -> None:
        try:
            self._keys.press(key)
        except ValueError as error:
            self._note = str(error)

    def _draw(self) -> None:
        width, height = shutil.get_terminal_size()
        lines = picture(self._stage, self._note, width - 1, height - 1)[: height - 1]
        text = ''.join(f'{coloured(line)}{_END_OF_LINE}' for line in lines)
        print(f'{_HOME}{text}{_BLANK_REST}', end='', flush=True)

    def _say(self, target: str, command: str) -> None:
        self._note = f'{target}: {command}'
        if target != 'service':
            getattr(self._stage, target).apply(command)
        elif self._stage.offers(command):
            self._stage.ask(command).add_done_callback(self._on_reply)
        else:
            self._note = f'refused: nobody offers {command}'

    def _on_reply(self, future: Any) -> None:
        reply = future.result()
        self._note = reply.message if reply.success else f'refused: {reply.message}'
