"""The frame around every payload: mBin, manual section 4.1."""

from __future__ import annotations

from enum import IntEnum
import struct

from bridge_core.checksums import fletcher16
from bridge_core.framing import ChecksumError
from bridge_core.framing import FrameError
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
REPEATED = POLLED[:-1]  # they may come by themselves, at a rate; the configuration never does

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


def size_of(head: bytes) -> int:
    """Return a frame's size in bytes from its first four. :raises FrameError: cannot be one."""
    kind, count = head[2], head[3]
    if count not in _LENGTHS.get(kind, _ANY_LENGTH):
        raise FrameError(f'message {kind} cannot have {count} bytes')
    return count + OVERHEAD


def payload_of(frame: bytes) -> bytes:
    """Return a whole frame's payload. :raises FrameError: if anything around it is wrong."""
    if len(frame) < OVERHEAD or not frame.startswith(HEADER):
        raise FrameError(f'not a frame: {frame[:HEAD_SIZE].hex()}')
    if len(frame) != size_of(frame):
        raise FrameError(f'{len(frame)} bytes, but COUNT says {frame[3]}')
    if frame[-CHECK_SIZE:] != _check_of(frame[len(HEADER) : -CHECK_SIZE]):
        raise ChecksumError(f'wrong checksum {frame[-CHECK_SIZE:].hex()}')
    return frame[HEAD_SIZE:-CHECK_SIZE]


def build_frame(kind: int, payload: bytes) -> bytes:
    """Return the whole frame around a payload."""
    body = bytes((kind, len(payload))) + payload
    return HEADER + body + _check_of(body)


def _check_of(body: bytes) -> bytes:
    """Return the sums over ID, COUNT and payload."""
    return _CHECK.pack(fletcher16(body))
