# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the machine, and the measuring process itself, keep from what they should do: pulses.

A pulse sleeps, and tells when it was late. There is one on each core, ``python
assurance/pauses.py CORE``: with real-time priority, where that is allowed, it waits for kernel
and host alone, otherwise for other work as well. One more is a thread of this process, and waits
for what its other threads hold, as each simulated device does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
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
        self._found: list[list[Pause]] = []  # by pulse
        for core in sorted(os.sched_getaffinity(0)):
            command = [sys.executable, '-S', __file__, str(core)]
            pulse = self.enter_context(
                subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            )
            assert pulse.stdout is not None
            self._collect(_told(pulse.stdout))
            self.callback(pulse.kill)
        ended = threading.Event()
        self._collect(_pulse(ended.is_set))
        self.callback(ended.set)

    def _collect(self, pulse: Iterator[Pause]) -> None:
        """Take its pauses, in a thread that ends with it."""
        found: list[Pause] = []

        def collect() -> None:
            for pause in pulse:
                found.append(pause)

        self._found.append(found)
        thread = threading.Thread(target=collect, name='pulse')
        thread.start()
        self.callback(thread.join)

    def between(self, begin: float, end: float) -> float:
        """Return the seconds lost between two moments (monotonic), where most was."""
        return max(lost(found, begin, end) for found in self._found)


def lost(pauses: list[Pause], begin: float, end: float) -> float:
    """Return how much of this time is in pauses, in s."""
    return sum(max(0.0, min(end, each.end) - max(begin, each.begin)) for each in pauses)


def _pulse(is_over: Callable[[], bool] = lambda: False) -> Iterator[Pause]:
    """Yield the pauses, each as soon as it is over."""
    while not is_over():
        due = time.monotonic() + _SLEEP
        time.sleep(_SLEEP)
        now = time.monotonic()
        if now - due > _LATE:
            yield Pause(due, now)


def _told(lines: Iterable[str]) -> Iterator[Pause]:
    """Yield what a pulse has written."""
    for line in lines:
        yield Pause(*map(float, line.split()))


def main(core: int) -> None:
    """Be the pulse of a core, and write its pauses."""
    os.sched_setaffinity(0, {core})
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    for pause in _pulse():
        print(*pause, flush=True)


if __name__ == '__main__':
    main(int(sys.argv[1]))
