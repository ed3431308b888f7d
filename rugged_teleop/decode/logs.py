# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The logs of other CAN tools, by python-can's readers."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, BinaryIO

import can
from can.io.blf import BLFParseError, OBJ_HEADER_BASE_STRUCT

from rugged_teleop.decode.pieces import can_piece, Damage, Piece
from rugged_teleop.decode.texts import lines_of


class _BLFReader(can.BLFReader):
    """One that ends at an object of size 0, at which python-can's turns round for ever."""

    def _parse_data(self, data: bytes) -> Iterator[can.Message]:
        at = data.find(b'LOBJ')
        while 0 <= at <= len(data) - OBJ_HEADER_BASE_STRUCT.size:
            size = OBJ_HEADER_BASE_STRUCT.unpack_from(data, at)[3]
            if not size:
                yield from super()._parse_data(data[:at])
                raise BLFParseError('an object of size 0')
            at = data.find(b'LOBJ', at + size)
        yield from super()._parse_data(data)


_TEXTS = {'asc': can.ASCReader, 'csv': can.CSVReader, 'trc': can.TRCReader}
_BINARIES = {'blf': _BLFReader, 'db': can.SqliteReader, 'mf4': can.MF4Reader}
FORMATS = (*_TEXTS, *_BINARIES)
_HOPELESS = 100  # damaged lines without a sound one between
_LONGEST_HEAD = 1000  # lines before the first frame


def read_log(kind: str, file: BinaryIO) -> Iterator[Piece | Damage]:
    """Read a log of one of FORMATS. :raises ValueError: what it needs is not installed."""
    if kind in _TEXTS:
        return _read_text(_TEXTS[kind], file)
    return _read_binary(_BINARIES[kind], file)


class _Lines:
    """What a reader of python-can reads; after an error a new one can go on with the next line."""

    read = write = None  # python-can before 4.6 takes nothing else for a file, and uses neither

    def __init__(self, file: BinaryIO) -> None:
        self._lines = lines_of(file)
        self._head: list[str] = []  # before the first frame: a new reader needs it, too
        self._again: deque[str] = deque()
        self._in_head = True
        self.offset = 0
        self.line = ''

    def __iter__(self) -> _Lines:
        return self

    def __next__(self) -> str:
        if self._again:
            return self._again.popleft()
        self.offset, self.line = next(self._lines)
        if self._in_head and len(self._head) < _LONGEST_HEAD:
            self._head.append(self.line)
        return self.line

    def end_head(self) -> None:
        """Note that the last line was a frame."""
        if self._in_head:
            self._in_head = False
            self._head.pop()

    def restart(self) -> None:
        """Begin with the head again; then go on behind the last line, which is damaged."""
        if self._in_head and self._head:
            self._head.pop()
        self._again.extend(self._head)

    def close(self) -> None:
        """The file is its opener's."""


def _read_text(reader: Any, file: BinaryIO) -> Iterator[Piece | Damage]:
    lines, failures = _Lines(file), 0
    while failures < _HOPELESS:
        try:
            for message in reader(lines):
                failures = 0
                lines.end_head()
                yield _piece(message, lines.offset)
            return
        except Exception as error:  # each reader has its own
            failures += 1
            yield Damage(lines.offset, len(lines.line), _reason(error), lines.line.encode())
            lines.restart()
    yield Damage(lines.offset, 0, f'{_HOPELESS} bad lines without a frame: the rest is not read')


def _read_binary(reader: Any, file: BinaryIO) -> Iterator[Piece | Damage]:
    # Only these two have a place in a file; SQLite opens it by itself.
    is_stream = reader is not can.SqliteReader
    try:
        for message in reader(file if is_stream else file.name):
            yield _piece(message, file.tell() if is_stream else 0)
    except (ImportError, NotImplementedError) as error:
        raise ValueError(f'python-can cannot read this: {error}') from error
    except Exception as error:
        yield Damage(file.tell(), 0, f'the rest is not read: {_reason(error)}')


def _reason(error: Exception) -> str:
    return f'{type(error).__name__} of python-can: {" ".join(str(error).split())}'.rstrip(': ')


def _piece(message: can.Message, offset: int) -> Piece | Damage:
    return can_piece(
        offset,
        message.arbitration_id,
        bytes(message.data),
        at=message.timestamp,
        source='' if message.channel is None else str(message.channel),
        extended=message.is_extended_id,
        error=message.is_error_frame,
        remote=message.is_remote_frame,
        fd=message.is_fd,
    )
