# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What makes a frame sound, told a second time: from the manuals' tables, by the plain definitions.

Nothing here imports what it judges. Offsets and lengths are those of the pages in docs/devices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import accumulate
import random


def fletcher(data: bytes) -> bytes:
    """Return the plain sum and the sum of sums, each modulo 256."""
    return bytes((sum(data) & 0xFF, sum(accumulate(data)) & 0xFF))


def _crc_table(polynomial: int, width: int) -> list[int]:
    table, top = [], 1 << width - 1
    for byte in range(256):
        value = byte << width - 8
        for _ in range(8):
            value = (value << 1 ^ polynomial if value & top else value << 1) & (1 << width) - 1
        table.append(value)
    return table


_CRC16 = _crc_table(0x1021, 16)
_CRC32 = _crc_table(0x04C11DB7, 32)
_MIRRORED = bytes(int(f'{byte:08b}'[::-1], 2) for byte in range(256))


def crc16(data: bytes) -> bytes:
    """Return the CRC-16/CCITT-FALSE, low byte first."""
    value = 0xFFFF
    for byte in data:
        value = (value << 8 & 0xFF00) ^ _CRC16[value >> 8 ^ byte]
    return value.to_bytes(2, 'little')


def crc32(data: bytes, *, mirrored: bool) -> bytes:
    """Return CRC-32/MPEG-2, or with mirrored bits CRC-32/ISO-HDLC, low byte first."""
    value = 0xFFFFFFFF
    for byte in data.translate(_MIRRORED) if mirrored else data:
        value = (value << 8 & 0xFFFFFF00) ^ _CRC32[value >> 24 ^ byte]
    if mirrored:
        value = int(f'{value ^ 0xFFFFFFFF:032b}'[::-1], 2)
    return value.to_bytes(4, 'little')


@dataclass(frozen=True)
class Line:
    """
    Frames in a stream.

    :param size_of: of the frame that begins at an offset; 0: none can. Called with a whole head.
    :param is_sound: whether the check of the frame from one offset to another is right.
    :param check: what a frame without its check ends with.
    """

    header: bytes
    head_size: int
    max_size: int
    size_of: Callable[[bytes, int], int]
    is_sound: Callable[[bytes, int, int], bool]
    check: Callable[[bytes], bytes]
    length_at: int = 0  # of a byte that says how long the payload is; 0: none does
    overhead: int = 0

    def frames(self, stream: bytes) -> Iterator[bytes]:
        """Yield the sound frames of a stream that has ended, first come, none within another."""
        at = 0
        while (at := stream.find(self.header, at)) >= 0 and at + self.head_size <= len(stream):
            end = at + self.size_of(stream, at)
            if at < end <= len(stream) and self.is_sound(stream, at, end):
                yield stream[at:end]
                at = end
            else:
                at += 1

    def anywhere(self, stream: bytes) -> Iterator[bytes]:
        """Yield the sound frames that begin at any place, be it within another."""
        at = -1
        while (at := stream.find(self.header, at + 1)) >= 0 and at + self.head_size <= len(stream):
            end = at + self.size_of(stream, at)
            if at < end <= len(stream) and self.is_sound(stream, at, end):
                yield stream[at:end]

    def repair(self, data: bytes, rng: random.Random) -> bytes:
        """Make the last frame of a read fit its length, or its length fit it; then its check."""
        at = data.rfind(self.header)
        if at < 0 or len(data) - at < self.head_size:
            return data
        if self.length_at and rng.random() < 0.7:
            length = len(data) - at - self.overhead
            if not 0 <= length <= 0xFF:
                return data
            place = at + self.length_at
            body = data[at:place] + bytes((length,)) + data[place + 1 : len(data)]
        else:
            size = self.size_of(data, at) or self.head_size
            body = data[at:][:size].ljust(size, b'\0')
        check = self.check(body)
        return data[:at] + body[: -len(check)] + check


# FORT VSC, docs/devices/fort_vsc.md: by type, how long a payload may be.
_VSC = {0x10: (14,), 0x12: range(1, 249), 0x20: (6,), 0x21: (1,), 0x22: (6,)}
_VSC |= {0x23: (4,), 0x30: (5,), 0x31: (21,), 0x32: (1,)}
_VSC |= {0xAC: range(1, 249), 0xAD: (1,), 0xAE: (2,)}
_SSC = {10: (0, 2), 11: range(25), 12: range(0, 49, 2), 13: range(0, 33, 2)}
_SSC |= {14: (0, *range(2, 15, 2)), 15: (0, 14), 20: range(2, 49, 2), 21: range(2, 15, 2)}
_SSC |= {98: (0,)}


def _packets(header: bytes, lengths: dict[int, object], most: int, summed_from: int) -> Line:
    def size_of(data: bytes, at: int) -> int:
        length, possible = data[at + 3], lengths.get(data[at + 2])
        fits = length <= most and (possible is None or length in possible)  # type: ignore[operator]
        return length + 6 if fits else 0

    def is_sound(data: bytes, start: int, end: int) -> bool:
        return data[end - 2 : end] == fletcher(data[start + summed_from : end - 2])

    return Line(
        header,
        4,
        most + 6,
        size_of,
        is_sound,
        lambda frame: fletcher(frame[summed_from:-2]),
        length_at=3,
        overhead=6,
    )


def _fixed(size: int) -> Line:
    return Line(
        b'\xf0\xf0',
        2,
        size,
        lambda data, at: size,
        lambda data, start, end: data[end - 2 : end] == crc16(data[start + 2 : end - 2]),
        lambda frame: crc16(frame[2:-2]),
    )


def crc16_modbus(data: bytes) -> bytes:
    """Return the CRC of Modbus over Serial Line V1.02, 6.2.2."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 * (value & 1)
    return value.to_bytes(2, 'little')


def _answer_size(data: bytes, at: int) -> int:
    """Return the size of a unit's answer: Application Protocol V1.1b3, 6.2, 6.11 and 7."""
    return {2: 5 + data[at + 2], 15: 8, 0x82: 5, 0x8F: 5}.get(data[at + 1], 0)


MODBUS_RTU = Line(
    b'\x01',  # the unit
    3,
    260,
    _answer_size,
    # Up to eight inputs are asked for: one byte.
    lambda data, start, end: (
        data[end - 2 : end] == crc16_modbus(data[start : end - 2])
        and (data[start + 1] != 2 or data[start + 2] == 1)
    ),
    lambda frame: crc16_modbus(frame[:-2]),
)
VSC = _packets(b'\x10\x01', dict(_VSC), 248, 0)
SSC = _packets(b'\x81\xa1', dict(_SSC), 255, 2)
ESI_STATUS, ESI_COMMAND = _fixed(12), _fixed(10)
ESI_COMPACT_STATUS = _fixed(8)


def is_sound_datagram(data: bytes, *, mirrored: bool) -> bool:
    """Tell whether it is a packet of EG-Link: revision, size and check."""
    return (
        20 <= len(data) <= 512
        and data[4:6] == b'\0\0'
        and int.from_bytes(data[10:12], 'little') == len(data) - 20
        and data[-4:] == crc32(data[:-4], mirrored=mirrored)
    )


def repair_datagram(data: bytes, rng: random.Random) -> bytes:
    """Make size and check of a datagram fit, the latter by one of the two readings."""
    if len(data) < 20:
        return data
    size = (len(data) - 20 & 0xFFFF).to_bytes(2, 'little')
    body = data[:4] + b'\0\0' + data[6:10] + size + data[12:-4]
    return body + crc32(body, mirrored=rng.random() < 0.2)
