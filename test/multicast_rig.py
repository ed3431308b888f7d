"""What multicast tests share: own ports, own networks, a simulator on the network."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import ctypes
import os
import select
import socket
import subprocess
import threading
import time
from typing import Any

import pytest

from bridge_core.transports.multicast import MulticastTransport

GROUP = '239.255.42.20'
LOOPBACK = '127.0.0.1'
_CLONE_NEWNET = 0x40000000  # linux/sched.h
_LONGEST_WAIT = 0.05
_given: set[int] = set()


def free_port() -> int:
    """Return an input port that, with its output port, no neighbour uses."""
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(('', 0))
            port = int(probe.getsockname()[1])
            if port > 0xFFFF - 2 or _given & {port, port + 2}:
                continue
            second = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            with second, contextlib.suppress(OSError):
                second.bind(('', port + 2))
                _given.update((port, port + 2))
                return port


def run_ip(*arguments: str) -> None:
    """Run ``ip`` in this thread's namespace."""
    subprocess.run(['ip', *arguments], check=True, capture_output=True, timeout=10.0)


def in_network_namespace(body: Callable[[], None]) -> None:
    """Run ``body`` in a thread that has a network of its own; skip where that is not allowed."""
    outcome: list[BaseException] = []
    denied: list[str] = []

    def run() -> None:
        if ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWNET):
            denied.append(os.strerror(ctypes.get_errno()))
            return
        try:
            run_ip('link', 'set', 'lo', 'up')
        except (OSError, subprocess.SubprocessError) as error:
            denied.append(str(error))
            return
        try:
            body()
        except BaseException as error:
            outcome.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(60.0)
    assert not thread.is_alive(), 'it hangs'
    if denied:
        pytest.skip(f'no network namespaces here: {denied[0]}')
    if outcome:
        raise outcome[0]


class Station:
    """
    A simulator on the network, run by a thread: it receives where the bridge sends.

    Use it as a context manager. ``sent`` and ``received`` hold (seconds, datagram).
    """

    def __init__(self, simulator: Any, input_port: int, group: str = GROUP) -> None:
        self.simulator = simulator
        self.sent: list[tuple[float, bytes]] = []
        self.received: list[tuple[float, bytes]] = []
        self.silent = False
        self._lock = threading.Lock()
        self._quit = threading.Event()
        self._port = MulticastTransport(
            group, input_port + 2, input_port, interface_address=LOOPBACK
        )
        self._port.open()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def apply(self, *lines: str) -> float:
        """Steer the simulator; return the moment."""
        with self._lock:
            for line in lines:
                self.simulator.apply(line)
            return time.monotonic()

    def look(self, what: Callable[[Any], Any]) -> Any:
        """Return something about the simulator, undisturbed."""
        with self._lock:
            return what(self.simulator)

    def write(self, data: bytes) -> None:
        """Send a datagram that the simulator knows nothing of."""
        with self._lock:
            self._port.send(data)

    def _run(self) -> None:
        while not self._quit.is_set():
            due = self.simulator.deadline() - time.monotonic()
            select.select([self._port.fileno()], [], [], min(max(due, 0.0), _LONGEST_WAIT))
            with self._lock:
                self._step(time.monotonic())

    def _step(self, now: float) -> None:
        for data in self._port.receive():
            self.received.append((now, data))
            self.simulator.receive(data, now)
        for packet in self.simulator.poll(now):
            if not self.silent:
                self._port.send(packet)
                self.sent.append((now, packet))

    def __enter__(self) -> Station:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._quit.set()
        self._thread.join(2.0)
        self._port.close()
