"""
The simulated SSC's menus, as section 3 prints them.

A menu is a generator: it yields what it prints and is sent the key that was pressed. The manual
leaves open what stands between two menus, so a Terminal can be told: whether keys are echoed, and
whether the unit waits for a key after it has printed something.
"""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Generator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from ssc_bridge.simulator.memory import CHANNELS
from ssc_bridge.simulator.memory import Memory
from ssc_bridge.simulator.memory import RATES_HZ
from ssc_bridge.simulator.memory import Settings

T = TypeVar('T')
Menu = Generator[str, str, T]
CLEAR = '\x1b[2J\x1b[1;1H'
_SELECT = '\r\nSelect : '
_KEYS = '123456789ABCDEFG'  # of the rows on one screen (3)
_SOURCES = ('PIN', 'PINv', 'CONST', 'SERIAL', 'LAST')
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
        pages: dict[str, Callable[[], Menu[None]]] = {
            '1': self._io,
            '2': self._table,
            '3': self._rates,
            '4': self._primary,
            '5': self._lockout,
            'C': self._config,
        }
        while (key := (yield _page(MAIN))) != 'X':
            if key in pages:
                yield from pages[key]()

    # -- 3.1 -------------------------------------------------------------------------------------

    def _config(self) -> Menu[None]:
        memory = self.memory
        note = ''
        while (key := (yield CLEAR + note + _lines(CONFIG) + _SELECT)) != '0':
            note = ''
            if key == 'S':
                memory.save()
                note = 'Saved.\r\n'
            elif key == 'L':
                memory.reload()
                note = 'Reloaded.\r\n'
            elif key == 'E':
                memory.erase()
                note = 'Erased.\r\n'
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

    # -- 3.2 -------------------------------------------------------------------------------------

    def _io(self) -> Menu[None]:
        while True:
            now = self.memory.settings
            rows = [f'{n}) Aux {n} Assign [{_aux_text(w)}]' for n, w in enumerate(now.aux, 1)]
            head = [
                f'A) Pulse Input Channels [{now.inputs}]',
                f'B) User Config ID [{now.config_id}]',
            ]
            key = yield _page(
                '\n'.join(['I/O SETUP', '', *head, '', *rows, '', '0) Previous Menu'])
            )
            if key == '0':
                return
            if key == 'A':
                now.inputs = yield from _number('Pulse Input Channels', 1, 16)
            elif key == 'B':
                now.config_id = yield from _number('User Config ID', 0, 255)
            elif key in '123456':
                now.aux[int(key) - 1] = yield from _aux_word()
            self._keep(now)

    # -- 3.3 -------------------------------------------------------------------------------------

    def _table(self) -> Menu[None]:
        column = first = 0
        while True:
            now = self.memory.settings
            shown = range(first, min(first + len(_KEYS), now.outputs))
            key = yield _page(_table_text(now, shown, column))
            if key == '0':
                return
            if key == 'N':
                column = (column + 1) % len(_COLUMNS)
            elif key == 'M':
                first = len(_KEYS) - first if now.outputs > len(_KEYS) else 0
            elif key in _KEYS[: len(shown)]:
                row = shown[_KEYS.index(key)]
                _set(now, row, column, (yield from _cell(now, column)))
            elif key == 'X':
                row = (yield from _number('Channel', 1, now.outputs)) - 1
                value = yield from _cell(now, 0)
                for place in range(4):
                    _set(now, row, place, value)
            elif key == 'Y':
                value = yield from _cell(now, column)
                for row in range(now.outputs):
                    _set(now, row, column, value)
            self._keep(now)

    # -- 3.4 to 3.6 ------------------------------------------------------------------------------

    def _rates(self) -> Menu[None]:
        names = ('Status Message', 'Source Selections', 'Pulse Out Message', 'Pulse In Message')
        while True:
            now = self.memory.settings
            lines = [
                f'{n}) {name} (msg {n + 9}) [{now.rates[n - 1]}Hz]'
                for n, name in enumerate((*names, 'Aux In Message'), 1)
            ]
            key = yield _page('\n'.join(['MESSAGE RATES', *lines, '', '0) Previous Menu']))
            if key == '0':
                return
            if key in '12345':
                rates = [f'{rate}Hz' for rate in RATES_HZ]
                now.rates[int(key) - 1] = RATES_HZ[(yield from _choice('RATE', rates))]
            self._keep(now)

    def _primary(self) -> Menu[None]:
        while True:
            now = self.memory.settings
            lines = [f'{n}) Comm {n} [{"X" if n == now.primary else " "}]' for n in (1, 2)]
            key = yield _page('\n'.join(['PRIMARY COMM', *lines, '', '0) Previous Menu']))
            if key == '0':
                return
            if key in '12':
                now.primary = int(key)
            self._keep(now)

    def _lockout(self) -> Menu[None]:
        while True:
            now = self.memory.settings
            lines = [
                f'{n}) On Rcv Msg {message} [{"X" if now.lockouts[n - 1] else " "}]'
                for n, message in ((1, 98), (2, 20))
            ]
            key = yield _page('\n'.join(['CONFIG LOCKOUT', *lines, '', '0) Previous Menu']))
            if key == '0':
                return
            if key in '12':
                now.lockouts[int(key) - 1] ^= True
            self._keep(now)

    def _keep(self, settings: Settings) -> None:
        self.memory.working = settings.to_image()


def _lines(text: str) -> str:
    return text.replace('\n', '\r\n')


def _page(text: str) -> str:
    return CLEAR + _lines(text) + _SELECT


def _choice(title: str, options: Sequence[str]) -> Menu[int]:
    """Let one of the options be chosen; return its place."""
    lines = [f'{n}) {option}' for n, option in enumerate(options, 1)]
    while True:
        key = yield _page('\n'.join([title, '', *lines]))
        if key.isdecimal() and 1 <= int(key) <= len(options):
            return int(key) - 1


def _number(title: str, low: int, high: int) -> Menu[int]:
    """Let a number be typed, with Enter behind it; asks again until it is in range."""
    digits = ''
    text = f'\r\n{title} ({low}-{high}): '
    while True:
        key = yield text
        text = key if key.isdecimal() else ''
        if key.isdecimal():
            digits += key
        elif key == '\r':
            if digits and low <= int(digits) <= high:
                return int(digits)
            digits, text = '', f'\r\n{title} ({low}-{high}): '


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


def _source_text(byte: int) -> str:
    source = byte & 0x0F
    if source > 1:
        return _SOURCES[source] if source < len(_SOURCES) else '?'
    return f'{_SOURCES[source]} {(byte >> 4) + 1}'


def _table_text(now: Settings, shown: range, column: int) -> str:
    """Return the switch table; asterisks mark the active column."""
    heads = '  '.join(f'{name:<8}' for name in _COLUMNS)
    marks = '  '.join('********' if place == column else '--------' for place in range(6))
    rows = [
        f'{_KEYS[row - shown.start]}) {row + 1:<3}'
        + '  '.join(f'{_source_text(byte):<8}' for byte in now.table[row])
        + f'  {now.constants[row]:<8}  {now.periods[row]:<8}'
        for row in shown
    ]
    more = ['M) More Channels'] * (now.outputs > len(_KEYS))
    keys = ['X) Set All in Row', 'Y) Set All in Column', '', 'N) Select Next Column', *more]
    head = ['SWITCH TABLE', '', f'   Ch {heads}', f'   -- {marks}']
    return '\n'.join([*head, *rows, '', *keys, '0) Previous Menu'])


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


assert len(_KEYS) < CHANNELS
