# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A toy's node with its wire in a process, its link without a node, and a link as a process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import ctypes
import os
from pathlib import Path
from signal import SIGKILL, SIGSTOP
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

from std_msgs.msg import Bool

from bridge_core.transports import process
from bridge_core.transports.process import ProcessLink
from stage.link_rig import FakeOwner
from stage.node_bench import LINK
from stage.rig import latched, Observer, Pty, Record, wait_for
from stage.run_delay import HELD_UP, RunDelay
from stage.talkers import Diagnostics
from stage.toy_bridge import toy_process
from stage.toy_rig import (
    ESTOP,
    is_running,
    name_of,
    runs,
    spares_of,
    ToyDevice,
    wait_value,
    wires_of,
)
from stage.toy_wire import BRIDGE


def wait_stop_since(observer: Observer, estop: Record, cause: float) -> None:
    observer.wait_for(lambda: any(m.data for _, m in estop.since(cause)), 10.0, 'a stop')


class Toy:
    """The toy with its wire in a process, and a healthy device."""

    def __init__(self, pty: Pty, observer: Observer, **parameters: Any) -> None:
        self.observer = observer
        self.device = ToyDevice(pty, observer)
        self.node = toy_process(pty.path, 'process', **parameters)
        self.pid = self.node.process.pid
        self.estop = observer.record(Bool, ESTOP, latched())
        self.diagnostics = Diagnostics(observer, 'toy_bridge')
        self.delay = RunDelay([self.pid])  # since it was healthy

    @property
    def pty(self) -> Pty:
        return self.device.pty

    def wire(self) -> int:
        """Return the process of its wire, once there is one and only one."""
        return int(self.wait(lambda: wires_of(self.pid), 'a wire')[0])

    def held_up(self) -> bool:
        """Tell whether the machine may have made a wire count as hung, which then is replaced."""
        return self.delay.exceeds(HELD_UP)

    def spare(self) -> int:
        """Return the process that waits to take over, once it is ready."""

        def ready() -> int:
            told = self.diagnostics.value(LINK, 'spare process')
            return int(told) if told.isdigit() and name_of(int(told)) == 'spare wire' else 0

        return int(self.wait(ready, 'a spare that is ready'))

    def wait(self, condition: Callable[[], Any], what: str, timeout: float = 10.0) -> Any:
        return self.observer.wait_for(condition, timeout, what)

    def wait_stop(self, value: bool) -> float:
        return wait_value(self.observer, self.estop, value)

    def wait_stop_since(self, cause: float) -> None:
        """Wait for a stop, even one that is over."""
        wait_stop_since(self.observer, self.estop, cause)

    def names(self, wire: int) -> bool:
        return self.diagnostics.value(LINK, 'wire process') == str(wire)

    def wait_gone(self, *pids: int) -> None:
        def gone() -> bool:
            self.delay.seconds()  # what has ended cannot be asked any more
            return not any(map(is_running, pids))

        self.wait(gone, f'the end of {pids}')

    def keep_alives(self) -> int:
        """Return how many the device has heard."""
        self.pty.read()
        return self.pty.received.count(b'h')


@contextlib.contextmanager
def running(pty: Pty, observer: Observer, **parameters: Any) -> Iterator[Toy]:
    toy = Toy(pty, observer, **parameters)
    with toy.node:
        yield toy


class Direct:
    """A link without a node, on a toy device."""

    def __init__(self, pty: Pty) -> None:
        self.pty = pty
        self.owner = FakeOwner()
        self.link = ProcessLink('direct', BRIDGE, self.owner, device=str(pty.path))
        self.link.start()

    def activate(self) -> None:
        values = {'port': str(self.pty.path), 'link_timeout': 0.25, 'fault': ''}
        self.link.activate(values)
        wait_for(self.is_healthy, 5.0, 'no stop')

    def is_healthy(self) -> bool:
        self.pty.write(b'k')
        self.pty.read()
        return self.owner.told[-1] is False

    def wire(self) -> int:
        return wait_for(lambda: wires_of(os.getpid()), 5.0, 'a wire')[0]

    def spare(self) -> int:
        """Return the process of its spare, once the link knows it: a fork is there before."""
        spare: Any = wait_for(lambda: self.link._spare, 20.0, 'a spare')
        return int(spare.process.pid)

    def close(self) -> None:
        self.link.stop()
        wait_for(
            lambda: not (wires_of(os.getpid()) or spares_of(os.getpid())),
            5.0,
            'the end of its processes',
        )


WITHOUT_TEMPLATE: Any = SimpleNamespace(used=contextlib.nullcontext)  # all wires start by exec
ALONE = """
import contextlib
from dataclasses import replace
import math
import sys
import threading
from types import SimpleNamespace
from bridge_core.transports import process
from stage.toy_wire import BRIDGE

class Owner:
    def __getattr__(self, name):
        return lambda *arguments: None
    def carried_over(self, values):
        return {}
    def pace(self, now):
        return now + 0.02

link = process.ProcessLink
link.TIMES = replace(link.TIMES, spare=0.0, kill=math.inf)  # a busy machine kills none
process._PROGRAM = sys.argv[3]
if process._PROGRAM != 'bridge_core.start_wire':
    process.TEMPLATE = SimpleNamespace(used=contextlib.nullcontext)
link = process.ProcessLink('alone', BRIDGE, Owner(), device=sys.argv[1])
link.start()
link.activate({'port': sys.argv[1], 'link_timeout': 0.25, 'fault': ''})
sys.stdin.readline()
exec(sys.argv[2])
print(flush=True)
threading.Event().wait()
"""


def pidfd_getfd(process: int, number: int) -> int:
    """Return a descriptor of another process as one of ours; pidfd_getfd(2)."""
    return int(ctypes.CDLL(None, use_errno=True).syscall(438, process, number, 0))


class Alone:
    """A node that is nothing but a link, with its wire, and a spare that is ready."""

    def __init__(self, pty: Pty, *, then: str = '', ready: bool = True) -> None:
        self.pty = pty
        words = [sys.executable, '-c', ALONE, str(pty.path), then, process._PROGRAM]
        self.node = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.pids = {'node': self.node.pid}
        pty.wait_received(b'h', 20.0)
        self.pids['wire'] = wait_for(lambda: wires_of(self.node.pid), 5.0, 'a wire')[0]

        def spares() -> list[int]:
            pids = spares_of(self.node.pid)
            return [pid for pid in pids if name_of(pid) == 'spare wire' or not ready]

        self.pids['spare'] = wait_for(spares, 20.0, 'a spare')[0]
        assert self.node.stdin is not None
        assert self.node.stdout is not None
        self.node.stdin.close()  # what follows may begin
        self.node.stdout.readline()

    def kill(self, name: str) -> None:
        os.kill(self.pids[name], SIGKILL)

    def kill_both(self) -> None:
        """Kill node and wire; both are stopped before, as the wire may see the node's end."""
        both = self.pids['node'], self.pids['wire']
        for signal in (SIGSTOP, SIGKILL):
            for pid in both:
                os.kill(pid, signal)
            wait_for(lambda: not any(runs(pid) for pid in both), 5.0, 'that both stand still')

    def ports_of(self, name: str) -> list[int]:
        """Return the descriptors that it has of the port."""
        folder, port = Path(f'/proc/{self.pids[name]}/fd'), os.path.realpath(self.pty.path)
        return [int(each.name) for each in folder.iterdir() if os.readlink(each) == port]

    def ends(self) -> int:
        """Wait until all have ended; return how often the farewell was said."""
        self.node.wait()
        wait_for(lambda: not any(map(is_running, self.pids.values())), 10.0, 'their ends')
        self.pty.read()
        return self.pty.received.count(b'BYE')

    def close(self) -> None:
        for who in self.pids:
            with contextlib.suppress(ProcessLookupError):
                self.kill(who)
        self.node.wait()
        assert self.node.stdout is not None
        self.node.stdout.close()


def descriptors() -> set[tuple[int, str]]:
    """Return this process's descriptors, with what they are of."""
    found = set()
    for name in os.listdir('/proc/self/fd'):
        with contextlib.suppress(FileNotFoundError):  # of the list itself
            found.add((int(name), os.readlink(f'/proc/self/fd/{name}')))
    return found
