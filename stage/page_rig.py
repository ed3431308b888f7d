# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A status page without ROS: a model that is fed with a whole machine, and its server."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
import math
from pathlib import Path
import threading
import time
from typing import Any

import aiohttp

from bridge_core import clock
from rugged_teleop.devices import devices
from rugged_teleop.status_page.access import Access
from rugged_teleop.status_page.graph import find
from rugged_teleop.status_page.model import Diagnostic, Model
from rugged_teleop.status_page.server import Server
from stage.rig import TIMEOUT_FACTOR

TOKEN = 'a-token-of-the-test'
_PERIOD = 0.05  # s
_BOOL, _JOY = 'std_msgs/msg/Bool', 'sensor_msgs/msg/Joy'
_STRING, _STATUS = 'std_msgs/msg/String', 'diagnostic_msgs/msg/DiagnosticStatus'
_JOINTS = 'sensor_msgs/msg/JointState'
TOPICS = {
    '/fort_vsc_bridge/estop': [_BOOL],
    '/fort_vsc_bridge/link_up': [_BOOL],
    '/fort_vsc_bridge/joy': [_JOY],
    '/fort_vsc_bridge/radio_strength': ['std_msgs/msg/Int8'],
    '/vm110_bridge/estop': [_BOOL],
    '/vm110_bridge/link_up': [_BOOL],
    '/vm110_bridge/joy': [_JOY],
    '/vm110_bridge/armed': [_BOOL],
    '/esi_drive_bridge/estop': [_BOOL],
    '/esi_drive_bridge/link_up': [_BOOL],
    '/esi_drive_bridge/enabled': [_BOOL],
    '/esi_drive_bridge/joint_states': [_JOINTS],
    '/akron_can_bridge/estop': [_BOOL],
    '/akron_can_bridge/link_up': [_BOOL],
    '/akron_can_bridge/joint_states': [_JOINTS],
    '/akron_can_bridge/limits': [_STATUS],
    '/safety_mux/state': [_STRING],
    '/safety_mux/status': [_STATUS],
    '/safety_mux/command': [_JOINTS],
    '/rosout': ['rcl_interfaces/msg/Log'],
}
MUX, FORT, UNIT = '/safety_mux', '/fort_vsc_bridge', '/vm110_bridge'
DRIVE, MONITOR = '/esi_drive_bridge', '/akron_can_bridge'
BRIDGES = (FORT, UNIT, DRIVE, MONITOR)
STOPPED = {
    'state': 'STOPPED',
    'owner': 'none',
    'inhibit 1': "e-stop source 'fort' demands a stop: release the stop button of the remote",
    'inhibit 2': 'waiting for reset: call ~/reset',
    'code': 'fort.estop.remote',
    'code.1': 'fort.estop.remote',
    'code.1.node': 'fort_vsc_bridge',
    'code.2': 'mux.reset.due',
    "condition of e-stop source 'fort'": 'stop',
    "condition of operator 'fort'": 'at rest',
    'last transition': 'ACTIVE to STOPPED, 1.5 s ago: e-stop source demands a stop',
}
WORN = 'have the brakes looked at, left: 0.62 s from 10.0 rad/s, commissioned 0.41'
LEDGER = (
    1,
    WORN,
    {
        'last seen to work': 'fort 3 h ago, deadman of fort never',
        'stops of left (rad/s, s, commissioned s)': '; '.join(
            f'10.00 {0.4 + 0.011 * n:.2f} 0.41' for n in range(21)
        ),
        'stops of right (rad/s, s, commissioned s)': '8.00 0.30 -; 8.00 - 0.33; 9.00 0.37 0.37',
    },
)
ACTIVE = {
    'state': 'ACTIVE',
    'owner': 'fort',
    "condition of e-stop source 'fort'": 'clear',
    "condition of operator 'fort'": 'in use',
    "condition of operator 'vm110'": 'rested',
    'condition of the drive': 'enabled',
    'last transition': "READY to ACTIVE, 0.2 s ago: operator 'fort' takes control",
}


def model() -> Model:
    """Return a model of the machine in TOPICS, of which nothing was heard."""
    result = Model()
    result.found(find(TOPICS, devices().values()))
    result.operators(MUX, {'fort': f'{FORT}/joy', 'vm110': f'{UNIT}/joy'})
    result.listeners(MUX, [DRIVE, MONITOR])
    return result


class Machine:
    """
    A machine that runs, as far as the page can tell: all it says is an attribute to be changed.

    :param host: as the page would be told; it is on loopback all the same.
    :param answer: of the mux to a wish. :param has_moved: for a minute already.
    """

    def __init__(
        self,
        *,
        host: str = '127.0.0.1',
        control: bool = False,
        recordings: Path | None = None,
        answer: tuple[bool, str] = (True, 'reset: READY'),
        has_moved: bool = False,
    ) -> None:
        self.status = dict(STOPPED)
        self.estops = dict.fromkeys(BRIDGES, False)
        self.silent: set[str] = set()
        self.hangs = False  # the page's node
        self.axes = [0.0, 0.0, 0.0, 0.0]
        self.speed = 0.0
        self.ledger: tuple[int, str, dict[str, str]] | None = None  # what the recorder says
        self.wishes: list[tuple[str, str]] = []
        self._model = model()
        self._answer = answer
        self.recordings: list[dict[str, Any]] = []
        access = Access(host, [''], TOKEN, control=control)
        self.make_server: Callable[[int], Server] = lambda port: Server(
            '127.0.0.1', port, access, control=self._control, recordings=recordings
        )
        self.server = self.make_server(0)
        self.port = self.server.start()
        if has_moved:
            self._move()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        return f'http://127.0.0.1:{self.port}/'

    @property
    def origin(self) -> dict[str, str]:
        return {'Origin': self.address.rstrip('/')}

    def say(self, now: float) -> dict[str, Any]:
        """Say everything once; return the snapshot."""
        model = self._model
        for name in BRIDGES:
            if name in self.silent:
                continue
            model.estop(name, self.estops[name], now)
            model.link_up(name, True, now)
            level = int(self.estops[name])
            words = 'release the stop button of the remote' if level else 'ok'
            model.diagnostic(f'{name[1:]}: device', Diagnostic(level, words, {}), now)
            counters = {'frames': f'{now * 50:.0f}', 'checksum errors': '0'}
            model.diagnostic(f'{name[1:]}: link', Diagnostic(0, 'ok', counters), now)
        if MUX not in self.silent:
            model.state(MUX, self.status['state'], now)
            model.status(MUX, self.status, now)
            model.command(MUX, {'left': self.speed, 'right': self.speed * 0.8}, now)
        if self.ledger:
            model.diagnostic('recorder: ledger', Diagnostic(*self.ledger), now)
        if FORT not in self.silent:
            model.joy(FORT, self.axes, [0, 0], now)
        model.joy(UNIT, [0.0, 0.0], [0], now)
        model.speeds(DRIVE, {'left': self.speed * 0.95, 'right': self.speed * 0.76}, now)
        return model.snapshot(now, time.time())

    def _move(self) -> None:
        now = clock.now()
        for tick in range(600):
            stick = min(max(math.sin(tick / 70) * 1.2 * math.sin(tick / 190), -1.0), 1.0)
            self.axes = [0.3 * math.sin(tick / 40), stick, 0.0, 0.0]
            self.speed = 20.0 * stick
            self.server.publish(self.say(now - 60.0 + tick / 10))

    def restart(self) -> None:
        """End the page, and start it again at the same port."""
        self.server.close()
        self.server = self.make_server(self.port)
        self.server.start()

    def _run(self) -> None:
        while not self._ending.wait(_PERIOD):
            if not self.hangs:
                self.server.publish({**self.say(clock.now()), 'recordings': self.recordings})

    def _control(self, action: str, mux: str, address: str) -> Future[tuple[bool, str]]:
        del address
        self.wishes.append((action, mux))
        result: Future[tuple[bool, str]] = Future()
        result.set_result(self._answer)
        return result

    def close(self) -> None:
        self._ending.set()
        self._thread.join(5.0)
        self.server.close()

    def __enter__(self) -> Machine:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


async def watch(
    session: aiohttp.ClientSession,
    machine_address: str,
    wanted: Callable[[dict[str, Any]], bool],
    timeout: float = 10.0,
) -> dict[str, Any]:
    """Return the first snapshot that is wanted, as a browser would get it."""
    origin = machine_address.rstrip('/')

    async def look() -> dict[str, Any]:
        async with session.ws_connect(f'{origin}/live', origin=origin) as stream:
            await stream.send_str('')
            async for message in stream:
                snapshot: dict[str, Any] = message.json()
                if 'muxes' in snapshot and wanted(snapshot):
                    return snapshot
            raise AssertionError(f'the page left with {stream.close_code}')

    return await asyncio.wait_for(look(), timeout * TIMEOUT_FACTOR)


class Viewer(threading.Thread):
    """Somebody who looks at a page: the newest snapshot is ``snapshot``."""

    def __init__(self, address: str) -> None:
        super().__init__(daemon=True)
        self.snapshot: dict[str, Any] = {}
        self._address = address
        self._leaving = False
        self.start()

    def run(self) -> None:
        asyncio.run(self._look())

    async def _look(self) -> None:
        def keep(snapshot: dict[str, Any]) -> bool:
            self.snapshot = snapshot
            return self._leaving

        async with aiohttp.ClientSession() as session:
            await watch(session, self._address, keep, timeout=300.0)

    def leave(self) -> None:
        self._leaving = True
        self.join(10.0)

    @property
    def mux(self) -> dict[str, Any]:
        return next(iter(self.snapshot.get('muxes', ())), {'state': 'none'})

    def bridge(self, name: str) -> dict[str, Any]:
        found = [each for each in self.snapshot.get('bridges', ()) if each['name'] == name]
        return found[0] if found else {'estop': 'none'}
