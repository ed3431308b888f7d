# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The configuration image: golden is the one that the manual prints (3.1)."""

from __future__ import annotations

import contextlib
import itertools

from hypothesis import given, strategies as st
import pytest

from ssc_bridge.config.image import compare, Image, ImageError, KNOWN_SIZE, rate_text
from stage.ssc_rig import VECTORS

LINES: list[str] = VECTORS['config_image']['lines']
GOLDEN = Image.parse('\n'.join(LINES))
START = '---------- Start Of Image ----------'
END = '---------- End Of Image ----------'


def plain_sums(data: bytes) -> bytes:
    """The definition of 4.1, word for word."""
    first = second = 0
    for byte in data:
        first += byte
        second += first
    return bytes((first & 0xFF, second & 0xFF))


def with_bytes(changes: dict[int, int]) -> Image:
    """Return the golden image with other bytes, and the check that belongs to them."""
    body = bytearray(GOLDEN.data[:-2])
    for offset, byte in changes.items():
        body[offset] = byte
    return Image(bytes(body) + plain_sums(bytes(body)))


def value(image: Image, name: str) -> str:
    (text,) = (field.text for field in image.fields if field.name == name)
    return text


# The check.


def test_printed_image_checks_once_a_letter_o_is_read_as_0() -> None:
    fourth = '0514057805DC064006A40708076C07D003E8044C05DCO5DC05DCO5DC05DCO5DC00800F5C'
    printed = [*LINES[:3], fourth, *LINES[4:]]
    with pytest.raises(ImageError, match=r"line 4: 'O' is no hex digit"):
        Image.parse('\n'.join(printed))
    assert Image.parse('\n'.join(printed).replace('O', '0')) == GOLDEN
    assert len(GOLDEN.data) == VECTORS['config_image']['bytes'] == KNOWN_SIZE
    assert GOLDEN.data[-2:] == bytes.fromhex('C87C') == plain_sums(GOLDEN.data[:-2])


def test_every_single_flipped_bit_is_refused() -> None:
    for offset, bit in itertools.product(range(KNOWN_SIZE), range(8)):
        data = bytearray(GOLDEN.data)
        data[offset] ^= 1 << bit
        with pytest.raises(ImageError):
            Image(bytes(data))


@pytest.mark.parametrize('data', [b'', b'\0\0', bytes(KNOWN_SIZE)])
def test_blank_image_is_refused_though_its_sums_are_right(data: bytes) -> None:
    with pytest.raises(ImageError, match='blank'):
        Image(data)


@pytest.mark.parametrize('inputs', [0, 17, 255])
def test_impossible_number_of_inputs_is_refused_though_its_sums_are_right(inputs: int) -> None:
    with pytest.raises(ImageError, match=f'{inputs} pulse inputs'):
        with_bytes({2: inputs})


# The text.


@pytest.mark.parametrize('ends', ['\n', '\r\n', '\r', '\n\n', '  \r\n'])
@pytest.mark.parametrize('marked', [False, True])
def test_text_is_read_as_the_unit_prints_it(ends: str, marked: bool) -> None:
    lines = ['log', START, *LINES, END, 'S) Save'] if marked else LINES
    assert Image.parse(ends.join(lines)) == GOLDEN
    assert Image.parse(ends.join(lines).lower()) == GOLDEN


def test_written_text_is_the_printed_one() -> None:
    assert GOLDEN.text == ''.join(f'{line}\n' for line in LINES)


@pytest.mark.parametrize(
    ('lines', 'reason'),
    [
        ([], 'no hex digits'),
        ([*LINES[:-1], LINES[-1][:-1] + 'D'], 'its check is C87D, its bytes give C87C'),
        ([LINES[1], LINES[0], *LINES[2:]], 'its check is'),
        *((LINES[:cut] + LINES[cut + 1 :], 'check') for cut in range(1, 6)),
        ([START, END], 'no hex digits'),
        ([START, *LINES], 'marks the end'),
        ([*LINES, END], 'marks the start'),
        ([END, *LINES, START], 'marks the start'),
        ([START, *LINES, END, START, *LINES, END], 'one line'),
        ([LINES[0][:-1], *LINES[1:]], 'line 1 has 71 digits, an odd number'),
        ([LINES[0][:-2], *LINES[1:]], 'line 1 has 35 bytes'),
        ([*LINES[:2], LINES[2] + '00', *LINES[3:]], 'line 3 has 37 bytes'),
        ([''.join(LINES[:2]), *LINES[2:]], 'line 1 has 72 bytes'),
        ([LINES[0], 'Select :', *LINES[1:]], "line 2: 'S' is no hex digit"),
        (['٣' * 72, *LINES[1:]], 'is no hex digit'),
    ],
)
def test_damaged_text_is_refused_in_one_line(lines: list[str], reason: str) -> None:
    with pytest.raises(ImageError, match=reason) as caught:
        Image.parse('\n'.join(lines))
    assert '\n' not in str(caught.value)


@given(st.binary(min_size=1, max_size=300).filter(any))
def test_any_image_survives_its_text(body: bytes) -> None:
    data = body + plain_sums(body)
    if len(data) == KNOWN_SIZE and not 1 <= data[2] <= 16:
        return
    assert Image.parse(Image(data).text).data == data


@given(st.text(max_size=400))
def test_any_text_is_an_image_or_refused(text: str) -> None:
    with contextlib.suppress(ImageError):
        image = Image.parse(text)
        assert plain_sums(image.data[:-2]) == image.data[-2:]


# What is known of it.


@pytest.mark.parametrize(
    ('name', 'text'),
    [
        ('pulse inputs', '12'),  # as the menu of 3.2 shows
        ('user config ID', '126'),
        ('output 1 at 0 ms', 'CONST'),  # as the table of 3.3 shows
        ('output 1 at 1 ms', 'SERIAL'),
        ('output 1 at 1.5 ms', 'LAST'),
        ('output 1 at 2 ms', 'PIN (nibble 1)'),
        ('output 2 at 2 ms', 'PINv (nibble 1)'),
        ('output 12 period', '20000 µs'),
        ('output 1 constant', '1100 µs'),
        ('output 10 constant', '2000 µs'),
        ('unused row 13 constant', '1500 µs'),
        ('unused row 24 constant', '16697 µs'),
        ('aux 6', 'Dig In'),
        ('rate of message 10', '5 or 20 Hz (code 5)'),
        ('byte 0', '0x01 (not known)'),
    ],
)
def test_printed_image_reads(name: str, text: str) -> None:
    assert value(GOLDEN, name) == text


def test_every_byte_but_the_check_is_told_once() -> None:
    told = [range(field.offset, field.offset + len(field.raw)) for field in GOLDEN.fields]
    assert list(itertools.chain(*told)) == list(range(KNOWN_SIZE - 2))
    assert b''.join(field.raw for field in GOLDEN.fields) == GOLDEN.data[:-2]


@pytest.mark.parametrize(
    ('code', 'text'),
    [
        (0, '0 Hz (code 0)'),
        (2, '2 Hz (code 2)'),
        (5, '5 or 20 Hz (code 5)'),
        (7, '50 Hz (code 7)'),
        (50, '50 Hz (code 50)'),
        (8, 'unknown code 8'),
    ],
)
def test_rate_says_what_its_code_can_mean(code: int, text: str) -> None:
    assert rate_text(code) == text


def test_image_of_another_size_is_told_byte_by_byte() -> None:
    body = bytes(range(1, 11))
    image = Image(body + plain_sums(body))
    assert not image.has_known_layout
    assert [field.name for field in image.fields] == [f'byte {n}' for n in range(10)]


@pytest.mark.parametrize(
    ('changes', 'warning'),
    [
        ({8: 0x07}, 'output 1 at 0 ms is unknown 7: the manual has no such source'),
        ({11: 0xD0}, 'output 1 at 2 ms is PIN (nibble 13): there are 12 pulse inputs'),
        ({104: 0x7D, 105: 0x01}, 'output 1 constant is 32001 µs: the manual allows 0 to 32000 µs'),
        ({152: 0, 153: 0}, 'output 1 period is 0 µs: the manual allows 1000 to 32000 µs'),
        ({152: 0x7D, 153: 1}, 'output 1 period is 32001 µs: the manual allows 1000 to 32000 µs'),
        ({201: 0x05}, 'aux 1 is unknown (0x0005): the manual has no such thing'),
        ({212: 9}, 'rate of message 10 is unknown code 9: the manual has no such thing'),
    ],
)
def test_value_beyond_the_manual_is_a_warning(changes: dict[int, int], warning: str) -> None:
    assert with_bytes(changes).warnings == (warning,)


# Comparing.


def test_difference_is_named_by_field_and_by_offset_where_unknown() -> None:
    other = with_bytes({6: 127, 7: 9, 8: 3, 105: 0x4D, 213: 7})
    told = [(a.name, a.text, b.text) for a, b in compare(GOLDEN, other)]
    assert told == [
        ('user config ID', '126', '127'),
        ('byte 7', '0x00 (not known)', '0x09 (not known)'),
        ('output 1 at 0 ms', 'CONST', 'SERIAL'),
        ('output 1 constant', '1100 µs', '1101 µs'),
        ('rate of message 11', '5 or 20 Hz (code 5)', '50 Hz (code 7)'),
    ]


def test_images_of_different_size_are_not_compared_by_field() -> None:
    body = GOLDEN.data[:-2] + b'\0'
    ((one, other),) = compare(GOLDEN, Image(body + plain_sums(body)))
    assert (one.text, other.text) == ('220 bytes', '221 bytes')
