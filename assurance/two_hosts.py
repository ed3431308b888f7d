# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The machine on two computers: network namespaces, and a network between them that may be bad.

VSC bridge, mux and whoever looks on are on one of them, the drive node is on the other. It takes
the right to make namespaces, which root has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
import ctypes
import fcntl
import os
from pathlib import Path
import struct
import subprocess
import threading
from typing import Any

from assurance.benchmarks.rig import UnavailableError
from assurance.machine import Machine, Setting
from stage.devices import DRIVE
from stage.network import NetworkProcess
from stage.rig import Observer

_CLONE_NEWNET = 0x40000000  # linux/sched.h
_TUNSETIFF, _TUNSETCARRIER = 0x400454CA, 0x400454E2  # linux/if_tun.h
_TAP = 0x1002  # IFF_TAP, without a header of its own
_OURS, _THEIRS = 'cable0', 'cable1'


class Cable:
    """
    A second host, and a network to it from this one, which is this thread and what it starts.

    Both have no other network. Make it before anything of ROS, which looks for networks once.

    :raises UnavailableError: namespaces or TAPs are not allowed.
    """

    def __init__(self) -> None:
        self._there = ThreadPoolExecutor(1)
        _leave_network()
        self.there(_leave_network)
        for name in ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE'):
            os.environ.pop(name, None)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
        os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'  # shared memory is no network
        self._taps = [_tap(_OURS), self.there(_tap, _THEIRS)]
        self.network = NetworkProcess('assurance.cable', *map(str, self._taps), files=self._taps)
        _ip('address', 'add', '10.74.0.1/24', 'dev', _OURS)
        self.there(_ip, 'address', 'add', '10.74.0.2/24', 'dev', _THEIRS)
        self.join()

    def there(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call it in the other host's thread."""
        return self._there.submit(function, *arguments).result()

    def cut(self) -> None:
        """Cut the cable: both ends lose their carrier."""
        self._carry(False)

    def join(self) -> None:
        """Plug it in, and have it sound."""
        self.network.set()
        self._carry(True)
        _connect(_OURS)
        self.there(_connect, _THEIRS)

    def _carry(self, is_joined: bool) -> None:
        for tap in self._taps:
            fcntl.ioctl(tap, _TUNSETCARRIER, struct.pack('i', is_joined))


class TwoHosts(Machine):
    """:param cable: made by the thread that makes this."""

    def __init__(self, cable: Cable, folder: Path, observer: Observer, setting: Setting) -> None:
        self.cable = cable
        super().__init__(folder, observer, setting)

    def start(self, name: str, module: str, parameters: Any, arguments: Iterable[str]) -> None:
        """Start a node on its host."""
        where = self.cable.there if name == DRIVE else _here
        where(super().start, name, module, parameters, arguments)

    def mend(self) -> None:
        """Have everything sound."""
        self.cable.join()
        super().mend()


def _here(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


def _leave_network() -> int:
    """Give this thread a network with nothing but a loopback; return the thread's id."""
    if ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWNET):
        raise UnavailableError(f'no network namespaces: {os.strerror(ctypes.get_errno())}')
    _connect('lo')
    return threading.get_native_id()


def _tap(name: str) -> int:
    """Return an end of the cable: who reads there has what this thread's network sends."""
    try:
        tap = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(tap, _TUNSETIFF, struct.pack('16sH22x', name.encode(), _TAP))
    except OSError as error:
        raise UnavailableError(f'no TAP: {error}') from error
    return tap


def _connect(name: str) -> None:
    _ip('link', 'set', name, 'up')
    _ip('route', 'replace', '224.0.0.0/4', 'dev', name)


def _ip(*arguments: str) -> None:
    subprocess.run(['ip', *arguments], check=True, capture_output=True, timeout=10.0)
