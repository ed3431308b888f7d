# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Those who look on: the status page, over HTTP and by its callbacks, recorder, words of the mux.

None of them decides, so nothing that they hear may do more than be shown.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable
from concurrent.futures import Future
import functools
import json
import socket
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, String

from assurance.fuzz.campaign import Target
from assurance.fuzz.messages import Filler
from assurance.fuzz.mutate import Input, joined, Kit, whole
from rugged_teleop.recorder.triggers import Nodes, Triggers
from rugged_teleop.status_page.node import StatusPage
from safety_mux.device_words import DeviceWords
from safety_mux.node import SafetyMux
from stage.safety_mux_bench import Bench

_FORT, _MUX = '/fort_vsc_bridge', '/safety_mux'
_NAMES = (
    'fort_vsc_bridge: link',
    'fort_vsc_bridge: device',
    'safety_mux: mux',
    'other: thing',
    '',
)
_KEYS = ('state', 'owner', 'inhibit 1', 'stopped by', 'trip active', 'last transition', 'other')
_MOST_SHOWN = 1_000_000  # bytes of a snapshot; texts of 5000 come from here, too
_TURNS = 20  # of the event loop, until a browser that has left is forgotten
_TOKEN = b'a-token-of-the-test'
_SECRET = 'what only the token shows'


def _filled(filler: Filler, kind: Any) -> Any:
    """Return a message whose names are those that somebody listens for."""
    message = filler.fill(kind())
    for status in getattr(message, 'status', [message] if kind is DiagnosticStatus else []):
        status.name = _NAMES[filler.byte() % len(_NAMES)]
        for value in status.values:
            value.key = _KEYS[filler.byte() % len(_KEYS)]
    return message


class OnlookerTarget(Target):
    """
    What one of them does with messages; the first byte of a read chooses which.

    :param make: returns what hears them by number, what is shown then, and what is kept.
    """

    lines = (60_000, 6000)
    most = 200_000

    def __init__(self, name: str, kinds: tuple[Any, ...], make: Callable[[], Any]) -> None:
        self.name = name
        self._kinds, self._make = kinds, make
        seeds = [bytes((n, *range(1, 30))) for n in range(len(kinds))]
        self.kit = Kit([whole(*seeds), *map(whole, seeds)], [bytes((n,)) for n in range(32)])

    def run(self, reads: Input) -> Hashable:
        """Hear messages; return which were, and what was told of them."""
        hear, tell, self._kept = self._make()
        seen = set()
        for _, data in reads:
            filler = Filler(data)
            number = filler.byte() % len(self._kinds)
            hear(number, _filled(filler, self._kinds[number]))
            seen.add((number, tell()))
        return frozenset(seen)

    def kept(self) -> Any:
        """Return what remembers the messages."""
        return self._kept


_SHOWN = (DiagnosticArray, DiagnosticStatus, String, Joy, JointState, JointState, Twist, Bool)


def _page() -> Any:
    from stage.page_rig import model  # late: aiohttp is an extra

    shown = model()
    node: Any = SimpleNamespace(_model=shown)
    takes = (
        functools.partial(StatusPage._on_diagnostics, node),
        functools.partial(StatusPage._on_status, node, _MUX),
        lambda message: shown.state(_MUX, message.data, 1.0),
        functools.partial(StatusPage._on_joy, node, _FORT),
        functools.partial(StatusPage._on_joint_states, node, '/esi_drive_bridge'),
        functools.partial(StatusPage._on_command, node, _MUX),
        functools.partial(StatusPage._on_command, node, _MUX),
        lambda message: shown.estop(_FORT, message.data, 1.0),
    )

    def tell() -> Hashable:
        snapshot = shown.snapshot(1.0, 1.0)
        text = json.dumps(snapshot, allow_nan=False)
        assert len(text) < _MOST_SHOWN, 'a snapshot without an end'
        return min(len(snapshot['events']), 4)

    return lambda number, message: takes[number](message), tell, shown


def _recorder() -> Any:
    reasons = Triggers(lambda kind, message: message)
    reasons.know(Nodes((_FORT, _MUX), (_MUX,)))
    found = []

    def hear(number: int, message: Any) -> None:
        topic = ('/diagnostics', f'{_MUX}/status', f'{_MUX}/estop')[number]
        data = message if number < 2 else bytes((0, 1, 0, 0, message.data))
        reason = reasons.reason_of(topic, data)
        assert not reason or reason == 'trip' or reason.startswith(('stop', 'fault_'))
        found.append(reason[:5])

    return hear, lambda: found[-1], reasons


def _explained() -> Any:
    bench = Bench()
    words = DeviceWords(bench.arbiter.explain)
    words.listen('e-stop source', 'fort', '/fort_vsc_bridge/estop')
    words.listen('operator', 'fort', '/fort_vsc_bridge/joy')
    node: Any = SimpleNamespace(
        lane=SimpleNamespace(post=lambda function, *arguments: function(*arguments)),
        _inputs=SimpleNamespace(device_words=words),
        _words_posted=False,
        _unheard='',
        _arbiter=bench.arbiter,
    )
    node._explain = functools.partial(SafetyMux._explain, node)
    before = bench.arbiter.tick(bench.now)

    def tell() -> Hashable:
        assert bench.arbiter.tick(bench.now) == before, 'a text has decided something'
        return len(bench.arbiter.status(bench.now).inhibits) > 1

    return lambda _, message: SafetyMux._on_diagnostics(node, message), tell, bench.arbiter


# HTTP and the websocket.


class _Transport(asyncio.Transport):
    """Keeps what is written; a browser that takes all."""

    def __init__(self, plug: socket.socket) -> None:
        super().__init__({'socket': plug, 'peername': ('127.0.0.1', 1)})
        self.text = bytearray()
        self._closed = False

    def write(self, data: Any) -> None:
        self.text += data

    def is_closing(self) -> bool:
        return self._closed

    def close(self) -> None:
        self._closed = True

    def abort(self) -> None:
        self._closed = True

    def pause_reading(self) -> None: ...

    def resume_reading(self) -> None: ...


def _request(line: str, *headers: str, body: bytes = b'') -> bytes:
    head = [f'{line} HTTP/1.1', 'Host: robot:8080', *headers]
    if body:
        head.append(f'Content-Length: {len(body)}')
    return '\r\n'.join([*head, '', '']).encode() + body


_ORIGIN = 'Origin: http://robot:8080'
_BEARER = f'Authorization: Bearer {_TOKEN.decode()}'
_WISH = {'action': 'reset', 'mux': _MUX, 'confirmed': True, 'seen': 1.0}
_UPGRADE = _request(
    'GET /live',
    *(_ORIGIN, 'Connection: Upgrade', 'Upgrade: websocket', 'Sec-WebSocket-Version: 13'),
    'Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==',
)
_HELLO = bytes((0x81, 0x80 | len(_TOKEN), 0, 0, 0, 0)) + _TOKEN  # masked by zeros
_BYE = bytes((0x88, 0x80, 0, 0, 0, 0))


class HttpTarget(Target):
    """
    What a browser, or whoever is in its place, may send.

    Without the token nothing of the machine is shown and nothing done; no request is a fault of
    the server's, and of a connection that ends nothing stays.
    """

    name = 'page http'
    lines = (4000, 60)
    most = 30_000

    def __init__(self) -> None:
        asked = json.dumps(_WISH).encode()
        requests = (
            _request('GET /'),
            _request('GET /recordings/a.mcap', _BEARER),
            _request('POST /control', _ORIGIN, _BEARER, body=asked),
            _request('POST /control', _ORIGIN, body=asked),
        )
        self.kit = Kit(
            [
                whole(_UPGRADE, _HELLO, _BYE),
                whole(_UPGRADE, b'\x81\x80\0\0\0\0'),
                *map(whole, requests),
            ],
            [_TOKEN, b'\r\n', b'\r\n\r\n', _HELLO, b'/live', b'"seen": NaN', b'[::1', b'null'],
        )
        self._asked: list[tuple[str, str]] = []
        self._faults: list[Any] = []

    @functools.cached_property
    def _served(self) -> Any:
        """The server, its loop, what makes connections, and a socket for their options."""
        from aiohttp import web  # late: it is an extra

        from rugged_teleop.status_page.access import Access
        from rugged_teleop.status_page.server import Server

        access = Access('0.0.0.0', ['robot'], _TOKEN.decode(), control=True)
        server = Server('0.0.0.0', 0, access, control=self._control)
        loop = server._loop
        loop.set_exception_handler(lambda _, context: self._faults.append(context))
        runner = web.AppRunner(server._application(), access_log=None)
        loop.run_until_complete(runner.setup())
        return server, loop, runner, socket.socket()

    def _control(self, action: str, mux: str, who: str) -> Future[tuple[bool, str]]:
        del who
        self._asked.append((action, mux))
        result: Future[tuple[bool, str]] = Future()
        result.set_result((True, 'done'))
        return result

    def run(self, reads: Input) -> Hashable:
        """Send it on a connection of its own; return the answers' statuses and what was asked."""
        server, loop, runner, plug = self._served
        self._asked.clear()
        self._faults.clear()
        server._samples.clear()  # those of the last minute, but here no time passes
        server._show(json.dumps({'now': 1.0, 'sample': _SECRET}), 1.0, 0)
        transport = _Transport(plug)
        loop.run_until_complete(self._talk(server, runner.server(), transport, reads))
        sent, told = joined(reads), bytes(transport.text)
        assert not self._faults, f'nobody caught {self._faults[0]}'
        assert b'HTTP/1.1 500' not in told, 'a fault of the server'
        if _TOKEN not in sent:
            assert _SECRET.encode() not in told, 'shown without the token'
            assert not self._asked, 'done without the token'
        assert all(action in sent.decode(errors='replace') for action, _ in self._asked)
        statuses = frozenset(part[:3] for part in told.split(b'HTTP/1.1 ')[1:])
        return statuses, len(self._asked), _SECRET.encode() in told

    async def _talk(self, server: Any, protocol: Any, transport: _Transport, reads: Input) -> None:
        protocol.connection_made(transport)
        for _, data in reads:
            if not transport.is_closing():
                protocol.data_received(data)
            for _ in range(8):
                await asyncio.sleep(0)
        protocol.connection_lost(None)
        for _ in range(_TURNS):
            server._news.set()  # as every snapshot does
            await asyncio.sleep(0)
        assert not server.browsers, 'a browser that has left is still there'
        rest = asyncio.all_tasks() - {asyncio.current_task()}
        for task in rest:  # aiohttp waits some seconds for the rest of a body
            task.cancel()
        await asyncio.gather(*rest, return_exceptions=True)

    def kept(self) -> Any:
        """Return what the server keeps of them all."""
        return self._served[0]._samples


ONLOOKERS = (
    OnlookerTarget('page callbacks', _SHOWN, _page),
    OnlookerTarget('recorder callbacks', (DiagnosticArray, DiagnosticStatus, Bool), _recorder),
    OnlookerTarget('mux diagnostics', (DiagnosticArray,), _explained),
    HttpTarget(),
)
