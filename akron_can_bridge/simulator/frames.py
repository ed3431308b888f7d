# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The frames of simulated devices.

Built and read by their own few lines, straight from the manual's bit rows, so that a slip in the
codec of the bridge cannot hide in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from bridge_core.j1939 import CanFrame

OFF, ON, ERROR, ABSENT = 0b00, 0b01, 0b10, 0b11
ALL = 0xFF  # destination of a broadcast


def bits(text: str) -> bytes:
    """Return bytes written as 0 and 1; blanks are for the reader."""
    digits = text.replace(' ', '')
    return bytes(int(digits[place : place + 8], 2) for place in range(0, len(digits), 8))


def number(value: int, width: int) -> str:
    """Return a number as ``width`` digits of 0 and 1, for ``bits``; negative ones too."""
    return f'{value % (1 << width):0{width}b}'


def build_message(kind: int, body: bytes, source: int, destination: int = ALL) -> CanFrame:
    """Return a message of PGN EF00 ("General Message Characteristics")."""
    return CanFrame(int(f'18EF{destination:02X}{source:02X}', 16), bytes((kind,)) + body)


def build_deflection(value: int, status: int = ON) -> bytes:
    """
    Return two bytes of a joystick message. :param value: -1023 to 1023 in 0.1 %.

    :param status: ON, or ERROR in all three statuses, or ABSENT: nothing but ones.
    """
    if status == ABSENT:
        return b'\xff\xff'
    signs = (value > 0, value < 0, value == 0)
    statuses = ''.join(number(status if sign or status != ON else OFF, 2) for sign in signs)
    return bits(number(abs(value) & 3, 2) + statuses) + bytes((abs(value) >> 2,))


def build_statuses(statuses: Sequence[int]) -> bytes:
    """Return four two-bit statuses a byte, from the top down."""
    return bits(''.join(number(status, 2) for status in statuses))


def build_joystick(source: int, x: bytes, y: bytes, switches: Sequence[int]) -> CanFrame:
    """Return PGN 64982. :param switches: 12 statuses."""
    return CanFrame(0x0CFDD600 + source, x + y + b'\0' + build_statuses(switches))


def build_extended(
    source: int, x: bytes, y: bytes, theta: bytes, switches: Sequence[int] = (OFF,) * 4
) -> CanFrame:
    """Return PGN 64983. :param switches: 13 to 16."""
    return CanFrame(0x0CFDD700 + source, x + y + theta + b'\0' + build_statuses(switches))


def build_angle(degrees: float, status: int = ON) -> str:
    """Return 16 digits of type 01: 12 of 0.1 degree, plus status, minus status."""
    if status != ON:
        return '1' * 12 + number(status, 2) * 2
    tenths = round(degrees * 10)
    signs = ('01' if sign else '00' for sign in (tenths > 0, tenths < 0))
    return number(abs(tenths), 12) + ''.join(signs)


def build_position(
    source: int, rotation: str, elevation: str, stops: Sequence[int], error: int, calibrated: int
) -> CanFrame:
    """Return type 01. :param rotation: from build_angle. :param stops: 10, axis 1 + first."""
    statuses = ''.join(number(status, 2) for status in (*stops, error, calibrated))
    return build_message(0x01, bits(rotation + elevation + statuses), source)


def build_limits(kind: int, source: int, low: float, high: float, oscillating: bool) -> CanFrame:
    """Return type 81 or 82. :param low: degrees, left or down."""
    limits = number(round(low * 10), 16) + number(round(high * 10), 16)
    return build_message(kind, bits(f'{limits}{"1" if oscillating else "0"}0000000'), source)


def build_name(source: int, identity: int, function: int, capable: bool) -> CanFrame:
    """Return PGN 60928, of an Akron Brass device on the highway."""
    manufacturer = number(326, 11)
    low = number(identity, 21)
    return CanFrame(
        0x18EEFF00 + source,
        bits(low[13:] + low[5:13] + manufacturer[8:] + low[:5] + manufacturer[:8])
        + bytes((0, function, 0, 0x90 if capable else 0x10)),
    )


def build_announcement(source: int, pin: str, top_bit: bool = True) -> CanFrame:
    """Return type FF. :param top_bit: set, as in the manual's example, or not."""
    letters = number(ord(pin[4]), 7) + number(ord(pin[5]), 7)
    digits = number(int(pin[:4]), 12) + ('1' if top_bit else '0') + number(int(pin[6:]), 29)
    return build_message(0xFF, bits(letters + digits), source)


def _places(rows: dict[int, str]) -> dict[str, tuple[int, int]]:
    """Return the byte (from 1) and bit (8 to 1) of each name. :param rows: names from bit 8 on."""
    return {
        name: (byte, 8 - place)
        for byte, names in rows.items()
        for place, name in enumerate(names.split())
        if name != '-'
    }


# Bits of types 02, 83, 84 and 85, by byte.
FAULTS = _places(
    {
        2: 's12 can_output sci_output',
        3: 'external_eeprom - fuse - - - - pcode_syntax',
        4: 'xgate can_input sci_input - - - - output_3',
        5: 'output_2 output_1 axis_5 axis_4 axis_3 axis_2 axis_1 internal_eeprom',
    }
)
OUTPUTS = _places(
    {
        2: 'enable active stowed point_aim soe - riser_high riser_low',
        3: 'aux_agent discharge high_flow handheld_led remote_mode not_in_zone point_aim_led '
        'panel_led',
    }
)
MINI_OUTPUTS = _places(
    {2: 'device_active device_faulted', 3: '- - - - - - riser_extended riser_retracted'}
)
INPUTS = _places({2: '- - - - - stow deploy allowed'})


def build_flags(names: set[str], places: dict[str, tuple[int, int]], size: int) -> bytes:
    """Return bytes 2 to ``size`` with the bits of these names set."""
    body = bytearray(size - 1)
    for name in names:
        byte, bit = places[name]
        body[byte - 2] |= 1 << (bit - 1)
    return bytes(body)


class Stick(NamedTuple):
    """A joystick message as a unit takes it: what is not vouched for is no request."""

    x: int | None  # -1000 to 1000 in 0.1 %
    y: int | None
    switches: frozenset[int]  # numbers of those that are on


def read_deflection(low: int, high: int) -> int | None:
    """Return -1000 to 1000; None where not exactly one direction is on and the others off."""
    signs = {0b010000: 1, 0b000100: -1, 0b000001: 0}
    sign = signs.get(low & 0b111111)
    return None if sign is None else sign * min(high << 2 | low >> 6, 1000)


def read_switches(data: bytes, first: int) -> frozenset[int]:
    """Return the numbers of the switches that are on."""
    digits = ''.join(number(byte, 8) for byte in data)
    pairs = (digits[place : place + 2] for place in range(0, len(digits), 2))
    return frozenset(first + place for place, pair in enumerate(pairs) if pair == '01')
