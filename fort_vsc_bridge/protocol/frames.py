"""The frame around every payload: manual section 7.2, 7.3 and 7.6."""

from __future__ import annotations

from enum import IntEnum
import struct
from typing import ClassVar
from typing import TypeVar

from bridge_core.checksums import fletcher16
from bridge_core.framing import FrameError
from bridge_core.framing import FrameFormat
from bridge_core.framing import StreamParser

HEADER = b'\x10\x01'
HEAD_SIZE = 4  # header, type, length
CHECK_SIZE = 2
MAX_LENGTH = 248  # largest payload in bytes, known or unknown type
BAUD = 115200  # 8N1 (section 7)

_CHECK = struct.Struct('<H')


class MessageType(IntEnum):
    """Table 17."""

    JOYSTICK = 0x10
    GPS = 0x12
    HEARTBEAT = 0x20
    HOST_HEARTBEAT = 0x21
    REMOTE_STATUS = 0x22
    MESSAGE_CONTROL = 0x23
    USER_FEEDBACK = 0x30
    USER_FEEDBACK_NAME = 0x31
    USER_FEEDBACK_GET = 0x32


_LENGTHS: dict[int, range] = {  # bytes of payload
    MessageType.JOYSTICK: range(14, 15),
    MessageType.GPS: range(1, MAX_LENGTH + 1),
    MessageType.HEARTBEAT: range(6, 7),
    MessageType.HOST_HEARTBEAT: range(1, 2),
    MessageType.REMOTE_STATUS: range(6, 7),
    MessageType.MESSAGE_CONTROL: range(4, 5),
    MessageType.USER_FEEDBACK: range(5, 6),
    MessageType.USER_FEEDBACK_NAME: range(21, 22),
    MessageType.USER_FEEDBACK_GET: range(1, 2),
}
_ANY_LENGTH = range(MAX_LENGTH + 1)


def _size_of(head: bytes) -> int:
    """Return a frame's size in bytes from its first four. :raises FrameError: cannot be one."""
    kind, length = head[2], head[3]
    if length not in _LENGTHS.get(kind, _ANY_LENGTH):
        raise FrameError(f'type 0x{kind:02X} cannot have {length} bytes')
    return HEAD_SIZE + length + CHECK_SIZE


def _has_good_check(frame: bytes) -> bool:
    """Tell whether the last two bytes are the sum of all before them."""
    return frame[-CHECK_SIZE:] == _CHECK.pack(fletcher16(frame[:-CHECK_SIZE]))


FORMAT = FrameFormat(
    header=HEADER,
    head_size=HEAD_SIZE,
    max_size=HEAD_SIZE + MAX_LENGTH + CHECK_SIZE,
    size_of=_size_of,
    check=_has_good_check,
)


def parser() -> StreamParser:
    """Return a parser for one direction of one link."""
    return StreamParser(FORMAT)


def payload_of(frame: bytes) -> bytes:
    """Return a whole frame's payload. :raises FrameError: if anything around it is wrong."""
    if len(frame) < HEAD_SIZE + CHECK_SIZE or not frame.startswith(HEADER):
        raise FrameError(f'not a frame: {frame[:HEAD_SIZE].hex()}')
    if len(frame) != _size_of(frame):
        raise FrameError(f'{len(frame)} bytes, but the length byte says {frame[3]}')
    if not _has_good_check(frame):
        raise FrameError(f'wrong checksum {frame[-CHECK_SIZE:].hex()}')
    return frame[HEAD_SIZE:-CHECK_SIZE]


def build_frame(kind: int, payload: bytes) -> bytes:
    """Return the whole frame around a payload."""
    body = HEADER + bytes((kind, len(payload))) + payload
    return body + _CHECK.pack(fletcher16(body))


_M = TypeVar('_M', bound='Message')


class Message:
    """What all messages share: the frame around the payload, and which fault is whose."""

    __slots__ = ()
    TYPE: ClassVar[MessageType]

    @classmethod
    def from_bytes(cls: type[_M], frame: bytes) -> _M:
        """Read a whole frame. :raises FrameError: if it is not a sound frame of this type."""
        payload = payload_of(frame)
        if frame[2] != cls.TYPE:
            raise FrameError(f'type 0x{frame[2]:02X} is not {cls.__name__}')
        return cls.from_payload(payload)

    @classmethod
    def from_payload(cls: type[_M], payload: bytes) -> _M:
        """Read a payload of this type's length. :raises FrameError: a value that cannot be."""
        try:
            return cls._from_payload(payload)
        except ValueError as error:  # a value that we must not send is the peer's fault here
            raise FrameError(f'{cls.__name__}: {error}') from error

    def to_bytes(self) -> bytes:
        """Return the whole frame."""
        return build_frame(self.TYPE, self.to_payload())

    def to_payload(self) -> bytes:
        """Return what the frame is around; CAN carries some of these without one."""
        return self._to_payload()

    @classmethod
    def _from_payload(cls: type[_M], payload: bytes) -> _M:
        raise NotImplementedError

    def _to_payload(self) -> bytes:
        raise NotImplementedError
