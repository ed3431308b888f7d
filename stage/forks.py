# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Nodes that begin in a process which has imported ROS already: that is half of a node's start.

``python -m stage.forks SOCKET`` is that process. Each node is a fork of it, with a session,
an environment and descriptors of its own, that runs what ``python -m`` or ``-c`` would: all of
this package is imported anew. What a start from nothing takes is tested where commands are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import contextlib
import ctypes
import gc
import importlib
import json
import os
from pathlib import Path
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from typing import Any

_ROOT = Path(__file__).resolve().parents[1]
# Only what is not ours: a node that forgets to import a module of ours has to fail.
_IMPORTED = (
    *('rclpy', 'rclpy.lifecycle', 'rclpy.executors', 'rclpy.parameter', 'yaml', 'serial'),
    *('builtin_interfaces.msg', 'diagnostic_msgs.msg', 'geometry_msgs.msg', 'rcl_interfaces.msg'),
    *('lifecycle_msgs.msg', 'lifecycle_msgs.srv', 'rcl_interfaces.srv', 'rosgraph_msgs.msg'),
    *('sensor_msgs.msg', 'std_msgs.msg', 'std_srvs.srv', 'type_description_interfaces.srv'),
)
_BY_INTERPRETER = ('PYTHONPATH', 'PYTHONHOME', 'LD_LIBRARY_PATH', 'LD_PRELOAD')
_ENVIRONMENT = {
    'PYTHONUNBUFFERED': '1',
    'OPENBLAS_NUM_THREADS': '1',
    # lttng-ust looks at its threads as a process ends, and a fork has none of them: keep what the
    # C library remembers of threads mapped.
    'GLIBC_TUNABLES': 'glibc.pthread.stack_cache_size=1073741824',
}
_PR_SET_PDEATHSIG = 1
_REQUEST = 1 << 17  # bytes; an environment has some thousand


class ForkedProcess:
    """
    What a test uses of a subprocess.Popen, of a fork.

    :param command: what would follow ``python``, from -m or -c on.
    :param stdout: a descriptor, for errors, too.
    """

    def __init__(self, server: Server, command: Sequence[str], stdout: int) -> None:
        self.args = [*command]
        self._server = server
        request = {
            'command': self.args,
            'environment': dict(os.environ),
            'priority': os.getpriority(os.PRIO_PROCESS, 0),
        }
        self.pid = server.ask(request, stdout)
        self._ended = os.pidfd_open(self.pid)
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit status, negative after a signal; None while it runs."""
        return self._wait(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end. :raises subprocess.TimeoutExpired: not within so many seconds."""
        status = self._wait(timeout)
        if status is None:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        return status

    def _wait(self, timeout: float | None) -> int | None:
        if self.returncode is None and select.select([self._ended], [], [], timeout)[0]:
            self.returncode = self._server.ask({'reap': self.pid})
            os.close(self._ended)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it."""
        self.send_signal(signal.SIGKILL)


class Server:
    """
    The process that forks, from the side of who asks.

    :param command: what to put before its own, so that it ends with us.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._lock = threading.Lock()
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._environment = _of_interpreter(os.environ)
        with theirs:
            self._process = subprocess.Popen(
                [*command, sys.executable, '-m', 'stage.forks', str(theirs.fileno())],
                cwd=_ROOT,
                env={**os.environ, **_ENVIRONMENT},
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )

    def serves(self) -> bool:
        """Tell whether a process that starts now has the interpreter's settings of a fork."""
        return _of_interpreter(os.environ) == self._environment

    def ask(self, request: Mapping[str, Any], *descriptors: int) -> int:
        """Send a request; return the number that answers it."""
        with self._lock:
            socket.send_fds(self._socket, [json.dumps(request).encode()], descriptors)
            return int(self._socket.recv(_REQUEST))


def _of_interpreter(environment: Mapping[str, str]) -> list[str | None]:
    return [environment.get(name) for name in _BY_INTERPRETER]


def serve(client: socket.socket) -> list[str]:
    """Fork at each request; return in the fork, with what it is to run."""
    while True:
        data, descriptors, _, _ = socket.recv_fds(client, _REQUEST, 1)
        if not data:
            raise SystemExit(0)
        request = json.loads(data)
        if pid := request.get('reap'):
            status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
            client.send(str(status).encode())
            continue
        server = os.getpid()
        if pid := os.fork():
            for each in descriptors:
                os.close(each)
            client.send(str(pid).encode())
            continue
        client.close()
        _settle(server, descriptors[0], request)
        return [str(word) for word in request['command']]


def _settle(server: int, output: int, request: Mapping[str, Any]) -> None:
    """Be a process of one's own that ends with the server."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != server:
        raise SystemExit(1)
    os.setsid()
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, request['priority'])
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.close(output)
    os.environ.clear()
    os.environ.update(request['environment'])
    time.tzset()


def main() -> None:
    """Import, with what carries each message, then serve."""
    for name in _IMPORTED:
        for kind in vars(importlib.import_module(name)).values():
            if hasattr(kind, '__import_type_support__'):
                kind.__import_type_support__()
    gc.collect()
    gc.freeze()
    sys.argv[:] = serve(socket.socket(fileno=int(sys.argv[1])))
    if sys.argv[0] == '-m':
        del sys.argv[0]
        runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)
    else:
        exec(sys.argv.pop(1), {'__name__': '__main__'})


if __name__ == '__main__':
    main()
