# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Copies standard input to standard output and to a log file, and drops what one has no room for.

usage: drain.py [LOG_FILE]

A process of its own, run by output.py: it may wait for a terminal or a disk, a node may not. It
imports nothing of the package, so that it is there within some milliseconds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import os
import re
import select
import sys
import threading

_ROOM = 1 << 18  # bytes that wait for an output
_CHUNK = 1 << 16
_LAST_TIME = 0.5  # s, that the outputs may take once the input has ended
_COLOUR = re.compile(rb'\x1b\[[0-9;]*m')


class Output:
    """
    A queue for one output, and the thread that empties it.

    :param open_it: returns its descriptor; may take as long as it likes.
    :param plain: leave colours out.
    """

    def __init__(self, open_it: Callable[[], int], *, plain: bool = False) -> None:
        self._open_it = open_it
        self._plain = plain
        self._news = threading.Condition()
        self._waiting: deque[bytes] = deque()
        self._size = 0
        self._lost_lines = 0
        self._ended = False
        self.thread = threading.Thread(target=self._write, daemon=True)
        self.thread.start()

    def put(self, data: bytes) -> None:
        """Take more to be put out, if there is room."""
        with self._news:
            if self._size + len(data) > _ROOM:
                self._lost_lines += data.count(b'\n')
                return
            self._note_loss()
            self._waiting.append(data)
            self._size += len(data)
            self._news.notify()

    def end(self) -> None:
        """Take nothing more."""
        with self._news:
            self._ended = True
            self._news.notify()

    def _write(self) -> None:
        """Put it out until there is no more, or the output has gone."""
        try:
            descriptor = self._open_it()
            while data := self._take():
                _write(descriptor, _COLOUR.sub(b'', data) if self._plain else data)
                with self._news:
                    self._size -= len(data)
        except OSError:
            return

    def _take(self) -> bytes:
        with self._news:
            self._news.wait_for(lambda: self._waiting or self._lost_lines or self._ended)
            if not self._waiting:
                self._note_loss()
            return self._waiting.popleft() if self._waiting else b''

    def _note_loss(self) -> None:
        if self._lost_lines:
            note = f'[{self._lost_lines} lines are missing here: the output was blocked]\n'
            self._lost_lines = 0
            self._waiting.append(note.encode())
            self._size += len(note)


def _write(descriptor: int, data: bytes) -> None:
    while data:
        try:
            data = data[os.write(descriptor, data) :]
        except BlockingIOError:  # whoever shares the terminal has made it so
            poll = select.poll()
            poll.register(descriptor, select.POLLOUT)
            poll.poll()


def main() -> None:
    """Run until the end of the input; the outputs may take a while longer."""
    shown = Output(sys.stdout.fileno)
    outputs = [shown]

    def open_log() -> int:
        path = sys.argv[1]
        try:
            os.makedirs(os.path.dirname(path), exist_ok=True)
            return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
        except OSError as error:
            shown.put(f'[no log file: {path}: {error.strerror}]\n'.encode())
            raise

    if sys.argv[1:]:
        outputs.append(Output(open_log, plain=True))
    while data := os.read(sys.stdin.fileno(), _CHUNK):
        for output in outputs:
            output.put(data)
    for output in reversed(outputs):  # the file first: what is shown last is why there is none
        output.end()
        output.thread.join(_LAST_TIME)
    os._exit(0)  # a writer may be blocked


if __name__ == '__main__':
    main()
