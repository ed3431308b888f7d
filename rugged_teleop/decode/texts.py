# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Captures that are text: hex listings, and what candump writes to a file or shows on a screen."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
import re
from typing import BinaryIO

from rugged_teleop.decode.pieces import can_piece, Damage, ERROR_FRAME, Piece

# A longer line is cut: between two bytes, be they of 2, 3, 5 or 6 characters (0x10 and a space).
_LONGEST = 61440
_ERROR, _REMOTE = 0x20000000, 0x40000000  # bits of an identifier in Linux (linux/can.h)

# (1700000000.123456) can0 0CFDE801#090000000000, from candump -l and python-can
_LOG = re.compile(
    r'\s*\((?P<at>[\d.]+)\)\s+(?P<channel>\S+)\s+(?P<id>[0-9A-F]{3}|[0-9A-F]{8})'
    r'#(?P<data>[0-9A-F]*|R[0-9A-F]?|#[0-9A-F]*)(?:\s+[RT])?\s*',
    re.IGNORECASE,
)
#  (1700000000.123456)  can0  RX - -  0CFDE801   [6]  09 00 00 00 00 00   '......'
_SCREEN = re.compile(
    r'\s*(?:\((?P<at>[^)]*)\)\s+)?(?P<channel>[A-Za-z]\S*)\s+(?:[RT]X\s+[B-]\s+[E-]\s+)?'
    r'(?P<id>[0-9A-F]{3}|[0-9A-F]{8})\s+\[(?P<size>\d\d?)\]\s*(?P<data>.*)',
    re.IGNORECASE | re.DOTALL,
)
_COMMENTS = ('#', ';', '//')
_ADDRESS = re.compile(r'(?:0x)?[0-9A-F]{4,}(?P<colon>:)?(?:\s+|$)', re.IGNORECASE)
_BYTES = re.compile(r'(?:[0-9A-F]{2}\s*)+', re.IGNORECASE)
_PUNCTUATION = re.compile(r'\b0x|\\x|[,;:{}-]', re.IGNORECASE)


def lines_of(file: BinaryIO) -> Iterator[tuple[int, str]]:
    """Yield each line and its offset; what is not ASCII is replaced."""
    offset = 0
    while line := file.readline(_LONGEST):
        yield offset, line.decode('ascii', 'replace')
        offset += len(line)


# candump


def is_candump(line: str) -> bool:
    """Tell whether candump may have written this line."""
    return bool(_LOG.fullmatch(line) or _SCREEN.fullmatch(line))


def candump(file: BinaryIO) -> Iterator[Piece | Damage]:
    """Read what candump wrote (-l, -L) or showed, with whatever options for its times."""
    in_error = False
    for offset, line in lines_of(file):
        try:
            frame = _frame(offset, line)
        except ValueError:
            # What -e says of an error frame is indented by a tab.
            if line.strip() and not (line.startswith(_COMMENTS) or (in_error and line[0] == '\t')):
                yield Damage(offset, len(line), 'not a line of candump', line.encode())
        else:
            in_error = isinstance(frame, Piece) and frame.form == ERROR_FRAME
            yield frame


def _frame(offset: int, line: str) -> Piece | Damage:
    """:raises ValueError: it is not a line of candump."""
    match = _LOG.fullmatch(line) or _SCREEN.fullmatch(line)
    if match is None:
        raise ValueError(line)
    identifier, text = int(match['id'], 16), match['data']
    size = int(match['size']) if 'size' in match.re.groupindex else (len(text) + 1) // 2
    remote = text[:1] in ('R', 'r')  # 'remote request' on a screen
    fd = text[:1] == '#' or size > 8
    data = b'' if remote or fd else bytes.fromhex(' '.join(text.split()[:size]))
    if not (remote or fd or len(data) == size):
        raise ValueError(line)
    return can_piece(
        offset,
        identifier & 0x1FFFFFFF,
        data,
        at=_seconds(match['at']),
        source=match['channel'],
        extended=len(match['id']) == 8,
        error=bool(identifier & _ERROR),
        remote=remote or bool(identifier & _REMOTE),
        fd=fd,
    )


def _seconds(text: str | None) -> float | None:
    """Return a time of candump: seconds, or a date (-t A). :raises ValueError: it is neither."""
    if not text:
        return None
    return float(text) if text[4:5] != '-' else datetime.fromisoformat(text).timestamp()


# Hex listings


class HexListing:
    """Reads lines of hex; the first line with bytes tells whether addresses stand before them."""

    def __init__(self) -> None:
        self._addressed: bool | None = None

    def read(self, line: str) -> bytes:
        """Return the bytes of a line. :raises ValueError: saying what is wrong with it."""
        text = line.strip()
        if text == '*':
            raise ValueError('* stands for lines that were left out; use hexdump -Cv or xxd')
        if not text or text.startswith('#'):
            return b''
        if self._addressed is None:
            self._addressed = _begins_with_address(text)
        if self._addressed:
            address = _ADDRESS.match(text)
            if address is None:
                raise ValueError('no address, as the lines before it have')
            text = text[address.end() :]
            if address['colon']:
                text = text.partition('  ')[0]  # behind it xxd repeats the bytes as characters
        try:
            return bytes.fromhex(_PUNCTUATION.sub(' ', text.partition('|')[0]))
        except ValueError:
            raise ValueError('not hex') from None


def _begins_with_address(text: str) -> bool:
    """Tell an address from bytes: a colon and a space follow it, or single bytes do."""
    address = _ADDRESS.match(text)
    if address is None:
        return False
    rest = text[address.end() :].partition('|')[0].split()
    return bool(address['colon']) or (bool(rest) and all(len(word) == 2 for word in rest))


def is_hex(line: str) -> bool:
    """Tell whether this line may be of a hex listing."""
    try:
        return bool(HexListing().read(line))
    except ValueError:
        return False


def hex_listing(file: BinaryIO) -> Iterator[Piece | Damage]:
    """Read xxd, hexdump -C, od -A x -t x1, or bytes in any usual notation."""
    listing = HexListing()
    for offset, line in lines_of(file):
        try:
            data = listing.read(line)
        except ValueError as error:
            yield Damage(offset, len(line), str(error), line.encode())
        else:
            if data:
                yield Piece(offset, data)
