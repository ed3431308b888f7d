# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A wire that a test steps by hand, by a clock of its own: no thread, and nobody waits."""

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from bridge_core import clock
from bridge_core.report import Report
from bridge_core.transports import active, opener, wire
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.link import Mailbox
from bridge_core.transports.request import Activate, Call, Deactivate, Request
from bridge_core.transports.wire import Wire
from bridge_core.waiting import ready
from stage.link_rig import FakeOwner, FakeSession, FakeTransport

_MOST_WAITS = 3000  # of one test; more of them at work than asleep is a wire that spins


class Port(FakeTransport):
    """Notes what is sent in ``log``, which is the owner's, too."""

    def __init__(self, name: str, log: list[str]) -> None:
        super().__init__(name)
        self._log = log

    def send(self, frame: bytes) -> bool:
        if self.calls['send'] > _MOST_WAITS:
            pytest.fail('the wire sends for ever')
        taken = super().send(frame)
        if taken:
            self._log.append(f'sent {frame.decode()}')
        return taken


class TimedOwner(FakeOwner):
    """Notes when it was told a report; ``on_pace`` is called with the time, when paced."""

    def __init__(self) -> None:
        super().__init__()
        self.reported: list[float] = []
        self.on_pace: Callable[[float], None] = lambda now: None

    def on_report(self, report: Report, now: float) -> None:
        self.reported.append(now)
        super().on_report(report, now)
        if 'on_report' in self.faults:
            raise RuntimeError('fault in on_report')

    def pace(self, now: float) -> float:
        self.on_pace(now)
        return super().pace(now)


class WireBench:
    """
    A wire with fakes all around.

    Its ``ready``, ``sleep`` and threads are replaced: what waits lets ``now`` go on, and a port
    is opened at once, or when ``open_ports`` is called where ``blocks`` is true. The device of
    ``port`` is healthy once it has said anything.

    :param patch: ends all that with the test.
    """

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now = 0.0  # s; no test needs more of them than a float has room for
        self.late = 0.0  # s that the next wait lasts too long: the process is frozen
        self.waits: list[float] = []
        self.blocks = self.no_threads = False
        self.opening: list[Callable[[], None]] = []  # by the threads
        self.tried_at: list[float] = []
        self.daemons: set[bool] = set()
        self.during_wait: Callable[[], None] = lambda: None
        self.expects_fault = False
        self.ends: list[tuple[int, str]] = []  # of commands
        self.owner, self.session, self.resting = TimedOwner(), FakeSession(), FakeSession()
        self.port = self.make_port('port')
        self.on_make: Callable[[], None] = lambda: None
        self.requests = Mailbox(lambda number, error: self.ends.append((number, error)))
        self._number = 0
        self._patch(patch)
        self.wire = self.make_wire(reconnect_period=0.4)

    def make_port(self, name: str) -> Port:
        return Port(name, self.owner.log)

    def make_wire(self, **options: Any) -> Wire[Any]:
        bridge: Bridge[Any] = Bridge(
            __name__,
            lambda values: self._made(self.session),
            lambda values: self.port,
            lambda values: self._made(self.resting),
        )
        made: Wire[Any] = Wire(bridge, self.owner, self.requests, **options)
        made._opener._woken.setblocking(False)  # a fault is to fail a test, not to hang it
        return made

    def _made(self, session: FakeSession) -> FakeSession:
        self.on_make()
        return session

    def use(self, **options: Any) -> None:
        """Go on with a new wire. :param options: of Wire."""
        self._close_wire()
        self.wire = self.make_wire(**options)

    def _close_wire(self) -> None:
        self.wire._opener.close()

    def close(self) -> None:
        self._close_wire()
        self.port.close()
        self.requests.close()

    def _patch(self, patch: pytest.MonkeyPatch) -> None:
        bench = self

        class Namespace:
            """In the place of two modules, as the wire knows them."""

            def __init__(self, **functions: Any) -> None:
                self.__dict__.update(functions)

        class Thread:
            def __init__(
                self, *, target: Callable[..., None], args: tuple[Any, ...], daemon: bool
            ) -> None:
                bench.daemons.add(daemon)
                self._work = lambda: target(*args)

            def start(self) -> None:
                bench.tried_at.append(bench.now)
                if bench.no_threads:
                    raise RuntimeError("can't start new thread")
                bench.opening.append(self._work)
                if not bench.blocks:
                    bench.open_ports()

        patch.setattr(clock, 'now', lambda: self.now)
        for module in (active, wire):
            patch.setattr(module, 'ready', self._ready)
            patch.setattr(module, 'time', Namespace(sleep=self._sleep))
        patch.setattr(opener, 'threading', Namespace(Thread=Thread))

    def open_ports(self) -> None:
        """Let the threads end that are to open one."""
        opening, self.opening = self.opening, []
        for work in opening:
            work()

    def _sleep(self, seconds: float) -> None:
        assert seconds >= 0.0
        self.now += seconds

    def _ready(self, descriptors: Sequence[int], timeout: float) -> list[int]:
        self.waits.append(timeout)
        if len(self.waits) > _MOST_WAITS:
            pytest.fail('the wire spins')
        self.during_wait()
        found = ready(descriptors, 0.0)
        if not found:
            self._sleep(timeout)
        self.now += self.late
        self.late = 0.0
        return found

    # What a test does.

    def step(self) -> None:
        """Wait once and step, as run does."""
        self.wire._guarded(self.wire._wait_and_step)
        if not self.expects_fault:
            faults = [line for line in self.owner.log if 'internal error' in line]
            assert not faults, faults[0]

    def go_on(self, seconds: float) -> None:
        """Step until so much time has passed."""
        end = self.now + seconds
        while self.now < end:
            self.step()

    def ask(self, name: str, *arguments: Any, **options: Any) -> int:
        """Put a request, and return its number. :param options: of Request."""
        return self.put(Call(name, arguments), **{'key': name, **options})

    def put(self, what: Call | Activate | Deactivate, key: str = '', **options: Any) -> int:
        self._number += 1
        request = Request(self._number, key, what, **{'at': self.now, **options})
        self.requests.put(request, True)
        return self._number

    def do(self, function: Callable[[float], object], **options: Any) -> int:
        return self.ask('do', function, **options)

    def activate(self, *, resting: bool = False) -> None:
        """Have it open the port; see ``step``."""
        self.put(Activate({}, resting), stop=True)

    def begin_opening(self) -> None:
        """Activate it, and step, with a port that takes until ``open_ports`` to open."""
        self.blocks = True
        self.activate()
        self.step()

    def deactivate(self) -> None:
        """Have it close the port, and step."""
        self.put(Deactivate(), stop=True)
        self.step()

    def open(self, *, resting: bool = False) -> None:
        """Activate it, and step until the port is open and nothing is left to do."""
        self.activate(resting=resting)
        self.step()
        self.step()
        assert self.wire.status.is_open

    def run(self) -> None:
        """Open the port of a device that is healthy; what was told of that is forgotten."""
        self.open()
        self.hear(b'x')
        assert self.owner.told[-1] is False
        self.log()

    def hear(self, data: bytes) -> None:
        self.port.say(data)
        self.step()

    def lose(self) -> None:
        """Unplug the device, and step."""
        self.port.unplug()
        self.step()

    def log(self) -> list[str]:
        """Return and forget what the owner was told, and what was sent between."""
        lines = [*self.owner.log]
        self.owner.log.clear()
        return lines
