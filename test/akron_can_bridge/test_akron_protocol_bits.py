# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Akron Brass messages bit by bit, against tables and numbers from the manual."""

from __future__ import annotations

import math

from hypothesis import given, strategies as st
import pytest

from akron_can_bridge import protocol
from akron_can_bridge.protocol import (
    AddressAnnouncement,
    Axis,
    BasicJoystick,
    DigitalInputs,
    DigitalOutputs,
    ExtendedJoystick,
    FaultStatus,
    MiniOutputs,
    Output,
    Position,
    PositionLimit,
    SoePermissive,
    Status,
    VistaData,
    Writable,
)
from bridge_core.framing import FrameError
from bridge_core.j1939 import CanFrame, J1939Id
from stage.akron_frames import check, frame_of

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


# Name, byte (from 1) and bit (8 to 1) as the manual counts them.
FAULTS = {
    'S12 processor or code': (2, 8),
    'CAN output overrun': (2, 7),
    'SCI output overrun': (2, 6),
    'external EEPROM': (3, 8),
    'internal fuse blown': (3, 6),
    'pCode syntax error': (3, 1),
    'XGATE processor or code': (4, 8),
    'CAN input overrun': (4, 7),
    'SCI input overrun': (4, 6),
    'digital output 3': (4, 1),
    'digital output 2': (5, 8),
    'digital output 1': (5, 7),
    'motor axis 5': (5, 6),
    'motor axis 4': (5, 5),
    'motor axis 3': (5, 4),
    'motor axis 2': (5, 3),
    'motor axis 1': (5, 2),
    'internal EEPROM': (5, 1),
}
OUTPUTS = {
    'enable': (2, 8),
    'active': (2, 7),
    'stowed': (2, 6),
    'point aim mode active': (2, 5),
    'SOE mode active': (2, 4),
    'aux agent dispense': (3, 8),
    'discharge': (3, 7),
    'high flow': (3, 6),
    'handheld LED': (3, 5),
    'remote mode': (3, 4),
    'not in exclusion zone': (3, 3),
    'point aim LED': (3, 2),
    'panel LED': (3, 1),
}
MINI_OUTPUTS = {
    'device active': (2, 8),
    'device faulted': (2, 7),
    'riser extended': (3, 2),
    'riser retracted': (3, 1),
}
INPUTS = {'stow': (2, 3), 'deploy': (2, 2), 'allowed in collision zone': (2, 1)}
PERMISSIONS = {'down': (3, 4), 'up': (3, 3), 'left': (3, 2), 'right': (3, 1)}
VISTA = {
    'K1 relay reset': (3, 6),
    'K1 relay set': (3, 5),
    'digital output 3': (3, 4),
    'digital output 2': (3, 3),
    'digital output 1': (3, 2),
    'digital input 5L': (3, 1),
    'digital input 5H': (4, 8),
    'digital input 4L': (4, 7),
    'digital input 4H': (4, 6),
    'digital input 3L': (4, 5),
    'digital input 3H': (4, 4),
    'digital input 2L': (4, 3),
    'digital input 2H': (4, 2),
    'digital input 1': (4, 1),
    'joystick switch 10': (6, 2),
    'joystick switch 3': (6, 1),
    'joystick switch 2': (8, 6),
    'joystick switch 1': (8, 5),
    'joystick Y forward': (8, 4),
    'joystick Y back': (8, 3),
    'joystick X left': (8, 2),
    'joystick X right': (8, 1),
}
FLAGS: list[tuple[type[Writable], int, str, dict[str, tuple[int, int]]]] = [
    (FaultStatus, 7, 'faults', FAULTS),
    (DigitalOutputs, 3, 'outputs', OUTPUTS),
    (MiniOutputs, 3, 'outputs', MINI_OUTPUTS),
    (DigitalInputs, 2, 'inputs', INPUTS),
    (SoePermissive, 3, 'permitted', PERMISSIONS),
    (VistaData, 8, 'bits', VISTA),
]


@pytest.mark.parametrize(('kind', 'length', 'field', 'table'), FLAGS)
def test_every_flag_by_its_name(
    kind: type[Writable], length: int, field: str, table: dict[str, tuple[int, int]]
) -> None:
    for name, (byte, bit) in table.items():
        data = bytearray(length)
        data[0] = kind.TYPE or 0
        data[byte - 1] |= 1 << (bit - 1)
        message = kind.from_bytes(bytes(data))
        assert protocol.flag_names(getattr(message, field)) == [name]
        assert message.to_bytes() == bytes(data)


def test_flags_are_named_from_the_top_down() -> None:
    for kind, _, field, table in FLAGS:
        everything = kind.from_bytes(bytes((kind.TYPE or 0,)) + b'\xff' * (kind.LENGTHS[0] - 1))
        assert protocol.flag_names(getattr(everything, field)) == list(table)


def test_riser_command_is_a_number_of_two_bits() -> None:
    for riser in range(4):
        check('18EFFF80', f'830{riser}00', DigitalOutputs(Output(0), riser))


# Place of each two-bit status: byte, and its upper bit.
@pytest.mark.parametrize('status', Status)
def test_every_status_of_a_message_in_its_place(status: Status) -> None:
    stops = [(6, 8), (6, 6), (6, 4), (6, 2), (7, 8), (7, 6), (7, 4), (7, 2), (8, 8), (8, 6)]
    for place, (byte, bit) in enumerate(stops):
        limits = PositionLimit.from_bytes(_with_status(8, 1, byte, bit, status))
        assert limits.hard_stops == (*[OFF] * place, status, *[OFF] * (9 - place))
    assert PositionLimit.from_bytes(_with_status(8, 1, 8, 4, status)).operational_error is status
    assert PositionLimit.from_bytes(_with_status(8, 1, 8, 2, status)).calibration is status
    for number in range(1, 13):
        byte, bit = 6 + (number - 1) // 4, 8 - 2 * ((number - 1) % 4)
        basic = BasicJoystick.from_bytes(_with_status(8, 0, byte, bit, status))
        assert basic.switches == (*[OFF] * (number - 1), status, *[OFF] * (12 - number))
    for place, bit in enumerate((8, 6, 4, 2)):
        extended = ExtendedJoystick.from_bytes(_with_status(8, 0, 8, bit, status))
        assert extended.switches == (*[OFF] * place, status, *[OFF] * (3 - place))
    basic = BasicJoystick.from_bytes(_with_status(8, 0, 5, 6, status))
    assert basic.detents == (OFF, status)
    extended = ExtendedJoystick.from_bytes(_with_status(8, 0, 7, 4, status))
    assert extended.detents == (OFF, OFF, status)


def _with_status(length: int, kind: int, byte: int, bit: int, status: Status) -> bytes:
    data = bytearray(length)
    data[0] = kind
    data[byte - 1] |= status << (bit - 2)
    return bytes(data)


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
