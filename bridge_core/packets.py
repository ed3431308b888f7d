# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Packets of a serial line with a type, a length and Fletcher sums: FORT VSC (7.2), SSC (4.1).

======  ====  ==============================================================
offset  size  content
======  ====  ==============================================================
0       2     header
2       1     type
3       1     length N of the payload
4       N     payload
N+4     2     Fletcher sums, modulo 256: the plain sum, then the sum of sums
======  ====  ==============================================================
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
import math
import struct
from typing import ClassVar, TypeVar

from bridge_core.checksums import fletcher16, is_fletcher16
from bridge_core.framing import (
    ChecksumError,
    expiry,
    FrameError,
    FrameFormat,
    MessageT,
    StreamParser,
    Unknown,
)

HEAD_SIZE = 4  # header, type, length
CHECK_SIZE = 2
OVERHEAD = HEAD_SIZE + CHECK_SIZE  # bytes of a packet beside its payload

_CHECK = struct.Struct('<H')  # sum1, then sum2
_sums_at = _CHECK.unpack_from

_M = TypeVar('_M', bound='Message')


@dataclass(frozen=True, slots=True)
class PacketFormat:
    """
    What differs from protocol to protocol.

    :param header: two bytes. :param max_length: bytes of the largest payload, whatever its type.
    :param lengths: by type, the bytes that its payload may have; an unknown type may have any.
    :param summed_from: the offset of the first byte that the sums cover.
    """

    header: bytes
    max_length: int
    lengths: Mapping[int, Collection[int]]
    summed_from: int

    @property
    def max_size(self) -> int:
        """Bytes of the largest packet."""
        return self.max_length + OVERHEAD

    def build(self, kind: int, payload: bytes) -> bytes:
        """Return the whole packet around a payload."""
        body = self.header + bytes((kind, len(payload))) + payload
        return body + _CHECK.pack(fletcher16(body[self.summed_from :]))

    def size_of(self, head: bytes) -> int:
        """Return a packet's size from its first four bytes; 0 where type and length cannot be."""
        length, possible = head[3], self.lengths.get(head[2])
        if length > self.max_length or (possible is not None and length not in possible):
            return 0
        return length + OVERHEAD

    def is_sound(self, buffer: bytes, start: int, end: int) -> bool:
        """Tell whether the sums of the packet that stands there are right."""
        check = end - CHECK_SIZE
        return is_fletcher16(buffer[start + self.summed_from : check], _sums_at(buffer, check)[0])

    def payload_of(self, packet: bytes) -> bytes:
        """Return a whole packet's payload. :raises FrameError: if anything around it is wrong."""
        if len(packet) < OVERHEAD or not packet.startswith(self.header):
            raise FrameError(f'not a packet: {packet[:HEAD_SIZE].hex()}')
        size = self.size_of(packet)
        if not size:
            raise FrameError(f'type 0x{packet[2]:02X} cannot have {packet[3]} bytes')
        if len(packet) != size:
            raise FrameError(f'{len(packet)} bytes, but the length byte says {packet[3]}')
        if not self.is_sound(packet, 0, size):
            raise ChecksumError(f'wrong checksum {packet[-CHECK_SIZE:].hex()}')
        return packet[HEAD_SIZE:-CHECK_SIZE]

    def parser(
        self, decode: Callable[[int, bytes], MessageT | Unknown], baud: float = math.inf
    ) -> StreamParser[MessageT]:
        """
        Return a parser for one direction of one link.

        :param decode: from type and payload to a message; raises FrameError for bad contents.
        :param baud: of the line.
        """
        expire = expiry(OVERHEAD + max(map(max, self.lengths.values())), baud)
        return StreamParser(self.frame_format(decode), expire=expire)

    def frame_format(
        self, decode: Callable[[int, bytes], MessageT | Unknown]
    ) -> FrameFormat[MessageT]:
        """Return how a parser tells these packets apart. :param decode: see ``parser``."""

        def read(packet: bytes) -> MessageT | Unknown:
            if not self.is_sound(packet, 0, len(packet)):
                raise ChecksumError('wrong checksum')
            return decode(packet[2], packet[HEAD_SIZE:-CHECK_SIZE])

        return FrameFormat(self.header, HEAD_SIZE, self.max_size, self.size_of, read)


def decode_by(
    messages: Mapping[int, type[_M]],
) -> Callable[[int, bytes], _M | Unknown]:
    """Return what reads a payload by its type. :param messages: what may come, by type."""

    def decode(kind: int, payload: bytes) -> _M | Unknown:
        message = messages.get(kind)
        return Unknown(kind) if message is None else message.from_payload(payload)

    return decode


class Message:
    """What all messages share: the packet around the payload, and which fault is whose."""

    __slots__ = ()
    PACKETS: ClassVar[PacketFormat]
    TYPE: ClassVar[int]
    LAYOUT: ClassVar[struct.Struct]  # of a payload that is the fields of the message, in order

    @classmethod
    def from_bytes(cls: type[_M], packet: bytes) -> _M:
        """Read a whole packet. :raises FrameError: if it is not a sound one of this type."""
        payload = cls.PACKETS.payload_of(packet)
        if packet[2] != cls.TYPE:
            raise FrameError(f'type 0x{packet[2]:02X} is not {cls.__name__}')
        return cls.from_payload(payload)

    @classmethod
    def from_payload(cls: type[_M], payload: bytes) -> _M:
        """Read a payload of this type's length. :raises FrameError: a value that cannot be."""
        try:
            return cls._from_payload(payload)
        except (ValueError, struct.error) as error:
            # A value that we must not send is the peer's fault here.
            raise FrameError(f'{cls.__name__}: {error}') from error

    def to_bytes(self) -> bytes:
        """Return the whole packet."""
        return self.PACKETS.build(self.TYPE, self.to_payload())

    def to_payload(self) -> bytes:
        """Return what the packet is around."""
        return self._to_payload()

    @classmethod
    def _from_payload(cls: type[_M], payload: bytes) -> _M:
        return cls(*cls.LAYOUT.unpack(payload))

    def _to_payload(self) -> bytes:
        names = self.__dataclass_fields__  # type: ignore[attr-defined]
        return self.LAYOUT.pack(*(getattr(self, name) for name in names))
