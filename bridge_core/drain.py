# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Copies standard input to standard output, and drops what a blocked output has no room for.

A process of its own, run by output.py: it may wait for a terminal, a node may not. It imports
nothing of the package, so that it is there within some milliseconds.
"""

from __future__ import annotations

from collections import deque
import os
import select
import sys
import threading

_ROOM = 1 << 18  # bytes that wait for the output
_CHUNK = 1 << 16
_LAST_TIME = 0.5  # s, that the output may take once the input has ended


class Drain:
    """Reads in one thread, writes in another."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._waiting: deque[bytes] = deque()
        self._size = 0
        self._lost_lines = 0
        self._ended = False

    def read(self) -> None:
        """Take the input until its end."""
        while data := os.read(sys.stdin.fileno(), _CHUNK):
            with self._news:
                self._put(data)
                self._news.notify()
        with self._news:
            self._ended = True
            self._news.notify()

    def write(self) -> None:
        """Put it out until there is no more, or the output has gone."""
        try:
            while data := self._take():
                _write(data)
                with self._news:
                    self._size -= len(data)
        except OSError:
            return

    def _put(self, data: bytes) -> None:
        if self._size + len(data) > _ROOM:
            self._lost_lines += data.count(b'\n')
            return
        self._note_loss()
        self._waiting.append(data)
        self._size += len(data)

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


def _write(data: bytes) -> None:
    while data:
        try:
            data = data[os.write(sys.stdout.fileno(), data) :]
        except BlockingIOError:  # whoever shares the terminal has made it so
            select.select([], [sys.stdout.fileno()], [])


def main() -> None:
    """Run until the end of the input; the output may take a while longer."""
    drain = Drain()
    writer = threading.Thread(target=drain.write, daemon=True)
    writer.start()
    drain.read()
    writer.join(_LAST_TIME)
    os._exit(0)  # the writer may be blocked


if __name__ == '__main__':
    main()
