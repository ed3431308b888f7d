# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VSC's DBC file and our codec, each as a second opinion on the other, signal by signal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cantools
from hypothesis import given, strategies as st
import pytest

from bridge_core.framing import FrameError
from fort_vsc_bridge.protocol.can import (
    BasicJoystick,
    CanIds,
    decode_data,
    encode_frame,
    ExtendedJoystick,
    StringSegment,
)
from fort_vsc_bridge.protocol.messages import Heartbeat, RemoteStatus, UserFeedback
from fort_vsc_bridge.protocol.values import Axis, Button, InputState, Key, Mode, mode_name

DBC = Path(__file__).resolve().parents[2] / 'dbc' / 'fort_vsc.dbc'
DATABASE: Any = cantools.database.load_file(DBC, strict=True)
NAMES = {  # ours to the file's
    'left_basic': 'LeftBasic',
    'left_extended': 'LeftExtended',
    'right_basic': 'RightBasic',
    'right_extended': 'RightExtended',
    'heartbeat': 'Heartbeat',
    'remote_status': 'RemoteStatus',
    'feedback_value': 'FeedbackValue',
    'feedback_string': 'FeedbackString',
}
PAD = ('Down', 'Right', 'Up', 'Left')
STATUS = {0: 'not set', 1: 'set', 2: 'error', 3: 'unavailable'}  # tables 46 and 48
Signals = dict[str, int]


def signals_of(name: str, data: bytes) -> Signals:
    """Return what the file makes of the data."""
    message = DATABASE.get_message_by_name(NAMES[name])
    signals: Signals = message.decode(data, decode_choices=False, scaling=False)
    return signals


# The file's signals to what our codec should say: the tables once more, in other words.


def axis_of(signals: Signals, name: str) -> Axis:
    directions = [STATUS[signals[name + way]] for way in ('Neutral', 'Negative', 'Positive')]
    if 'error' in directions:
        return Axis(None, InputState.ERROR)
    if 'unavailable' in directions:
        return Axis(None, InputState.UNAVAILABLE)
    if directions.count('set') != 1:
        return Axis(None, InputState.ERROR)
    sign = (0, -1, 1)[directions.index('set')]
    return Axis(sign * signals[f'{name}Magnitude'])


def button_of(status: int) -> Button:
    states = {'error': InputState.ERROR, 'unavailable': InputState.UNAVAILABLE}
    word = STATUS[status]
    return Button(None, states[word]) if word in states else Button(word == 'set')


def is_foreign(name: str, data: bytes) -> bool:
    """Tell whether bytes that a VSC sends as FF (tables 35 to 38) are something else."""
    unused = data[4:5] + data[6:] if name.endswith('_basic') else data[2:]
    return name.endswith(('_basic', '_extended')) and any(data) and set(unused) != {0xFF}


def basic_of(signals: Signals, side: str) -> BasicJoystick:
    buttons = tuple(button_of(signals[f'{side}Pad{name}']) for name in PAD)
    return BasicJoystick(axis_of(signals, f'{side}X'), axis_of(signals, f'{side}Y'), buttons)


def message_of(name: str, signals: Signals) -> Any:
    """Return the message that our codec should read; None where it should refuse."""
    side = name.split('_')[0].capitalize()
    if name.endswith('_basic'):
        return basic_of(signals, side)
    if name.endswith('_extended'):
        return ExtendedJoystick(axis_of(signals, f'{side}Z'))
    if name == 'heartbeat':
        return Heartbeat(signals['VscMode'], signals['AutonomyMode'], signals['EStopIndication'])
    if name == 'remote_status':
        return remote_status_of(signals)
    if name == 'feedback_value':
        key = signals['ValueKey']
        return UserFeedback(key, signals['Value']) if key <= 99 else None
    return segment_of(signals)


def remote_status_of(signals: Signals) -> RemoteStatus | None:
    level = signals['BatteryLevel']
    if 100 < level < 255:
        return None
    return RemoteStatus(
        None if level == 255 else level,
        signals['BatteryCharging'] > 0,
        signals['StrengthAtVsc'],
        signals['StrengthAtSrc'],
        bytes((signals['Reserved4'], signals['Reserved5'])),
    )


def segment_of(signals: Signals) -> StringSegment | None:
    codes = bytes(signals[f'Character{number}'] for number in range(1, 7)).rstrip(b'\0')
    printable = all(0x20 <= code < 0x7F for code in codes)
    if not printable or signals['StringKey'] > 99 or signals['Segment'] > 2:
        return None
    return StringSegment(signals['StringKey'], signals['Segment'], codes.decode())


def test_file_has_every_message_and_its_size_and_no_other() -> None:
    by_name = {message.name: message for message in DATABASE.messages}
    assert set(by_name) == set(NAMES.values())
    for name, identifier in CanIds().by_name.items():
        message = by_name[NAMES[name]]
        assert message.frame_id == identifier
        assert message.is_extended_frame
    sizes = {name: by_name[NAMES[name]].length for name in NAMES}
    short = {'heartbeat': 6, 'feedback_value': 5}
    assert sizes == {**dict.fromkeys(NAMES, 8), **short}


def test_modes_and_keys_have_our_names() -> None:
    def choices(name: str, signal: str) -> dict[int, str]:
        message = DATABASE.get_message_by_name(NAMES[name])
        return {
            number: str(word)
            for number, word in message.get_signal_by_name(signal).choices.items()
        }

    assert choices('heartbeat', 'VscMode') == {int(m): mode_name(m) for m in Mode}
    keys = choices('feedback_value', 'ValueKey') | choices('feedback_string', 'StringKey')
    assert set(keys) == {int(key) for key in Key} - {Key.USER_ESTOP_TIMEOUT}


WORDS = st.binary(min_size=8, max_size=8)
DATA = st.one_of(  # any, and with FF where the joystick frames have it
    WORDS,
    WORDS.map(lambda data: data[:4] + b'\xff' + data[5:6] + b'\xff\xff'),
    WORDS.map(lambda data: data[:2] + b'\xff' * 6),
)


@pytest.mark.parametrize('name', NAMES)
@given(data=DATA)
def test_codec_reads_any_data_as_the_file_does(name: str, data: bytes) -> None:
    data = data[: DATABASE.get_message_by_name(NAMES[name]).length]
    expected = None if is_foreign(name, data) else message_of(name, signals_of(name, data))
    if expected is None:
        with pytest.raises(FrameError):
            decode_data(name, data)
    else:
        assert decode_data(name, data) == expected


AXES = st.builds(Axis, st.integers(-1023, 1023)) | st.sampled_from(
    [Axis(None, InputState.ERROR), Axis(None, InputState.UNAVAILABLE)]
)
PADS = st.tuples(*[st.integers(0, 3).map(button_of)] * 4)
BYTE = st.integers(0, 255)
TEXT = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=6)
MESSAGES: dict[str, st.SearchStrategy[Any]] = {
    'left_basic': st.builds(BasicJoystick, AXES, AXES, PADS),
    'left_extended': st.builds(ExtendedJoystick, AXES),
    'right_basic': st.builds(BasicJoystick, AXES, AXES, PADS),
    'right_extended': st.builds(ExtendedJoystick, AXES),
    'heartbeat': st.builds(Heartbeat, BYTE, BYTE, st.integers(0, 0xFFFFFFFF)),
    'remote_status': st.builds(
        RemoteStatus,
        st.integers(0, 100) | st.none(),
        st.booleans(),
        BYTE,
        BYTE,
        st.binary(min_size=2, max_size=2),
    ),
    'feedback_value': st.builds(
        UserFeedback, st.integers(0, 99), st.integers(-(1 << 31), (1 << 31) - 1)
    ),
    'feedback_string': st.builds(StringSegment, st.integers(0, 99), st.integers(0, 2), TEXT),
}


@pytest.mark.parametrize('name', NAMES)
@given(data=st.data())
def test_file_reads_and_writes_what_the_codec_writes(name: str, data: st.DataObject) -> None:
    message = data.draw(MESSAGES[name])
    frame = encode_frame(name, message, CanIds())
    signals = signals_of(name, frame.data)
    assert message_of(name, signals) == message
    definition = DATABASE.get_message_by_name(NAMES[name])
    again = definition.encode(signals, padding=True, scaling=False, strict=False)
    assert again == frame.data  # unused bytes are FF in both
