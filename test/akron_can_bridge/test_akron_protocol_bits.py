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
    Fault,
    Output,
    Position,
    Status,
    Vista,
    Writable,
)
from bridge_core.framing import FrameError
from bridge_core.j1939 import CanFrame, J1939Id
from stage.akron_frames import frame_of

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
