# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The process that runs a wire, once it is its turn: see process.py. It imports nothing of ROS.

Its program is start_wire.py.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import gc
import importlib
import os
import pickle
import signal
import socket
import struct
import time
from typing import Any

from bridge_core import clock
from bridge_core.report import Report
from bridge_core.thread_name import show_thread
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.request import Request
from bridge_core.transports.tap import Tap
from bridge_core.transports.wire import Wire
from bridge_core.waiting import ready

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)  # ask a process to end
_BEAT_PERIOD = 0.03  # s, between two signs of life
_BEAT_EARLY = 0.001  # s, if the wire is awake anyway
# The first messages to a process: that the node knows it, and that it is to run the wire.
KNOWN, TURN = b'known', b'turn'
_LARGEST = 1 << 20  # bytes of a message
_READS = 64  # requests, before the port gets its turn again
_OPEN_TIME = 3.0  # s that a port may take to open for a farewell: slcan 2 s, rfc2217:// 0.4 s
_WIRE_TIME = _OPEN_TIME + 1.0  # s that a wire may take for its farewell
_TRY_TIME = 2.0  # s for which a port is tried that cannot be had
_TRY_PERIOD = 0.02  # s
_LOST = 'the node did not take what its wire had to tell, and something of it is lost'


def receive(end: socket.socket) -> bytes | None:
    """Return the next message, without waiting; empty: the other end is gone; None: nothing."""
    for _ in range(2):
        try:
            return end.recv(_LARGEST)
        except BlockingIOError:
            return None
        except ConnectionResetError:
            continue  # it left messages unread; told once, before those that it has sent
        except OSError:
            break
    return b''


class Node:
    """The node's end of the socket, as owner of the wire and as source of requests."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _LARGEST)
        self.wire: Wire[Any]
        self._told_at = 0.0
        self._lost = self._ended = False
        self.has_asked = False  # anything of the wire
        self.knows = False  # of this process: its end is the end of the node, and no failed start

    def fileno(self) -> int:
        """Return what becomes readable when there are requests, or there will be none."""
        return self._socket.fileno()

    def wait_for_turn(self) -> bool:
        """Say that this is ready; tell whether its turn has come, and not the end."""
        self._tell('beat')
        ready([self.fileno()], None)
        word = receive(self._socket)
        if word == KNOWN:
            self.knows = True
            show_thread('spare wire')
            ready([self.fileno()], None)
            word = receive(self._socket)
        if word == TURN:
            show_thread('wire')
        return word == TURN

    def take(self) -> list[Request]:
        """Return the requests that have come. :raises EOFError: the node is gone."""
        requests: list[Request] = []
        if self._ended:
            raise EOFError
        for _ in range(_READS):
            data = receive(self._socket)
            if data is None:
                break
            if not data:
                self._ended = True
                break
            self.has_asked = True
            requests.append(Request(*pickle.loads(data)))
        if self._ended and not requests:
            raise EOFError
        return requests

    def done(self, number: int, error: str) -> None:
        """Tell the end of a command."""
        self._tell('done', number, error)

    def on_events(self, events: Sequence[Any], now: float) -> None:
        """Tell events of the session."""
        if events:
            self._tell('on_events', list(events), now)

    def on_report(self, report: Report, now: float) -> None:
        """Tell how link and device are."""
        self._tell('on_report', report, now)

    def on_refused(self, number: int, key: str, text: str) -> None:
        """Tell why a request makes no sense."""
        self._tell('on_refused', number, key, text)

    def link_changed(self, text: str, ok: bool) -> None:
        """Tell that the port was opened, lost or could not be opened."""
        self._tell('link_changed', text, ok)

    def pace(self, now: float) -> float:
        """Give a sign of life where nothing else was said; return when to be called next."""
        due = self._lost or now >= self._told_at + _BEAT_PERIOD - _BEAT_EARLY
        if due and self._tell('beat') and self._lost:
            # There is room again. What could not be told may have been a stop.
            self._lost = False
            self.wire.interrupt(_LOST, now)
        return self._told_at + _BEAT_PERIOD

    def _tell(self, name: str, *arguments: Any) -> bool:
        self._told_at = clock.now()
        at = 0.0 if self._lost else self._told_at  # 0: the node does not know all that was before
        try:
            self._socket.send(pickle.dumps((name, arguments, at)))
        except OSError:  # no room; or the node is gone, as take() finds out
            self._lost = True
            return False
        return True


class InForce:
    """
    What was asked of a wire and is not over, for the process that may have to end it.

    It is in memory that all processes of a link share. It outlives the node, and whoever is killed
    amid a change leaves it as it was.

    :param descriptor: of that memory; -1: make it.
    """

    _PLACE = struct.Struct('=QQ')  # where the newest is, and its size; 0: nothing is in force
    _PLACES = (_LARGEST, 2 * _LARGEST)

    def __init__(self, descriptor: int = -1) -> None:
        self._descriptor = os.memfd_create('in force') if descriptor < 0 else descriptor
        self._kept = b''
        self._writes = 0

    def fileno(self) -> int:
        """Return the descriptor of the memory."""
        return self._descriptor

    def keep(self, requests: Sequence[Request]) -> None:
        """Replace what is there."""
        data = pickle.dumps([tuple(each) for each in requests]) if requests else b''
        if data != self._kept and self._descriptor >= 0:
            self._writes += 1
            place = self._PLACES[self._writes % 2]
            os.pwrite(self._descriptor, data, place)
            os.pwrite(self._descriptor, self._PLACE.pack(place, len(data)), 0)
            self._kept = data

    def clear(self) -> None:
        """Note that nothing is in force: the farewell was said."""
        os.pwrite(self._descriptor, self._PLACE.pack(0, 0), 0)

    def read(self) -> list[Request]:
        """Return what is in force."""
        head = os.pread(self._descriptor, self._PLACE.size, 0)
        place, size = self._PLACE.unpack(head) if head else (0, 0)
        data = os.pread(self._descriptor, size, place)
        return [Request(*each) for each in pickle.loads(data)] if data else []

    def close(self) -> None:
        """Close the descriptor; may be called twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1


class _Rest:
    """Requests that a wire left behind, and then no more."""

    def __init__(self, requests: list[Request]) -> None:
        self._requests = requests
        self._event = os.eventfd(1)

    def fileno(self) -> int:
        return self._event

    def take(self) -> list[Request]:
        requests, self._requests = self._requests, []
        if not requests:
            raise EOFError
        return requests

    def done(self, number: int, error: str) -> None: ...


def load(
    descriptor: int, module: str, rt_priority: int
) -> tuple[Node, Bridge[Any], Sequence[str]]:
    """Load all that a wire needs; return the node's end, what the wire is of, and refusals."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)  # whatever ends the node ends this, too
    node = Node(descriptor)
    bridge = importlib.import_module(module).BRIDGE
    for late in bridge.loads:
        importlib.import_module(late)
    gc.freeze()
    refusals: Sequence[str] = ()
    if rt_priority > 0:
        from bridge_core.realtime import use_realtime  # late: it takes memory

        refusals = use_realtime(rt_priority)
    return node, bridge, refusals


def run(
    node: Node,
    bridge: Bridge[Any],
    refusals: Sequence[str],
    reconnect_period: float,
    tap: int,
    in_force: InForce,
    before: int,
) -> None:
    """
    Run until the node is gone, or has said that it is the end.

    :param before: the process of the wire that this is the spare of, as a pidfd; -1: none.
    """
    if not node.wait_for_turn():
        if node.knows:
            _end_for(before, in_force, node, bridge)
    else:
        for refusal in refusals:
            node.on_refused(0, 'rt_priority', refusal)
        node.wire = Wire(
            bridge,
            node,
            node,
            reconnect_period=reconnect_period,
            tap=Tap(tap) if tap >= 0 else None,
            patience=_OPEN_TIME,
        )
        node.wire.run()
        if not node.has_asked:  # its node died between the turn and the orders
            _end_for(before, in_force, node, bridge)
        elif node.wire.left_safe:
            in_force.clear()
    os._exit(0)  # a thread may be at work in a driver that does not return


def _end_for(before: int, in_force: InForce, node: Node, bridge: Bridge[Any]) -> None:
    """
    Say the farewell of a wire that died with its node, before it could.

    Its port may be held for a moment longer. A wire that hangs is killed: nobody else can.
    """
    if before >= 0 and not ready([before], _WIRE_TIME):  # its pidfd
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(before, signal.SIGKILL)
        ready([before], _WIRE_TIME)
    end = clock.now() + _TRY_TIME
    while requests := in_force.read():
        node.wire = Wire(bridge, node, _Rest(requests), patience=_OPEN_TIME)
        node.wire.run()
        if node.wire.left_safe or clock.now() >= end:
            break
        time.sleep(_TRY_PERIOD)
