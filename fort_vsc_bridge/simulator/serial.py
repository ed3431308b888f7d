# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The packet protocol's side of a simulated VSC: manual section 7, with its own checksum loop."""

from __future__ import annotations

import struct

from fort_vsc_bridge.protocol.frames import MessageType, PACKETS
from fort_vsc_bridge.protocol.values import AXIS_NAMES, BUTTON_NAMES
from fort_vsc_bridge.simulator.vsc import Vsc


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


def _as_they_came(kind: int, payload: bytes) -> tuple[int, bytes]:
    return kind, payload


_SETUP = {1: b'VSC-SIM-0000001', 111: b'1.2.3'}  # texts by key, as a public driver has them


class Simulator(Vsc):
    """A VSC on its USB or RS232 port: bytes in any split."""

    MESSAGES = {  # table 17
        MessageType.JOYSTICK: (True, 0.02),
        MessageType.GPS: (True, 1.0),
        MessageType.HEARTBEAT: (True, 0.05),
        MessageType.REMOTE_STATUS: (False, 1.0),
    }
    GREATEST_RATES = {0x30: 0.05, 0x31: 0.25, 0x32: 0.05}

    def __init__(self, *, latch_bits: bool = True) -> None:
        self._parser = PACKETS.parser(_as_they_came)
        super().__init__(latch_bits=latch_bits)

    def _boot(self, up_at: float) -> None:
        super()._boot(up_at)
        self._parser.reset()
        self.unlocked = False  # its setup answers

    def _hear(self, data: bytes, now: float) -> None:
        for kind, payload in self._parser.feed(data, now):
            self._obey(kind, payload, now)

    def _hear_late(self, now: float) -> None:
        for kind, payload in self._parser.poll(now):
            self._obey(kind, payload, now)

    def _late_deadline(self) -> float:
        return self._parser.deadline

    def _obey(self, kind: int, payload: bytes, now: float) -> None:
        if kind in self.GREATEST_RATES:
            self._watch_rate(kind, now)
        if kind == MessageType.HOST_HEARTBEAT:
            self._take_heartbeat(payload[0] > 0, now)
        elif kind == MessageType.MESSAGE_CONTROL:
            self._take_control(payload, now)
        elif kind == MessageType.USER_FEEDBACK:
            self._take_value(payload, now)
        elif kind == MessageType.USER_FEEDBACK_NAME:
            self._take_name(payload[0], payload[1:])
        elif kind == MessageType.USER_FEEDBACK_GET:
            self._answer(payload[0])
        elif kind == MessageType.SETUP_UNLOCK:
            self.unlocked = payload == b'\xc0\xde'
        elif kind == MessageType.SETUP_STRING_GET and self.unlocked and payload[0] in _SETUP:
            self._out.append(build_frame(0xAC, payload + _SETUP[payload[0]]))

    def _take_control(self, payload: bytes, now: float) -> None:
        kind, enabled, interval_ms = struct.unpack('<BBH', payload)
        if kind in self.messages and interval_ms >= 20:
            self.messages[kind] = (enabled > 0, interval_ms * 1e-3)
            self._due[kind] = now + interval_ms * 1e-3
            self.eeprom_writes += 1

    def _tell_value(self, key: int, value: int) -> None:
        self._out.append(build_frame(0x30, struct.pack('<Bi', key, value)))

    def _build(self, kind: int) -> list[bytes]:
        if kind == MessageType.JOYSTICK:
            return [build_frame(0x10, self._joystick())]
        if kind == MessageType.HEARTBEAT:
            return [build_frame(0x20, self._heartbeat())]
        if kind == MessageType.REMOTE_STATUS:
            return [build_frame(0x22, self._remote_status())]
        return [build_frame(0x12, b'\x00' + s.encode()) for s in self._sentences()]

    def _joystick(self) -> bytes:
        pads = (self._pad(BUTTON_NAMES[:4]), self._pad(BUTTON_NAMES[4:]))
        return struct.pack('<6H', *map(self._axis_word, AXIS_NAMES)) + bytes(pads)

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


def _degrees_text(degrees: float, digits: int) -> str:
    """Return degrees as (d)ddmm.mmmmm; rounded first, so that minutes never read 60."""
    minutes = round(degrees * 60.0, 5)
    return f'{int(minutes // 60):0{digits}}{minutes % 60.0:08.5f}'
