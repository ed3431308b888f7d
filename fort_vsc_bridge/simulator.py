"""
The device's side of the link: a VSC and its remote, without a port or a clock.

Builds its frames by its own few lines and the manual's own checksum loop (7.6), so that a slip in
the bridge's codec cannot hide in both.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import math
import struct
from typing import Any

from bridge_core.framing import StreamParser
from bridge_core.simulation import obey
from bridge_core.simulation import one_of
from bridge_core.simulation import switch
from bridge_core.simulation import within
from fort_vsc_bridge.protocol import AXIS_NAMES
from fort_vsc_bridge.protocol import BUTTON_NAMES
from fort_vsc_bridge.protocol import FORMAT
from fort_vsc_bridge.protocol import Key
from fort_vsc_bridge.protocol import MessageType
from fort_vsc_bridge.protocol import Mode

HOST_TIMEOUT = 0.5  # User E-STOP Timeout (7.3.4)
BOOT_TIME = 1.0
_SRC, _VSC, _USER = 0x01, 0x04, 0x40
_CHOSEN_MODES = {
    'remote': Mode.REMOTE,
    'operational': Mode.OPERATIONAL,
    'menu': Mode.MENU,
    'pause': Mode.PAUSE,
}
_FAULTS = {'ok': None, 'error': 0b10, 'unavailable': 0b11}
_GREATEST_RATES = {0x30: 0.05, 0x31: 0.25, 0x32: 0.05}  # seconds between two (table 17)


def build_frame(kind: int, payload: bytes) -> bytes:
    """Return a frame with the manual's checksum loop (figure 16)."""
    data = bytes((0x10, 0x01, kind, len(payload))) + payload
    sum1 = sum2 = 0
    for byte in data:
        sum1 = (sum1 + byte) & 255
        sum2 = (sum2 + sum1) & 255
    return data + bytes((sum1, sum2))


def build_sentence(body: str) -> str:
    """Return an NMEA 0183 sentence around its body."""
    total = 0
    for character in body:
        total ^= ord(character)
    return f'${body}*{total:02X}\r\n'


class Simulator:
    """
    A VSC with a connected remote in Remote mode.

    :param latch_bits: E-stop bits stay until acknowledged, not only as long as their cause. The
        manual does not say which; the mode stays Local until then in both.
    """

    def __init__(self, *, latch_bits: bool = True) -> None:
        self.latch_bits = latch_bits
        self.eeprom: dict[int, int] = {80: 0, 81: 1, 82: 1, 83: 1, 84: 1, 85: 0}
        self.messages: dict[
            int, tuple[bool, float]
        ] = {  # enabled, interval in seconds; EEPROM too
            MessageType.JOYSTICK: (True, 0.02),
            MessageType.GPS: (True, 1.0),
            MessageType.HEARTBEAT: (True, 0.05),
            MessageType.REMOTE_STATUS: (False, 1.0),
        }
        self.eeprom_writes = 0
        self.sticks = dict.fromkeys(AXIS_NAMES, 0)  # -1023 to 1023, X right, Y forward
        self.buttons = dict.fromkeys(BUTTON_NAMES, False)
        self.faults: dict[str, int] = {}  # two-bit status by control name
        self.battery_percent = 100
        self.charging = False
        self.strength = 2
        self.autonomy = 0
        self.position: tuple[float, float] | None = (60.1699, 24.9384)  # degrees
        self.radio = True
        self.remote_estop = False
        self.wired_estop = False
        self._parser = StreamParser(FORMAT)
        self._due: dict[int, float] = dict.fromkeys(self.messages, 0.0)
        self._out: list[bytes] = []
        self._now = 0.0
        self._boot(0.0)

    def _boot(self, up_at: float) -> None:
        """Forget what is not kept in EEPROM."""
        self.values: dict[int, int] = {}
        self.names: dict[int, str] = {}
        self.rumbles: deque[tuple[float, str]] = deque(maxlen=100)  # time, side
        self.too_fast: dict[int, int] = dict.fromkeys(_GREATEST_RATES, 0)
        self.host_heartbeats = 0
        self.host_estop = False
        self.unacknowledged = False
        self._mode = Mode.REMOTE
        self._latched = 0
        self._host_heard = math.inf  # the limit counts from the first poll on
        self._last_of: dict[int, float] = {}
        self._up_at = up_at
        self._out.clear()
        self._parser.reset()

    # -- the link --------------------------------------------------------------------------------

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes of the host."""
        self._now = now
        if now < self._up_at:
            return
        for frame in self._parser.feed(data, now):
            self._take(frame[2], frame[4:-2], now)

    def poll(self, now: float) -> list[bytes]:
        """Return the frames that are due."""
        self._now = now
        if now < self._up_at:
            return []
        for frame in self._parser.poll(now):
            self._take(frame[2], frame[4:-2], now)
        self._watch_stops(now)
        frames, self._out = self._out, []
        for kind, (enabled, interval) in self.messages.items():
            if enabled and now >= self._due[kind]:
                on_time = self._due[kind] + interval > now
                self._due[kind] = (self._due[kind] if on_time else now) + interval
                frames += self._build(kind)
        return frames

    def deadline(self) -> float:
        """Return when poll wants to be called next."""
        if self._now < self._up_at:
            return self._up_at
        due = [self._due[kind] for kind, (enabled, _) in self.messages.items() if enabled]
        return min([*due, self._parser.deadline, *([self._now] if self._out else [])])

    # -- what the host says ----------------------------------------------------------------------

    def _take(self, kind: int, payload: bytes, now: float) -> None:
        if kind in _GREATEST_RATES:
            gap = now - self._last_of.get(kind, -math.inf)
            self.too_fast[kind] += gap < _GREATEST_RATES[kind] - 5e-3  # a port may squeeze gaps
            self._last_of[kind] = now
        if kind == MessageType.HOST_HEARTBEAT:
            self.host_heartbeats += 1
            self._host_heard = now
            self.host_estop = payload[0] > 0
            self._watch_stops(now)
        elif kind == MessageType.MESSAGE_CONTROL:
            self._take_control(payload, now)
        elif kind == MessageType.USER_FEEDBACK:
            self._take_value(payload, now)
        elif kind == MessageType.USER_FEEDBACK_NAME:
            self.names[payload[0]] = payload[1:].rstrip(b'\0').decode('ascii', 'replace')
        elif kind == MessageType.USER_FEEDBACK_GET:
            self._answer(payload[0])

    def _take_control(self, payload: bytes, now: float) -> None:
        kind, enabled, interval_ms = struct.unpack('<BBH', payload)
        if kind in self.messages and interval_ms >= 20:
            self.messages[kind] = (enabled > 0, interval_ms * 1e-3)
            self._due[kind] = now + interval_ms * 1e-3
            self.eeprom_writes += 1

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

    def _answer(self, key: int) -> None:
        known = self.eeprom if key in self.eeprom else self.values
        if key in range(1, 10) or key in known:
            self._out.append(build_frame(0x30, struct.pack('<Bi', key, known.get(key, 0))))

    # -- stops and modes -------------------------------------------------------------------------

    def _causes(self, now: float) -> int:
        """Return the E-stop bits whose cause is there now."""
        self._host_heard = min(self._host_heard, now)
        silent = self.eeprom[85] == 1 and now - self._host_heard > HOST_TIMEOUT
        bits = _SRC if self.remote_estop or not self.radio else 0
        bits |= _VSC if self.wired_estop else 0
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

    @property
    def mode(self) -> Mode:
        """Local while a stop is there or not acknowledged (6.6), else what the remote chose."""
        return Mode.LOCAL if self.unacknowledged else self._mode

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

    def _build(self, kind: int) -> list[bytes]:
        if kind == MessageType.JOYSTICK:
            return [build_frame(0x10, self._joystick())]
        if kind == MessageType.HEARTBEAT:
            payload = struct.pack('<BBI', self.mode, self.autonomy, self.estop_bits)
            return [build_frame(0x20, payload)]
        if kind == MessageType.REMOTE_STATUS:
            charging, strength = int(self.charging), self.strength
            payload = bytes((self.battery_percent, charging, strength, strength, 0, 0))
            return [build_frame(0x22, payload)]
        return [build_frame(0x12, b'\x00' + s.encode()) for s in self._sentences()]

    def _joystick(self) -> bytes:
        active = self.mode == Mode.OPERATIONAL
        words = (self._axis_word(name, active) for name in AXIS_NAMES)
        pads = (self._pad(BUTTON_NAMES[:4], active), self._pad(BUTTON_NAMES[4:], active))
        return struct.pack('<6H', *words) + bytes(pads)

    def _axis_word(self, name: str, active: bool) -> int:
        value = self.sticks[name] if active else 0
        if active and name in self.faults:
            return self.faults[name] * 0b010101 | 0xFFC0
        status = 0b000001 if value == 0 else 0b000100 if value < 0 else 0b010000
        return status | abs(value) << 6

    def _pad(self, names: tuple[str, ...], active: bool) -> int:
        pad = 0
        for place, name in enumerate(names):
            bits = self.faults.get(name, int(self.buttons[name])) if active else 0
            pad |= bits << 2 * place
        return pad

    def _sentences(self) -> list[str]:
        if not self.radio:
            return []
        seconds = int(self._now) % 86400
        time = f'{seconds // 3600:02}{seconds // 60 % 60:02}{seconds % 60:02}.00'
        if self.position is None:
            return [build_sentence(f'GPGGA,{time},,,,,0,00,,,M,,M,,')]
        latitude, longitude = self.position
        north = _degrees_text(abs(latitude), 2) + (',N' if latitude >= 0 else ',S')
        east = _degrees_text(abs(longitude), 3) + (',E' if longitude >= 0 else ',W')
        return [build_sentence(f'GPGGA,{time},{north},{east},1,08,1.0,12.0,M,17.0,M,,')]

    # -- for people and tests --------------------------------------------------------------------

    def apply(self, text: str) -> None:
        """Obey one line, such as 'stick left_y 0.8'. :raises ValueError: one line of help."""
        obey(self, self.commands, text)
        self._watch_stops(self._now)

    def describe(self) -> dict[str, Any]:
        """Return what can be seen, as plain values."""
        return {
            'mode': self.mode.name.capitalize(),
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

    def _set_mode(self, name: str) -> None:
        mode = _CHOSEN_MODES[one_of(_CHOSEN_MODES, name)]
        if self.unacknowledged:
            raise ValueError('stopped; take the cause away and say ack first')
        self._mode = mode

    def _set_radio(self, value: str) -> None:
        self.radio = switch(value)

    def _set_battery(self, value: str) -> None:
        self.battery_percent = round(within(value, 0, 100))

    def _set_charging(self, value: str) -> None:
        self.charging = switch(value)

    def _set_strength(self, value: str) -> None:
        self.strength = round(within(value, 0, 2))

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
        'mode': ('remote|operational|menu|pause', _set_mode),
        'radio': ('on|off', _set_radio),
        'battery': ('0..100', _set_battery),
        'charging': ('on|off', _set_charging),
        'strength': ('0..2', _set_strength),
        'gps': ('LATITUDE|off LONGITUDE|off', _set_gps),
        'value': ('KEY VALUE', _set_value),
        'ack': ('', acknowledge),
        'reboot': ('', reboot),
    }


def _degrees_text(degrees: float, digits: int) -> str:
    """Return degrees as (d)ddmm.mmmmm; rounded first, so that minutes never read 60."""
    minutes = round(degrees * 60.0, 5)
    return f'{int(minutes // 60):0{digits}}{minutes % 60.0:08.5f}'
