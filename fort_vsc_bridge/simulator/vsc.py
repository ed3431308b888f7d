# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A VSC and its remote, without a port or a clock: what is the same whatever wire it is joined by.

Builds what it says by its own few lines, so that a slip in the bridge's codec cannot hide in both.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import math
import struct
from typing import Any, ClassVar

from bridge_core.simulation import obey, one_of, setter, switch, within
from fort_vsc_bridge.protocol.values import (
    AXIS_NAMES,
    BUTTON_NAMES,
    Key,
    Mode,
    mode_name,
    TEXT_KEYS,
)

HOST_TIMEOUT = 0.5  # User E-STOP Timeout (7.3.4)
BOOT_TIME = 1.0
_USER = 0x40  # of the E-stop indication
_CHOSEN_MODES = {
    'remote': Mode.REMOTE,
    'operational': Mode.OPERATIONAL,
    'menu': Mode.MENU,
    'pause': Mode.PAUSE,
}
# What sticks say unless Operational: all values are 0 (6.1 to 6.6). The manual leaves open whether
# bytes that are FF on CAN are values, too, and whether 0 may mean what a stick at rest says.
_ZEROS = ('values', 'all', 'rest')
_FAULTS = {'ok': None, 'error': 0b10, 'unavailable': 0b11}
_NEUTRAL, _NEGATIVE, _POSITIVE = 0b000001, 0b000100, 0b010000  # tables 30 and 45


class Vsc:
    """
    A VSC with a connected remote in Remote mode; what it says and hears, the subclasses know.

    :param latch_bits: E-stop bits stay until acknowledged, not only as long as their cause. The
        manual does not say which; the mode stays Local until then in both.
    """

    MESSAGES: ClassVar[dict[int, tuple[bool, float]]]  # enabled, interval in seconds
    GREATEST_RATES: ClassVar[dict[int, float]] = {}  # seconds between two of a type from the host

    def __init__(self, *, latch_bits: bool = True) -> None:
        self.latch_bits = latch_bits
        self.eeprom: dict[int, int] = {80: 0, 81: 1, 82: 1, 83: 1, 84: 1, 85: 0}
        self.messages = dict(self.MESSAGES)  # in EEPROM too
        self.eeprom_writes = 0
        self.sticks = dict.fromkeys(AXIS_NAMES, 0)  # -1023 to 1023, X right, Y forward
        self.buttons = dict.fromkeys(BUTTON_NAMES, False)
        self.faults: dict[str, int] = {}  # two-bit status by control name
        self.battery_percent = 100
        self.charging = False
        self.strength = 2
        self.autonomy = 0
        self.zeros = _ZEROS[0]
        self.transition = 0.0  # s of Remote transition between two modes; not in the manual
        self.position: tuple[float, float] | None = (60.1699, 24.9384)  # degrees
        self.bits = {'remote': 0x01, 'vsc': 0x04, 'lost': 0x01}  # of its indication, by cause
        self.falls_silent = False  # while it has lost its remote
        self.radio = True
        self.remote_estop = False
        self.wired_estop = False
        self._due: dict[int, float] = dict.fromkeys(self.messages, 0.0)
        self._out: list[Any] = []
        self._now = 0.0
        self._boot(0.0)

    def _boot(self, up_at: float) -> None:
        """Forget what is not kept in EEPROM."""
        self.values: dict[int, int] = {}
        self.names: dict[int, str] = {}
        self.rumbles: deque[tuple[float, str]] = deque(maxlen=100)  # time, side
        self.too_fast: dict[int, int] = dict.fromkeys(self.GREATEST_RATES, 0)
        self.host_heartbeats = 0
        self.host_estop = False
        self.unacknowledged = False
        self._mode = self._last_mode = Mode.REMOTE
        self._settled_at = -math.inf  # when the mode is the next one
        self._latched = 0
        self._host_heard = math.inf  # the limit counts from the first poll on
        self._last_of: dict[int, float] = {}
        self._up_at = up_at
        self._out.clear()

    # -- the link --------------------------------------------------------------------------------

    def receive(self, data: Any, now: float) -> None:
        """Take what the host sent."""
        self._now = now
        if now >= self._up_at:
            self._hear(data, now)

    def poll(self, now: float) -> list[Any]:
        """Return the frames that are due."""
        self._now = now
        if now < self._up_at:
            return []
        self._hear_late(now)
        self._watch_stops(now)
        self._watch_mode(now)
        frames, self._out = self._out, []
        silent = self.falls_silent and not self.radio
        for kind, (enabled, interval) in self.messages.items():
            if enabled and now >= self._due[kind]:
                on_time = self._due[kind] + interval > now
                self._due[kind] = (self._due[kind] if on_time else now) + interval
                frames += [] if silent else self._build(kind)
        return frames

    def deadline(self) -> float:
        """Return when poll wants to be called next."""
        if self._now < self._up_at:
            return self._up_at
        due = [self._due[kind] for kind, (enabled, _) in self.messages.items() if enabled]
        return min([*due, self._late_deadline(), *([self._now] if self._out else [])])

    def _hear(self, data: Any, now: float) -> None:
        """Take what the host sent."""

    def _hear_late(self, now: float) -> None:
        """Take what time has completed."""

    def _late_deadline(self) -> float:
        return math.inf

    def _build(self, kind: int) -> list[Any]:
        """Return the frames of a message that is due."""
        raise NotImplementedError

    def _tell_value(self, key: int, value: int) -> None:
        """Tell the host a value, if the wire can."""

    # -- what the host says ----------------------------------------------------------------------

    def _watch_rate(self, kind: int, now: float) -> None:
        gap = now - self._last_of.get(kind, -math.inf)
        self.too_fast[kind] += gap < self.GREATEST_RATES[kind] - 5e-3  # a port may squeeze gaps
        self._last_of[kind] = now

    def _take_heartbeat(self, stop: bool, now: float) -> None:
        self.host_heartbeats += 1
        self._host_heard = now
        self.host_estop = stop
        self._watch_stops(now)

    def _take_value(self, payload: bytes, now: float) -> None:
        key, value = struct.unpack('<Bi', payload)
        if key in self.eeprom:
            self.eeprom[key] = value
            self.eeprom_writes += 1
            self._host_heard = now  # a watchdog switched on begins to count now
        elif key in (10, 11, 12) and value == 1:
            self.rumbles.append((now, ('left', 'right', 'both')[key - 10]))
        elif key in range(1, 10) or key == Key.DISPLAY_MODE:
            self.values[key] = value

    def _take_name(self, key: int, text: bytes) -> None:
        self.names[key] = text.rstrip(b'\0').decode('ascii', 'replace')

    def _answer(self, key: int) -> None:
        known = self.eeprom if key in self.eeprom else self.values
        if key in range(1, 10) or key in known:
            self._tell_value(key, known.get(key, 0))

    # -- stops and modes -------------------------------------------------------------------------

    def _causes(self, now: float) -> int:
        """Return the E-stop bits whose cause is there now."""
        self._host_heard = min(self._host_heard, now)
        silent = self.eeprom[85] == 1 and now - self._host_heard > HOST_TIMEOUT
        bits = self.bits['remote'] if self.remote_estop else 0
        bits |= self.bits['vsc'] if self.wired_estop else 0
        bits |= 0 if self.radio else self.bits['lost']
        return bits | (_USER if self.host_estop or silent else 0)

    def _watch_stops(self, now: float) -> None:
        causes = self._causes(now)
        self._latched |= causes
        if causes:
            self.unacknowledged = True
            self._mode = Mode.REMOTE  # where the remote is after the next acknowledgement

    @property
    def estop_bits(self) -> int:
        """The E-stop indication."""
        return self._latched if self.latch_bits else self._causes(self._now)

    def _watch_mode(self, now: float) -> None:
        if self._next_mode is not self._last_mode:
            self._last_mode, self._settled_at = self._next_mode, now + self.transition

    @property
    def _next_mode(self) -> Mode:
        """Local while a stop is there or not acknowledged (6.6), else what the remote chose."""
        return Mode.LOCAL if self.unacknowledged else self._mode

    @property
    def mode(self) -> Mode:
        """The next one, but while a transition takes its time."""
        return Mode.REMOTE_TRANSITION if self._now < self._settled_at else self._next_mode

    @property
    def display(self) -> str:
        """What the remote shows: its own screen but in Operational, where key 99 counts (6)."""
        if not self._active:
            stopped = 'E-Stop' if self.unacknowledged else mode_name(self.mode)
            return f'its own: {stopped if self.radio else "Searching"}'
        kind = self.values.get(Key.DISPLAY_MODE, 0)
        if kind == 1:
            return '\n'.join(self.names.get(key, '') for key in TEXT_KEYS)
        return f'its own: {("position", "text", "names and values", "values")[kind]}'

    def acknowledge(self) -> None:
        """Acknowledge a stop on the remote. :raises ValueError: its cause is still there."""
        causes = self._causes(self._now)
        if causes:
            raise ValueError(f'the cause of the stop is still there (bits 0x{causes:02X})')
        self.unacknowledged = False
        self._latched = 0

    def reboot(self) -> None:
        """Switch off and on: silent for BOOT_TIME; only EEPROM survives."""
        self._boot(self._now + BOOT_TIME)
        self._due = dict.fromkeys(self.messages, self._up_at)

    # -- what the VSC says -----------------------------------------------------------------------

    def _heartbeat(self) -> bytes:
        return struct.pack('<BBI', self.mode, self.autonomy, self.estop_bits)

    def _remote_status(self) -> bytes:
        strengths = (self.strength, self.strength)
        return bytes((self.battery_percent, int(self.charging), *strengths, 0, 0))

    @property
    def _active(self) -> bool:
        """Sticks and buttons are not zeroed."""
        return self.mode == Mode.OPERATIONAL

    def _axis_word(self, name: str) -> int:
        if not self._active:
            return _NEUTRAL if self.zeros == 'rest' else 0
        if name in self.faults:
            return self.faults[name] * 0b010101 | 0xFFC0
        value = self.sticks[name]
        status = _NEUTRAL if value == 0 else _NEGATIVE if value < 0 else _POSITIVE
        return status | abs(value) << 6

    def _pad(self, names: tuple[str, ...]) -> int:
        pad = 0
        for place, name in enumerate(names):
            bits = self.faults.get(name, int(self.buttons[name])) if self._active else 0
            pad |= bits << 2 * place
        return pad

    # -- for people and tests --------------------------------------------------------------------

    def apply(self, text: str) -> None:
        """Obey one line, such as 'stick left_y 0.8'. :raises ValueError: one line of help."""
        obey(self, self.commands, text)
        self._watch_stops(self._now)

    def describe(self) -> dict[str, Any]:
        """Return what can be seen, as plain values."""
        return {
            'mode': mode_name(self.mode),
            'estop_bits': self.estop_bits,
            'master_enable': not self.unacknowledged,
            'radio': self.radio,
            'remote_estop': self.remote_estop,
            'wired_estop': self.wired_estop,
            'host_estop': self.host_estop,
            'sticks': {name: value / 1023 for name, value in self.sticks.items()},
            'buttons': [name for name, pressed in self.buttons.items() if pressed],
            'faults': dict(self.faults),
            'battery_percent': self.battery_percent,
            'charging': self.charging,
            'values': dict(self.values),
            'names': dict(self.names),
            'display': self.display,
            'rumbles': len(self.rumbles),
            'host_heartbeats': self.host_heartbeats,
            'too_fast': dict(self.too_fast),
            'eeprom': dict(self.eeprom),
            'eeprom_writes': self.eeprom_writes,
        }

    def _set_stick(self, name: str, value: str) -> None:
        self.sticks[one_of(self.sticks, name)] = round(1023 * within(value, -1.0, 1.0))

    def _set_button(self, name: str, value: str) -> None:
        self.buttons[one_of(self.buttons, name)] = switch(value)

    def _set_fault(self, name: str, kind: str) -> None:
        one_of({**self.sticks, **self.buttons}, name)
        status = _FAULTS[one_of(_FAULTS, kind)]
        self.faults.pop(name, None)
        if status is not None:
            self.faults[name] = status

    def _set_estop(self, source: str, value: str) -> None:
        fields = {'remote': 'remote_estop', 'vsc': 'wired_estop'}
        setattr(self, fields[one_of(fields, source)], switch(value))

    def _set_bits(self, cause: str, bits: str) -> None:
        """Have the E-stop indication of a cause be this, in hex."""
        one_of(self.bits, cause)
        self.bits[cause] = int(within(str(int(bits, 16)), 1, 0xFFFFFFFF))

    def _set_lost(self, what: str) -> None:
        """Say stop while it has lost its remote, or nothing at all."""
        self.falls_silent = one_of(('stop', 'silent'), what) == 'silent'

    def _set_watchdog(self, state: str) -> None:
        """Set its User E-STOP Timeout."""
        self.eeprom[85] = int(switch(state))

    def _set_mode(self, name: str) -> None:
        mode = _CHOSEN_MODES[one_of(_CHOSEN_MODES, name)]
        if self.unacknowledged:
            raise ValueError('stopped; take the cause away and say ack first')
        self._mode = mode

    def _set_gps(self, latitude: str, longitude: str) -> None:
        known = latitude != 'off'
        position = (within(latitude, -90, 90), within(longitude, -180, 180)) if known else None
        self.position = position

    def _set_value(self, key: str, value: str) -> None:
        if self.mode != Mode.MENU:
            raise ValueError('values are set in mode menu only')
        number = int(within(key, 1, 9))
        self.values[number] = int(within(value, -32768, 32767))
        self._answer(number)

    # Words: usage, and what obeys.
    commands: dict[str, tuple[str, Callable[..., None]]] = {
        'stick': ('AXIS -1..1', _set_stick),
        'button': ('BUTTON 0|1', _set_button),
        'fault': ('AXIS|BUTTON ok|error|unavailable', _set_fault),
        'estop': ('remote|vsc on|off', _set_estop),
        'bits': ('remote|vsc|lost HEX', _set_bits),
        'lost': ('stop|silent', _set_lost),
        'watchdog': ('on|off', _set_watchdog),
        'mode': ('remote|operational|menu|pause', _set_mode),
        'zeros': ('values|all|rest', setter('zeros', lambda text: one_of(_ZEROS, text))),
        'transition': ('SECONDS', setter('transition', lambda text: within(text, 0.0, 60.0))),
        'radio': ('on|off', setter('radio', switch)),
        'battery': ('0..100', setter('battery_percent', lambda text: round(within(text, 0, 100)))),
        'charging': ('on|off', setter('charging', switch)),
        'strength': ('0..2', setter('strength', lambda text: round(within(text, 0, 2)))),
        'gps': ('LATITUDE|off LONGITUDE|off', _set_gps),
        'value': ('KEY VALUE', _set_value),
        'ack': ('', acknowledge),
        'reboot': ('', reboot),
    }
