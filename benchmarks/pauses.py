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
What the machine keeps from everybody: a pulse on each core that tells when it was late.

``python benchmarks/pauses.py CORE`` is such a pulse, of `Pauses`. With real-time priority, where
that is allowed, it waits for kernel and host alone; otherwise for other work as well.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from typing import NamedTuple

_SLEEP = 0.005  # s
_LATE = 0.002  # s; shorter pauses are not told


class Pause(NamedTuple):
    """When one began (monotonic), and when it was over, in s."""

    begin: float
    end: float


class Pauses(contextlib.ExitStack):
    """Watches all cores while it is open."""

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

    def between(self, begin: float, end: float) -> float:
        """Return the seconds lost between two moments (monotonic), of the core that lost most."""
        for reading, found in self._cores:
            with contextlib.suppress(BlockingIOError):
                # As much as a pipe holds, and a pulse writes whole lines: none is cut.
                while said := os.read(reading, 1 << 16):
                    found += [Pause(*map(float, line.split())) for line in said.splitlines()]
        return max(lost(found, begin, end) for _, found in self._cores)


def lost(pauses: list[Pause], begin: float, end: float) -> float:
    """Return how much of this time is in pauses, in s."""
    return sum(max(0.0, min(end, each.end) - max(begin, each.begin)) for each in pauses)


def _pulse(core: int) -> None:
    os.sched_setaffinity(0, {core})
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    due = time.monotonic() + _SLEEP
    while True:
        time.sleep(_SLEEP)
        now = time.monotonic()
        if now - due > _LATE:
            print(f'{due:.6f} {now:.6f}', flush=True)
        due = now + _SLEEP


if __name__ == '__main__':
    _pulse(int(sys.argv[1]))
