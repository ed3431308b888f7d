# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A process that a node starts to run its wire, and the node's end of the socket to it."""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import os
import signal
import socket
import subprocess

from bridge_core.transports.forked import Forked, Template
from bridge_core.transports.started import popen
from bridge_core.transports.wire_process import KNOWN, receive

_ROOM = 1 << 20  # bytes, for messages to it; the system may allow less


class Child:
    """
    One that runs the wire, or a spare.

    :param socket: to it; neither end waits for the other.
    """

    def __init__(self, process: subprocess.Popen[bytes] | Forked, socket: socket.socket) -> None:
        self.process = process
        self.socket = socket

    @classmethod
    def start(
        cls,
        title: str,
        program: str,
        module: str,
        rt_priority: int,
        reconnect_period: float,
        descriptors: Sequence[int],
        template: Template | None,
    ) -> Child:
        """
        Start one; the arguments are those of start_wire.

        :param title: for whoever lists the processes. :param module: as of Bridge.
        :param descriptors: TAP and so on. :raises OSError: the system allows no more.
        """
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs, contextlib.ExitStack() as undo:
            undo.callback(ours.close)
            ours.setblocking(False)
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
            given = [theirs.fileno(), *(each for each in descriptors if each >= 0)]
            words = [rt_priority, theirs.fileno(), module, reconnect_period, *descriptors]
            arguments = [*map(str, words)]
            forked = template.fork(title, arguments, given) if template else None
            process = forked or popen(title, program, module, arguments, given)
            undo.pop_all()
        return cls(process, ours)

    def fileno(self) -> int:
        """Return what becomes readable with its next word, or while it is not known its pid."""
        if isinstance(self.process, Forked) and self.process.answer.fileno() >= 0:
            return self.process.answer.fileno()
        return self.socket.fileno()

    def is_known(self) -> bool:
        """Tell whether it is there, as it is told, too. :raises OSError: as of Forked."""
        if isinstance(self.process, Forked) and not self.process.is_known():
            return False
        with contextlib.suppress(OSError):  # it has just ended
            self.socket.send(KNOWN)
        return True

    def drop(self) -> None:
        """Have one end that may be there, and is not known."""
        self.socket.close()
        if isinstance(self.process, Forked):
            self.process.answer.close()

    def receive(self) -> bytes | None:
        """Return what it says next, without waiting; empty: it has ended; None: nothing."""
        return receive(self.socket)

    def end(self, timeout: float) -> None:
        """Have it end; one that takes longer than ``timeout`` s is killed, at 0 unasked."""
        if timeout > 0.0:
            self.ends(timeout)
        self.process.kill()
        self.process.wait()
        self.socket.close()

    def ends(self, timeout: float) -> bool:
        """Have it end; tell whether it has within ``timeout`` s, farewell included."""
        self.socket.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.process.wait(timeout) == 0
        return False

    def pidfd(self) -> int:
        """Return a descriptor of the process; -1 where the kernel has none."""
        with contextlib.suppress(OSError):
            return os.pidfd_open(self.process.pid)
        return -1

    def cause(self) -> str:
        """Return how it has ended, in words."""
        code = self.process.returncode
        if code >= 0:
            return f'ended with {code}'
        with contextlib.suppress(ValueError):  # a real-time signal has no name
            return f'was killed by {signal.Signals(-code).name}'
        return f'was killed by signal {-code}'
