# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a tty or a TCP connection has still to send: frames that wait there delay a stop."""

from __future__ import annotations

import contextlib
import fcntl
import math
import os
import socket
import struct
import termios
import time

from bridge_core import clock
from bridge_core.framing import BITS_PER_BYTE

_BACKLOG_LIMIT = 64  # bytes, which take 5.6 ms at 115200 baud
# A line busy for longer is blocked: at 9600 baud 64 bytes take 0.07 s.
STALL_TIMEOUT = 0.5  # s
STALLED = f'took no bytes for {STALL_TIMEOUT * 1e3:.0f} ms'
_DRAIN_TIMEOUT = 0.05  # s
_SIOCOUTQNSD = 0x894B  # linux/sockios.h: as TIOCOUTQ, less what was sent but not acknowledged
_TCP_USER_TIMEOUT_MS = 2000


class Line:
    """
    The kernel's end of a port.

    :param fd: of a tty or a TCP connection, which stays open; -1: nobody knows what waits.
    """

    def __init__(self, fd: int = -1) -> None:
        self.fd = fd
        self.is_tty = fd >= 0 and os.isatty(fd)
        self._busy_since = math.inf
        self._written = 0  # bytes since nothing waited
        if fd >= 0 and not self.is_tty:
            _set_tcp_options(fd)

    def wrote(self, size: int) -> None:
        """Note that so many bytes were given to it."""
        self._written += size

    def busy_since(self) -> float:
        """Return since when too many bytes wait; math.inf: they do not. :raises OSError: gone."""
        waiting = self.backlog()
        if not waiting:
            self._written = 0
        # cdc_acm counts whole buffers of its own: 1280 bytes for a frame of 8.
        if min(waiting, self._written) <= _BACKLOG_LIMIT:
            self._busy_since = math.inf
        else:
            self._busy_since = min(self._busy_since, clock.now())
        return self._busy_since

    def backlog(self) -> int:
        """Return how many bytes wait. :raises OSError: it is gone, or cannot tell."""
        return self._count(termios.TIOCOUTQ if self.is_tty else _SIOCOUTQNSD)

    def unread(self) -> int:
        """Return how many bytes have come, and nobody has read. :raises OSError: it is gone."""
        return self._count(termios.FIONREAD)

    def _count(self, request: int) -> int:
        if self.fd < 0:
            return 0
        (count,) = struct.unpack('i', fcntl.ioctl(self.fd, request, b'\0' * 4))
        return int(count)

    def discard(self) -> None:
        """Discard what waits, which only a tty can. On a pty, also what its peer has not read."""
        if self.is_tty:
            with contextlib.suppress(termios.error):  # unplugged
                termios.tcflush(self.fd, termios.TCOFLUSH)

    def drain(self, baud: float = math.inf) -> None:
        """
        Wait for queued bytes to leave, as the last of them stop the device; discard what does not.

        For as long as they take at ``baud`` and 50 ms more: close alone could block for 30 s.
        """
        with contextlib.suppress(OSError):  # unplugged: nothing to drain
            takes = min(self.backlog(), self._written) * BITS_PER_BYTE / baud
            end = clock.now() + takes + _DRAIN_TIMEOUT
            while self.backlog() and clock.now() < end:
                time.sleep(0.001)
            if self.backlog():
                self.discard()


def _set_tcp_options(fd: int) -> None:
    """Make a TCP connection send small frames at once and detect a lost peer."""
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(fd)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _TCP_USER_TIMEOUT_MS)
