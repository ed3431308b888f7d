# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ledger's thread: it writes beside whoever says what happened, and waits for a full disk."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import math
import os
from pathlib import Path
import queue
import threading
from typing import Any

from bridge_core import clock
from bridge_core.thread_name import show_thread
from rugged_teleop.ledger.book import Book, now
from rugged_teleop.ledger.chain import Moment

_AGAIN = 1.0  # s, from one attempt to the next
_HANGS = 5.0  # s, after which an anchor that has not answered counts as gone
_WAITING = 10_000  # lines that a full disk may leave waiting
_Line = tuple[Moment, str, dict[str, Any]]


class Anchor:
    """
    Where the newest head is written, too: number, SHA-256 and time, a line each.

    A thread of its own does it, so that a file server that hangs holds up no line of the ledger.

    :param path: a file, a pipe or a serial printer.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._newest, self._error = path, '', ''
        self._busy_since = math.inf
        self._news = threading.Event()
        threading.Thread(target=self._run, name='ledger anchor', daemon=True).start()

    @property
    def error(self) -> str:
        """Why the newest head is not there; empty: it is, or will be at once."""
        if clock.now() - self._busy_since > _HANGS:
            return f'no answer: {self._path}'
        return self._error

    def say(self, text: str) -> None:
        """Write this, unless something newer comes first; again until it is written."""
        self._newest = text
        self._news.set()

    def _run(self) -> None:
        show_thread('ledger anchor')
        torn = ''
        while self._news.wait():
            self._news.clear()
            self._busy_since = clock.now()
            try:
                self._write(f'{torn}{self._newest}\n'.encode())
                self._error = torn = ''
            except OSError as error:
                self._error, torn = f'{error.strerror}: {self._path}', '\n'
            self._busy_since = math.inf
            if self._error:
                self._news.wait(_AGAIN)
                self._news.set()

    def _write(self, data: bytes) -> None:
        """Append a line. :raises OSError: it is not, or not all of it."""
        # A pipe that nobody reads is an error then, and holds nobody up.
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOCTTY | os.O_NONBLOCK
        file = os.open(self._path, flags, 0o640)
        try:
            while data:
                data = data[os.write(file, data) :]
        finally:
            os.close(file)


class LedgerWriter:
    """
    :param counts: is called in this thread with each line that is on the disk.
    :param anchor: None: there is none.
    """

    def __init__(self, path: Path, anchor: Path | None, counts: Callable[[str], None]) -> None:
        self.error = ''
        self.lost = 0  # lines, since too many waited
        self.book = Book(path)
        self.anchor = None if anchor is None else Anchor(anchor)
        self._counts = counts
        self._lines: queue.Queue[_Line | None] = queue.Queue(_WAITING)
        self._counting = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name='ledger', daemon=True)
        self._thread.start()

    def note(self, what: str, **facts: Any) -> None:
        """Have a line written. It may be called in any thread, and does not wait."""
        try:
            self._lines.put_nowait((now(), what, facts))
        except queue.Full:
            with self._counting:
                self.lost += 1

    def stop(self, timeout: float) -> None:
        """Have written what waits, and the thread end; wait up to ``timeout`` s."""
        self._ended.set()
        with suppress(queue.Full):  # its disk is full, too
            self._lines.put_nowait(None)
        self._thread.join(timeout)

    def _run(self) -> None:
        show_thread('ledger')
        while (line := self._lines.get()) is not None:
            while not self._is_written(*line):
                if self._ended.wait(_AGAIN):
                    return
        self.book.close()

    def _is_written(self, moment: Moment, what: str, facts: dict[str, Any]) -> bool:
        try:
            if self.lost:
                lost = self.lost
                self.book.append(now(), 'lost lines', {'count': lost})
                with self._counting:  # there may be more by now
                    self.lost -= lost
            line = self.book.append(moment, what, facts)
        except OSError as error:
            self.error = f'{error.strerror}: {self.book.path}'
            return False
        self.error = ''
        self._counts(line.decode())
        if self.anchor is not None:
            number, digest = self.book.head
            self.anchor.say(f'{number} {digest} {moment.at:.3f}')
        return True
