# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages as bytes are those of rclpy, whatever they say; what is damaged is left to it."""

from collections.abc import Iterator
from typing import Any

from builtin_interfaces.msg import Time
from hypothesis import given, settings, strategies as st
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Header, MultiArrayDimension, UInt8MultiArray

from bridge_core import cdr
from bridge_core.cdr import bool_message, joint_state_writer, reader_of

KINDS = (Bool, Joy, JointState, UInt8MultiArray)
FLOATS = st.lists(st.floats(width=32), max_size=9)
DOUBLES = st.lists(st.floats(), max_size=9)
TEXTS = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=9)
INTEGERS = st.integers(-(1 << 31), (1 << 31) - 1)
TIMES = st.builds(Time, sec=INTEGERS, nanosec=st.integers(0, (1 << 32) - 1))
HEADERS = st.builds(Header, stamp=TIMES, frame_id=TEXTS)
JOINTS: Any = {'name': st.lists(TEXTS, max_size=4), **dict.fromkeys(cdr._FIELDS, DOUBLES)}
MESSAGES = st.one_of(
    st.builds(Bool, data=st.booleans()),
    st.builds(Joy, header=HEADERS, axes=FLOATS, buttons=st.lists(INTEGERS, max_size=9)),
    st.builds(JointState, header=HEADERS, **JOINTS),
    st.builds(UInt8MultiArray, data=st.binary(max_size=99)),
)


def plain(message: Any) -> Any:
    """Return a message, or what has its fields, as lists; NaN, as text, equals itself."""
    if isinstance(message, bool | int | float | str):
        return repr(message)
    if hasattr(message, 'sec'):
        return message.sec, message.nanosec
    names = ('header', 'stamp', 'frame_id', 'data', 'axes', 'buttons', 'name', *cdr._FIELDS)
    found = [plain(getattr(message, name)) for name in names if hasattr(message, name)]
    return found or [plain(each) for each in message]


def reads(kind: Any, data: bytes) -> Any:
    read = reader_of(kind)
    assert read is not None
    return read(data)


@given(MESSAGES)
def test_read_message_has_the_fields_that_rclpy_gives(message: Any) -> None:
    data = serialize_message(message)
    found = reads(type(message), data)
    assert not isinstance(found, type(message)), 'rclpy was asked'
    assert plain(found) == plain(deserialize_message(data, type(message)))


def damaged(data: bytes) -> Iterator[bytes]:
    yield from (data[:size] for size in range(len(data)))
    for at in range(4, len(data)):
        yield data[:at] + b'\xff' + data[at + 1 :]


@settings(max_examples=20)
@given(MESSAGES)
def test_damaged_message_is_what_rclpy_says_or_none(message: Any) -> None:
    kind = type(message)
    for data in damaged(serialize_message(message)):
        try:
            wanted = plain(deserialize_message(data, kind))
        except Exception:
            with pytest.raises(Exception):  # noqa: B017, PT011 - whatever rclpy has
                reads(kind, data)
        else:
            assert plain(reads(kind, data)) == wanted


def test_array_with_dimensions_and_the_other_byte_order_are_left_to_rclpy() -> None:
    message = UInt8MultiArray(data=b'abc')
    message.layout.dim = [MultiArrayDimension(label='x', size=3, stride=3)]
    assert reads(UInt8MultiArray, serialize_message(message)) == message
    big_endian = b'\0\0\0\0' + (5).to_bytes(4, 'big') + bytes(4) + b'\0\0\0\1' + bytes(16)
    assert reads(Joy, big_endian).header.stamp.sec == 5


@given(st.lists(TEXTS, min_size=1, max_size=5), st.sampled_from(cdr._FIELDS), st.data())
def test_written_joints_are_what_rclpy_would_write(names: Any, field: str, data: Any) -> None:
    size = len(names)
    values = data.draw(st.lists(st.floats(), min_size=size, max_size=size))
    stamp = Time(sec=-7, nanosec=999_999_999)
    message = JointState(header=Header(stamp=stamp), name=names, **{field: values})
    written = joint_state_writer(names, field)(stamp, values)
    assert isinstance(written, bytes)
    assert plain(deserialize_message(written, JointState)) == plain(message)


@pytest.mark.parametrize('value', [False, True])
def test_written_bool_is_what_rclpy_would_write(value: bool) -> None:
    written = bool_message(value)
    assert isinstance(written, bytes)
    assert deserialize_message(written, Bool) == Bool(data=value)


def test_messages_of_another_form_stay_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cdr, 'fits', lambda: False)
    assert [reader_of(kind) for kind in KINDS] == [None] * 4
    assert reader_of(Time) is None
    assert bool_message(True) == Bool(data=True)
    written = joint_state_writer(['left'], 'velocity')(Time(sec=3), (1.5,))
    assert written == JointState(header=Header(stamp=Time(sec=3)), name=['left'], velocity=[1.5])
