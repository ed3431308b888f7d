# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The ledger's file: one writer, which only appends. A line counts once it is on the disk.

Whatever ends a write amid a line (a kill, a loss of power, a full disk), the next line names the
torn end and goes on with the chain. Nothing that was written is ever removed or written over.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
import errno
import fcntl
import os
from pathlib import Path
import time
from typing import Any

from bridge_core import clock
from bridge_core.refusals import default_folder
from rugged_teleop.ledger.chain import digest, Head, line_of, Moment, Reader, TORN

_WINDOW = 1 << 20  # bytes at the end that a start looks at, unless no line is among them
_BOOT = Path('/proc/sys/kernel/random/boot_id')


def default_file() -> Path:
    """Return where the ledger is if nobody said."""
    return default_folder() / 'ledger.jsonl'


def now() -> Moment:
    """Return the present moment."""
    boot = ''
    with suppress(OSError):
        boot = _BOOT.read_text(encoding='ascii')[:8]
    return Moment(time.time(), boot, clock.now())


def lines(path: Path, reader: Reader, since: int = 0) -> Iterator[dict[str, Any]]:
    """Yield the good lines of a ledger from a byte on. :raises OSError: it cannot be read."""
    with path.open('rb') as file:
        file.seek(since)
        for line in file:
            fields = reader.read(line)
            if fields is not None:
                yield fields


def tail(path: Path) -> tuple[Reader, list[dict[str, Any]]]:
    """Return the newest lines, and what has read them. :raises OSError: it cannot be read."""
    for since in (max(0, path.stat().st_size - _WINDOW), 0):
        reader = Reader()
        found = [*lines(path, reader, since)]
        if found or not since:
            break
    return reader, found


class Book:
    """
    :param path: its folder is made when it is needed. :param head: of the newest line.

    It opens with the first line, and again after an error, or if somebody has moved the file away.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.head = Head()
        self._file = -1
        self._end = 0  # of the file, in bytes, as this one has left it

    def append(self, moment: Moment, what: str, facts: Mapping[str, Any]) -> bytes:
        """
        Write a line and return it; it is on the disk then.

        :raises OSError: it may not be, and nobody but the next line knows.
        """
        try:
            if self._file < 0 or not self._is_in_place():
                self.close()
                self._open()
            elif os.fstat(self._file).st_size != self._end:
                self._write(b'\n')  # somebody has changed it: the chain says so, no line is lost
            return self._put(moment, what, facts)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let another process write. May be repeated."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)

    def _is_in_place(self) -> bool:
        with suppress(FileNotFoundError):
            return os.path.samestat(os.fstat(self._file), self.path.stat())
        return False

    def _open(self) -> None:
        self.path.parent.mkdir(0o750, parents=True, exist_ok=True)
        self._file = os.open(
            self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o640
        )
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OSError(errno.EAGAIN, 'another process writes it') from error
        folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
        reader, _ = tail(self.path)
        self.head = reader.head or self.head  # an empty one goes on with the one before
        self._mend(reader.rest)
        self._end = os.fstat(self._file).st_size

    def _mend(self, rest: bytes) -> None:
        """Complete a line that lacks its newline alone; name any other end that is torn."""
        if not rest:
            return
        if not rest.endswith(b'\n'):
            self._write(b'\n')
            cut = rest.rfind(b'\n') + 1
            whole = Reader(self.head, rest[:cut])
            whole.read(rest[cut:] + b'\n')
            if whole.head is not None and whole.head != self.head and not whole.faults:
                os.fsync(self._file)
                self.head = whole.head
                return
            rest += b'\n'
        self._put(now(), TORN, {'bytes': len(rest), 'sha256': digest(rest)})

    def _put(self, moment: Moment, what: str, facts: Mapping[str, Any]) -> bytes:
        line = line_of(self.head, moment, what, facts)
        self._write(line + b'\n')
        os.fsync(self._file)
        self.head = Head(self.head.number + 1, digest(line))
        self._end = os.fstat(self._file).st_size
        return line

    def _write(self, data: bytes) -> None:
        while data:
            data = data[os.write(self._file, data) :]
