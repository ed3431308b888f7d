# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which format a file has, and its pieces."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
import os
from pathlib import Path
import shutil
import sys
from tempfile import NamedTemporaryFile
from typing import Any, BinaryIO

from rugged_teleop.decode.pcap import MAGIC, MAGIC_NG, pcap, pcapng
from rugged_teleop.decode.pieces import Damage, Piece, Recorded
from rugged_teleop.decode.texts import candump, hex_listing, is_candump, is_hex
from rugged_teleop.loaded import check_unpacked

_BLOCK = 1 << 16
_HEAD = 3840  # bytes by which a format is told; an endless line of hex is cut between two
_BEGINNINGS = {
    **dict.fromkeys(MAGIC, 'pcap'),
    MAGIC_NG: 'pcapng',
    b'\x89MCAP0\r\n': 'mcap',
    b'LOGG': 'blf',
    b'SQLite format 3\0': 'db',
    b'MDF     ': 'mf4',
    b'timestamp,arbitration_id,': 'csv',
    b';': 'trc',
    b'date ': 'asc',
}


def raw(file: BinaryIO) -> Iterator[Piece | Damage]:
    """Read bytes as they came over a line."""
    offset = 0
    while data := file.read(_BLOCK):
        yield Piece(offset, data)
        offset += len(data)


_READERS = {
    'raw': raw,
    'hex': hex_listing,
    'candump': candump,
    'pcap': pcap,
    'pcapng': pcapng,
}
STREAMS = ('raw', 'hex')  # without times, and any piece may hold a part of a frame
LOGS = ('asc', 'blf', 'csv', 'db', 'mf4', 'trc')  # python-can's
RECORDING = 'mcap'  # with what topics said beside the bytes
_NAMED = 'db'  # SQLite opens its file by itself
_SEEKING = ('blf', 'mf4', RECORDING)  # are not read from a pipe
FORMATS = (*_READERS, *LOGS, RECORDING)


@dataclass(frozen=True)
class Capture:
    """
    An open file.

    :param size: bytes; 0 where it is not known.
    :param recorded: what a recording has, in place of pieces.
    """

    name: str
    format: str
    size: int
    pieces: Iterator[Piece | Damage]
    recorded: Iterator[Piece | Damage | Recorded] = field(default_factory=lambda: iter(()))


@contextmanager
def opened(name: str, kind: str = '') -> Iterator[Capture]:
    """
    Open a capture. ``-`` is the standard input.

    :param kind: one of FORMATS; empty: by what stands in it.
    :raises OSError: it cannot be read. :raises ValueError: it is no capture that is known here.
    """
    if name == '-':
        standard: Any = sys.stdin.buffer
        kind = kind or format_of(standard.peek(_HEAD)[:_HEAD])
        copied = kind == _NAMED or (kind in _SEEKING and not standard.seekable())
        with _copy(standard) if copied else nullcontext(standard) as file:
            yield _capture('standard input', file, kind)
        return
    with Path(name).open('rb') as file:
        yield _capture(name, file, kind)


@contextmanager
def _copy(file: BinaryIO) -> Iterator[Any]:
    """Give a copy of a file that has a name. :raises ValueError: there is no room for it."""
    with NamedTemporaryFile() as copy:
        try:
            shutil.copyfileobj(file, copy)
            copy.flush()
        except OSError as error:
            with suppress(OSError):
                copy.close()  # it tries again what found no room
            raise ValueError(f'is not copied to {copy.name}: {error.strerror}') from error
        with Path(copy.name).open('rb') as file:  # some readers take no wrapper for a file
            yield file


def _capture(name: str, file: Any, kind: str) -> Capture:
    kind = kind or format_of(file.peek(_HEAD)[:_HEAD])
    size = os.fstat(file.fileno()).st_size
    if kind == RECORDING:
        try:
            from rugged_teleop.decode.recorded import mcap  # late: an extra
        except ImportError as error:
            needed = 'pip install mcap mcap-ros2-support'
            raise ValueError(f'mcap needs {needed}: {error}') from error
        return Capture(name, kind, size, iter(()), mcap(file))
    if kind not in LOGS:
        return Capture(name, kind, size, _READERS[kind](file))
    try:
        from rugged_teleop.decode.logs import read_log  # late: python-can takes a while
    except ImportError as error:
        raise ValueError(f'{kind} needs python-can (pip install python-can): {error}') from error
    return Capture(name, kind, size, read_log(kind, file))


def format_of(head: bytes) -> str:
    """Return the format of a file that begins so. :raises ValueError: it is no capture."""
    for beginning, kind in _BEGINNINGS.items():
        if head.startswith(beginning):
            return kind
    if not head:
        raise ValueError('is empty')
    check_unpacked(head)
    if any(byte not in b'\t\r\n' and not 0x20 <= byte < 0x7F for byte in head):
        return 'raw'
    lines = [line.decode() for line in head.splitlines()]
    if len(head) == _HEAD and len(lines) > 1:
        del lines[-1]  # it is cut
    for kind, fits in (('candump', is_candump), ('hex', is_hex)):
        if any(map(fits, lines)):
            return kind
    raise ValueError(
        f'is text, but no capture known here; --format is one of {", ".join(FORMATS)}'
    )
