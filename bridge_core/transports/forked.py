# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The template that wires are forked from, see template.py, and a fork, from the node's side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import contextlib
import ctypes
import os
import signal
import socket
import subprocess
import threading

from bridge_core import clock
from bridge_core.transports.started import popen, root_of
from bridge_core.transports.template import DONE, LARGEST
from bridge_core.transports.wire_process import receive
from bridge_core.waiting import ready

_TITLE = 240  # characters that a fork has room for
_LOAD_TIME = 25.0  # s; a starved machine needs most of it
_FORK_TIME = 1.0  # s, of which a fork takes some thousandths
_PR_SET_CHILD_SUBREAPER = 36


class Forked:
    """
    What a link uses of a subprocess.Popen, of a child that the template forks.

    :param answer: where it says the pid. :param late_at: when it should have.
    """

    def __init__(self, answer: socket.socket, late_at: float) -> None:
        self.pid = 0
        self.returncode = 0
        self.answer = answer
        self._late_at = late_at
        self._lock = threading.Lock()
        self._end = -1

    def is_known(self) -> bool:
        """
        Tell whether it is there, and may be waited for.

        :raises TimeoutError: the template does not fork. :raises OSError: the system does not.
        """
        while data := receive(self.answer):
            if data == DONE and self.pid > 0:
                self._end = os.pidfd_open(self.pid)
                self.answer.close()
                return True
            self.pid = 0 if data == DONE else int(data)
            if self.pid <= 0:
                break
        if self.pid < 0:
            raise OSError(-self.pid, os.strerror(-self.pid))
        if data is None and clock.now() < self._late_at:
            return False
        raise TimeoutError

    def kill(self) -> None:
        """End it, from any thread."""
        with self._lock:
            if self._end >= 0:
                signal.pidfd_send_signal(self._end, signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end. :raises subprocess.TimeoutExpired: not within so many seconds."""
        if self._end >= 0:
            if not ready([self._end], timeout):
                raise subprocess.TimeoutExpired('wire', timeout or 0.0)
            with self._lock:
                os.close(self._end)
                self._end = -1
                self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self.returncode


class Template:
    """
    The process that all wires of this process are forked from, for as long as there are links.

    One that ends, hangs or cannot be started harms nothing: wires start without, and the next
    start finds another one.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket
        self._asked: set[str] = set()  # modules
        self._loading = 0  # of them
        self._load_end = 0.0

    @contextlib.contextmanager
    def used(self) -> Iterator[Template]:
        """Keep it, once it is there."""
        with self._lock:
            self._users += 1
        try:
            yield self
        finally:
            with self._lock:
                self._users -= 1
                if not self._users:
                    self._end()

    def loads(self, program: str, module: str, rt_priority: int) -> bool:
        """Start it if there is none; tell whether it still loads, or could fork this now."""
        now = clock.now()
        with self._lock:
            try:
                if self._process is None:
                    self._start(program, module, rt_priority)
                if module not in self._asked:
                    self._socket.send(os.fsencode(f'{module}\0{root_of(module)}'))
                    self._asked.add(module)
                    self._loading += 1
                    self._load_end = now + _LOAD_TIME
                while self._loading:
                    if self._socket.recv(LARGEST, socket.MSG_DONTWAIT) != DONE:
                        raise EOFError
                    self._loading -= 1
            except BlockingIOError:
                if now < self._load_end:
                    return True
                self._end()
            except (OSError, EOFError):
                self._end()
        return False

    def _start(self, program: str, module: str, rt_priority: int) -> None:
        """:raises OSError: the system is too old, or allows no more."""
        os.close(os.pidfd_open(os.getpid()))
        if ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
            raise OSError
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs, contextlib.ExitStack() as undo:
            undo.callback(ours.close)
            arguments = [str(rt_priority), str(theirs.fileno())]
            title = 'wire template'.ljust(_TITLE)
            self._process = popen(title, program, module, arguments, [theirs.fileno()])
            undo.pop_all()
        self._socket = ours

    def fork(
        self, title: str, arguments: Sequence[str], descriptors: Sequence[int]
    ) -> Forked | None:
        """
        Have it fork the process of a wire; None: there is no template.

        :param arguments: as of start_wire. :param descriptors: those among them, in this order.
        """
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        with theirs, self._lock, contextlib.suppress(OSError):
            if self._process is not None:
                request = os.fsencode('\0'.join([title, *arguments]))
                given = [theirs.fileno(), 1, 2, *descriptors]
                socket.send_fds(self._socket, [request], given)
                wait = _LOAD_TIME if self._loading else _FORK_TIME
                return Forked(ours, clock.now() + wait)
        ours.close()
        self.end()
        return None

    def end(self) -> None:
        """End it: what it may have forked, and nobody knows, finds its socket closed."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
            self._socket.close()
        self._asked.clear()
        self._loading = 0


TEMPLATE = Template()
