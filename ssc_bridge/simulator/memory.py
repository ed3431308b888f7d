# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The simulated SSC's memory: settings, the image that holds them, and the one that survives.

Frames and images are built by their own few lines and the plain definition of the sums (4.1), so
that a slip in the bridge cannot hide in both. Where the printed image (3.1) does not tell what a
byte is, this device has chosen by itself: 3 the primary port, 4 and 5 the lockouts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
import struct

CHANNELS = 24
AUX = 6
RATES_HZ = (0, 1, 2, 5, 10, 20, 25, 50)  # 4.2.1; the image holds places in this row
# 1, inputs, primary port, two lockouts, config ID; table, constants, periods, auxiliary words,
# places of the rates.
_BODY = struct.Struct('>BxB3BBx96s24H24H6H5sx')
assert _BODY.size == 218
_LINE_SIZE = 36


def sums(data: bytes) -> bytes:
    """Return the sums of 4.1: the plain one, then the sum of sums."""
    first = second = 0
    for byte in data:
        first = (first + byte) % 256
        second = (second + first) % 256
    return bytes((first, second))


def build_frame(kind: int, payload: bytes = b'') -> bytes:
    """Return a frame laid out by 4.1."""
    body = bytes((kind, len(payload))) + payload
    return b'\x81\xa1' + body + sums(body)


def _table() -> list[bytearray]:
    """CONST without a signal, SERIAL at 1 ms, LAST at 1.5 ms, its own PIN at 2 ms."""
    return [bytearray((2, 3, 4, (row % 8) << 4)) for row in range(CHANNELS)]


@dataclass
class Settings:
    """
    What can be configured (3).

    :param inputs: 1 to 16. :param config_id: 0 to 255. :param primary: 1 or 2: the port of the
        messages. :param lockouts: messages 98 and 20 lock the menus out (3.6).
    :param table: 24 rows, a byte as in message 11 for 0, 1, 1.5 and 2 ms.
    :param constants: 24, in us. :param periods: 24, in us. :param aux: 6 words as in message 15.
    :param rates: Hz, of messages 10 to 14.
    """

    inputs: int = 8
    config_id: int = 1
    primary: int = 1
    lockouts: list[bool] = field(default_factory=lambda: [False, False])
    table: list[bytearray] = field(default_factory=_table)
    constants: list[int] = field(default_factory=lambda: [1500] * CHANNELS)
    periods: list[int] = field(default_factory=lambda: [20000] * CHANNELS)
    aux: list[int] = field(default_factory=lambda: [0] * AUX)
    rates: list[int] = field(default_factory=lambda: [20, 5, 20, 50, 20])

    @property
    def outputs(self) -> int:
        """Channels that are no inputs (3.2.1)."""
        return CHANNELS - self.inputs

    def to_image(self) -> bytes:
        """Return the image, sums included."""
        head = (1, self.inputs, self.primary, *self.lockouts, self.config_id, b''.join(self.table))
        codes = bytes(RATES_HZ.index(rate) for rate in self.rates)
        body = _BODY.pack(*head, *self.constants, *self.periods, *self.aux, codes)
        return body + sums(body)

    @classmethod
    def from_image(cls, image: bytes) -> Settings:
        """Read an image, whatever is in it. :raises struct.error: it has not 220 bytes."""
        _, inputs, primary, lock_98, lock_20, config_id, table, *words, codes = _BODY.unpack(
            image[:-2]
        )
        return cls(
            inputs=min(max(inputs, 1), 16),
            config_id=config_id,
            primary=primary,
            lockouts=[bool(lock_98), bool(lock_20)],
            table=[bytearray(table[at : at + 4]) for at in range(0, 96, 4)],
            constants=words[:24],
            periods=words[24:48],
            aux=words[48:],
            rates=[RATES_HZ[code % len(RATES_HZ)] for code in codes],
        )


class Memory:
    """
    Working memory, and the non-volatile one.

    :ivar working: an image. :ivar stored: an image; anything else is invalid.
    :ivar worn: saving does nothing.
    """

    def __init__(self, image: bytes) -> None:
        self.stored = image
        self.worn = False
        self.saves = self.erasures = 0
        self.working = self._sensible()

    @staticmethod
    def _sensible() -> bytes:
        return Settings().to_image()

    @property
    def valid(self) -> bool:
        """What is stored is an image."""
        return is_image(self.stored)

    @property
    def settings(self) -> Settings:
        """The settings in the working memory, a copy."""
        return Settings.from_image(self.working)

    def reload(self) -> None:
        """Take what is stored; sensible defaults where that is invalid (3.1)."""
        self.working = self.stored if self.valid else self._sensible()

    def save(self) -> None:
        """Store the working memory."""
        self.saves += 1
        if not self.worn:
            self.stored = self.working

    def erase(self) -> None:
        """Erase what is stored."""
        self.erasures += 1
        self.stored = b'\xff' * len(self.stored)

    def take(self, data: bytes) -> bool:
        """Take an image, or as much of one as there is; tell whether it was a sound one."""
        if is_image(data):
            self.working = data
            return True
        body = (data + self.working[len(data) :])[: _BODY.size]
        self.working = body + sums(body)
        return False

    def lines(self) -> list[str]:
        """Return the working memory as 3.1 prints it."""
        text = self.working.hex().upper()
        return [text[at : at + 2 * _LINE_SIZE] for at in range(0, len(text), 2 * _LINE_SIZE)]


@lru_cache(maxsize=8)  # asked at each step, and the sums are slow
def is_image(data: bytes) -> bool:
    """Tell whether data is an image of this device."""
    return len(data) == _BODY.size + 2 and data[2] in range(1, 17) and sums(data[:-2]) == data[-2:]
