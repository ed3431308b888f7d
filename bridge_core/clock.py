# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The one clock by which anything here is late, stale or due.

CLOCK_MONOTONIC stands still while the computer sleeps: what was heard before would still be fresh
when it wakes up. CLOCK_BOOTTIME goes on. It never steps, and all processes of a computer share it,
so that they can tell each other moments.
"""

import time


def now() -> float:
    """Return the seconds since some moment in the past, sleep of the computer included."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)
