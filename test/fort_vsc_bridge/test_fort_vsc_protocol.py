# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VSC's frames: golden bytes, and every way in which a line can spoil them."""

import json
from typing import Any

from hypothesis import example, given, settings, strategies as st
import pytest

from bridge_core.framing import FrameError, StreamParser, Unknown
from fort_vsc_bridge.protocol import decode, parser as make_parser
from fort_vsc_bridge.protocol.frames import BAUD, Message, PACKETS, Rejected
from fort_vsc_bridge.protocol.messages import (
    Gps,
    Heartbeat,
    HostHeartbeat,
    Joystick,
    MessageControl,
    RemoteStatus,
    UserFeedback,
    UserFeedbackGet,
    UserFeedbackName,
)
from fort_vsc_bridge.protocol.serial import SerialDecoder
from fort_vsc_bridge.protocol.values import (
    AutonomyMode,
    AXES,
    Axis,
    Button,
    BUTTON_NAMES,
    estop_sources,
    InputState,
    Key,
    Mode,
    PERSISTENT_KEYS,
    VALUE_RANGES,
)
from fort_vsc_bridge.simulator import build_frame  # the manual's own loop, not our codec
from stage.parser_rig import frames_of
from stage.rig import ROOT

VECTORS = json.loads((ROOT / 'test' / 'vectors' / 'fort_vsc.json').read_text())['serial']
GOLDEN = [bytes.fromhex(vector['hex']) for vector in VECTORS]
# A stream with every type: the golden frames, and payloads written out from 7.3.
STREAM = [
    *GOLDEN,
    build_frame(
        0x12, b'\x01$GPGGA,092750.00,5321.68,N,00630.33,W,1,8,1.03,61.7,M,55.2,M,,*76\r\n'
    ),
    build_frame(0x31, b'\x5aHELLO' + bytes(15)),
    build_frame(0x32, b'\x51'),
    build_frame(0x40, b'\x10\x01\x20'),
    build_frame(0x25, b''),
    GOLDEN[0],
]


UNKNOWN = (0x40, 0x25)


def known(frames: list[bytes]) -> list[bytes]:
    """Leave out what is counted and not handed out."""
    return [frame for frame in frames if frame[2] not in UNKNOWN]


def message_of(vector: dict[str, Any]) -> Message:
    """Build the message that a vector describes in words."""
    kind = vector['is']
    if kind == 'heartbeat':
        mode = Mode[vector['mode'].upper()]
        return Heartbeat(mode, AutonomyMode.USER_CONTROL, vector['estop'])
    if kind == 'joystick':
        on = {name.replace(' pad ', '_') for name in vector['buttons_on']}
        buttons = tuple(Button(name in on) for name in BUTTON_NAMES)
        return Joystick(tuple(map(Axis, vector['axes'])), buttons)
    if kind == 'remote status':
        strength = vector['strength']
        return RemoteStatus(vector['battery_percent'], vector['charging'], strength, strength)
    if kind == 'user feedback':
        return UserFeedback(vector['key'], vector['value'])
    if kind == 'host heartbeat':
        return HostHeartbeat(vector['estop'])
    assert kind == 'message control'
    return MessageControl(vector['message'], vector['enabled'], vector['interval_ms'])


@pytest.mark.parametrize('vector', VECTORS, ids=lambda vector: str(vector['is']))
def test_golden_frames_both_ways(vector: dict[str, Any]) -> None:
    frame = bytes.fromhex(vector['hex'])
    assert decode(frame) == message_of(vector)
    assert message_of(vector).to_bytes() == frame


@pytest.mark.parametrize('frame', GOLDEN, ids=bytes.hex)
def test_the_manuals_checksum_loop_agrees(frame: bytes) -> None:
    assert build_frame(frame[2], frame[4:-2]) == frame


@pytest.mark.parametrize(
    ('message', 'frame'),
    [
        (Gps(1, '$GP'), build_frame(0x12, b'\x01$GP')),
        (UserFeedbackName(90, 'HELLO'), build_frame(0x31, b'\x5aHELLO' + bytes(15))),
        (UserFeedbackName(1, 'x' * 20), build_frame(0x31, b'\x01' + b'x' * 20)),
        *((UserFeedback(key, 0), build_frame(0x30, bytes((key, 0, 0, 0, 0)))) for key in (0, 99)),
        *(
            (UserFeedbackName(key, ''), build_frame(0x31, bytes((key,)) + bytes(20)))
            for key in (0, 99)
        ),
        *((UserFeedbackGet(key), build_frame(0x32, bytes((key,)))) for key in (0, 85, 99)),
        (HostHeartbeat(True), build_frame(0x21, b'\x01')),
        (Heartbeat(0x33, 7, 0x80000000), build_frame(0x20, b'\x33\x07\x00\x00\x00\x80')),
        (RemoteStatus(None, False, 2, 2), build_frame(0x22, b'\xff\0\x02\x02\0\0')),
        (RemoteStatus(10, False, 2, 1, b'\xc4\xb0'), build_frame(0x22, b'\n\0\x02\x01\xc4\xb0')),
    ],
)
def test_layouts_of_7_3_both_ways(message: Message, frame: bytes) -> None:
    assert message.to_bytes() == frame
    assert decode(frame) == message


def test_frames_beside_the_layouts() -> None:
    rest = Joystick.from_payload(bytes.fromhex('0100' * 6 + '0000'))
    assert rest == Joystick()
    assert not any(Joystick(zeroed=True).to_bytes()[4:18])
    assert decode(build_frame(0x40, b'abc')) == Unknown(0x40)
    assert decode(build_frame(0x21, b'\x80')) == HostHeartbeat(True)  # as any above 0
    with pytest.raises(FrameError):
        RemoteStatus.from_bytes(GOLDEN[0])


# -- sticks and buttons ---------------------------------------------------------------------------

ERROR = Axis(None, InputState.ERROR)
UNAVAILABLE = Axis(None, InputState.UNAVAILABLE)


@pytest.mark.parametrize(
    ('axis', 'ours', 'others'),
    [
        (Axis(0), 0x0001, [0xFFC1]),  # neutral wins over a magnitude without a sign
        (Axis(1), 0x0050, []),
        (Axis(-1), 0x0044, []),
        (Axis(1023), 0xFFD0, []),
        (Axis(-296), 0x4A04, []),
        # No direction, two of them, and error beside unavailable.
        (ERROR, 0x002A, [0x0000, 0xFFC0, 0x0005, 0x0014, 0x0015, 0x0002, 0x0019, 0x0032]),
        (UNAVAILABLE, 0xFFFF, [0x0003, 0x0031]),
    ],
)
def test_axis_words_of_table_30(axis: Axis, ours: int, others: list[int]) -> None:
    assert axis.to_word() == ours
    assert {AXES[word] for word in (ours, *others)} == {axis}


def test_buttons_keep_error_and_unavailable_apart_from_released() -> None:
    joystick = decode(build_frame(0x10, b'\x01\x00' * 6 + b'\b\x30'))
    assert isinstance(joystick, Joystick)
    expected = {
        'left_right': Button(None, InputState.ERROR),
        'right_up': Button(None, InputState.UNAVAILABLE),
    }
    for name, button in zip(BUTTON_NAMES, joystick.buttons, strict=True):
        assert button == expected.get(name, Button(False))


def test_unknown_mode_is_never_operational() -> None:
    for value in set(range(256)) - set(Mode):
        heartbeat = decode(build_frame(0x20, bytes((value, 0, 0, 0, 0, 0))))
        assert isinstance(heartbeat, Heartbeat)
        assert heartbeat.mode != Mode.OPERATIONAL
        assert not isinstance(heartbeat.mode, Mode)


# -- bad values of ours and of the peer -----------------------------------------------------------


@pytest.mark.parametrize(
    'make',
    [
        lambda: UserFeedback(100, 0),
        lambda: UserFeedback(-1, 0),
        lambda: UserFeedback(1, 2**31),
        lambda: UserFeedback(1, -(2**31) - 1),
        lambda: UserFeedback(1, 1.5),  # type: ignore[arg-type]
        lambda: UserFeedbackGet(100),
        lambda: UserFeedbackName(100, 'x'),
        lambda: UserFeedbackName(1, 'x' * 21),
        lambda: UserFeedbackName(1, 'naïve'),
        lambda: UserFeedbackName(1, 'a\0b'),
        lambda: UserFeedbackName(1, 'a\n'),
        lambda: MessageControl(0x22, True, 19),
        lambda: MessageControl(0x22, True, 65536),
        lambda: MessageControl(256, True, 20),
        lambda: Axis(1024),
        lambda: Axis(None),
        lambda: Axis(3, InputState.ERROR),
        lambda: Button(None),
    ],
)
def test_own_bad_value_is_refused_when_made(make: Any) -> None:
    with pytest.raises(ValueError, match=r'.') as caught:
        make()
    assert not isinstance(caught.value, FrameError)


@pytest.mark.parametrize(
    'frame',
    [
        b'',
        b'\x10',
        b'\x10\x01\x20',
        b'\x11' + GOLDEN[0][1:],
        GOLDEN[0][:-1],
        GOLDEN[0] + b'\0',
        GOLDEN[0][:-1] + b'\0',
        build_frame(0x20, bytes(5)),
        build_frame(0x12, b''),
        build_frame(0x12, b'\0\xff'),
        build_frame(0x22, bytes((101, 0, 0, 0, 0, 0))),
        build_frame(0x23, b'\x22\x01\x13\x00'),
        build_frame(0x30, b'\x64' + bytes(4)),
        build_frame(0x31, b'\x01a\xff' + bytes(18)),
        build_frame(0x31, b'\x01a\0b' + bytes(17)),
        build_frame(0x32, b'\x64'),
    ],
    ids=bytes.hex,
)
def test_unsound_frame_is_the_peers_fault(frame: bytes) -> None:
    with pytest.raises(FrameError):
        decode(frame)


PAYLOADS = {0x10: 14, 0x12: 30, 0x20: 6, 0x21: 1, 0x22: 6, 0x23: 4, 0x30: 5, 0x31: 21, 0x32: 1}
CONTENTS = st.binary(min_size=30, max_size=30) | st.text(
    st.characters(min_codepoint=32, max_codepoint=126), max_size=21
).map(lambda text: text.encode().ljust(30, b'\0'))


@settings(max_examples=500)
@given(st.sampled_from([*PAYLOADS]), CONTENTS)
def test_round_trip(kind: int, contents: bytes) -> None:
    try:
        message: Any = decode(build_frame(kind, contents[: PAYLOADS[kind]]))
    except FrameError:
        return
    assert decode(message.to_bytes()) == message


def test_round_trip_of_every_axis_and_button() -> None:
    assert all(AXES[axis.to_word()] == axis for axis in AXES)
    for status in range(256):
        joystick = decode(build_frame(0x10, b'\x01\0' * 6 + bytes((status, 255 - status))))
        assert isinstance(joystick, Joystick)
        assert decode(joystick.to_bytes()) == joystick


@given(st.binary(max_size=60) | st.binary(max_size=40).map(lambda data: b'\x10\x01' + data))
def test_any_bytes_decode_or_raise_frame_error(data: bytes) -> None:
    try:
        decode(data)
    except FrameError:
        return
    assert build_frame(data[2], data[4:-2]) == data


# -- the parser -----------------------------------------------------------------------------------


def drain(parser: StreamParser[bytes], now: float) -> list[bytes]:
    """Let time pass until nothing is pending."""
    frames = []
    while parser.deadline <= (now := now + 0.1):
        frames += parser.poll(now)
    return frames


def parse(data: bytes) -> list[bytes]:
    parser = frames_of(make_parser())
    return parser.feed(data, 0.0) + drain(parser, 0.0)


def test_whole() -> None:
    assert parse(b''.join(STREAM)) == known(STREAM)


@given(st.lists(st.binary(max_size=30), min_size=len(STREAM), max_size=len(STREAM)))
@example([b'\x10'] * len(STREAM))
@example([b'\x10\x01'] * len(STREAM))
@example([b'\x10\x01\x12\xf8'] * len(STREAM))
@settings(max_examples=50)
def test_garbage_before_and_between(garbage: list[bytes]) -> None:
    data = b''.join(noise + frame for noise, frame in zip(garbage, STREAM, strict=True))
    assert [f for f in parse(data) if f in STREAM] == known(STREAM)


def test_corrupt_length_keeps_next_frame() -> None:
    for frame in STREAM:
        for length in set(range(256)) - {frame[3]}:
            corrupt = frame[:3] + bytes((length,)) + frame[4:]
            assert parse(corrupt + GOLDEN[0])[-1:] == [GOLDEN[0]], (frame.hex(), length)


def test_one_flipped_bit_loses_at_most_its_own_frame() -> None:
    data = b''.join(STREAM)
    start = 0
    for number, frame in enumerate(STREAM):
        others = known(STREAM[:number] + STREAM[number + 1 :])
        for bit in range(8 * len(frame)):
            corrupt = bytearray(data)
            corrupt[start + bit // 8] ^= 1 << bit % 8
            assert parse(bytes(corrupt)) == others, (frame.hex(), bit)
        start += len(frame)


# -- words, and what is refused -------------------------------------------------------------------


@pytest.mark.parametrize(
    ('bits', 'words'),
    [
        (0, []),
        (0x45, ['SRC (remote)', 'VSC (wired input)', 'USER (this computer)']),
        (0x41, ['SRC (remote)', 'USER (this computer)']),
        (0x80000010, ['unknown source (bits 0x80000010)']),
        (0x14, ['VSC (wired input)', 'unknown source (bits 0x10)']),
    ],
)
def test_sources_of_a_stop_in_words(bits: int, words: list[str]) -> None:
    assert estop_sources(bits) == words


# -- sound frames of another length ---------------------------------------------------------------

OTHER = build_frame(0x20, bytes(8))  # a heartbeat has 6 bytes


def rejected(decoder: SerialDecoder, data: bytes) -> list[Rejected]:
    return [each for each in decoder.feed(data, 1.0) if isinstance(each, Rejected)]


@pytest.mark.parametrize('length', [0, 8, 248])
def test_sound_frame_of_another_length_is_named_as_soon_as_it_is_whole(length: int) -> None:
    decoder, other = SerialDecoder(), build_frame(0x20, bytes(length))
    assert rejected(decoder, other[:-1]) == []
    (found,) = rejected(decoder, other[-1:])
    assert f'its heartbeat message has {length} bytes, not 6' in found.text
    (again,) = rejected(decoder, GOLDEN[0] + other)
    assert again == found


@pytest.mark.parametrize('head', [b'\x20\xf9', b'\x60\xf0', b'\x20\x06'])
def test_it_does_not_wait_for_the_body_of_a_head_that_cannot_be(head: bytes) -> None:
    """Too long for any type, of an unknown type, or as long as that type is."""
    decoder = SerialDecoder()
    assert len(rejected(decoder, PACKETS.header + head + OTHER)) == 1


@pytest.mark.parametrize('cut', range(1, len(OTHER)))
def test_its_first_half_is_forgotten_with_the_port(cut: int) -> None:
    decoder = SerialDecoder()
    decoder.feed(OTHER[:cut], 1.0)
    decoder.reset()
    assert rejected(decoder, OTHER[cut:]) == []


def test_modes_and_keys_have_the_manuals_numbers() -> None:
    assert BAUD == 115200
    # Tables 12, 19, 24, 27 and 29; modes 0 and 1 as seen on devices, 2, 3, 5, 7, 8 in a decoder.
    assert [*map(int, Mode)] == [*range(12)]
    assert [*map(int, AutonomyMode)] == [0, 1, 2]
    assert [*map(int, Key)] == [*range(1, 13), *range(80, 86), *range(90, 94), 99]


def test_values_that_may_be_set_are_those_of_table_24() -> None:
    whole, switch = (-(2**31), 2**31 - 1), (0, 1)
    assert {
        **dict.fromkeys(range(1, 10), whole),
        **dict.fromkeys((10, 11, 12, 81, 82, 83, 84, 85), switch),
        80: (0, 10),
        99: (0, 3),
    } == VALUE_RANGES
    assert [*PERSISTENT_KEYS] == [80, 81, 82, 83, 84, 85]


@pytest.mark.parametrize('length', [1, 2, 247, 248])
def test_position_is_as_long_as_the_longest_payload_at_most(length: int) -> None:
    (message,) = SerialDecoder().feed(build_frame(0x12, b'$' * length), 1.0)
    assert isinstance(message, Gps)
