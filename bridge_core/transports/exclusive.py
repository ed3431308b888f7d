# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One program at a time has a tty, by whatever device node: a lock is one of the node alone.

A container has a node of its own for a device of the host, so no lock of the one holds in the
other. The exclusive mode of the tty (tty_ioctl(4)) does. It refuses all but root at ``open``; root
is told by ``is_exclusive``. The kernel ends it as the last descriptor is closed.
"""

from collections.abc import Iterator
import contextlib
import errno
import fcntl
import os
import socket
import stat
import struct
import termios
from urllib.parse import urlsplit

from bridge_core.transports.serial_name import is_network

_TIOCGEXCL = 0x80045440  # asm-generic/ioctls.h: _IOR('T', 0x40, int)
PTY_MAJORS = range(136, 144)  # no node of another one's; their mode outlasts who has set it


def is_exclusive(fd: int) -> bool:
    """Tell whether somebody has a tty alone."""
    with contextlib.suppress(OSError):
        return bool(struct.unpack('i', fcntl.ioctl(fd, _TIOCGEXCL, bytes(4)))[0])
    return False


@contextlib.contextmanager
def refused_if_taken(path: str) -> Iterator[None]:
    """
    Look before the line is set up, which would disturb who has it alone.

    What looks stays open until all is done: a last close would let go of the modem lines.

    :raises OSError: another program has it alone.
    """
    with contextlib.ExitStack() as held:
        if _is_tty_with_mode(path):
            fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
            held.callback(os.close, fd)
            if is_exclusive(fd):
                raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
        yield


def _is_tty_with_mode(path: str) -> bool:
    with contextlib.suppress(OSError, ValueError):
        status = os.stat(path)
        return stat.S_ISCHR(status.st_mode) and os.major(status.st_rdev) not in PTY_MAJORS
    return False


def take(fd: int) -> None:
    """Have a tty alone from now on. :raises OSError: another program has it alone."""
    if os.major(os.fstat(fd).st_rdev) in PTY_MAJORS:
        return
    if is_exclusive(fd):
        raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
    with contextlib.suppress(OSError):  # no tty
        fcntl.ioctl(fd, termios.TIOCEXCL)


def give_back(fd: int) -> None:
    """Let others have it, whoever else keeps it open."""
    if os.major(os.fstat(fd).st_rdev) not in PTY_MAJORS:
        with contextlib.suppress(OSError):
            fcntl.ioctl(fd, termios.TIOCNXCL)


def claim(name: str) -> contextlib.ExitStack:
    """
    Claim a serial server, if this names one, for this process: a device file has a lock instead.

    Others on this computer are kept out, as far as they ask, by whatever name they call it; a
    server's clients elsewhere are not.

    :raises OSError: another one has it, or nobody knows its name.
    """
    with contextlib.ExitStack() as claims:
        if is_network(name):
            url = urlsplit(name)
            found = socket.getaddrinfo(url.hostname, url.port, type=socket.SOCK_STREAM)
            for address in {each[4][0] for each in found}:
                claimed = claims.enter_context(socket.socket(socket.AF_UNIX))
                claimed.bind(f'\0rugged_teleop/{address}:{url.port}')
        return claims.pop_all()
