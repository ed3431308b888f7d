# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Status messages that come unasked, types 01, 81 to 85, A1, FD and FF, and the ASCII pipe FE."""

from __future__ import annotations

from dataclasses import dataclass
import re
from typing import Annotated

from akron_can_bridge.protocol.fields import bit, degrees, Field, flags, position, status, statuses
from akron_can_bridge.protocol.flags import Input, MiniOutput, Output, Permission
from akron_can_bridge.protocol.frames import Message, MessageType, Sendable, Writable
from akron_can_bridge.protocol.values import Position, Status
from bridge_core.numerals import check_range

PERMISSIVE_PERIOD = 0.1  # A1
PERMISSIVE_TIMEOUT = 0.3

_PIN = re.compile(r'[0-9]{4}[!-~]{2}[0-9]{9}')
_PIN_TOP_BIT = 1 << 29


@dataclass(frozen=True, slots=True)
class PositionLimit(Writable):
    """
    Type 01, every 100 ms from 6032, 6040 and 6042.

    :param hard_stops: ON where an axis is at its end, in the order of HARD_STOP_NAMES.
    :param operational_error: ON: poll the faults. :param calibration: ON: calibrated.
    """

    TYPE = MessageType.POSITION_LIMIT
    rotation: Annotated[Position, position(at=40)]
    elevation: Annotated[Position, position(at=24)]
    hard_stops: Annotated[tuple[Status, ...], statuses(10, at=4)]
    operational_error: Annotated[Status, status(at=2)]
    calibration: Annotated[Status, status(at=0)]


@dataclass(frozen=True, slots=True)
class RotationSoftLimits(Writable):
    """Type 81, every 100 ms from a 6032 with position feedback; left is negative."""

    TYPE = MessageType.ROTATION_SOFT_LIMITS
    left_deg: Annotated[float, degrees(at=24)]
    right_deg: Annotated[float, degrees(at=8)]
    # Then these are the limits of the oscillation.
    oscillating: Annotated[bool, bit(at=7)] = False


@dataclass(frozen=True, slots=True)
class ElevationSoftLimits(Writable):
    """Type 82, every 100 ms from a 6032 with position feedback; down is negative."""

    TYPE = MessageType.ELEVATION_SOFT_LIMITS
    down_deg: Annotated[float, degrees(at=24)]
    up_deg: Annotated[float, degrees(at=8)]


@dataclass(frozen=True, slots=True)
class DigitalOutputs(Writable):
    """Type 83, every 100 ms. :param riser: electric riser command bits, 0 to 3."""

    TYPE = MessageType.DIGITAL_OUTPUTS
    outputs: Annotated[Output, flags(Output, 16)]
    riser: Annotated[int, Field(2, at=8)] = 0


@dataclass(frozen=True, slots=True)
class MiniOutputs(Writable):
    """Type 84, every 100 ms from a 6033 Mini Universal."""

    TYPE = MessageType.MINI_OUTPUTS
    outputs: Annotated[MiniOutput, flags(MiniOutput, 16)]


@dataclass(frozen=True, slots=True)
class DigitalInputs(Writable):
    """Type 85, every 100 ms from a 6039 CAN I/O module."""

    TYPE = MessageType.DIGITAL_INPUTS
    inputs: Annotated[Input, flags(Input, 8)]


@dataclass(frozen=True, slots=True)
class SoePermissive(Sendable):
    """Type A1, every 100 ms to a unit in SOE mode, which stops 300 ms after the last one."""

    TYPE = MessageType.SOE_PERMISSIVE
    permitted: Annotated[Permission, flags(Permission, 16)]


def is_pin(text: str) -> bool:
    """Tell whether this is 4 digits up to 4095, 2 characters and 9 digits."""
    return _PIN.fullmatch(text) is not None and int(text[:4]) <= 0xFFF


@dataclass(frozen=True, slots=True)
class AddressAnnouncement(Writable):
    """
    Type FF: who claimed the address that this comes from (Appendix A).

    The manual gives PIN digits 7-15 30 bits, but does not count the highest one in its example,
    where it is set. So that bit is kept apart, and ``matches`` knows both readings.

    :param pin: 15 characters: device type, two ASCII characters, nine digits below 2**29.
    """

    TYPE = MessageType.ADDRESS_ANNOUNCEMENT
    LENGTHS = range(8, 9)
    pin: str
    top_bit: bool = False

    def __post_init__(self) -> None:
        if not is_pin(self.pin):
            raise ValueError(f'a PIN is such as 1032AE100801035, not {self.pin!r}')
        check_range('digits 7-15 of a PIN', int(self.pin[6:]), 0, _PIN_TOP_BIT - 1)

    @property
    def device_type(self) -> int:
        """The key of DEVICE_TYPES."""
        return int(self.pin[:4])

    @property
    def identity(self) -> int:
        """The identity number in the NAME of the same device."""
        return int(self.pin[6:]) & 0x1FFFFF

    def matches(self, pin: str) -> bool:
        """Tell whether the device has this PIN, be the highest bit counted or not."""
        counted = int(self.pin[6:]) + (_PIN_TOP_BIT if self.top_bit else 0)
        return pin in (self.pin, f'{self.pin[:6]}{counted:09}')

    @classmethod
    def _from_payload(cls, payload: bytes) -> AddressAnnouncement:
        word = int.from_bytes(payload, 'big')  # 7 bits digit 5, 7 digit 6, 12 and 30 of digits
        letters = chr(word >> 49) + chr(word >> 42 & 0x7F)
        digits = word & (_PIN_TOP_BIT - 1)
        return cls(f'{word >> 30 & 0xFFF:04}{letters}{digits:09}', bool(word & _PIN_TOP_BIT))

    def _to_payload(self) -> bytes:
        letters = ord(self.pin[4]) << 49 | ord(self.pin[5]) << 42
        digits = int(self.pin[6:]) | (_PIN_TOP_BIT if self.top_bit else 0)
        return (letters | self.device_type << 30 | digits).to_bytes(7, 'big')


@dataclass(frozen=True, slots=True)
class DiagnosticData(Message):
    """Type FD, for the maker's diagnostic program: never sent by us. :param content: 1-6 bytes."""

    TYPE = MessageType.DIAGNOSTIC_DATA
    LENGTHS = range(3, 9)
    record_type: int
    content: bytes

    @classmethod
    def _from_payload(cls, payload: bytes) -> DiagnosticData:
        return cls(payload[0], payload[1:])


@dataclass(frozen=True, slots=True)
class AsciiPipe(Message):
    """Type FE, not available for integrator use. :param characters: 1 to 7 bytes."""

    TYPE = MessageType.ASCII_PIPE
    LENGTHS = range(2, 9)
    characters: bytes

    @property
    def text(self) -> str:
        """The characters, with an escape for what is not ASCII."""
        return self.characters.decode('ascii', 'backslashreplace')

    @classmethod
    def _from_payload(cls, payload: bytes) -> AsciiPipe:
        return cls(payload)


@dataclass(frozen=True, slots=True)
class AsciiPipeAcknowledgement(Message):
    """Type FE without characters: the previous ones were received."""

    TYPE = MessageType.ASCII_PIPE
    LENGTHS = range(1, 2)

    @classmethod
    def _from_payload(cls, payload: bytes) -> AsciiPipeAcknowledgement:
        del payload
        return cls()
