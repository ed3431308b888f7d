# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the messages carry: statuses, deflections, positions, and who the devices are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
import math
from typing import NamedTuple

from bridge_core.numerals import check_range

JOYSTICK_ADDRESSES = range(0x33, 0x39)  # Appendix B; the first outranks all after it
FULL_SCALE = 1000  # a deflection of 100.0 %
MAX_MAGNITUDE = 1023  # ten bits; other makers' sticks read this much at their stop

# What the first four digits of the PIN say (Appendix A).
DEVICE_TYPES: dict[int, str] = {
    1032: '6032 Universal II',
    1033: '6033 Mini Universal',
    1034: '6034 Operator Station',
    1035: '6035 Joystick (or 6041 Switchbox)',
    1036: '6036 Direction Indicator',
    1037: '6037 Wireless Interface',
    1040: '6040 Forestry controller',
    1041: '6041 Switchbox (or 6035 Joystick)',
    1042: '6042 Global Platform controller',
    1051: '6051 CAN Gateway',
    1052: '6052 StreamMaster II',
}
# Axes 1 to 5, their positive direction first (Appendix C).
_AIMED = (('right', 'left'), ('up', 'down'), ('stream', 'fog'))
_DISCHARGE = (('open', 'close'),)
AXIS_USAGE: dict[int, tuple[tuple[str, str], ...]] = {
    1032: (*_AIMED, ('high flow or deploy', 'low flow or stow'), *_DISCHARGE),
    1040: (*_AIMED, *_DISCHARGE),
    1042: _AIMED,
    1052: _AIMED,
}
HARD_STOP_NAMES = tuple(f'axis {axis} {sign}' for axis in range(1, 6) for sign in '+-')
PCODE_ERRORS: dict[int, str] = {  # the rest is in the reference manual of the device
    0: 'none',
    11: 'rotation sensor error',
}


def pcode_name(code: int) -> str:
    """Return a pCode error code in words; the number where this manual does not name it."""
    return PCODE_ERRORS.get(code, f'error flash code {code}')


class Status(IntEnum):
    """The manual's 2 bit status field."""

    OFF = 0b00
    ON = 0b01
    ERROR = 0b10
    NOT_AVAILABLE = 0b11


_STATUSES = tuple(Status)
# By byte: its four statuses, from the top bits down.
STATUSES = tuple(
    tuple(_STATUSES[byte >> shift & 3] for shift in (6, 4, 2, 0)) for byte in range(256)
)


def unpack_statuses(data: bytes) -> tuple[Status, ...]:
    """Return four statuses a byte, from the top bits down."""
    return tuple(status for byte in data for status in STATUSES[byte])


def pack_statuses(statuses: Iterable[Status]) -> int:
    """Return the bits of statuses, the first one on top. :raises ValueError: for another value."""
    bits = 0
    for status in statuses:
        bits = bits << 2 | Status(status)
    return bits


def _worst(statuses: tuple[Status, ...]) -> Status | None:
    """Return what is wrong with any of them; an error outweighs an absence."""
    faults = (fault for fault in (Status.ERROR, Status.NOT_AVAILABLE) if fault in statuses)
    return next(faults, None)


@dataclass(frozen=True, slots=True)
class Axis:
    """
    One deflection of a joystick with its three statuses, as on the wire; see ``value``.

    :param magnitude: 0 to 1023 in 0.1 %. :param positive: right or forward.
    :param negative: left or back.
    """

    magnitude: int
    positive: Status = Status.OFF
    negative: Status = Status.OFF
    neutral: Status = Status.OFF

    def __post_init__(self) -> None:
        check_range('a deflection (0.1 %)', self.magnitude, 0, MAX_MAGNITUDE)
        pack_statuses((self.positive, self.negative, self.neutral))

    @classmethod
    def of(cls, permille: int) -> Axis:
        """Return the deflection for -1000 (left, back) to 1000 (right, forward)."""
        check_range('a deflection (0.1 %)', permille, -FULL_SCALE, FULL_SCALE)
        directions = (Status(permille > 0), Status(permille < 0), Status(permille == 0))
        return cls(abs(permille), *directions)

    @property
    def fault(self) -> Status | None:
        """
        ERROR or NOT_AVAILABLE; None where the sender vouches for the deflection.

        No direction or several at once is an error: which one is true is not ours to guess.
        """
        statuses = (self.positive, self.negative, self.neutral)
        fault = _worst(statuses)
        return fault if fault or statuses.count(Status.ON) == 1 else Status.ERROR

    @property
    def value(self) -> int | None:
        """
        The deflection in 0.1 %, right and forward positive; None where there is a fault.

        Neutral with a magnitude is neutral: the flag is the sender's own verdict.
        """
        if self.fault is not None:
            return None
        if self.neutral is Status.ON:
            return 0
        return self.magnitude if self.positive is Status.ON else -self.magnitude

    @staticmethod
    @lru_cache(maxsize=4096)  # sticks say the same again and again
    def from_word(word: int) -> Axis:
        """Read 16 bits, low byte first on the wire; from bit 0: neutral, negative, positive."""
        return Axis(word >> 6, *STATUSES[word & 0x3F][1:])

    def to_word(self) -> int:
        """Return the 16 bits."""
        return self.magnitude << 6 | pack_statuses((self.positive, self.negative, self.neutral))


NEUTRAL = Axis.of(0)
UNAVAILABLE = Axis(MAX_MAGNITUDE, *[Status.NOT_AVAILABLE] * 3)  # FFFF, as in the manual's example


@dataclass(frozen=True, slots=True)
class Position:
    """
    A measured angle with its two statuses, as on the wire; see ``degrees``.

    :param tenths: 0 to 4095 in 0.1 degree. :param positive: right or up.
    :param negative: left or down.
    """

    tenths: int
    positive: Status = Status.OFF
    negative: Status = Status.OFF

    def __post_init__(self) -> None:
        check_range('a position (0.1 degree)', self.tenths, 0, 0xFFF)
        pack_statuses((self.positive, self.negative))

    @property
    def fault(self) -> Status | None:
        """ERROR or NOT_AVAILABLE (no sensor); None where the unit vouches for the position."""
        fault = _worst((self.positive, self.negative))
        signed = self.positive is not self.negative or (self.tenths == 0 and not self.positive)
        return fault if fault or signed else Status.ERROR

    @property
    def degrees(self) -> float | None:
        """The angle, right and up positive; None where there is a fault."""
        if self.fault is not None:
            return None
        return (-self.tenths if self.negative is Status.ON else self.tenths) / 10

    @property
    def radians(self) -> float | None:
        """The same in rad."""
        degrees = self.degrees
        return None if degrees is None else math.radians(degrees)

    @classmethod
    def from_word(cls, word: int) -> Position:
        """Read 16 bits, high byte first on the wire: angle, positive, negative."""
        return cls(word >> 4, _STATUSES[word >> 2 & 3], _STATUSES[word & 3])

    def to_word(self) -> int:
        """Return the 16 bits."""
        return self.tenths << 4 | pack_statuses((self.positive, self.negative))


class Version(NamedTuple):
    """A version as the unit tells it: two bytes."""

    major: int
    minor: int

    def __str__(self) -> str:
        return f'{self.major}.{self.minor}'
