# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What tests of the toy bridge share: its device, waits for its topics, and its processes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import time
from typing import Any

from stage.rig import Observer, Pty, Record

ESTOP = '/toy_bridge/estop'
OUTLASTS_GAPS = 5.0  # s; a link_timeout where a device that is held up must not count as silent


class ToyDevice:
    """A device that sends ``k`` every 50 ms while the observer spins and ``talking`` is true."""

    def __init__(self, pty: Pty, observer: Observer) -> None:
        self.pty, self.observer = pty, observer
        self.talking = True
        observer.node.create_timer(0.05, self._talk)

    def _talk(self) -> None:
        if self.talking and self.pty.master >= 0:
            self.pty.write(b'k')
            self.pty.read()

    def wait_for(
        self, condition: Any, what: str | Callable[[], str], timeout: float = 10.0
    ) -> None:
        self.observer.wait_for(condition, timeout, what)


def wait_value(observer: Observer, record: Record, value: bool, timeout: float = 15.0) -> float:
    """Wait until a topic says ``value``; return when the first of these came."""
    start = time.monotonic()

    def first() -> float:
        for arrival, message in record.since(start):
            if message.data is value:
                return arrival
        return 0.0

    return observer.wait_for(first, timeout, f'{record.topic} says {value}')


def wait_repeats(observer: Observer, record: Record, value: bool, count: int = 5) -> None:
    """Wait for some more messages, all of which must say ``value``."""
    record.clear()
    observer.wait_for(lambda: len(record.data) >= count, 5.0, f'{count} more on {record.topic}')
    assert set(record.data) == {value}


def wires_of(node: int) -> list[int]:
    """Return the processes of wires that run for this node. :param node: its process."""
    return [pid for pid in _started_for(node) if _read(pid, 'comm').strip() == 'wire']


def spares_of(node: int) -> list[int]:
    """Return the processes that wait to be the wire of this node, or start."""
    return [pid for pid in _started_for(node) if _read(pid, 'comm').strip() != 'wire']


def _started_for(node: int) -> list[int]:
    return [pid for pid in children_of(node) if ': wire ' in command_of(pid)]


def children_of(parent: int) -> list[int]:
    """Return the processes that run and that this one has started."""
    pids = (int(folder.name) for folder in Path('/proc').glob('[0-9]*'))
    # In this order: one that ends meanwhile has no state to read.
    return [pid for pid in pids if _stat(pid)[1:2] == [str(parent)] and is_running(pid)]


def is_running(pid: int) -> bool:
    """Tell whether a process runs, or is stopped: it has an end before somebody waits for it."""
    state = _stat(pid)[:1]
    return bool(state) and state[0] not in 'ZX'


def runs(pid: int) -> bool:
    """Tell whether a process may do anything: it has neither ended nor is it stopped."""
    return is_running(pid) and _stat(pid)[:1] != ['T']


def name_of(pid: int) -> str:
    """Return what ``ps -o comm`` shows."""
    return _read(pid, 'comm').strip()


def command_of(pid: int) -> str:
    """Return the command line, as ps shows it."""
    return _read(pid, 'cmdline').replace('\0', ' ')


def _stat(pid: int) -> list[str]:
    """Return state, parent and so on; proc(5)."""
    return _read(pid, 'stat').rpartition(')')[2].split()


def _read(pid: int, name: str) -> str:
    try:
        return Path(f'/proc/{pid}/{name}').read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ''
