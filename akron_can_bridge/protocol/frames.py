# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What all messages share: identifiers, the type byte, lengths, and which fault is whose."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, ClassVar, get_origin, get_type_hints, Literal, TypeVar

from akron_can_bridge.protocol.fields import Field
from bridge_core.framing import FrameError
from bridge_core.j1939 import CanFrame, GLOBAL_ADDRESS, J1939Id, NULL_ADDRESS

BASIC_JOYSTICK_PGN = 64982
EXTENDED_JOYSTICK_PGN = 64983
FIELD_REQUEST_PGN = 59904
NAME_PGN = 60928
PROPRIETARY_PGN = 0xEF00  # every message with a type byte


class MessageType(IntEnum):
    """First byte of data on PGN EF00."""

    POSITION_LIMIT = 0x01
    FAULT = 0x02
    FIRMWARE_VERSION = 0x03
    PCODE_VERSION = 0x04
    CONFIG_VERSION = 0x05
    VISTA = 0x21
    VISTA_POSITION = 0x22
    ZERO_POSITIONS = 0x41
    RESET_CONTROLLER = 0x45
    ENTER_SETUP = 0x46
    ROTATION_SOFT_LIMITS = 0x81
    ELEVATION_SOFT_LIMITS = 0x82
    DIGITAL_OUTPUTS = 0x83
    MINI_OUTPUTS = 0x84
    DIGITAL_INPUTS = 0x85
    SOE_PERMISSIVE = 0xA1
    DIAGNOSTIC_DATA = 0xFD
    ASCII_PIPE = 0xFE
    ADDRESS_ANNOUNCEMENT = 0xFF


_M = TypeVar('_M', bound='Message')


class Message:
    """
    One message.

    Reserved and unused bits are ignored where they are read and zero where they are written.
    """

    __slots__ = ()
    PGN: ClassVar[int] = PROPRIETARY_PGN
    TYPE: ClassVar[MessageType | None] = None  # the first byte; None: the PGN has no such byte
    LENGTHS: ClassVar[range]  # bytes of data, the type included

    @classmethod
    def from_bytes(cls: type[_M], data: bytes) -> _M:
        """Read a frame's data. :raises FrameError: it is not a sound message of this kind."""
        if len(data) not in cls.LENGTHS:
            raise FrameError(f'{cls.__name__} cannot have {len(data)} bytes')
        if cls.TYPE is not None and data[0] != cls.TYPE:
            raise FrameError(f'type {data[0]:02X} is not {cls.__name__}')
        return cls.from_data(data)

    @classmethod
    def from_data(cls: type[_M], data: bytes) -> _M:
        """Read data whose type and length are this kind's. :raises FrameError: it is unsound."""
        try:
            return cls._from_payload(data if cls.TYPE is None else data[1:])
        except ValueError as error:  # a value that we must not send is the peer's fault here
            raise FrameError(f'{cls.__name__}: {error}') from error

    @classmethod
    def _from_payload(cls: type[_M], payload: bytes) -> _M:
        raise NotImplementedError


class Writable(Message):
    """
    A message that can be written as well as read.

    Its annotations are the table of its fields: each is Annotated with its Field.
    """

    __slots__ = ()
    ORDER: ClassVar[Literal['big', 'little']] = 'big'  # of bytes
    FIELDS: ClassVar[tuple[tuple[str, Field], ...]] = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        hints = get_type_hints(cls, include_extras=True)
        cls.FIELDS = tuple(
            (name, hint.__metadata__[0])
            for name, hint in hints.items()
            if get_origin(hint) is Annotated
        )
        if cls.FIELDS:
            bits = max(field.at + field.bits for _, field in cls.FIELDS)
            length = (bits + 7) // 8 + (cls.TYPE is not None)
            cls.LENGTHS = range(length, length + 1)

    def __post_init__(self) -> None:
        """:raises ValueError: for a value that does not fit."""
        self._to_payload()

    def to_bytes(self) -> bytes:
        """Return a frame's data."""
        head = b'' if self.TYPE is None else bytes((self.TYPE,))
        return head + self._to_payload()

    @classmethod
    def _from_payload(cls: type[_M], payload: bytes) -> _M:
        assert issubclass(cls, Writable)
        word = int.from_bytes(payload, cls.ORDER)
        return cls(**{name: field.read(word) for name, field in cls.FIELDS})

    def _to_payload(self) -> bytes:
        word = 0
        for name, field in self.FIELDS:
            word |= field.write(name, getattr(self, name))
        return word.to_bytes(self.LENGTHS.start - (self.TYPE is not None), self.ORDER)


class Sendable(Writable):
    """A message that an integrator may send."""

    __slots__ = ()
    PRIORITY: ClassVar[int] = 6

    def to_frame(self, source: int, destination: int = GLOBAL_ADDRESS) -> CanFrame:
        """
        Return the frame.

        :raises ValueError: what acts on one unit has no unit's address as destination, or the
            PGN has no destination but one is given.
        """
        if self.TYPE is not None and destination >= NULL_ADDRESS:
            raise ValueError(f'{type(self).__name__} is for one unit: {destination:02X} is none')
        parts = J1939Id(self.PRIORITY, self.PGN, source, destination)
        return CanFrame(parts.identifier, self.to_bytes())


@dataclass(frozen=True, slots=True)
class Bare(Sendable):
    """A message that is its type byte and no more."""

    LENGTHS = range(1, 2)
