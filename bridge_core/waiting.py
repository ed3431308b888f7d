# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Waiting for descriptors of any number: ``select.select`` refuses those above 1023.

The kernel counts in whole milliseconds here, so a wait may take up to 1 ms longer, never less:
a loop that waits until something is due would spin until then.
"""

from collections.abc import Iterable
import errno
import math
import os
import select

FAULT_PAUSE = 0.01  # s after a step of a loop that failed: it may have failed to wait


def ready(descriptors: Iterable[int], timeout: float | None) -> list[int]:
    """
    Return those that are readable, ended or broken, after ``timeout`` s at most; None: no limit.

    :raises OSError: one is closed. :raises ValueError: one is negative.
    """
    return _wait(descriptors, select.POLLIN, timeout)


def writable(descriptor: int, timeout: float) -> bool:
    """Wait until it takes bytes, or refuses them with an error; tell whether it does."""
    return bool(_wait([descriptor], select.POLLOUT, timeout))


def _wait(descriptors: Iterable[int], event: int, timeout: float | None) -> list[int]:
    poll = select.poll()
    for descriptor in descriptors:
        poll.register(descriptor, event)
    found = poll.poll(None if timeout is None else math.ceil(max(timeout, 0.0) * 1e3))
    if any(events & select.POLLNVAL for _, events in found):
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))
    return [descriptor for descriptor, _ in found]
