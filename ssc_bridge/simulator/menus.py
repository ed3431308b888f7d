# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The simulated SSC's menus, as section 3 prints them.

A menu is a generator: it yields what it prints and is sent the key that was pressed. The manual
leaves open what stands between two menus, so a Terminal can be told: whether keys are echoed, and
whether the unit waits for a key after it has printed something.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
import contextlib
from dataclasses import dataclass
from typing import TypeVar

from ssc_bridge.simulator.memory import Memory, RATES_HZ, Settings

T = TypeVar('T')


class _Previous(Exception):  # noqa: N818 - what the key 0 asks for, not an error
    """Back to the previous menu."""


Menu = Generator[str, str, T]
Page = Callable[[Settings], str]
Act = Callable[[Settings, str], Menu[None]]
CLEAR = '\x1b[2J\x1b[1;1H'
_SELECT = '\r\nSelect : '
_KEYS = '123456789ABCDEFG'  # of the rows on one screen (3)
_SOURCES = ('PIN', 'PINv', 'CONST', 'SERIAL', 'LAST')
_BACK = '0) Previous Menu'
_MESSAGES = (
    *('Status Message', 'Source Selections', 'Pulse Out Message'),
    *('Pulse In Message', 'Aux In Message'),
)
_COLUMNS = ('0ms', '1ms', '1.5ms', '2ms', 'Const', 'Period')

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
            table = _TableView()
            pages: dict[str, tuple[Page, Act]] = {
                '1': (_io_text, _set_io),
                '2': (table.text, table.act),
                '3': (_rates_text, _set_rate),
                '4': (_primary_text, _set_primary),
                '5': (_lockout_text, _set_lockout),
            }
            if key in pages:
                yield from self._edit(*pages[key])
            elif key == 'C':
                yield from self._config()

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

    # -- 3.2 to 3.6 ------------------------------------------------------------------------------

    def _edit(self, page: Page, act: Act) -> Menu[None]:
        """Show a page of settings and let keys change them, until 0."""
        while (key := (yield _page(page(self.memory.settings)))) != '0':
            now = self.memory.settings
            with contextlib.suppress(_Previous):
                yield from act(now, key)
                self.memory.working = now.to_image()


def _lines(text: str) -> str:
    return text.replace('\n', '\r\n')


def _page(text: str) -> str:
    return CLEAR + _lines(text) + _SELECT


def _listed(*lines: str) -> str:
    return '\n'.join([*lines, '', _BACK])


def _choice(title: str, options: Sequence[str]) -> Menu[int]:
    """Let one of the options be chosen; return its place."""
    lines = [f'{n}) {option}' for n, option in enumerate(options, 1)]
    while True:
        key = yield _page(_listed(title, '', *lines))
        if key == '0':
            raise _Previous
        if key.isdecimal() and 1 <= int(key) <= len(options):
            return int(key) - 1


def _number(title: str, low: int, high: int) -> Menu[int]:
    """Let a number be typed, with Enter behind it; asks again until it is in range."""
    digits = ''
    text = prompt = f'\r\n{title} ({low}-{high}): '
    while (key := (yield text)) != '\r' or not low <= int(digits or -1) <= high:
        if key == '\r' and not digits:
            raise _Previous
        digits = digits + key if key.isdecimal() else '' if key == '\r' else digits
        text = prompt if key == '\r' else key
    return int(digits)


# 3.2


def _io_text(now: Settings) -> str:
    rows = [f'{n}) Aux {n} Assign [{_aux_text(word)}]' for n, word in enumerate(now.aux, 1)]
    head = [f'A) Pulse Input Channels [{now.inputs}]', f'B) User Config ID [{now.config_id}]']
    return _listed('I/O SETUP', '', *head, '', *rows)


def _set_io(now: Settings, key: str) -> Menu[None]:
    if key == 'A':
        now.inputs = yield from _number('Pulse Input Channels', 1, 16)
    elif key == 'B':
        now.config_id = yield from _number('User Config ID', 0, 255)
    elif key in '123456':
        now.aux[int(key) - 1] = yield from _aux_word()


def _aux_word() -> Menu[int]:
    """Let a function and its attributes be chosen (3.2.3); return the word of message 15."""
    names = ('Digital In', 'Timer In', 'Pulse Accum In', 'Digital Out', 'Pulse Out')
    function = yield from _choice('FUNCTION', names)
    word = function
    if function == 1:
        word |= (yield from _choice('START EDGE', ('-', '+'))) << 8
    if function in (1, 2):
        word |= (yield from _choice('EDGE', ('-', '+'))) << 7
    if function == 3:
        word |= (yield from _choice('INITIAL STATE', ('-', '+'))) << 4
    if function == 4:
        word |= (yield from _choice('MODE', ('free running', 'single shot'))) << 8
        word |= (yield from _choice('POLARITY', ('+', '-'))) << 7
    if function in (1, 4):
        word |= (yield from _choice('TIME BASE', [f'{1 << n}us' for n in range(8)])) << 4
    return word


def _aux_text(word: int) -> str:
    """Return a function as the menu of 3.2 prints it."""
    base, bit_7, bit_8 = f'{1 << (word >> 4 & 7)}us', bool(word & 0x80), bool(word & 0x100)
    texts = (
        'Dig In',
        f'Timer In ({base},{"-+"[bit_8]},{"-+"[bit_7]})',
        f'PulAcc In ({"-+"[bit_7]})',
        f'Dig Out ({"-+"[bool(word & 0x10)]})',
        f'Pulse Out ({base},{"fs"[bit_8]},{"+-"[bit_7]})',
    )
    return texts[word & 0x0F] if word & 0x0F < len(texts) else '?'


def source_text(byte: int) -> str:
    """Return a source as the switch table prints it."""
    source = byte & 0x0F
    if source > 1:
        return _SOURCES[source] if source < len(_SOURCES) else 'unknown'
    return f'{_SOURCES[source]} {(byte >> 4) + 1}'


# 3.3


class _TableView:
    """The switch table as it is shown: the active column, the first row."""

    def __init__(self) -> None:
        self.column = self.first = 0

    def _rows(self, now: Settings) -> range:
        return range(self.first, min(self.first + len(_KEYS), now.outputs))

    def text(self, now: Settings) -> str:
        """Return the page; asterisks mark the active column."""
        heads = '  '.join(f'{name:<8}' for name in _COLUMNS)
        marks = '  '.join('********' if n == self.column else '--------' for n in range(6))
        rows = [
            f'{key}) {_row_text(now, n)}' for key, n in zip(_KEYS, self._rows(now), strict=False)
        ]
        more = ['M) More Channels'] * (now.outputs > len(_KEYS))
        keys = ['X) Set All in Row', 'Y) Set All in Column', '', 'N) Select Next Column', *more]
        head = ['SWITCH TABLE', '', f'   Ch {heads}', f'   -- {marks}']
        return '\n'.join([*head, *rows, '', *keys, _BACK])

    def act(self, now: Settings, key: str) -> Menu[None]:
        """Obey a key of the page."""
        rows = self._rows(now)
        if key == 'N':
            self.column = (self.column + 1) % len(_COLUMNS)
        elif key == 'M':
            self.first = len(_KEYS) - self.first if now.outputs > len(_KEYS) else 0
        elif key in _KEYS[: len(rows)]:
            value = yield from _cell(now, self.column)
            _set(now, rows[_KEYS.index(key)], self.column, value)
        elif key == 'X':
            row = (yield from _number('Channel', 1, now.outputs)) - 1
            value = yield from _cell(now, 0)
            for column in range(4):
                _set(now, row, column, value)
        elif key == 'Y':
            value = yield from _cell(now, self.column)
            for row in range(now.outputs):
                _set(now, row, self.column, value)


def _row_text(now: Settings, row: int) -> str:
    sources = '  '.join(f'{source_text(byte):<8}' for byte in now.table[row])
    return f'{row + 1:<3}{sources}  {now.constants[row]:<8}  {now.periods[row]:<8}'


def _cell(now: Settings, column: int) -> Menu[int]:
    """Let a value for one column be entered: a source byte, or us."""
    if column == 4:
        return (yield from _number('Constant (us)', 0, 32000))
    if column == 5:
        return (yield from _number('Period (us)', 1000, 32000))
    source = yield from _choice('SOURCE', _SOURCES)
    pin = (yield from _number('PIN', 1, now.inputs)) - 1 if source < 2 else 0
    return source | pin << 4


def _set(now: Settings, row: int, column: int, value: int) -> None:
    if column < 4:
        now.table[row][column] = value
    else:
        (now.constants, now.periods)[column - 4][row] = value


# 3.4 to 3.6


def _rates_text(now: Settings) -> str:
    lines = [
        f'{n}) {name} (msg {n + 9}) [{now.rates[n - 1]}Hz]' for n, name in enumerate(_MESSAGES, 1)
    ]
    return _listed('MESSAGE RATES', *lines)


def _set_rate(now: Settings, key: str) -> Menu[None]:
    if key in '12345':
        place = yield from _choice('RATE', [f'{rate}Hz' for rate in RATES_HZ])
        now.rates[int(key) - 1] = RATES_HZ[place]


def _primary_text(now: Settings) -> str:
    lines = [f'{n}) Comm {n} [{"X" if n == now.primary else " "}]' for n in (1, 2)]
    return _listed('PRIMARY COMM', *lines)


def _set_primary(now: Settings, key: str) -> Menu[None]:
    if key in '12':
        now.primary = int(key)
    yield from ()


def _lockout_text(now: Settings) -> str:
    lines = [
        f'{n}) On Rcv Msg {message} [{"X" if locks else " "}]'
        for n, message, locks in zip((1, 2), (98, 20), now.lockouts, strict=True)
    ]
    return _listed('CONFIG LOCKOUT', *lines)


def _set_lockout(now: Settings, key: str) -> Menu[None]:
    if key in '12':
        now.lockouts[int(key) - 1] ^= True
    yield from ()
