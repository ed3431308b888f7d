# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
When a file of tests may begin, so that many at once do not starve each other's nodes.

Nodes that get no processor stop, as they should; then their tests wait and repeat, and starve the
others the more.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
import socket
import threading
import time

_QUEUE = 2.0  # processes, running and waiting, for each processor
_SAMPLES, _STEP = 20, 0.025  # s
_SETTLE = 5.0  # s, until many nodes have started
_PATIENCE = 240.0  # s; then it begins all the same


def admit(many: bool) -> None:
    """
    Wait until the processors have time; one process after the other does.

    :param many: the file runs many nodes, so the next one waits until they show.
    """
    end = time.monotonic() + _PATIENCE
    turn = socket.socket(socket.AF_UNIX)
    while time.monotonic() < end:
        with contextlib.suppress(OSError):  # it is another one's turn
            turn.bind(f'\0rugged_teleop_admission_{os.getuid()}')
            break
        time.sleep(_STEP)
    while _queue() > _QUEUE * (os.cpu_count() or 1) and time.monotonic() < end:
        pass
    if not many:
        turn.close()
        return
    ends = threading.Timer(_SETTLE, turn.close)
    ends.daemon = True
    ends.start()


def _queue() -> float:
    """Return how many processes run or want to, beside this one; the mean of half a second."""
    found = 0
    for _ in range(_SAMPLES):
        time.sleep(_STEP)
        found += int(Path('/proc/loadavg').read_text().split()[3].partition('/')[0]) - 1
    return found / _SAMPLES
