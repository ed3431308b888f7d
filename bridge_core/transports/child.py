# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A process that a node starts to run its wire, and the node's end of the socket to it."""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import os
from pathlib import Path
import signal
import socket
import subprocess
import sys

from bridge_core.transports.wire_process import receive

_ROOM = 1 << 20  # bytes, for messages to it; the system may allow less


class Child:
    """
    One that runs the wire, or a spare.

    :param socket: to it; neither end waits for the other.
    """

    def __init__(self, process: subprocess.Popen[bytes], socket: socket.socket) -> None:
        self.process = process
        self.socket = socket

    @classmethod
    def start(
        cls,
        title: str,
        program: str,
        module: str,
        arguments: Sequence[str],
        descriptors: Sequence[int],
    ) -> Child:
        """
        Start one; it is told the descriptor of its end, the module and the arguments.

        :param title: for whoever lists the processes. :param module: as of Bridge.
        :param descriptors: that it gets besides. :raises OSError: the system allows no more.
        """
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs, contextlib.ExitStack() as undo:
            undo.callback(ours.close)
            ours.setblocking(False)
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
            process = subprocess.Popen(
                [title, '-S', '-m', program, str(theirs.fileno()), module, *arguments],
                executable=sys.executable,
                pass_fds=[theirs.fileno(), *descriptors],
                stdin=subprocess.DEVNULL,
                env=environment(module),
                start_new_session=True,  # the terminal's signals are the node's business
            )
            undo.pop_all()
        return cls(process, ours)

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


def environment(module: str) -> dict[str, str]:
    """
    Return the environment in which ``python -S -m`` finds what this process has imported.

    Without the module ``site`` it starts sooner and takes less memory. Its own name is no path
    that would lead it to its libraries.
    """
    roots = [
        str(Path(sys.modules[name].__file__ or '').parents[name.count('.')])
        for name in (__name__, module)
    ]
    path = [*roots, *(folder or os.getcwd() for folder in sys.path)]
    return {
        **os.environ,
        'PYTHONHOME': f'{sys.base_prefix}:{sys.base_exec_prefix}',
        'PYTHONPATH': os.pathsep.join(dict.fromkeys(path)),
        'PYTHONSAFEPATH': '1',  # from Python 3.11: nothing from where the node was started
    }
