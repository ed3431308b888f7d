# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Descriptors that whoever starts a process has closed, or left open in it."""

from collections.abc import Iterable
import contextlib
import os
import re

_NAMED = re.compile(r'/(?:dev|proc/(?:self|thread-self|\d+))/fd/(\d+)')
_FIRST_LISTENED = 3  # as of sd_listen_fds(3)


def fill_standard_descriptors() -> None:
    """Open /dev/null for each of 0, 1 and 2 that is closed: what is opened next would be it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def close_inherited_descriptors(argv: Iterable[str]) -> None:
    """
    Close what is open above 2 since before this program: a thousand leave few for its own.

    Those of systemd's sockets stay, and those that an argument or the environment names as a file.
    What this program has opened itself ends with an exec, and is told by that.
    """
    words = (*argv, *os.environ.values())
    kept = {int(number) for word in words for number in _NAMED.findall(word)}
    if os.environ.get('LISTEN_PID') == str(os.getpid()):
        with contextlib.suppress(ValueError):  # systemd writes a number, or it was not systemd
            listened = int(os.environ.get('LISTEN_FDS', ''))
            kept.update(range(_FIRST_LISTENED, _FIRST_LISTENED + listened))
    for number in {int(name) for name in os.listdir('/proc/self/fd')} - kept - {0, 1, 2}:
        with contextlib.suppress(OSError):  # that of the listing
            if os.get_inheritable(number):
                os.close(number)
