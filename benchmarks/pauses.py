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
What the machine, and the measuring process itself, keep from what they should do: pulses.

A pulse sleeps, and tells when it was late. There is one on each core, ``python
benchmarks/pauses.py CORE``: with real-time priority, where that is allowed, it waits for kernel
and host alone, otherwise for other work as well. One more is a thread of this process, and waits
for what its other threads hold, as each simulated device does.
"""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Iterator
import contextlib
import os
import subprocess
import sys
import threading
import time
from typing import NamedTuple

_SLEEP = 0.005  # s
_LATE = 0.002  # s; shorter pauses are not told


class Pause(NamedTuple):
    """When one began (monotonic), and when it was over, in s."""

    begin: float
    end: float


class Pauses(contextlib.ExitStack):
    """Watches all cores and this process while it is open."""

    def __init__(self) -> None:
        super().__init__()
        self._cores: list[tuple[int, list[Pause]]] = []
        for core in sorted(os.sched_getaffinity(0)):
            reading, writing = os.pipe()
            self.callback(os.close, reading)
            command = [sys.executable, '-S', __file__, str(core)]
            pulse = self.enter_context(subprocess.Popen(command, stdout=writing))
            self.callback(pulse.kill)
            os.close(writing)
            os.set_blocking(reading, False)
            self._cores.append((reading, []))
        self._own: list[Pause] = []
        ended = threading.Event()
        thread = threading.Thread(target=self._watch, args=(ended.is_set,), name='pulse')
        self.callback(thread.join)
        self.callback(ended.set)
        thread.start()

    def _watch(self, is_over: Callable[[], bool]) -> None:
        for pause in _pulse(is_over):
            self._own.append(pause)

    def between(self, begin: float, end: float) -> float:
        """Return the seconds lost between two moments (monotonic), where most was."""
        for reading, found in self._cores:
            with contextlib.suppress(BlockingIOError):
                # As much as a pipe holds, and a pulse writes whole lines at once: none is cut.
                while said := os.read(reading, 1 << 16):
                    found += [Pause(*map(float, line.split())) for line in said.splitlines()]
        pulses = (self._own[:], *(found for _, found in self._cores))
        return max(lost(found, begin, end) for found in pulses)


def lost(pauses: list[Pause], begin: float, end: float) -> float:
    """Return how much of this time is in pauses, in s."""
    return sum(max(0.0, min(end, each.end) - max(begin, each.begin)) for each in pauses)


def _pulse(is_over: Callable[[], bool] = lambda: False) -> Iterator[Pause]:
    """Yield the pauses, each as soon as it is over."""
    due = time.monotonic() + _SLEEP
    while not is_over():
        time.sleep(_SLEEP)
        now = time.monotonic()
        if now - due > _LATE:
            yield Pause(due, now)
        due = now + _SLEEP


def main(core: int) -> None:
    """Be the pulse of a core, and write its pauses."""
    os.sched_setaffinity(0, {core})
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    for pause in _pulse():
        os.write(1, f'{pause.begin} {pause.end}\n'.encode())  # print may write it in parts


if __name__ == '__main__':
    main(int(sys.argv[1]))
