# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From the VSC's wire to the drive's: our nodes between them, or the anchors that do as little."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import contextlib
from functools import partial
from pathlib import Path
import random
import subprocess
import time
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from assurance.benchmarks.rig import Rig, running, UnavailableError
from rugged_teleop.stack import wiring
from stage.rig import NodeProcess, Observer, ROOT, wait_for

VSC, MUX, DRIVE = 'fort_vsc_bridge', 'safety_mux', 'esi_drive_bridge'
SPINE = (VSC, MUX, DRIVE)
STICK = 500  # of 1023
_PAUSE = 0.6  # s after a reset that was refused; one that comes sooner counts as repeated
_START = 30.0  # s
_BARE = {'floor': ['floor'], 'bare': ['in', 'mid', 'out']}


class Bare:
    """One of the anchors; 'floor' or 'bare'."""

    def __init__(self, rig: Rig, processes: dict[str, subprocess.Popen[bytes]]) -> None:
        self.rig = rig
        self.pids = {name: process.pid for name, process in processes.items()}

    def move(self) -> None:
        """Have it enable. :raises AssertionError: it does not."""
        self.rig.say('estop 0')
        wait_for(self.rig.enabled, _START, 'enable')
        time.sleep(random.uniform(0.03, 0.05))

    def rest(self, seconds: float) -> None:
        """Let so much time pass."""
        self.rig.say('estop 0')
        time.sleep(seconds)


class Variant(NamedTuple):
    """Another module for a node, further ROS arguments, and the terminal that it writes to."""

    module: str
    arguments: tuple[str, ...] = ()
    terminal: int | None = None


class Nodes:
    """
    VSC bridge, mux and drive node, each a process or all in one.

    :param further: of a stack: parameters beside config/demo.yaml of nodes that it has besides, or
        of the three, by name. :param variants: of nodes that are started in another way, by name.
    :param hosts: by name of a node on another host, what calls functions there.
    """

    neutral_time = 0.35  # s of neutral sticks before the deadman, above the mux's parameter

    def __init__(
        self,
        rig: Rig,
        observer: Observer,
        exits: contextlib.ExitStack,
        *,
        stack: bool = False,
        further: Mapping[str, Mapping[str, Any]] | None = None,
        rt_priority: int = 0,
        variants: Mapping[str, Variant] | None = None,
        hosts: Mapping[str, Callable[..., Any]] | None = None,
    ) -> None:
        self.rig, self.observer = rig, observer
        self.nodes: dict[str, NodeProcess] = {}
        self.may_end: set[str] = set()  # nodes whose end is no surprise
        self._exits = exits
        self._variants, self._hosts = variants or {}, hosts or {}
        self.status = observer.record(DiagnosticStatus, f'/{MUX}/status', keep=200)
        self._reset = observer.node.create_client(Trigger, f'/{MUX}/reset')
        given: dict[str, dict[str, Any]] = {VSC: {'port': rig.vsc}, DRIVE: {'port': rig.drive}}
        further = further or {}
        self._parameters = {
            name: {
                **given.get(name, {}),
                **further.get(name, {}),
                **({'rt_priority': rt_priority} if rt_priority else {}),
                # One trial comes after another.
                **({'reset_silence': 0.0} if name == MUX else {}),
            }
            for name in dict.fromkeys((*SPINE, *further))
        }
        if stack:
            together = {
                f'{name}:{key}': value
                for name, values in self._parameters.items()
                for key, value in values.items()
            }
            file = ('--params-file', str(ROOT / 'config' / 'demo.yaml')) if further else ()
            # The names of the nodes are no ROS arguments: they end the list of these.
            arguments = (*file, '--', *self._parameters)
            node = NodeProcess('rugged_teleop.stack', together, arguments=arguments)
            self.nodes['stack'] = exits.enter_context(node)
        else:
            for name in SPINE:
                self.start(name)

    def start(self, name: str) -> None:
        """Start a node, or start it again."""
        module, arguments, terminal = self._variants.get(name, Variant(f'{name}.node'))
        node = partial(
            NodeProcess,
            module,
            self._parameters[name],
            arguments=(*wiring([name]), *arguments),
            terminal=terminal,
        )
        there = self._hosts.get(name)
        self.nodes[name] = self._exits.enter_context(there(node) if there else node())

    @property
    def pids(self) -> dict[str, int]:
        """Return the processes' ids by name."""
        return {name: node.process.pid for name, node in self.nodes.items()}

    @property
    def state(self) -> str:
        """The mux's state by its newest status; empty before the first."""
        return '' if self.status.last is None else str(self.status.last.values[0].value)

    @property
    def why(self) -> str:
        """What the mux says."""
        return '' if self.status.last is None else str(self.status.last.message)

    def wait(self, condition: Callable[[], Any], what: str, timeout: float = _START) -> Any:
        """
        Spin until it is true.

        :raises AssertionError: it was not in time. :raises UnavailableError: a node has ended.
        """

        def check() -> Any:
            for name, node in self.nodes.items():
                if node.process.poll() is not None and name not in self.may_end:
                    raise UnavailableError(f'{name} has ended: {node.output.strip()[-300:]}')
            return condition()

        return self.observer.wait_for(check, timeout, lambda: f'{what}: {self.why}')

    def pause(self, seconds: float) -> None:
        """Spin for so long."""
        end = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() > end, 'time', seconds + 5.0)

    def let_go(self) -> None:
        """Release stick, deadman and e-stop of the remote, which is heard."""
        self.rig.say('silence 0', 'estop 0', 'deadman 0', 'stick 0')

    def ready(self) -> None:
        """Be READY, with everything let go."""
        self.let_go()

        def done() -> bool:
            if self.state != 'READY' and not self.try_reset():
                return False
            self.wait(lambda: self.state == 'READY', 'READY')
            return True

        self.wait(done, 'a reset', 2 * _START)

    def try_reset(self) -> bool:
        """Reset; tell whether it counts. One that does not is followed by a pause."""
        self.wait(self._reset.service_is_ready, 'the mux')
        future = self._reset.call_async(Trigger.Request())
        self.wait(future.done, 'an answer')
        if not future.result().success:
            self.pause(_PAUSE)
        return bool(future.result().success)

    def move(self) -> None:
        """Be in motion, by reset, deadman and stick. :raises AssertionError: it does not move."""
        self.ready()
        self.pause(self.neutral_time)
        self.rig.say('deadman 1')
        self.pause(0.08)
        self.rig.say(f'stick {STICK}')
        self.wait(self.rig.moves, 'motion', 3.0)
        self.pause(random.uniform(0.15, 0.2))

    def rest(self, seconds: float) -> None:
        """Be READY for so long."""
        self.ready()
        self.pause(seconds)


@contextlib.contextmanager
def chain_of(kind: str, folder: Path, rt_priority: int = 0) -> Iterator[Bare | Nodes]:
    """
    Put 'floor', 'bare', 'three' (processes) or 'stack' (in one) between VSC and drive.

    :param rt_priority: SCHED_FIFO of all threads; the rig is one above; 0: none.
    """
    with contextlib.ExitStack() as exits:
        rig = exits.enter_context(Rig(folder, priority=rt_priority and rt_priority + 1))
        if kind in _BARE:
            processes = {}
            for role in _BARE[kind]:
                arguments = (role, str(rig.vsc), str(rig.drive), str(rt_priority))
                process = running('-m', 'assurance.benchmarks.bare', *arguments)
                processes[role] = exits.enter_context(process)
            yield Bare(rig, processes)
        else:
            observer = exits.enter_context(Observer('benchmark'))
            stack = kind == 'stack'
            yield Nodes(rig, observer, exits, stack=stack, rt_priority=rt_priority)
