# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The simulated SSC's menus, as section 3 prints them. Of settings only the config ID can be changed.

A menu is a generator: it yields what it prints and is sent the key that was pressed. The manual
leaves open what stands between two menus, so a Terminal can be told: whether keys are echoed, and
whether the unit waits for a key after it has printed something.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeVar

from ssc_bridge.simulator.memory import Memory

T = TypeVar('T')
Menu = Generator[str, str, T]
CLEAR = '\x1b[2J\x1b[1;1H'
_SELECT = '\r\nSelect : '
_BACK = '\n0) Previous Menu'
_TITLES = {'2': 'SWITCH TABLE', '3': 'MESSAGE RATES', '4': 'PRIMARY COMM', '5': 'CONFIG LOCKOUT'}

MAIN = """\
MAIN MENU

1) I/O Setup
2) Switch Table
3) Message Rates
4) Primary Comm
5) Config Lockout

C) Config ...
X) Exit
"""
CONFIG = """\
S) Save to NV Memory
L) Reload from NV Memory
E) Erase NV Memory

D) Dump Config Image (ASCII Hex)
I) Receive Config Image (ASCII Hex)

0) Previous Menu
"""
START = '---------- Start Of Image ----------'
END = '---------- End Of Image ----------'
WAITING = '---------- Waiting For Image ----------'


@dataclass
class Terminal:
    """
    What the manual leaves open.

    :param echoes: prints the digits of an image as they come. :param asks_for_key: waits for a key
        before the menu comes back. :param takes_digits: after so many it refuses; None: all.
    """

    echoes: bool = False
    asks_for_key: bool = True
    takes_digits: int | None = None


class Menus:
    """All menus of one unit."""

    def __init__(self, memory: Memory, terminal: Terminal) -> None:
        self.memory = memory
        self.terminal = terminal

    def main(self) -> Menu[None]:
        """The main menu; ends with X."""
        while (key := (yield _page(MAIN))) != 'X':
            if key == '1':
                yield from self._io_setup()
            elif key == 'C':
                yield from self._config()
            elif key in _TITLES:
                while (yield _page(f'{_TITLES[key]}\n{_BACK}')) != '0':
                    pass

    def _io_setup(self) -> Menu[None]:
        while True:
            now = self.memory.settings
            key = yield _page(f'I/O SETUP\n\nB) User Config ID [{now.config_id}]\n{_BACK}')
            if key == '0':
                return
            if key == 'B':
                now.config_id = yield from _number('User Config ID (0-255): ')
                self.memory.working = now.to_image()

    # -- 3.1 -------------------------------------------------------------------------------------

    def _config(self) -> Menu[None]:
        memory = self.memory
        acts = {
            'S': (memory.save, 'Saved'),
            'L': (memory.reload, 'Reloaded'),
            'E': (memory.erase, 'Erased'),
        }
        note = ''
        while (key := (yield CLEAR + note + _lines(CONFIG) + _SELECT)) != '0':
            note = ''
            if key in acts:
                act, done = acts[key]
                act()
                note = f'{done}.\r\n'
            elif key == 'D':
                note = yield from self._tell(_lines('\n'.join((START, *memory.lines(), END, ''))))
            elif key == 'I':
                verdict = yield from self._receive()
                note = yield from self._tell(f'\r\n{verdict}\r\n')

    def _tell(self, text: str) -> Menu[str]:
        """Print and wait for a key; return what is left to print above the menu."""
        if not self.terminal.asks_for_key:
            return text
        yield f'{text}\r\nPress any key to continue.'
        return ''

    def _receive(self) -> Menu[str]:
        """Receive an image digit by digit; return the verdict. The first bad sign ends it."""
        digits, wanted = '', 2 * len(self.memory.working)
        limit = self.terminal.takes_digits
        text = f'{CLEAR}{WAITING}\r\n'
        while len(digits) < wanted:
            key = yield text
            text = key if self.terminal.echoes else ''
            if key.isspace():
                continue
            if key not in '0123456789ABCDEF' or len(digits) == limit:
                self.memory.take(bytes.fromhex(digits[: len(digits) // 2 * 2]))
                return 'Image load FAILED: check the file and try again.'
            digits += key
        if self.memory.take(bytes.fromhex(digits)):
            return 'Image load successful. Save it to keep it.'
        return 'Image load FAILED: wrong checksum.'


def _lines(text: str) -> str:
    return text.replace('\n', '\r\n')


def _page(text: str) -> str:
    return CLEAR + _lines(text) + _SELECT


def _number(prompt: str) -> Menu[int]:
    """Let a byte be typed, with Enter behind it."""
    digits, text = '', f'\r\n{prompt}'
    while (key := (yield text)) != '\r':
        digits, text = digits + key * key.isdecimal(), key
    return min(int(digits or 0), 255)
