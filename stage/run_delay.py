# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How long processes waited for a processor, by the kernel's own account."""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import os
from pathlib import Path

from stage.rig import wait_for

HELD_UP = 0.15  # s; a bridge that is held up for 0.2 s demands a stop
WIRE_HELD_UP = 0.05  # s; a wire is silent for 0.085 s then, with the 0.025 s between its beats
WIRE_HUNG = 0.3  # s, until another one takes over from it


class RunDelay:
    """
    What may be added to a bound on a reaction: the machine's share in it, measured beside it.

    It counts from the moment at which it is made, over all threads of the processes and of this
    one, and what the host of a virtual machine took from all of them. A thread that sleeps or is
    stopped by a signal waits for no processor.

    :param pids: of processes besides this one.
    """

    def __init__(self, pids: Sequence[int]) -> None:
        self._pids = {*pids, os.getpid()}
        self._before = self._waited()
        self._last = dict(self._before)
        self._stolen_before = _stolen()

    def seconds(self) -> float:
        """
        Return the sum; 0 where the kernel keeps no account.

        Of what has ended it knows only what was so when it was asked last. A wire outlives its
        node, and still counts.
        """
        self._last |= self._waited()
        waited = sum(self._last[thread] - self._before.get(thread, 0) for thread in self._last)
        return 1e-9 * waited + _stolen() - self._stolen_before

    def allowed(self, bound: float) -> float:
        """
        Return a bound (seconds) on a reaction at a wire, with what the machine may add to it.

        A wire that was held up is taken for one that hangs: then the bound on that counts.
        """
        seconds = self.seconds()
        return (bound if seconds < WIRE_HELD_UP else max(bound, WIRE_HUNG)) + seconds

    def exceeds(self, bound: float) -> bool:
        """Tell whether it is more; a wait is counted at its end, so look for another second."""
        with contextlib.suppress(AssertionError):
            return wait_for(lambda: self.seconds() > bound, 1.0)
        return False

    def _waited(self) -> dict[str, int]:
        """Return the nanoseconds of each thread (kernel: Documentation/scheduler/sched-stats)."""
        found: dict[str, int] = {}
        self._pids.update(*map(_family, self._pids))
        for pid in self._pids:
            for file in Path(f'/proc/{pid}/task').glob('*/schedstat'):
                with contextlib.suppress(OSError):  # it has ended
                    found[str(file)] = int(file.read_text().split()[1])
        return found


def _family(pid: int) -> list[int]:
    """Return a process and all below it: a node's wire waits, too."""
    found = [pid]
    for file in Path(f'/proc/{pid}/task').glob('*/children'):
        with contextlib.suppress(OSError):  # it has ended
            for child in map(int, file.read_text().split()):
                found += _family(child)
    return found


def _stolen() -> float:
    """Return the seconds that the host took, of all processors (proc(5): steal)."""
    ticks = int(Path('/proc/stat').read_text().split(maxsplit=9)[8])
    return ticks / os.sysconf('SC_CLK_TCK')
