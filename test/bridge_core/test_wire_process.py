# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The process of a wire: how it begins, waits for its turn, and hears and tells its node."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
import errno
import importlib
import os
from pathlib import Path
import pickle
import signal
import socket
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core import clock, realtime
from bridge_core.j1939 import CanFrame
from bridge_core.report import Report, Status
from bridge_core.session import Level, StopChanged, Verdict
from bridge_core.transports import wire_process
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.can import CanTransport
from bridge_core.transports.request import Activate, Call, Deactivate, Request
from bridge_core.transports.wire_process import ENDING, InForce, KNOWN, Node, receive, TURN
from bridge_core.waiting import ready
from stage.link_rig import FakeSession
from stage.rig import Pty, run_python
from stage.toy_wire import BRIDGE

# -- how it begins --------------------------------------------------------------------------------


class Spare:
    """The end of a process that waits for its turn; ``ours`` is the node's."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.ours.setblocking(False)
        self.node = Node(theirs.detach())
        self.word = TURN  # which ends the wait
        self.names: list[str] = []
        self.heard: list[Any] = []
        self.wires: list[dict[str, Any]] = []
        self.ends: list[int] = []
        patch.setattr(wire_process, 'ready', self._ready)
        patch.setattr(wire_process, 'show_thread', self.names.append)
        patch.setattr(wire_process, 'Wire', self._wire)
        patch.setattr(os, '_exit', self.ends.append)

    def _ready(self, descriptors: list[int], timeout: float | None) -> None:
        assert timeout is None
        if not self.heard:
            self.heard += [pickle.loads(self.ours.recv(1000))[0]]
            self.ours.send(KNOWN)
        else:
            self.ours.send(self.word)
        assert ready(descriptors, 0.0) == [self.node.fileno()]

    def _wire(self, bridge: Any, owner: Any, requests: Any, **options: Any) -> Any:
        assert bridge is BRIDGE
        assert owner is requests is self.node
        self.wires.append(options)
        return SimpleNamespace(run=lambda: self.heard.append('runs'), left_safe=True)

    def run(self, tap: int = -1) -> None:
        in_force = InForce()
        wire_process.run(self.node, BRIDGE, ['no permission'], 2.5, tap, in_force, -1)
        in_force.close()


@pytest.fixture
def spare(monkeypatch: pytest.MonkeyPatch) -> Iterator[Spare]:
    spare = Spare(monkeypatch)
    yield spare
    spare.ours.close()
    spare.node._socket.close()


def test_process_runs_its_wire_and_takes_its_threads_along(spare: Spare) -> None:
    spare.run()
    assert spare.names == ['spare wire', 'wire']
    assert spare.wires == [{'reconnect_period': 2.5, 'tap': None, 'patience': 3.0}]
    assert spare.heard == ['beat', 'runs']
    assert spare.ends == [0]
    told = pickle.loads(spare.ours.recv(1000))
    assert told[:2] == ('on_refused', (0, 'rt_priority', 'no permission'))


def test_spare_that_is_told_anything_but_its_turn_runs_nothing(spare: Spare) -> None:
    spare.word = b'other'
    spare.run()
    assert spare.names == ['spare wire']
    assert not spare.wires


@pytest.mark.parametrize('known', [False, True])
def test_process_that_its_node_does_not_know_says_no_farewell_for_it(
    spare: Spare, monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    """It was started in vain: its end is not that of the node."""
    said: list[int] = []
    monkeypatch.setattr(wire_process, '_end_for', lambda before, *_: said.append(before))
    words = [KNOWN, b''] if known else [b'']
    monkeypatch.setattr(wire_process, 'receive', lambda _: words.pop(0))
    monkeypatch.setattr(wire_process, 'ready', lambda *_: None)
    spare.run()
    assert said == [-1] * known
    assert spare.names == ['spare wire'] * known
    assert spare.ends == [0]


@pytest.mark.parametrize('asked', [False, True])
def test_node_that_died_between_turn_and_orders_leaves_the_farewell_to_its_wire(
    spare: Spare, monkeypatch: pytest.MonkeyPatch, asked: bool
) -> None:
    """It was never active, so its own end says nothing; what was in force before still moves."""
    said: list[int] = []
    cleared: list[bool] = []
    monkeypatch.setattr(wire_process, '_end_for', lambda before, *_: said.append(before))
    monkeypatch.setattr(InForce, 'clear', lambda _: cleared.append(True))
    words = [KNOWN, TURN, *([pickle.dumps((1, '', 'x', 0.0, 1.0, False, False))] * asked), b'']
    monkeypatch.setattr(wire_process, 'receive', lambda _: words.pop(0))
    monkeypatch.setattr(wire_process, 'ready', lambda *_: None)
    wire = SimpleNamespace(run=spare.node.take if asked else lambda: None, left_safe=True)
    monkeypatch.setattr(wire_process, 'Wire', lambda *_, **__: wire)
    spare.run()
    assert (said, cleared) == (([], [True]) if asked else ([-1], []))


def test_wire_has_the_tap_of_its_node(spare: Spare) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        spare.run(theirs.fileno())
        tap = spare.wires[0]['tap']
        tap.note(True, b'frame', 1.0)
        tap.close()
        assert ours.recv(100, socket.MSG_DONTWAIT).endswith(b'frame')


@pytest.mark.parametrize(('priority', 'used'), [(-1, []), (0, []), (1, [1])])
def test_process_ignores_what_ends_its_node_and_loads_all_it_needs(
    monkeypatch: pytest.MonkeyPatch, priority: int, used: list[int]
) -> None:
    ignored: list[Any] = []
    loaded: list[str] = []
    priorities: list[int] = []

    def use_realtime(priority: int) -> list[str]:
        priorities.append(priority)
        return ['no permission']

    def load(name: str, of: Callable[[str], Any] = importlib.import_module) -> Any:
        loaded.append(name)
        return of(name)

    monkeypatch.setattr(signal, 'signal', lambda *what: ignored.append(what))
    monkeypatch.setattr(importlib, 'import_module', load)
    monkeypatch.setattr(realtime, 'use_realtime', use_realtime)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        node, bridge, refusals = wire_process.load(theirs.detach(), 'stage.toy_wire', priority)
        node._tell('beat')
        assert ours.recv(1000, socket.MSG_DONTWAIT)
        node._socket.close()
    assert ignored == [(number, signal.SIG_IGN) for number in ENDING]
    assert bridge is BRIDGE
    assert loaded == ['stage.toy_wire', 'bridge_core.transports.serial']
    assert priorities == used
    assert list(refusals) == ['no permission'] * len(used)


def start_wire(
    folder: Path, source: str, *program: str, priority: int = 0
) -> subprocess.CompletedProcess[str]:
    """Run the process of a wire whose module has this source until it ends."""
    (folder / 'lost').mkdir()
    (folder / 'lost' / 'wire.py').write_text(source)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        arguments = (str(priority), str(theirs.fileno()), 'lost.wire', '1', *['-1'] * 3)
        return subprocess.run(
            [*program, sys.executable, '-m', 'bridge_core.start_wire', *arguments],
            env={**os.environ, 'PYTHONPATH': f'{folder}{os.pathsep}{os.getcwd()}'},
            pass_fds=[theirs.fileno()],
            capture_output=True,
            text=True,
            check=False,
        )


@pytest.mark.parametrize(
    ('source', 'reason'),
    [
        ('', "AttributeError: module 'lost.wire' has no attribute 'BRIDGE'"),
        ('raise MemoryError', 'lost.wire: MemoryError()'),
        ('import no_such_driver', 'No module named'),
        ("open('/none')", 'No such file'),
    ],
)
def test_process_that_cannot_load_says_why(tmp_path: Path, source: str, reason: str) -> None:
    """In one line, but for what is a fault of the code."""
    ended = start_wire(tmp_path, source)
    assert ended.returncode == 1
    assert reason in ended.stderr
    assert ended.stdout == ''
    assert bool(source) == (ended.stderr.count('\n') == 1)


@pytest.mark.parametrize('priority', [3, -1, 0])
def test_wire_loads_without_the_priority_of_its_node(tmp_path: Path, priority: int) -> None:
    """What loads for a quarter of a second, and never yields, would delay the stops of others."""
    program = ['chrt', '--fifo', '3']
    if subprocess.run([*program, 'true'], capture_output=True, check=False).returncode:
        pytest.skip('this user may not use real-time priority')
    source = 'import os\nprint(os.sched_getscheduler(0))\nraise MemoryError'
    ended = start_wire(tmp_path, source, *program, priority=priority)
    assert ended.stdout.split() == [str(os.SCHED_OTHER if priority else os.SCHED_FIFO)]


def test_wire_gives_the_priority_of_its_node_up_before_it_loads_anything() -> None:
    source = """
import os
import sys
from bridge_core.start_wire import main

def give_up(*_):
    print([name for name in sys.modules if name.startswith('bridge_core.')])
    sys.exit()

os.sched_setscheduler = give_up
sys.argv = ['start_wire', '3', '0', 'nothing', '1', '-1', '-1', '-1']
main()
"""
    said = run_python('-c', source, check=True).stdout
    assert ast.literal_eval(said) == ['bridge_core.descriptors', 'bridge_core.start_wire']


# -- its node -------------------------------------------------------------------------------------


class Ends:
    """The wire's end of the socket, ``node``, and the node's, ``theirs``."""

    def __init__(self) -> None:
        self.theirs, ours = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.theirs.setblocking(False)
        self.node = Node(ours.detach())
        self.interrupted: list[float] = []
        self.node.wire = SimpleNamespace(  # type: ignore[assignment]
            interrupt=lambda reason, now: self.interrupted.append(now)
        )

    def told(self) -> list[str]:
        """Return the names of what the node was told."""
        said = iter(lambda: receive(self.theirs), None)
        return [pickle.loads(each or b'')[0] for each in said]

    def ask(self, number: int) -> Request:
        asked = Request(number, 'estop', Call('set_estop', (True,)), 1.0, stop=True)
        self.theirs.send(pickle.dumps(tuple(asked)))
        return asked


@pytest.fixture
def ends() -> Iterator[Ends]:
    ends = Ends()
    yield ends
    ends.theirs.close()
    ends.node._socket.close()


def test_sign_of_life_comes_where_nothing_was(ends: Ends, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(clock, 'now', lambda: now)
    ends.node.on_events(['event'], now)
    due = ends.node.pace(now)
    assert due == now + 0.03
    ends.node.on_events([], now)  # which says nothing
    now = due - 0.0005  # awake for something else, a moment before
    assert ends.node.pace(now) == ends.node.pace(now) == now + 0.03
    assert ends.told() == ['on_events', 'beat']


@pytest.mark.parametrize('why', ['full', 'no memory'])
def test_wire_that_could_not_tell_something_interrupts_its_session_once_it_can(
    ends: Ends, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def send(data: bytes) -> None:
        raise OSError(errno.ENOBUFS, 'no buffer space')

    with monkeypatch.context() as patch:
        if why == 'full':
            ends.node._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
        else:
            patch.setattr(ends.node, '_socket', SimpleNamespace(send=send))
        while not ends.node._lost:
            ends.node.on_events([StopChanged(Verdict.stop())], 1.0)
        ends.node.pace(clock.now())
        assert not ends.interrupted  # there is no room yet, so nobody could be told
    ends.told()
    ends.node.pace(clock.now())
    ends.node.pace(clock.now())
    assert len(ends.interrupted) == 1
    ends.told()
    ends.node.on_events([StopChanged(Verdict.stop())], 2.0)
    assert ends.told() == ['on_events']


@pytest.mark.parametrize('unread', [False, True])
def test_requests_are_taken_to_the_last_one_and_then_the_end(ends: Ends, unread: bool) -> None:
    assert ends.node.take() == []
    if unread:
        ends.node.done(1, '')
    asked = [ends.ask(number) for number in range(100)]
    ends.theirs.close()
    first = ends.node.take()
    assert len(first) < 100  # the port has its turn between
    assert first + ends.node.take() == asked
    with pytest.raises(EOFError):
        ends.node.take()


def test_turn_counts_though_the_node_went_before_it_heard_that_the_spare_is_ready(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        wire_process, 'show_thread', lambda name: ends.theirs.close()
    )  # right behind it
    ends.theirs.send(TURN)
    assert ends.node.wait_for_turn()


def test_nothing_is_raised_by_telling_a_node_that_is_gone(ends: Ends) -> None:
    node = ends.node
    ends.theirs.close()
    assert receive(ends.theirs) == b''
    node.on_events([StopChanged(Verdict.stop())], 1.0)
    node.on_report(Report(Status(Level.OK, 'ok', {}), Status(Level.OK, 'ok', {})), 1.0)
    node.link_changed('text', False)
    node.on_refused(1, 'key', 'text')
    node.done(1, '')
    assert node.pace(1.0) > 1.0
    with pytest.raises(EOFError):
        node.take()


# -- what is in force -----------------------------------------------------------------------------


def test_what_is_in_force_is_read_by_whoever_has_the_memory_until_it_is_cleared() -> None:
    ours = InForce()
    spare = InForce(os.dup(ours.fileno()))
    assert spare.read() == []
    for number in (1, 2, 3):
        command = Request(number, '', Activate({}), 1.0, stop=True)
        ours.keep([command])
        assert spare.read() == [command]
    ours.keep([])
    assert spare.read() == []
    ours.keep([command])
    spare.clear()
    assert ours.read() == []
    for each in (ours, ours, spare):
        each.close()
    ours.keep([command])  # the link has ended


class Leaving(FakeSession):
    """Has nothing to say but its farewell, of one CAN frame."""

    def opened(self, now: float) -> tuple[list[Any], list[Any]]:
        return [], []

    def farewell(self, now: float) -> list[Any]:
        return [CanFrame(0x0CFDD633, b'\xfe')]


@pytest.mark.parametrize('orders', [[Activate({})], [Activate({}), Deactivate()]])
def test_farewell_leaves_by_an_adapter_that_takes_two_seconds_to_open(
    ends: Ends, pty: Pty, orders: list[Activate | Deactivate]
) -> None:
    """As a serial one does for python-can."""
    transport = CanTransport('slcan', str(pty.path), bitrate=250_000)
    bridge: Bridge[Any] = Bridge(__name__, lambda _: Leaving(), lambda _: transport)
    in_force = InForce()
    in_force.keep([Request(1, '', each, 1.0, stop=True) for each in orders])
    wire_process._end_for(-1, in_force, ends.node, bridge)
    in_force.close()
    pty.wait_received(b'T0CFDD6331FE\r')
