# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""``python -m assurance.cable FD FD``: a network between two TAPs, see two_hosts.py."""

from __future__ import annotations

import contextlib
import math
import os
import select
import sys
import time

from stage.network import obey, Way

_MOST = 1 << 16  # bytes of a frame, or of what is told


def main(*taps: int) -> None:
    """Carry until the input ends. :param taps: descriptors that do not block, of both ends."""
    ways = {tap: Way(tap) for tap in taps}
    ends = dict(zip(taps, reversed(taps), strict=True))
    while True:
        due = min(way.next_arrival() for way in ways.values())
        wait = None if due == math.inf else max(0.0, due - time.monotonic())
        for file in select.select([0, *taps], [], [], wait)[0]:
            if file:
                _take(file, ways[file])
            elif told := os.read(0, _MOST):
                obey(told.splitlines()[-1], ways.values())
            else:
                return
        for tap, way in ways.items():
            for frame in way.arrived(time.monotonic()):
                with contextlib.suppress(OSError):  # the end is down
                    os.write(ends[tap], frame)


def _take(tap: int, way: Way) -> None:
    with contextlib.suppress(OSError):  # nothing more, or the end is down
        while True:
            frame = os.read(tap, _MOST)
            way.send(frame, len(frame), time.monotonic())


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
