# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's server, without browser and ROS: who is let in, and who is never waited for."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from http.client import HTTPConnection
import json
import math
from pathlib import Path
import socket
from typing import Any

import aiohttp
import pytest

from bridge_core import clock
from rugged_teleop.status_page import server
from rugged_teleop.status_page.access import Access, recordings
from rugged_teleop.status_page.server import WRONG_TOKEN
from stage.page_rig import FORT, Machine, MUX, TOKEN, watch
from stage.rig import TIMEOUT_FACTOR

WISH = {'action': 'reset', 'mux': MUX, 'confirmed': True}
BEARER = {'Authorization': f'Bearer {TOKEN}'}


@pytest.fixture(scope='module')
def machine() -> Iterator[Machine]:
    with Machine() as result:
        yield result


def got(
    machine: Machine, path: str, body: str | None = None, **headers: str
) -> tuple[int, dict[str, str], bytes]:
    """Return status, headers and body; the path goes out as it is."""
    plug = HTTPConnection('127.0.0.1', machine.port, timeout=10.0)
    try:
        plug.request('GET' if body is None else 'POST', path, body, headers)
        answer = plug.getresponse()
        return answer.status, dict(answer.headers), answer.read()
    finally:
        plug.close()


def asked(machine: Machine, wish: Any, headers: dict[str, str]) -> tuple[int, str]:
    """Return status and text of the answer to a wish; a text goes out as it is."""
    body = wish if isinstance(wish, str) else json.dumps(wish)
    kind = {'Content-Type': 'application/json', **headers}
    status, _, answer = got(machine, '/control', body, **kind)
    return status, answer.decode()


def first_told(machine: Machine, token: str) -> aiohttp.WSMessage:
    """Return the first message of the stream to a browser with this token."""

    async def first() -> aiohttp.WSMessage:
        origin = machine.address.rstrip('/')
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f'{machine.address}live', origin=origin) as stream,
        ):
            await stream.send_str(token)
            return await stream.receive(10.0)

    return asyncio.run(first())


# Who comes from where.


@pytest.mark.parametrize(
    ('host', 'known'),
    [
        ('localhost:8080', True),
        ('127.0.0.1', True),
        ('192.168.1.7:8080', True),
        ('[::1]:8080', True),
        ('robot.local', True),
        ('ROBOT.local:80', True),
        ('evil.example', False),
        ('localhost.evil.example', False),
        ('127.0.0.1.evil.example', False),
        ('', False),
        ('[::1', False),
    ],
)
def test_name_that_could_be_rebound_is_refused(host: str, known: bool) -> None:
    assert Access('0.0.0.0', ['robot.local'], 't', control=False).knows(host) is known


@pytest.mark.parametrize(
    ('origin', 'same'),
    [
        ('http://127.0.0.1:8080', True),
        ('https://127.0.0.1:8080', True),
        ('http://127.0.0.1:8081', False),
        ('http://evil.example', False),
        ('http://r[::1obot:8080', False),
        ('null', False),
        (None, False),
    ],
)
def test_other_site_is_no_origin(origin: str | None, same: bool) -> None:
    access = Access('127.0.0.1', [], 't', control=False)
    assert access.same_origin(origin, '127.0.0.1:8080') is same


def test_token_is_needed_beyond_loopback_and_for_control() -> None:
    for host, is_open in (('127.0.0.1', True), ('::1', True), ('0.0.0.0', False)):
        for control in (False, True):
            access = Access(host, [], 'secret', control=control)
            assert access.may_see('') is is_open
            assert access.may_see('secret')
            assert not access.may_control('')
            assert not access.may_control('sécret\ud800')
            assert access.may_control('secret') is control
            assert access.needs_token is (control or not is_open)


def answer_to(machine: Machine, data: bytes) -> bytes:
    """Return the beginning of what the server says to these bytes."""
    with socket.create_connection(('127.0.0.1', machine.port), 5.0) as plug:
        plug.sendall(data)
        return plug.recv(100)


@pytest.mark.parametrize('header', ['Host', 'Sec-WebSocket-Key', 'Authorization'])
def test_header_that_is_no_text_is_refused_and_no_fault(machine: Machine, header: str) -> None:
    data = b'GET /live HTTP/1.0\r\n%s: \xff\r\n\r\n' % header.encode()
    assert b' 400 ' in answer_to(machine, data)


@pytest.mark.parametrize(
    'line', [b'\x81\x80\0', b'GET / HTTP/1.1\r\nSec-WebS\x7fcket: 1', b'GET / HTTP/9999999999']
)
def test_nonsense_is_answered_and_fills_no_log(
    machine: Machine, line: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    assert b' 400 ' in answer_to(machine, line + b'\r\n\r\n')
    assert not caplog.records


def test_foreign_host_gets_nothing(machine: Machine) -> None:
    for path in ('/', '/page.js', '/live', '/recordings/a.mcap', '/nothing'):
        status, headers, body = got(machine, path, Host='evil.example')
        assert status == 403, path
        assert b'<' not in body
        assert 'Content-Security-Policy' in headers


@pytest.mark.parametrize('origin', ['http://evil.example', None])
def test_websocket_of_another_site_is_refused(machine: Machine, origin: str | None) -> None:
    async def look() -> None:
        async with aiohttp.ClientSession() as session:
            await session.ws_connect(f'{machine.address}live', origin=origin)

    with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
        asyncio.run(look())
    assert caught.value.status == 403


def test_wrong_token_sees_nothing_beyond_loopback() -> None:
    with Machine(host='0.0.0.0') as machine:
        for token in ('', 'wrong'):
            told = first_told(machine, token)
            assert (told.data, told.type) == (WRONG_TOKEN, aiohttp.WSMsgType.CLOSE)
        assert 'history' in first_told(machine, TOKEN).json()


# What is served.


def test_page_loads_nothing_from_elsewhere_and_nothing_inline(machine: Machine) -> None:
    for path, kind in (
        ('/', 'text/html'),
        ('/page.js', 'text/javascript'),
        ('/page.css', 'text/css'),
        ('/icon.svg', 'image/svg+xml'),
    ):
        status, headers, body = got(machine, path)
        assert status == 200
        assert headers['Content-Type'].startswith(kind)
        policy = headers['Content-Security-Policy']
        assert "default-src 'none'" in policy
        assert 'unsafe' not in policy
        assert 'Set-Cookie' not in headers
        outside = body.replace(b'http://www.w3.org/2000/svg', b'')
        assert b'http:' not in outside
        assert b'https:' not in outside.replace(b"=== 'https:'", b'')
        assert b' style=' not in body
        assert b' onclick=' not in body


OUTSIDE = (
    '/../server.py',
    '/%2e%2e/server.py',
    '/static/page.js',
    '/recordings/../secret.mcap',
    '/recordings/%2e%2e%2fsecret.mcap',
    '/recordings/..%5csecret.mcap',
    '/recordings/link.mcap',
    '/recordings/notes.txt',
    '/recordings/.mcap',
    '/recordings/none.mcap',
    '/recordings/folder.mcap',
    '/recordings/',
)


def test_no_path_leads_out_of_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / 'recordings'
    (folder / 'folder.mcap').mkdir(parents=True)
    (tmp_path / 'secret.mcap').write_bytes(b'secret')
    (folder / 'link.mcap').symlink_to(tmp_path / 'secret.mcap')
    (folder / 'notes.txt').write_bytes(b'secret')
    with Machine(recordings=folder) as machine:
        for path in OUTSIDE:
            status, _, body = got(machine, path)
            assert (status, b'secret' in body) == (404, False), path


def test_newest_recording_is_listed_first_and_nothing_else(tmp_path: Path) -> None:
    for name in ('1.mcap', '2.mcap', 'notes.txt'):
        (tmp_path / name).write_bytes(b'12')
    (tmp_path / '3.mcap').symlink_to(tmp_path / 'notes.txt')
    listed = [{'name': '2.mcap', 'size': 2}, {'name': '1.mcap', 'size': 2}]
    assert recordings(tmp_path) == listed
    assert recordings(None) == recordings(tmp_path / 'gone') == []


def test_recording_is_downloaded_as_it_is(tmp_path: Path) -> None:
    (tmp_path / 'stop 1.mcap').write_bytes(b'\x89MCAP')
    with Machine(recordings=tmp_path) as machine:
        status, headers, body = got(machine, '/recordings/stop%201.mcap')
    assert (status, body) == (200, b'\x89MCAP')
    assert headers['Content-Disposition'] == 'attachment; filename="stop 1.mcap"'
    assert headers['X-Content-Type-Options'] == 'nosniff'


def test_recording_beyond_loopback_needs_the_token(tmp_path: Path) -> None:
    (tmp_path / 'a.mcap').write_bytes(b'x')
    with Machine(host='0.0.0.0', recordings=tmp_path) as machine:
        assert got(machine, '/recordings/a.mcap')[0] == 401
        assert got(machine, '/recordings/a.mcap', **BEARER)[0] == 200


def test_taken_port_is_an_error(machine: Machine) -> None:
    with pytest.raises(OSError, match='address already in use'):
        machine.make_server(machine.port).start()


# What is shown.


def test_stop_reaches_every_browser(machine: Machine) -> None:
    async def see() -> None:
        async with aiohttp.ClientSession() as session:

            def stops(snapshot: dict[str, Any]) -> bool:
                shown = {each['name']: each['estop'] for each in snapshot['bridges']}
                return bool(shown[FORT] == 'stop')

            machine.estops[FORT] = True
            await asyncio.gather(*(watch(session, machine.address, stops) for _ in range(20)))

    try:
        asyncio.run(see())
    finally:
        machine.estops[FORT] = False


def test_new_browser_gets_the_last_minute_first(machine: Machine) -> None:
    start = first_told(machine, '').json()
    assert start['control'] is False
    moments = [at for at, _ in start['history']]
    assert moments == sorted(moments)
    assert moments[-1] <= start['now'] <= clock.now()
    assert f'axis|{FORT}|0' in start['history'][-1][1]


def test_browser_that_takes_nothing_is_dropped_and_holds_up_nobody(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, '_TAKE_LIMIT', 2.0 * TIMEOUT_FACTOR)  # of a busy machine
    lazy = socket.create_connection(('127.0.0.1', machine.port))
    lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    lazy.sendall(
        b'GET /live HTTP/1.1\r\nHost: 127.0.0.1:%(port)d\r\nOrigin: http://127.0.0.1:%(port)d\r\n'
        b'Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
        b'Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n'
        % {b'port': machine.port}
        + b'\x81\x80\0\0\0\0'  # an empty text
    )
    machine.status['slowed'] = 'x' * 200_000  # it takes no minute to fill the way
    try:

        async def see() -> None:
            async with aiohttp.ClientSession() as session:
                beside = 0  # snapshots that we got while it took none

                def is_alone(_: dict[str, Any]) -> bool:
                    nonlocal beside
                    beside += machine.server.browsers == 2
                    return beside > 5 and bool(machine.server.browsers == 1)

                await watch(session, machine.address, is_alone, timeout=30.0)

        asyncio.run(see())
    finally:
        machine.status.pop('slowed')
        lazy.close()


# What is done.


def seen_by(machine: Machine) -> float:
    async def newest() -> float:
        async with aiohttp.ClientSession() as session:
            snapshot = await watch(session, machine.address, lambda _: True)
            return float(snapshot['now'])

    return asyncio.run(newest())


def test_page_that_only_shows_does_nothing_with_any_token(machine: Machine) -> None:
    wish = WISH | {'seen': seen_by(machine)}
    status, text = asked(machine, wish, machine.origin | BEARER)
    assert status == 403
    assert 'allow_control' in text
    assert machine.wishes == []


def test_wish_is_done_only_with_origin_token_and_confirmation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(server, '_SEEN_LIMIT', 10.0 * TIMEOUT_FACTOR)  # of a busy machine
    with Machine(control=True, answer=(False, 'not reset: why')) as machine:
        now = seen_by(machine)
        good = WISH | {'seen': now}
        ours = machine.origin | BEARER
        wrong = {'Authorization': 'Bearer wrong'}
        refused: list[tuple[Any, dict[str, str], int]] = [
            (good, BEARER, 403),
            (good, {'Origin': 'http://evil.example'} | BEARER, 403),
            (good, machine.origin, 401),
            (good, machine.origin | wrong, 401),
            (good | {'confirmed': False}, ours, 400),
            (good | {'confirmed': 'yes'}, ours, 400),
            (good | {'action': 'move'}, ours, 400),
            ({'action': 'reset'}, ours, 400),
            ('"reset"', ours, 400),
            (good | {'seen': now - 60.0}, ours, 409),
            (good | {'seen': float(10**9)}, ours, 409),
            (good | {'seen': math.nan}, ours, 409),
            (good | {'padding': 'x' * 10_000}, ours, 413),
        ]
        for wish, headers, expected in refused:
            status, text = asked(machine, wish, headers)
            assert status == expected, (wish, headers, text)
        assert machine.wishes == []
        status, text = asked(machine, WISH | {'seen': seen_by(machine)}, ours)
        assert (status, json.loads(text)) == (200, {'done': False, 'answer': 'not reset: why'})
        assert machine.wishes == [('reset', MUX)]
        # A stop does not depend on what was seen.
        assert asked(machine, good | {'action': 'trip', 'seen': 0.0}, ours)[0] == 200
        assert machine.wishes[1:] == [('trip', MUX)]


@pytest.mark.parametrize(
    ('body', 'kind'),
    [
        ('[' * 4000, 'application/json'),
        (json.dumps(WISH | {'seen': 10**400}), 'application/json'),
        (json.dumps(WISH | {'seen': 1.0}), 'application/json; charset=foo'),
        ('not JSON', 'application/json'),
    ],
    ids=['nested', 'a number of 401 digits', 'an unknown charset', 'no JSON'],
)
def test_wish_that_cannot_be_read_makes_no_sense_and_is_no_fault(
    body: str, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    with Machine(control=True) as machine:
        headers = machine.origin | BEARER | {'Content-Type': kind}
        answer = asked(machine, body, headers)
        assert answer == (400, 'not done: the request makes no sense')
        assert machine.wishes == []
    assert not caplog.records


def test_wish_of_who_saw_a_page_that_hangs_is_refused_but_a_trip(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It is the newest page there is, and old: all may have changed since."""
    with Machine(control=True) as machine:
        now = seen_by(machine)
        machine.hangs = True
        monkeypatch.setattr(clock, 'now', lambda: now + 2.1)
        for action, expected in (('reset', 409), ('select autonomy', 409), ('trip', 200)):
            wish = WISH | {'action': action, 'seen': now}
            assert asked(machine, wish, machine.origin | BEARER)[0] == expected, action
        assert machine.wishes == [('trip', MUX)]
