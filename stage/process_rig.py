# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A link to a wire's processes, step by step, by a clock of the test's; they are fakes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import errno
import math
import os
import pickle
import signal
import socket
import subprocess
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core import clock
from bridge_core.reasons import Coded
from bridge_core.session import StopChanged, Verdict
from bridge_core.supervisor import Stage
from bridge_core.transports import process
from bridge_core.transports.child import Child
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Activate, Call, Deactivate, Request
from bridge_core.transports.wire_process import KNOWN, Node, receive, TURN
from bridge_core.waiting import ready
from stage.link_rig import FakeOwner
from stage.toy_links import WITHOUT_TEMPLATE
from stage.toy_wire import BRIDGE


class StoppedOwner(FakeOwner):
    """To whom a link that is lost is a stop, as to the node."""

    def link_changed(self, text: str, ok: bool) -> None:
        super().link_changed(text, ok)
        if not ok:
            self._publish(True)


class FakeProcess:
    """A process, in the place of its Popen."""

    def __init__(self, pid: int = 1) -> None:
        self.pid, self.returncode = pid, 0
        self.hangs = False
        self.kills = 0
        self.waited: list[float | None] = []  # for its end

    def kill(self) -> None:
        self.kills += 1

    def wait(self, timeout: float | None = None) -> int:
        self.waited.append(timeout)
        if self.hangs and timeout is not None:
            raise subprocess.TimeoutExpired('wire', timeout)
        return self.returncode


class StepBench:
    """A link whose thread is the test's."""

    def __init__(self, patch: pytest.MonkeyPatch, **options: Any) -> None:
        self.now = 100.0
        self.late = 0.0  # s that the next sleep takes longer
        self.owner = StoppedOwner()
        self.link = ProcessLink('link', BRIDGE, self.owner, **options)
        patch.setattr(clock, 'now', lambda: self.now)
        patch.setattr(process, 'ready', self._ready)
        patch.setattr(process, 'TEMPLATE', WITHOUT_TEMPLATE)

    def _ready(self, descriptors: Sequence[int], timeout: float) -> list[int]:
        found = ready(descriptors, 0.0)
        if not found:
            self.now += timeout + self.late
            self.late = 0.0
        return found

    def close(self) -> None:
        self.link.stop()

    def step(self) -> None:
        self.link._guarded_step()

    def step_until(self, when: float) -> None:
        while self.now < when:
            self.step()

    def troubles(self) -> list[str]:
        """Return what was told of the link that is bad."""
        return [line for line in self.owner.log if line.startswith('bad')]

    def command(self, number: int, name: str, told: list[int]) -> None:
        """Give the wire a command, whose number is in ``told`` once its end is."""
        self.link._waiting[number] = lambda error: told.append(number)
        what = Activate({'number': number}) if name == 'activate' else Deactivate()
        self.link._put(Request(number, name, what, self.now, stop=True), True)

    def deactivate(self) -> list[Deactivate]:
        """Deactivate, as if the link had its thread; return what the node waits for."""
        sent: list[Deactivate] = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(self.link, '_thread', SimpleNamespace(is_alive=lambda: True))
            patch.setattr(self.link, '_command', lambda timeout, command: sent.append(command))
            self.link.deactivate()
        return sent


class LinkBench(StepBench):
    """A link, and ``wire``, the end of its process."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        super().__init__(patch)
        self.on_interrupt: Callable[[], None] = lambda: None
        self.told: list[Request] = []  # what took over
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        self.ours = ours
        self.wire = Node(theirs.detach())
        assert not os.get_blocking(self.wire.fileno())  # else a test would wait for ever
        self.wire.wire = SimpleNamespace(interrupt=self._interrupt)  # type: ignore[assignment]
        self.child = FakeProcess()
        self.link._wire = self._as_child(self.child)
        self._has_turn()
        self.link._state.heard(self.now, 0.0)
        self.link._state._start_at = math.inf  # no spare

    def _as_child(self, child: Any) -> Child:
        return Child(child, self.ours)

    def _has_turn(self) -> None:
        state = self.link._state
        state.started(self.now)
        state.spare = Stage.READY
        state.turned(self.now)

    def _interrupt(self, reason: str, now: float) -> None:
        self.on_interrupt()
        self.wire.on_events([StopChanged(Verdict.stop(Coded('link.interrupted', reason)))], now)

    def close(self) -> None:
        self.ours.close()
        self.wire._socket.close()
        super().close()

    def say(self, *events: Any) -> None:
        """Have the wire tell events."""
        self.wire.on_events(events, self.now)

    def beat(self) -> None:
        """Let the wire be heard, 25 ms later."""
        self.now += 0.025
        self.wire.pace(self.now)

    def run(self) -> None:
        """Have a wire that demands no stop."""
        self.say(StopChanged(Verdict()))
        self.step()
        assert self.owner.told[-1] is False
        self.owner.told.clear()

    def fill(self) -> None:
        """Send requests until none fits any more."""
        self.ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
        while self.link.request(Call('ping')):
            pass

    def replace(self) -> list[str]:
        """Have another wire take over; return what it is told, and keep it all."""
        self.ours.close()
        self.ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.link._state.started(self.now)
        self.link._state.spare = Stage.READY
        with theirs:
            self.link._give_turn(self._as_child(FakeProcess(2)))
            assert theirs.recv(1 << 16) == TURN
            self.ours.close()
            told = iter(lambda: theirs.recv(1 << 16), b'')
            self.told = [Request(*pickle.loads(data)) for data in told]
        return [f'{each.number} {type(each.what).__name__.lower()}' for each in self.told]


class Started(FakeProcess):
    """A process that a link has started, with ``node``, its end; a test has it say things."""

    def __init__(self, bench: StartBench, words: list[str], options: dict[str, Any]) -> None:
        super().__init__(len(bench.children) + 1)
        self.bench, self.words, self.options = bench, words, options
        self.node = Node(os.dup(options['pass_fds'][0]))

    def beat(self) -> None:
        """Say that it lives, as it does first once it has loaded."""
        self.node._tell('beat')

    def clear(self) -> None:
        """Say that nothing demands a stop."""
        self.node.on_events([StopChanged(Verdict())], self.bench.now)

    def done(self, number: int) -> None:
        self.node.done(number, '')
        self.bench.step()

    def die(self, returncode: int = -signal.SIGKILL) -> None:
        self.returncode = returncode
        self.node._socket.close()
        self.bench.step()

    def told(self) -> list[str]:
        """Return the words that it was told, up to the end if that is there."""
        words = []
        while data := receive(self.node._socket):
            if data != KNOWN:
                what = 'turn' if data == TURN else type(pickle.loads(data)[2]).__name__
                words.append(what.lower())
        return words if data is None else [*words, 'end']


class StartBench(StepBench):
    """A link without a process yet."""

    def __init__(self, patch: pytest.MonkeyPatch, **options: Any) -> None:
        super().__init__(patch, **options)
        self.children: list[Started] = []
        self.tries: list[float] = []  # to start one
        self.refuses = False  # the system, to start one
        patch.setattr(subprocess, 'Popen', self._popen)
        start = self.link._new_process

        def checked(template: None) -> Child:
            made = start(template)
            assert not made.socket.getblocking()  # else a test would wait for ever
            return made

        patch.setattr(self.link, '_new_process', checked)

    def _popen(self, words: list[str], **options: Any) -> Started:
        self.tries.append(self.now)
        if self.refuses:
            raise OSError(errno.EAGAIN, 'too many')
        self.children.append(Started(self, words, options))
        return self.children[-1]

    def close(self) -> None:
        super().close()
        for each in (self.link._wire, self.link._spare):
            if each is not None:
                each.socket.close()
        for child in self.children:
            child.node._socket.close()

    def live(self, until: float) -> None:
        """Go on, with a wire that is heard."""
        while self.now < until:
            self.children[0].node.pace(self.now)
            self.step()

    def start_both(self) -> tuple[Started, Started]:
        """Have a wire that runs, and a spare that is ready."""
        self.step()
        self.children[0].clear()
        self.live(self.now + 1.1)
        wire, spare = self.children
        spare.beat()
        self.live(self.now + 0.1)
        return wire, spare

    def start_moving(self) -> tuple[Started, Started]:
        """Have a wire with an activation in force, and a spare that is ready."""
        wire, spare = self.start_both()
        self.command(1, 'activate', [])
        wire.done(1)
        return wire, spare
