# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an Akron Brass message cannot be, and each bit of those that can."""

from __future__ import annotations

import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from akron_can_bridge import protocol
from akron_can_bridge.protocol import (
    AddressAnnouncement,
    AsciiPipe,
    AsciiPipeAcknowledgement,
    Axis,
    BasicJoystick,
    ConfigVersion,
    DiagnosticData,
    DigitalOutputs,
    ElevationSoftLimits,
    ExtendedJoystick,
    Fault,
    FaultStatus,
    FieldRequest,
    FirmwareVersion,
    Message,
    Name,
    Output,
    PcodeVersion,
    Position,
    PositionLimit,
    RotationSoftLimits,
    Sendable,
    Status,
    Version,
    Vista,
    VistaData,
    VistaPosition,
    Writable,
    ZeroPositions,
)
from bridge_core.framing import FrameError, Unknown
from bridge_core.j1939 import CanFrame, J1939Id
from stage.akron_frames import frame_of, messages, VECTORS

OFF, ON, ERROR, ABSENT = Status

# -- bad values of ours and of the peer -----------------------------------------------------------


@pytest.mark.parametrize(
    'make',
    [
        lambda: Axis(1024),
        lambda: Axis(-1),
        lambda: Axis(0.5),  # type: ignore[arg-type]
        lambda: Axis(1, 4),  # type: ignore[arg-type]
        lambda: Axis.of(1001),
        lambda: Position(4096),
        lambda: Position(0, 7),  # type: ignore[arg-type]
        lambda: BasicJoystick(Axis.of(0), Axis.of(0), (OFF,) * 11),
        lambda: BasicJoystick(Axis.of(0), Axis.of(0), detents=(OFF,)),
        lambda: BasicJoystick(Axis.of(0), Axis.of(0), (*[OFF] * 11, 4)),  # type: ignore[arg-type]
        lambda: ExtendedJoystick(switches=(OFF,) * 5),
        lambda: ExtendedJoystick(detents=(OFF,) * 2),
        lambda: PositionLimit(Position(0), Position(0), (OFF,) * 9, OFF, ON),
        lambda: PositionLimit(Position(0), Position(0), (OFF,) * 10, OFF, 9),  # type: ignore[arg-type]
        lambda: RotationSoftLimits(0.0, 3276.8),
        lambda: RotationSoftLimits(math.nan, 0.0),
        lambda: RotationSoftLimits(0.0, math.inf),
        lambda: ElevationSoftLimits(-3276.9, 0.0),
        lambda: DigitalOutputs(Output(0), 4),
        lambda: FaultStatus(Fault(0), 0x10000),
        lambda: FirmwareVersion(Version(1, 256), Version(0, 0), Version(0, 0)),
        lambda: PcodeVersion(0x10000, 0, Version(0, 0)),
        lambda: PcodeVersion(0, -1, Version(0, 0)),
        lambda: PcodeVersion(0, 0x10000, Version(0, 0)),
        lambda: ConfigVersion(2**32, Version(0, 0)),
        lambda: VistaData(1024, 0, 0, Vista(0)),
        lambda: VistaPosition(0, 65536),
        lambda: VistaPosition(65536, 0),
        lambda: FieldRequest(2**24),
        lambda: Name(2**21, 0),
        lambda: Name(0, 2**11),
        lambda: AddressAnnouncement('1032AE10080103'),
        lambda: AddressAnnouncement('9999AE100801035'),
        lambda: AddressAnnouncement('1032 E100801035'),
        lambda: AddressAnnouncement('1032AE637671947'),
        lambda: AddressAnnouncement('4096AE100801035'),
    ],
)
def test_own_bad_value_is_refused_when_made(make: Any) -> None:
    with pytest.raises(ValueError, match=r'.') as caught:
        make()
    assert not isinstance(caught.value, FrameError)


@pytest.mark.parametrize(
    'message',
    [
        FieldRequest(0),
        FieldRequest(0xFFFFFF),
        ConfigVersion(0, Version(0, 255)),
        ConfigVersion(0xFFFFFFFF, Version(255, 0)),
        PcodeVersion(0, 0xFFFF, Version(0, 0)),
        PcodeVersion(0xFFFF, 0, Version(0, 0)),
        FaultStatus(Fault(0), 0),
        FaultStatus(Fault(0), 0xFFFF),
    ],
)
def test_least_and_greatest_value_is_good(message: Writable) -> None:
    assert type(message).from_bytes(message.to_bytes()) == message


@pytest.mark.parametrize(
    'kind', [kind for kind in protocol.MESSAGES if issubclass(kind, Sendable)]
)
def test_what_acts_on_a_unit_is_never_sent_to_all(kind: type[Sendable]) -> None:
    message = next(protocol.decode(frame).message for frame in FRAMES if _is_of(kind, frame))
    assert isinstance(message, Sendable)
    if kind.PGN != protocol.PROPRIETARY_PGN:
        assert message.to_frame(0x33).data == message.to_bytes()
        return
    for nobody in (0xFE, 0xFF):
        with pytest.raises(ValueError, match='one unit'):
            message.to_frame(0x33, nobody)


FRAMES = [frame_of(vector['id'], vector['data']) for vector in VECTORS] + [
    frame_of('18EF0580', data)
    for data in ('03', '04', '05', '21', '2180501010000000', '22123489AB', 'FE')
]


def _is_of(kind: type[Message], frame: CanFrame) -> bool:
    return isinstance(protocol.decode(frame).message, kind)


# Lengths of data as the manual prints them.
LENGTHS: dict[tuple[int, int | None], set[int]] = {
    (64982, None): {8},
    (64983, None): {8},
    (59904, None): {3},
    (60928, None): {8},
    **{(0xEF00, kind): {1, 7} for kind in (0x02, 0x03, 0x04, 0x05)},
    **{(0xEF00, kind): {1} for kind in (0x41, 0x45, 0x46)},
    **{(0xEF00, kind): {6} for kind in (0x81, 0x82)},
    **{(0xEF00, kind): {3} for kind in (0x83, 0x84, 0xA1)},
    **{(0xEF00, kind): {8} for kind in (0x01, 0xFF)},
    (0xEF00, 0x21): {1, 8},
    (0xEF00, 0x22): {5},
    (0xEF00, 0x85): {2},
    (0xEF00, 0xFD): {3, 4, 5, 6, 7, 8},
    (0xEF00, 0xFE): {1, 2, 3, 4, 5, 6, 7, 8},
}


def test_every_message_of_the_manual_is_here_and_the_makers_own_cannot_be_written() -> None:
    for kind in (DiagnosticData, AsciiPipe, AsciiPipeAcknowledgement):
        assert not issubclass(kind, Writable)
    assert {(kind.PGN, kind.TYPE) for kind in protocol.MESSAGES} == set(LENGTHS)


@pytest.mark.parametrize(('pgn', 'kind'), LENGTHS)
def test_wrong_length_is_the_peers_fault(pgn: int, kind: int | None) -> None:
    head = b'' if kind is None else bytes((kind,))
    for length in range(9):
        frame = CanFrame(J1939Id(6, pgn, 0x80).identifier, (head + b'\x85' * 8)[:length])
        if length in LENGTHS[pgn, kind]:
            message = protocol.decode(frame).message
            assert isinstance(message, Message)
            assert type(message).from_bytes(frame.data) == message
        else:
            with pytest.raises(FrameError):
                protocol.decode(frame)


@pytest.mark.parametrize('kind', protocol.MESSAGES)
def test_from_bytes_refuses_any_other_length_and_type(kind: type[Message]) -> None:
    for length in set(range(11)) - LENGTHS[kind.PGN, kind.TYPE]:
        with pytest.raises(FrameError):
            kind.from_bytes((bytes((kind.TYPE or 0,)) + bytes(10))[:length])
    if kind.TYPE is not None:
        with pytest.raises(FrameError):
            kind.from_bytes(b'\x99' + bytes(min(kind.LENGTHS) - 1))


def test_messages_are_values() -> None:
    for message in [protocol.NEUTRAL, Position(0), *(protocol.decode(f).message for f in FRAMES)]:
        assert not hasattr(message, '__dict__')
        with pytest.raises((AttributeError, TypeError)):
            message.PGN = 0  # type: ignore[union-attr, misc]
        for field in message.__slots__:
            with pytest.raises(AttributeError):
                setattr(message, field, getattr(message, field))


def test_pin_with_unprintable_letters_is_the_peers_fault() -> None:
    for data in ('FF03150226021A0B', 'FF82010226021A0B', 'FFFF150226021A0B'):
        with pytest.raises(FrameError):
            protocol.decode(frame_of('18EFFF80', data))


@pytest.mark.parametrize(
    ('identifier', 'data', 'expected'),
    [
        ('18EFFF80', '06', Unknown(6)),
        ('18EFFF80', '00', Unknown(0)),
        ('18FEF180', '', Unknown(0xFEF1)),
        ('1AEFFF80', '02', Unknown(0x2EF00)),  # extended data page
        ('19EFFF80', '02', Unknown(0x1EF00)),  # data page
    ],
)
def test_what_the_manual_does_not_list_is_unknown(
    identifier: str, data: str, expected: Unknown
) -> None:
    assert protocol.decode(frame_of(identifier, data)).message == expected


def test_priority_does_not_count() -> None:
    for priority in range(8):
        parts = J1939Id(priority, 0xEF00, 0x80, 0x05)
        received = protocol.decode(CanFrame(parts.identifier, b'\x41'))
        assert (received.message, received.id) == (ZeroPositions(), parts)


# -- properties -----------------------------------------------------------------------------------


@given(messages)
def test_round_trip(message: Writable) -> None:
    data = message.to_bytes()
    assert type(message).from_bytes(data) == message
    identifier = J1939Id(6, message.PGN, 0x80).identifier
    assert protocol.decode(CanFrame(identifier, data)).message == message


types = st.sampled_from([kind.TYPE or 0 for kind in protocol.MESSAGES])
mutated = st.builds(
    lambda frame, place, value: CanFrame(
        frame.identifier, frame.data[:place] + value + frame.data[place + 1 :]
    ),
    st.sampled_from(FRAMES),
    st.integers(0, 7),
    st.binary(max_size=1),
)
any_frame = st.builds(CanFrame, st.integers(0, 2**29 - 1), st.binary(max_size=8))
own_frame = st.builds(
    lambda kind, rest: CanFrame(0x18EFFF80, bytes((kind,)) + rest), types, st.binary(max_size=7)
)


@given(mutated | any_frame | own_frame)
def test_any_frame_decodes_or_raises_frame_error(frame: CanFrame) -> None:
    try:
        message = protocol.decode(frame).message
    except FrameError:
        return
    if isinstance(message, Writable):
        assert protocol.decode(CanFrame(frame.identifier, message.to_bytes())).message == message


# -- bit by bit -----------------------------------------------------------------------------------


OFF, ON, ERROR, ABSENT = Status


# -- every bit ------------------------------------------------------------------------------------

# Every message with contents, and the bits that the manual leaves unused or reserved.
WALKED = [
    ('0CFDD633', '107D046400100000', '000000000F000000'),
    ('0CFDD733', '107D0464FFFF0004', '0000000000000300'),
    ('18EAFFFF', '00EE00', '000000'),
    ('18EEFF80', '0B1AC22800420090', '0000000000000000'),
    ('18EFFF80', '011D940371000041', '0000000000000000'),
    ('18EF0580', '0200000000000B', '001F5E1E000000'),
    ('18EF0580', '03010B02040206', '00000000000000'),
    ('18EF0580', '040D1C000E0204', '00000000000000'),
    ('18EF0580', '050398690E0204', '00000000000000'),
    ('18EF0580', '2180501010000000', '00000000003C0000'),
    ('18EF0580', '22123489AB', '0000000000'),
    ('18EFFF80', '81FED401C280', '00000000007F'),
    ('18EFFF80', '82FF38038400', '0000000000FF'),
    ('18EFFF80', '83C051', '000400'),
    ('18EFFF81', '848002', '003FFC'),
    ('18EFFFD0', '8501', '00F8'),
    ('18EF8005', 'A10009', '00FFF0'),
    ('18EFFF80', 'FF83150226021A0B', '0000000000000000'),
]


@pytest.mark.parametrize(('identifier', 'data', 'unused'), WALKED)
def test_every_used_bit_comes_back_and_every_unused_one_is_ignored(
    identifier: str, data: str, unused: str
) -> None:
    frame = frame_of(identifier, data)
    message, mask = protocol.decode(frame).message, bytes.fromhex(unused)
    typed = J1939Id.from_identifier(frame.identifier).pgn == protocol.PROPRIETARY_PGN
    for bit in range(8 if typed else 0, 8 * len(frame.data)):
        flipped = bytearray(frame.data)
        flipped[bit // 8] ^= 0x80 >> bit % 8
        try:
            walked = protocol.decode(CanFrame(frame.identifier, bytes(flipped))).message
        except FrameError:
            assert isinstance(message, AddressAnnouncement)  # not the letters of a PIN
            continue
        assert isinstance(walked, Writable)
        if mask[bit // 8] & 0x80 >> bit % 8:
            assert walked == message
        else:
            assert walked != message
            assert walked.to_bytes() == bytes(flipped)


def test_flags_are_named_in_the_manuals_words_from_the_top_down() -> None:
    """Which bit each of them is, the DBC file says."""
    faults = Fault.SCI_OUTPUT_OVERRUN | Fault.PCODE_SYNTAX_ERROR | Fault.MOTOR_AXIS_1
    assert protocol.flag_names(faults) == [
        *('SCI output overrun', 'pCode syntax error', 'motor axis 1'),
    ]
    vista = Vista.K1_RELAY_SET | Vista.DIGITAL_INPUT_5L | Vista.JOYSTICK_X_RIGHT
    assert protocol.flag_names(vista) == ['K1 relay set', 'digital input 5L', 'joystick X right']
    outputs = Output.SOE_MODE_ACTIVE | Output.PANEL_LED
    assert protocol.flag_names(outputs) == ['SOE mode active', 'panel LED']


# -- deflections and positions --------------------------------------------------------------------


@pytest.mark.parametrize(
    ('statuses', 'value', 'fault'),
    [
        # positive, negative, neutral
        ((ON, OFF, OFF), 400, None),
        ((OFF, ON, OFF), -400, None),
        ((OFF, OFF, ON), 0, None),
        ((OFF, OFF, OFF), None, ERROR),  # no direction
        ((ON, ON, OFF), None, ERROR),  # two
        ((ON, OFF, ON), None, ERROR),
        ((ON, ERROR, OFF), None, ERROR),
        ((OFF, OFF, ERROR), None, ERROR),
        ((ABSENT, ABSENT, ABSENT), None, ABSENT),
        ((ON, ABSENT, OFF), None, ABSENT),
        ((ERROR, ABSENT, OFF), None, ERROR),
    ],
)
def test_deflection_counts_only_with_one_direction(
    statuses: tuple[Status, ...], value: int | None, fault: Status | None
) -> None:
    axis = Axis(400, *statuses)
    assert (axis.value, axis.fault) == (value, fault)
    assert Axis.from_word(axis.to_word()) == axis


def test_neutral_absent_and_broken_are_three_things() -> None:
    neutral, absent, broken = Axis.of(0), protocol.UNAVAILABLE, Axis(0, neutral=ERROR)
    assert len({neutral, absent, broken}) == 3
    assert [axis.value for axis in (neutral, absent, broken)] == [0, None, None]
    assert [axis.fault for axis in (neutral, absent, broken)] == [None, ABSENT, ERROR]


@pytest.mark.parametrize(
    ('permille', 'word'), [(0, 0x0001), (1000, 0xFA10), (1, 0x0050), (-1, 0x0044)]
)
def test_deflection_known_by_hand(permille: int, word: int) -> None:
    assert Axis.of(permille).to_word() == word
    assert Axis.from_word(word).value == permille


@given(st.integers(-1000, 1000))
def test_every_deflection_of_ours_counts(permille: int) -> None:
    assert Axis.from_word(Axis.of(permille).to_word()).value == permille


@pytest.mark.parametrize(
    ('position', 'degrees', 'fault'),
    [
        (Position(473, ON, OFF), 47.3, None),
        (Position(1800, OFF, ON), -180.0, None),
        (Position(0, OFF, OFF), 0.0, None),
        (Position(0, ON, OFF), 0.0, None),
        (Position(1, OFF, OFF), None, ERROR),  # of which side?
        (Position(0, ON, ON), None, ERROR),
        (Position(473, ERROR, OFF), None, ERROR),
        (Position(4095, ABSENT, ABSENT), None, ABSENT),  # a monitor without sensors
    ],
)
def test_position_counts_only_with_one_sign(
    position: Position, degrees: float | None, fault: Status | None
) -> None:
    assert (position.degrees, position.fault) == (degrees, fault)
    assert position.radians == (None if degrees is None else math.radians(degrees))
    assert Position.from_word(position.to_word()) == position


# -- numbers of the appendices --------------------------------------------------------------------


def test_device_types_are_the_product_numbers_from_1032_on() -> None:
    assert all(name.startswith(str(5000 + n)) for n, name in protocol.DEVICE_TYPES.items())
    assert sorted(protocol.DEVICE_TYPES) == [*range(1032, 1038), *range(1040, 1043), 1051, 1052]
    assert {n: len(axes) for n, axes in protocol.AXIS_USAGE.items()} == {
        1032: 5,
        1040: 4,
        1042: 3,
        1052: 3,
    }


def test_addresses_and_times_of_appendix_b_and_a1() -> None:
    assert list(protocol.JOYSTICK_ADDRESSES) == [0x33, 0x34, 0x35, 0x36, 0x37, 0x38]
    assert (protocol.JOYSTICK_PERIOD, protocol.JOYSTICK_TIMEOUT) == (0.02, 0.2)
    assert (protocol.PERMISSIVE_PERIOD, protocol.PERMISSIVE_TIMEOUT) == (0.1, 0.3)
