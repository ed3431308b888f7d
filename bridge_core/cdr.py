# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Messages of the topics that never rest as bytes: CDR, little endian, as middlewares carry them.

rclpy makes a message field by field, which takes longer than all that is done with it. What it
takes raw is read here into an object with the fields of its ROS type. Whatever looks unusual,
such as the other byte order, is left to rclpy.

payload          0, 1, 0, 0; then the fields, each aligned to its size from there on
string           uint32: bytes with the NUL behind it; these
array            uint32: items; these
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
import functools
import struct
from typing import Any, NamedTuple

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, UInt8MultiArray

_HEAD = b'\0\1\0\0'
_BOOLS = {False: _HEAD + bytes(4), True: _HEAD + b'\1\0\0\0'}
_STAMP = struct.Struct('<4xiII')  # with the length of the frame's name
_COUNT = struct.Struct('<I')
_FIELDS = ('position', 'velocity', 'effort')
_NO_LAYOUT = bytes(8)  # of a MultiArray: no dimensions, no offset


class _Stamp(NamedTuple):
    sec: int
    nanosec: int


class _Header(NamedTuple):
    stamp: _Stamp
    frame_id: str


class _Data(NamedTuple):
    data: Any


class _Joy(NamedTuple):
    header: _Header
    axes: Sequence[float]
    buttons: Sequence[int]


class _JointState(NamedTuple):
    header: _Header
    name: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]


@functools.cache
def fits() -> bool:
    """Tell whether the middleware in use has messages in this form."""
    # Not the bytes between the fields, nor those behind: they may be anything.
    return bool(serialize_message(Bool(data=True))[:5] == _BOOLS[True][:5])


def bool_message(value: bool) -> Any:
    """Return what to publish of a Bool."""
    return _BOOLS[value] if fits() else Bool(data=value)


def joint_state_writer(names: Sequence[str], field: str) -> Callable[[Any, Sequence[float]], Any]:
    """Return what makes, of a stamp and values for ``field``, what to publish of a JointState."""
    message = JointState(name=names)

    def write_message(stamp: Any, values: Sequence[float]) -> Any:
        message.header.stamp = stamp
        setattr(message, field, array('d', values))
        return message

    if not fits():
        return write_message
    texts = (name.encode() + b'\0' for name in ['', *names])
    frame, *rest = (_COUNT.pack(len(text)) + text + bytes(-len(text) % 4) for text in texts)
    size, none = _COUNT.pack(len(names)), _COUNT.pack(0)
    place = _FIELDS.index(field)
    before = b''.join((frame, size, *rest, none * place, size))
    before += bytes(-len(before) % 8)  # the stamp before it takes 8
    after = none * (len(_FIELDS) - 1 - place)
    layout = struct.Struct(f'<4siI{len(before)}s{len(names)}d{len(after)}s')

    def write(stamp: Any, values: Sequence[float]) -> bytes:
        return layout.pack(_HEAD, stamp.sec, stamp.nanosec, before, *values, after)

    return write


def reader_of(kind: Any) -> Callable[[bytes], Any] | None:
    """
    Return what reads raw messages of a type; None: take them as messages.

    It raises what rclpy does where they are malformed.
    """
    read = _READERS.get(kind)
    if read is None or not fits():
        return None

    def read_or_leave(data: bytes) -> Any:
        try:
            if data[:4] == _HEAD:
                return read(data)
        except (KeyError, ValueError, struct.error):
            pass
        return deserialize_message(data, kind)

    return read_or_leave


def _read_bool(data: bytes) -> Any:
    return _READ_BOOLS[data[4:5]]


def _read_bytes(data: bytes) -> _Data:
    (count,) = _COUNT.unpack_from(data, 12)
    if data[4:12] != _NO_LAYOUT or len(data) < 16 + count:
        raise ValueError
    return _Data(data[16 : 16 + count])


def _read_joy(data: bytes) -> _Joy:
    header, at = _read_header(data)
    axes, at = _read_array(data, at, 'f', 4)
    buttons, _ = _read_array(data, at, 'i', 4)
    return _Joy(header, axes, buttons)


def _read_joint_state(data: bytes) -> _JointState:
    header, at = _read_header(data)
    (count,) = _COUNT.unpack_from(data, at)
    at += 4
    names = []
    for _ in range(count):  # ends at the end of the data, whatever the count
        (size,) = _COUNT.unpack_from(data, at)
        name, at = _read_string(data, at + 4, size)
        names.append(name)
    position, at = _read_array(data, at, 'd', 8)
    velocity, at = _read_array(data, at, 'd', 8)
    effort, _ = _read_array(data, at, 'd', 8)
    return _JointState(header, names, position, velocity, effort)


def _read_header(data: bytes) -> tuple[_Header, int]:
    sec, nanosec, size = _STAMP.unpack_from(data)
    frame_id, at = _read_string(data, _STAMP.size, size)
    return _Header(_Stamp(sec, nanosec), frame_id), at


def _read_string(data: bytes, at: int, size: int) -> tuple[str, int]:
    """Return it, and where a count behind it is. :param size: with the NUL; 0 is empty, too."""
    end = at + size
    text, nul, rest = data[at:end].partition(b'\0')
    if rest or len(text) + len(nul) != size:
        raise ValueError
    return text.decode(), (end + 3) & ~3


def _read_array(data: bytes, at: int, code: str, size: int) -> tuple[tuple[Any, ...], int]:
    """Return the items of an array, of ``size`` bytes each, and where it ends."""
    (count,) = _COUNT.unpack_from(data, at)
    at += 4
    if count and size == 8:
        at += (4 - at) % 8  # counted from behind the head
    end = at + count * size
    if end > len(data):
        raise ValueError
    return struct.unpack_from(f'<{count}{code}', data, at), end


_READ_BOOLS = {b'\0': _Data(False), b'\1': _Data(True)}
_READERS: dict[Any, Callable[[bytes], Any]] = {
    Bool: _read_bool,
    Joy: _read_joy,
    JointState: _read_joint_state,
    UInt8MultiArray: _read_bytes,
}
