# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fakes of the processes that a link runs its wire in, and of the sockets to them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import math
import subprocess
from typing import Any

from bridge_core.session import StopChanged, Verdict
from bridge_core.transports import wire_process
from bridge_core.transports.request import Activate, Request
from bridge_core.transports.wire_process import Node, TURN

STEP = 0.125  # s
LOADING = 2 * STEP
PATIENCE = 4  # steps that a wire may take for its farewell
ROOM = 5  # messages either way: more than there are commands at a time
STOP, CLEAR = Verdict.stop(), Verdict()


@dataclass(frozen=True)
class Values:
    """Parameters of an activation, as a mapping; ``to`` None are nonsense."""

    to: str | None

    def keys(self) -> tuple[str, ...]:
        return ('to',)

    def __getitem__(self, name: str) -> str | None:
        return self.to


class End:
    """One end of a socket pair of messages."""

    def __init__(self) -> None:
        self.other = self
        self.queue: deque[Any] = deque()
        self.closed = False

    def send(self, message: Any) -> None:
        if self.other.closed:
            raise BrokenPipeError
        if len(self.other.queue) >= ROOM:
            raise BlockingIOError
        self.other.queue.append(message)

    def recv(self, _: int) -> Any:
        if self.queue:
            return self.queue.popleft()
        if self.other.closed:
            return b''
        raise BlockingIOError

    def close(self) -> None:
        self.closed = True

    def fileno(self) -> int:
        return id(self)

    def readable(self) -> bool:
        return bool(self.queue) or self.other.closed


class Process:
    """
    A process that is a spare, then the wire; to the link its Popen.

    Its end of the socket is the product's. What it runs is a device that demands a stop or not.

    :param world: what its device does, ``doing``; what time it is, ``now``.
    """

    pid = 1

    def __init__(self, world: Any, before: Process | None) -> None:
        self.world = world
        self.before = before  # the wire that it is the spare of
        self.ours, self.theirs = End(), End()
        self.ours.other, self.theirs.other = self.theirs, self.ours
        self.node = Node.__new__(Node)
        self.node._socket = self.theirs  # type: ignore[assignment]
        self.node._told_at = 0.0
        self.node._lost = self.node._ended = False
        self.node.wire = self  # type: ignore[assignment]
        self.alive, self.frozen, self.loaded, self.turn = True, False, False, False
        self.returncode = 0
        self.started_at = self.ran_at = world.now
        self.waited = 0  # steps, for the end of the one before
        self.silent = 0  # steps of the node's thread since it ran
        self.active: str | None = ''
        self.verdict: Verdict | None = None  # told last
        self.interrupted = False
        self.clear_at = -math.inf  # when it last said that there is no stop
        self.stop_at = math.inf  # when it had a stop of which the owner knows nothing

    # As subprocess.Popen.

    def kill(self) -> None:
        self.die(-9)

    def wait(self, timeout: float | None = None) -> int:
        if timeout:
            self.run()
            self.run()  # a farewell comes after what was asked before
        if self.alive:
            assert timeout is not None, 'waits for what does not end'
            raise subprocess.TimeoutExpired('wire', timeout)
        return self.returncode

    # As Wire, to its Node.

    def interrupt(self, reason: str, now: float) -> None:
        self.interrupted = True
        self.tell(STOP)

    # What it does.

    def die(self, returncode: int) -> None:
        if self.alive:
            self.alive, self.returncode = False, returncode
            self.theirs.close()

    def run(self) -> None:
        """Do all that there is to do now."""
        if self.frozen or not self.alive:
            return
        now = self.ran_at = self.world.now
        self.silent = 0
        if not self.loaded:
            if now < self.started_at + LOADING:
                return
            self.loaded = True
            self.node._tell('beat')
        if not self.turn and self.theirs.readable():
            self.turn = wire_process.receive(self.theirs) == TURN  # type: ignore[arg-type]
            if not self.turn:
                self.end_for_the_one_before()
        if self.turn:
            self.work(now)

    def end_for_the_one_before(self) -> None:
        """Say its farewell, once it has ended and has not said it."""
        if self.before is not None and self.before.alive:
            self.waited += 1
            if self.waited < PATIENCE:
                return
            self.before.kill()
        if self.world.link._in_force.kept:
            self.world.say_farewell()
        self.die(0)

    def work(self, now: float) -> None:
        self.interrupted = False
        try:
            requests = self.node.take()
        except EOFError:
            self.leave()
            self.world.link._in_force.clear()
            self.die(0)
            return
        for request in requests:
            self.serve(request)
        self.node.pace(now)
        self.note()
        if self.active:
            if self.world.doing['device'] == 'gone':
                self.lose_port()
                return
            stops = self.interrupted or self.world.doing['device'] == 'stop'
            if self.world.doing['device'] == 'blip':
                self.tell(STOP)
            self.tell(STOP if stops else CLEAR)

    def lose_port(self) -> None:
        if self.verdict is not None:
            self.verdict = None
            self.stop_at = min(self.stop_at, self.world.now)
            self.node.link_changed('unplugged', False)

    def serve(self, request: Request) -> None:
        if request.is_command:
            wanted = request.what.values['to'] if isinstance(request.what, Activate) else ''
            if wanted is not None:
                self.leave()
                self.active = wanted
                if wanted:
                    self.world.moving = True  # from now on it may be
                    self.tell(STOP)
            self.node.done(request.number, 'nonsense' if wanted is None else '')

    def leave(self) -> None:
        """Say the farewell."""
        if self.active:
            self.world.say_farewell()
            self.tell(STOP)
        self.active, self.verdict = '', None

    def tell(self, verdict: Verdict) -> None:
        if verdict != self.verdict or self.interrupted:
            self.verdict = verdict
            if verdict.estop:
                self.stop_at = min(self.stop_at, self.world.now)
            self.node.on_events([StopChanged(verdict)], self.world.now)
            self.note()

    def note(self) -> None:
        """Note that what was said just now means no stop, if so."""
        if self.verdict == CLEAR and not self.node._lost:
            self.clear_at = self.world.now
