# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The frame around every payload: manual section 3."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
import struct
from typing import ClassVar, TypeVar

from bridge_core.checksums import crc32_iso_hdlc, crc32_mpeg2
from bridge_core.framing import ChecksumError, FrameError
from bridge_core.numerals import check_range

REVISION = 0  # of the payload layouts that the manual describes
MAX_LENGTH = 492  # largest payload in bytes
_HEAD = struct.Struct('<4s4H4x')  # packet ID; revision, origin, serial, size; spare
_CHECK = struct.Struct('<I')
HEAD_SIZE = _HEAD.size
assert (HEAD_SIZE, _CHECK.size) == (16, 4)
MIN_FRAME = HEAD_SIZE + _CHECK.size
MAX_FRAME = MIN_FRAME + MAX_LENGTH


class LayoutError(FrameError):
    """The packet is sound, but not laid out as the manual has it: another revision or size."""


class PacketId(bytes, Enum):
    """Section 3.1: kind is P(eriodic), C(ommand) or A(cknowledge); I(nput) comes from the BU."""

    PERIODIC_INPUT = b'VRPI'
    COMMAND_INPUT = b'VRCI'
    ACKNOWLEDGE_INPUT = b'VRAI'
    PERIODIC_OUTPUT = b'VRPO'
    COMMAND_OUTPUT = b'VRCO'
    ACKNOWLEDGE_OUTPUT = b'VRAO'


class Crc(Enum):
    """The two readings of section 3.3, which prints no example."""

    MPEG2 = 'mpeg2'
    ISO_HDLC = 'iso_hdlc'

    def of(self, data: bytes) -> int:
        """Return the CRC, 32 bits."""
        return crc32_mpeg2(data) if self is Crc.MPEG2 else crc32_iso_hdlc(data)

    def is_good(self, datagram: bytes) -> bool:
        """Tell whether the last four bytes are the CRC of all before them."""
        body, check = datagram[: -_CHECK.size], datagram[-_CHECK.size :]
        return check == _CHECK.pack(self.of(body))


@dataclass(frozen=True, slots=True)
class Frame:
    """
    One packet; a datagram holds exactly one.

    :param kind: four bytes, see PacketId; an unknown one may come. :param serial: 0-65535.
    :param payload: up to 492 bytes. :param origin: the BU's ID, 0 for the machine controller.
    :param crc: by which reading of 3.3 it is, or was, checked.
    """

    kind: bytes
    serial: int
    payload: bytes
    origin: int = 0
    crc: Crc = Crc.MPEG2

    def __post_init__(self) -> None:
        check_range('the serial number', self.serial, 0, 0xFFFF)
        check_range('the origin', self.origin, 0, 0xFFFF)
        if len(self.kind) != 4 or len(self.payload) > MAX_LENGTH:
            raise ValueError(
                f'{self.kind!r} with {len(self.payload)} bytes: an ID has 4 bytes, a payload '
                f'{MAX_LENGTH} at most'
            )

    @classmethod
    def from_bytes(cls, datagram: bytes, crc: Crc | None) -> Frame:
        """
        Read a datagram.

        :param crc: the reading of 3.3; None: either. :raises ChecksumError: wrong CRC.
        :raises FrameError: anything else about it is not as section 3 says.
        """
        if not MIN_FRAME <= len(datagram) <= MAX_FRAME:
            raise FrameError(f'{len(datagram)} bytes, but a packet has {MIN_FRAME}-{MAX_FRAME}')
        readings = Crc if crc is None else (crc,)
        found = next((each for each in readings if each.is_good(datagram)), None)
        if found is None:
            raise ChecksumError(f'wrong CRC {datagram[-_CHECK.size :].hex()}')
        kind, revision, origin, serial, size = _HEAD.unpack_from(datagram)
        if revision != REVISION:
            raise LayoutError(f'revision {revision} is not {REVISION}')
        if size != len(datagram) - MIN_FRAME:
            raise LayoutError(f'size {size}, but {len(datagram) - MIN_FRAME} bytes of payload')
        return cls(kind, serial, datagram[HEAD_SIZE : -_CHECK.size], origin, found)

    def to_bytes(self) -> bytes:
        """Return the datagram."""
        sizes = (REVISION, self.origin, self.serial, len(self.payload))
        body = _HEAD.pack(self.kind, *sizes) + self.payload
        return body + _CHECK.pack(self.crc.of(body))


_M = TypeVar('_M', bound='Message')


class Message:
    """What all messages share: the payload's place in a frame, and which fault is whose."""

    __slots__ = ()
    KIND: ClassVar[PacketId]

    @classmethod
    def from_bytes(cls: type[_M], payload: bytes) -> _M:
        """Read a payload. :raises LayoutError: if it is not one of this packet."""
        try:
            return cls._from_payload(payload)
        except (ValueError, struct.error) as error:
            # What we must not send ourselves is the peer's fault here.
            raise LayoutError(f'{cls.__name__}: {error}') from error

    def to_bytes(self) -> bytes:
        """Return the payload."""
        return self._to_payload()

    @classmethod
    def _from_payload(cls: type[_M], payload: bytes) -> _M:
        raise NotImplementedError

    def _to_payload(self) -> bytes:
        raise NotImplementedError
