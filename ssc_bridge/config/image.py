# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
An SSC's configuration image: what the unit prints and takes as ASCII hex, 36 bytes a line (3.1).

The manual prints one image and describes none. This layout was read out of that one, as the last
column says.

======  ====  ============================================  =================================
offset  size  content                                       why
======  ====  ============================================  =================================
2       1     pulse inputs, 1 to 16                         12, as the menu of 3.2 shows
6       1     user config ID                                126, as the menu of 3.2 shows
8       96    switch table, 24 rows of 0, 1, 1.5 and 2 ms:  bytes as in message 11 (4.2.1.2)
              source in the low nibble, input in the high
104     48    24 constants, us, big-endian                  steps of 100 from 1100 to 2000
152     48    24 output periods, us, big-endian             20000, as the menu of 3.3 shows
200     12    6 auxiliary words, big-endian                 as many, and words of message 15
212     5     5 codes of message rates, 10 to 14            as many as the menu of 3.4 has
218     2     Fletcher sums over all before (4.1)           recomputed
======  ====  ============================================  =================================

Bytes 0, 1, 3 to 5, 7 and 217 are not known; primary port and lockouts must be among them. Rows
behind the last output (24 less the inputs) hold leftovers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import re
import struct

from bridge_core.checksums import fletcher16
from ssc_bridge.protocol import (
    AUX_CHANNELS,
    function_of,
    MAX_INPUTS,
    MAX_PULSE_US,
    PULSE_CHANNELS,
    REPEATED,
    Selection,
    Source,
)

LINE_SIZE = 36  # bytes
KNOWN_SIZE = 220  # bytes of the image that the manual prints
STATES = ('0 ms', '1 ms', '1.5 ms', '2 ms')  # columns of the switch table (3.3)
RATES_HZ = (0, 1, 2, 5, 10, 20, 25, 50)  # 4.2.1

_MIN_PERIOD_US = 1000  # 3.3

_INPUTS, _CONFIG_ID = 2, 6
_TABLE, _CONSTANTS, _PERIODS, _AUX, _RATES = 8, 104, 152, 200, 212
_UNKNOWN = (0, 1, 3, 4, 5, 7, 217)
_CHECK = struct.Struct('<H')  # plain sum, then sum of sums
_MARKER = re.compile(r'\W*(start|end)\b.*\bimage\b', re.IGNORECASE)


class ImageError(ValueError):
    """A text is no sound image; it says where and why."""


@dataclass(frozen=True, slots=True)
class Field:
    """
    A piece of an image.

    :param group: such as 'output 3'; 'byte 7' where nobody knows what it is.
    :param part: such as 'constant', where a group has several.
    :param text: its value, for people. :param offset: of its first byte. :param raw: its bytes.
    """

    group: str
    part: str
    text: str
    offset: int
    raw: bytes

    @property
    def name(self) -> str:
        """Group and part."""
        return f'{self.group} {self.part}'.strip()


@dataclass(frozen=True, slots=True)
class Image:
    """
    A whole image, sound by its check.

    :param data: bytes, check included. :raises ImageError: the check is wrong, or it is blank.
    """

    data: bytes

    def __post_init__(self) -> None:
        body, check = self.data[: -_CHECK.size], self.data[-_CHECK.size :]
        if not any(body):  # the sums of nothing but zeros are zero, too
            raise ImageError('it is blank')
        if check != _CHECK.pack(fletcher16(body)):
            right = _CHECK.pack(fletcher16(body)).hex().upper()
            raise ImageError(f'its check is {check.hex().upper()}, its bytes give {right}')
        if self.has_known_layout and not 1 <= self.data[_INPUTS] <= MAX_INPUTS:
            raise ImageError(f'{self.data[_INPUTS]} pulse inputs are not within 1 to {MAX_INPUTS}')

    @classmethod
    def parse(cls, text: str) -> Image:
        """Read ASCII hex, with or without the unit's two marker lines. :raises ImageError: bad."""
        lines = [line.strip() for line in _between_markers(text) if line.strip()]
        if not lines:
            raise ImageError('it has no hex digits')
        rows = [_bytes_of(number, line) for number, line in enumerate(lines, 1)]
        for number, row in enumerate(rows[:-1], 1):
            if len(row) != LINE_SIZE:
                raise ImageError(f'line {number} has {len(row)} bytes; all but the last have 36')
        return cls(b''.join(rows))

    @property
    def lines(self) -> tuple[str, ...]:
        """ASCII hex as the unit prints it, without markers and line ends."""
        starts = range(0, len(self.data), LINE_SIZE)
        return tuple(self.data[at : at + LINE_SIZE].hex().upper() for at in starts)

    @property
    def text(self) -> str:
        """The content of a file."""
        return ''.join(f'{line}\n' for line in self.lines)

    @property
    def has_known_layout(self) -> bool:
        """It is as large as the one in the manual; of any other only the check is known."""
        return len(self.data) == KNOWN_SIZE

    @property
    def outputs(self) -> int:
        """Pulse outputs: all of the 24 channels that are no inputs (3.2.1)."""
        return PULSE_CHANNELS - self.data[_INPUTS]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the manual does not allow (3.3, 4.2.1), in words; unused rows do not count."""
        used = (field for field in self.fields if not field.group.startswith('unused'))
        faults = ((field, self._fault(field)) for field in used)
        return tuple(f'{field.name} is {field.text}: {fault}' for field, fault in faults if fault)

    def _fault(self, field: Field) -> str:
        value = int.from_bytes(field.raw, 'big')
        if field.part == 'constant' and value > MAX_PULSE_US:
            return f'the manual allows 0 to {MAX_PULSE_US} µs'
        if field.part == 'period' and not _MIN_PERIOD_US <= value <= MAX_PULSE_US:
            return f'the manual allows {_MIN_PERIOD_US} to {MAX_PULSE_US} µs'
        if field.part.startswith('at '):
            return self._source_fault(Selection.from_byte(value))
        unknown = 'unknown' in field.text  # an auxiliary function, or the code of a rate
        return 'the manual has no such thing' if unknown else ''

    def _source_fault(self, selection: Selection) -> str:
        if not isinstance(selection.source, Source):
            return 'the manual has no such source'
        is_pin = selection.source in (Source.PIN, Source.PIN_INVERTED)
        # Whether the nibble counts from 0 or 1 is not known: more than this is beyond both.
        beyond = is_pin and selection.nibble > self.data[_INPUTS]
        return f'there are {self.data[_INPUTS]} pulse inputs' if beyond else ''

    @property
    def fields(self) -> tuple[Field, ...]:
        """All of it but the check, in the order of the bytes."""
        return tuple(sorted(self._fields(), key=lambda field: field.offset))

    def _fields(self) -> Iterator[Field]:
        if not self.has_known_layout:
            yield from map(self._unknown, range(len(self.data) - _CHECK.size))
            return
        yield self._field(_INPUTS, 1, str, 'pulse inputs')
        yield self._field(_CONFIG_ID, 1, str, 'user config ID')
        for row in range(PULSE_CHANNELS):
            yield from self._row(row)
        for channel in range(AUX_CHANNELS):
            yield self._field(
                _AUX + 2 * channel, 2, lambda word: function_of(word).text, f'aux {channel + 1}'
            )
        for place, message in enumerate(REPEATED):
            yield self._field(_RATES + place, 1, rate_text, f'rate of message {message}')
        yield from map(self._unknown, _UNKNOWN)

    def _row(self, row: int) -> Iterator[Field]:
        """Yield a row of the switch table, constant and period included."""
        group = f'output {row + 1}' if row < self.outputs else f'unused row {row + 1}'
        for column, state in enumerate(STATES):
            offset = _TABLE + len(STATES) * row + column
            yield self._field(offset, 1, source_text, group, f'at {state}')
        yield self._field(_CONSTANTS + 2 * row, 2, '{} µs'.format, group, 'constant')
        yield self._field(_PERIODS + 2 * row, 2, '{} µs'.format, group, 'period')

    def _unknown(self, offset: int) -> Field:
        return self._field(offset, 1, '0x{:02X} (not known)'.format, f'byte {offset}')

    def _field(
        self, offset: int, size: int, text_of: Callable[[int], str], group: str, part: str = ''
    ) -> Field:
        raw = self.data[offset : offset + size]
        return Field(group, part, text_of(int.from_bytes(raw, 'big')), offset, raw)


def _between_markers(text: str) -> list[str]:
    """Return the lines of the image. :raises ImageError: not one pair."""
    lines = re.split('\r\n|\r|\n', text)
    if not lines[-1]:
        del lines[-1]  # a line's end is none between two
    found = [(_MARKER.match(line), at) for at, line in enumerate(lines)]
    marks = [(match[1].lower(), at) for match, at in found if match]
    if not marks:
        return lines
    if [kind for kind, _ in marks] != ['start', 'end']:
        raise ImageError('it wants one line that marks the start, then one that marks the end')
    return lines[marks[0][1] + 1 : marks[1][1]]


def _bytes_of(number: int, line: str) -> bytes:
    stranger = re.search('[^0-9A-Fa-f]', line)
    if stranger:
        raise ImageError(f'line {number}: {stranger[0]!r} is no hex digit')
    if len(line) % 2:
        raise ImageError(f'line {number} has {len(line)} digits, an odd number')
    return bytes.fromhex(line)


def source_text(byte: int) -> str:
    """Return the menu's word (3.3); the nibble as it is, for 0 or 1 may stand for PIN 1."""
    selection = Selection.from_byte(byte)
    if selection.source in (Source.PIN, Source.PIN_INVERTED):
        word = 'PIN' if selection.source == Source.PIN else 'PINv'
        return f'{word} (nibble {selection.nibble})'
    return selection.text()


def rate_text(code: int) -> str:
    """Return a message rate: whether a code is Hz or a place among the rates is not known."""
    rates = sorted(rate for place, rate in enumerate(RATES_HZ) if code in (place, rate))
    if not rates:
        return f'unknown code {code}'
    return f'{" or ".join(map(str, rates))} Hz (code {code})'


def compare(one: Image, other: Image) -> list[tuple[Field, Field]]:
    """Return the fields that differ, in pairs; of images that differ in size only the sizes."""
    if len(one.data) != len(other.data):
        return [(_size(one), _size(other))]
    pairs = zip(one.fields, other.fields, strict=True)
    return [(a, b) for a, b in pairs if a.raw != b.raw]


def _size(image: Image) -> Field:
    return Field('size', '', f'{len(image.data)} bytes', 0, b'')
