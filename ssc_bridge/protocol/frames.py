"""The frame around every payload: mBin, manual section 4.1."""

from __future__ import annotations

from enum import IntEnum
import struct
from typing import ClassVar
from typing import TypeVar

from bridge_core.checksums import fletcher16
from bridge_core.framing import FrameError
from bridge_core.framing import FrameFormat
from bridge_core.framing import StreamParser
from ssc_bridge.protocol.values import AUX_CHANNELS
from ssc_bridge.protocol.values import MAX_INPUTS
from ssc_bridge.protocol.values import PULSE_CHANNELS

HEADER = b'\x81\xa1'
HEAD_SIZE = 4  # header, ID, COUNT
CHECK_SIZE = 2
OVERHEAD = HEAD_SIZE + CHECK_SIZE  # bytes of a frame beside its payload
MAX_LENGTH = 255  # largest payload in bytes, known or unknown ID
BAUD = 115200  # fixed (3.4), 8N1
BITS_PER_BYTE = 10

_CHECK = struct.Struct('<H')  # plain sum, then sum of sums


class MessageType(IntEnum):
    """The message ID (4.2)."""

    STATUS = 10
    CHANNEL_SOURCE = 11
    PULSE_OUTPUTS = 12
    PULSE_INPUTS = 13
    AUX_INPUTS = 14
    CONFIGURATION = 15
    PULSE_COMMAND = 20
    AUX_OUTPUTS = 21
    LOCKOUT = 98


# The device's own messages; without a payload each is a poll for itself (4.2.1).
POLLED = tuple(kind for kind in MessageType if kind <= MessageType.CONFIGURATION)

_PULSES = range(2, 2 * PULSE_CHANNELS + 1, 2)
_AUX = range(2, 2 + 2 * AUX_CHANNELS + 1, 2)
_LENGTHS: dict[int, tuple[int, ...]] = {  # bytes of payload
    MessageType.STATUS: (0, 2),
    MessageType.CHANNEL_SOURCE: tuple(range(PULSE_CHANNELS + 1)),
    MessageType.PULSE_OUTPUTS: (0, *_PULSES),
    MessageType.PULSE_INPUTS: (0, *_PULSES[:MAX_INPUTS]),
    MessageType.AUX_INPUTS: (0, *_AUX),
    MessageType.CONFIGURATION: (0, 14),
    MessageType.PULSE_COMMAND: (*_PULSES,),
    MessageType.AUX_OUTPUTS: (*_AUX,),
    MessageType.LOCKOUT: (0,),
}
_ANY_LENGTH = range(MAX_LENGTH + 1)


def _size_of(head: bytes) -> int:
    """Return a frame's size in bytes from its first four. :raises FrameError: cannot be one."""
    kind, count = head[2], head[3]
    if count not in _LENGTHS.get(kind, _ANY_LENGTH):
        raise FrameError(f'message {kind} cannot have {count} bytes')
    return count + OVERHEAD


def _has_good_check(frame: bytes) -> bool:
    """Tell whether the last two bytes are the sums over ID, COUNT and payload."""
    sums = fletcher16(frame[len(HEADER) : -CHECK_SIZE])
    return frame[-CHECK_SIZE:] == _CHECK.pack(sums)


FORMAT = FrameFormat(
    header=HEADER,
    head_size=HEAD_SIZE,
    max_size=MAX_LENGTH + OVERHEAD,
    size_of=_size_of,
    check=_has_good_check,
)


def parser() -> StreamParser:
    """Return a parser for one direction of one link."""
    return StreamParser(FORMAT)


def payload_of(frame: bytes) -> bytes:
    """Return a whole frame's payload. :raises FrameError: if anything around it is wrong."""
    if len(frame) < OVERHEAD or not frame.startswith(HEADER):
        raise FrameError(f'not a frame: {frame[:HEAD_SIZE].hex()}')
    if len(frame) != _size_of(frame):
        raise FrameError(f'{len(frame)} bytes, but COUNT says {frame[3]}')
    if not _has_good_check(frame):
        raise FrameError(f'wrong checksum {frame[-CHECK_SIZE:].hex()}')
    return frame[HEAD_SIZE:-CHECK_SIZE]


def build_frame(kind: int, payload: bytes) -> bytes:
    """Return the whole frame around a payload."""
    body = bytes((kind, len(payload))) + payload
    return HEADER + body + _CHECK.pack(fletcher16(body))


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
            raise FrameError(f'message {frame[2]} is not {cls.__name__}')
        try:
            return cls._from_payload(payload)
        except (ValueError, struct.error) as error:
            # A value that we must not send is the peer's fault here.
            raise FrameError(f'{cls.__name__}: {error}') from error

    def to_bytes(self) -> bytes:
        """Return the whole frame."""
        return build_frame(self.TYPE, self._to_payload())

    @classmethod
    def _from_payload(cls: type[_M], payload: bytes) -> _M:
        raise NotImplementedError

    def _to_payload(self) -> bytes:
        raise NotImplementedError
