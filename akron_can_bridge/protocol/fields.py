# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fields of messages: which bits, and what they mean."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntFlag
import math
from typing import Any

from akron_can_bridge.protocol.values import (
    Axis,
    pack_statuses,
    Position,
    Status,
    unpack_statuses,
    Version,
)
from bridge_core.numerals import check_range


def _same(value: Any) -> Any:
    return value


@dataclass(frozen=True, slots=True)
class Field:
    """
    Some bits of a message; a whole number, unless it is converted.

    :param bits: how many. :param at: place of the lowest one, where 0 is the message's lowest bit:
        that of the last byte, or of the first one where the low byte comes first.
    :param unpack: from the bits to the value. :param pack: back; may raise ValueError.
    """

    bits: int
    at: int
    unpack: Callable[[int], Any] = _same
    pack: Callable[[Any], int] = _same

    def read(self, word: int) -> Any:
        """Return the value out of the whole message's bits."""
        return self.unpack(word >> self.at & (1 << self.bits) - 1)

    def write(self, name: str, value: Any) -> int:
        """Return the value at its place. :raises ValueError: it does not fit, called ``name``."""
        bits = self.pack(value)
        check_range(name, bits, 0, (1 << self.bits) - 1)
        return bits << self.at


def bit(at: int) -> Field:
    """Return a field that is true or false."""
    return Field(1, at, bool, int)


def flags(kind: type[IntFlag], bits: int, at: int = 0) -> Field:
    """Return single bits; those without a name are ignored."""
    known = sum(kind)
    return Field(bits, at, lambda word: kind(word & known))


def statuses(count: int, at: int) -> Field:
    """Return a tuple of two-bit statuses, the first one on top."""

    def pack(values: tuple[Status, ...]) -> int:
        if len(values) != count:
            raise ValueError(f'{count} statuses are needed, not {len(values)}')
        return pack_statuses(values)

    def unpack(bits: int) -> tuple[Status, ...]:
        return unpack_statuses(bits.to_bytes((count + 3) // 4, 'big'))[-count:]

    return Field(2 * count, at, unpack, pack)


def status(at: int) -> Field:
    """Return one two-bit status."""
    return Field(2, at, Status, Status)


def axis(at: int) -> Field:
    """Return a deflection: 16 bits, low byte first."""
    return Field(
        16, at, lambda bits: Axis.from_word(_swap(bits)), lambda value: _swap(value.to_word())
    )


def position(at: int) -> Field:
    """Return a measured angle: 16 bits, high byte first."""
    return Field(16, at, Position.from_word, Position.to_word)


def degrees(at: int) -> Field:
    """Return a signed angle of 0.1 degree."""

    def pack(value: float) -> int:
        if not math.isfinite(value):
            raise ValueError(f'an angle must be a number of degrees, not {value}')
        tenths = round(value * 10)
        check_range('an angle (0.1 degree)', tenths, -0x8000, 0x7FFF)
        return tenths & 0xFFFF

    return Field(16, at, lambda bits: ((bits ^ 0x8000) - 0x8000) / 10, pack)


def two_bytes(at: int) -> Field:
    """Return a version: a major and a minor number, a byte each."""

    def pack(value: Version) -> int:
        for number in value:
            check_range('a version number', number, 0, 0xFF)
        return value.major << 8 | value.minor

    return Field(16, at, lambda bits: Version(*divmod(bits, 0x100)), pack)


def _swap(word: int) -> int:
    return (word & 0xFF) << 8 | word >> 8
