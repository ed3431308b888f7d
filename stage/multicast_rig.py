# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What multicast tests share: own ports, own networks, a simulator on the network."""

from __future__ import annotations

from collections.abc import Callable
import ctypes
import os
import subprocess
import threading
from typing import Any

import pytest

from rugged_teleop import multicasts
from rugged_teleop.multicasts import MulticastDevice, PORT_OFFSET
from stage.rig import claim

_CLONE_NEWNET = 0x40000000  # linux/sched.h


def free_port() -> int:
    """Return an input port that, with its output port, no neighbour and no other test uses."""
    while True:
        port = multicasts.free_port()
        if claim(f'port_{port}') and claim(f'port_{port + PORT_OFFSET}'):
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


class Station(MulticastDevice):
    """A simulator on the network of this machine; it receives where the bridge sends."""

    def __init__(self, simulator: Any, input_port: int) -> None:
        super().__init__(simulator, input_port)

    def look(self, what: Callable[[Any], Any]) -> Any:
        """Return something about the simulator, undisturbed."""
        return self.call(lambda device, now: what(device))

    def write(self, data: bytes) -> None:
        """Send a datagram that the simulator knows nothing of."""
        self.call(lambda device, now: self._transport.send(data))
