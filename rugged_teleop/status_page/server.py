# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The page over HTTP and a websocket, in a thread with an event loop of its own.

A snapshot is made and serialised once, and every browser is sent the newest one when it has taken
the last: one that is slow misses some, and one that takes nothing is dropped. Nothing waits for
a browser.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from contextlib import suppress
import ipaddress
import json
import logging
from pathlib import Path
import socket
import threading
from typing import Any

from aiohttp import web, WSMsgType
from aiohttp.http import HttpProcessingError

from bridge_core import clock
from rugged_teleop.status_page.access import Access, recording

STATIC = Path(__file__).resolve().parent / 'static'
WRONG_TOKEN = 4401  # the websocket is closed with it
ACTIONS = ('reset', 'trip', 'select autonomy', 'deselect autonomy')
_TOWARDS_MOTION = ('reset', 'select autonomy')
_TYPES = {
    '.html': 'text/html',
    '.js': 'text/javascript',
    '.css': 'text/css',
    '.svg': 'image/svg+xml',
}
_MOST_BROWSERS = 50
_TAKE_LIMIT = 2.0  # s for a browser to take a snapshot
_HELLO_LIMIT = 5.0  # s for a browser to show its token
_ANSWER_LIMIT = 5.0  # s for a service of the mux
_SEEN_LIMIT = 2.0  # s; who saw nothing newer does not know what he decides about
_START_LIMIT = 10.0  # s
_HISTORY = 60.0  # s that the charts show
_BUFFER = 1 << 16  # bytes on the way to one browser: some snapshots, not minutes of them
_LONGEST = 1 << 12  # bytes that a browser may send
_NO_SENSE = 'not done: the request makes no sense'
_HEADERS = {
    'Content-Security-Policy': "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Referrer-Policy': 'no-referrer',
    'X-Content-Type-Options': 'nosniff',
    'Cache-Control': 'no-store',
}

_LOG = logging.getLogger(__name__)

# Action and mux; the future has whether it was done, and the answer in words.
Control = Callable[[str, str, str], 'Future[tuple[bool, str]]']
# Takes an answer: from which browser, to which question, its kind, its text. Returns why not.
Desk = Callable[[str, int, str, str], str]
_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Server:
    """
    Serves until it is closed.

    :param port: 0 takes one that is free.
    :param control: does what the page asks for: action, mux, and from which address.
    :param desk: takes answers, of a page that asks. :param front: the file that is shown first.
    """

    def __init__(
        self,
        host: str,
        port: int,
        access: Access,
        *,
        control: Control | None = None,
        recordings: Path | None = None,
        desk: Desk | None = None,
        front: str = 'index.html',
    ) -> None:
        self._host, self._port = host, port
        self._access = access
        self._control, self._desk = control, desk
        self._recordings = recordings
        # Read once, and nothing else is ever served: no path leads anywhere.
        files = [path for path in STATIC.iterdir() if path.suffix != '.html']
        self._files = {f'/{path.name}': path.read_bytes() for path in files}
        self._files['/'] = (STATIC / front).read_bytes()
        self._loop = asyncio.new_event_loop()
        self._ending = asyncio.Event()
        self._news = asyncio.Event()  # set and cleared at once: it wakes those who wait
        self._text = ''
        self._samples: deque[tuple[float, Any]] = deque()  # of the last minute
        self.browsers = 0  # that look at this moment
        self._started: Future[int] = Future()
        self._thread = threading.Thread(target=self._run, name='status page', daemon=True)

    # For other threads.

    def start(self) -> int:
        """Begin to serve; return the port. :raises OSError: it cannot be had."""
        self._thread.start()
        return self._started.result(_START_LIMIT)

    def publish(self, snapshot: dict[str, Any]) -> None:
        """Have every browser shown this, unless there is a newer one by then."""
        text = json.dumps(snapshot, separators=(',', ':'), allow_nan=False)
        self._soon(self._show, text, snapshot['now'], snapshot['sample'])

    def close(self) -> None:
        """Leave all browsers, and end. May be repeated."""
        self._soon(self._ending.set)
        if self._thread.is_alive():
            self._thread.join(_TAKE_LIMIT)

    def _soon(self, function: Callable[..., None], *args: Any) -> None:
        with suppress(RuntimeError):  # it has ended, just now perhaps
            self._loop.call_soon_threadsafe(function, *args)

    # In the thread.

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except Exception as error:
            if self._started.done():
                raise
            self._started.set_exception(error)
        finally:
            self._loop.close()

    def _application(self) -> web.Application:
        app = web.Application(middlewares=[self._guard], client_max_size=_LONGEST)
        app.router.add_get('/live', self._live)
        if self._control is not None:
            app.router.add_post('/control', self._do)
        if self._desk is not None:
            app.router.add_post('/answer', self._take)
        app.router.add_get('/recordings/{name}', self._recording)
        for name in self._files:
            app.router.add_get(name, self._file)
        return app

    async def _serve(self) -> None:
        runner = web.AppRunner(
            self._application(), access_log=None, shutdown_timeout=0.1, logger=_LOG
        )
        await runner.setup()
        try:
            site = web.TCPSite(runner, self._host, self._port)
            await site.start()
            self._started.set_result(int(runner.addresses[0][1]))
            await self._ending.wait()
            self._news.set()
        finally:
            await runner.cleanup()

    def _show(self, text: str, now: float, sample: Any) -> None:
        self._text = text
        self._samples.append((now, sample))
        while self._samples[0][0] < now - _HISTORY:
            self._samples.popleft()
        self._news.set()
        self._news.clear()

    @web.middleware
    async def _guard(self, request: web.Request, handler: _Handler) -> web.StreamResponse:
        """Refuse a name that is not ours, and give every answer its headers."""
        host = request.host
        if not all(map(str.isascii, request.headers.values())):  # nobody has to read the others
            response: web.StreamResponse = web.Response(status=400, text='headers are ASCII')
        elif not self._access.knows(host):
            response = web.Response(
                status=403,
                text=f'{host} is no known name of this page: add it to the parameter names',
            )
        else:
            try:
                response = await handler(request)
            except web.HTTPException as error:
                response = web.Response(status=error.status, text=error.text)
        if not response.prepared:
            response.headers.update(_HEADERS)
        return response

    async def _file(self, request: web.Request) -> web.StreamResponse:
        suffix = Path(request.path).suffix or '.html'
        return web.Response(
            body=self._files[request.path], content_type=_TYPES[suffix], charset='utf-8'
        )

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """Send snapshots to a browser until one of us leaves."""
        self._check_origin(request)
        if self.browsers >= _MOST_BROWSERS:
            raise web.HTTPServiceUnavailable(text='too many browsers look at this page')
        _keep_little(request)
        stream = web.WebSocketResponse(compress=False, max_msg_size=_LONGEST, timeout=0.5)
        self.browsers += 1
        try:
            await stream.prepare(request)
            await self._talk(request, stream)
        except (ConnectionError, asyncio.TimeoutError):
            if request.transport is not None:
                request.transport.abort()  # what waits to be taken will not be
        finally:
            self.browsers -= 1
        return stream

    async def _talk(self, request: web.Request, stream: web.WebSocketResponse) -> None:
        hello = await stream.receive(timeout=_HELLO_LIMIT)
        if hello.type is not WSMsgType.TEXT:
            return
        if not self._access.may_see(hello.data):
            await stream.close(code=WRONG_TOKEN)
            return
        start = {
            'history': list(self._samples),
            'control': self._access.control,
            'now': clock.now(),  # what it is shown next may be older
        }
        await _give(stream, json.dumps(start, separators=(',', ':'), allow_nan=False))
        reader = asyncio.create_task(_read(stream))
        try:
            shown = ''
            while not (stream.closed or reader.done() or self._ending.is_set()):
                if self._text is shown:
                    await self._news.wait()
                else:
                    shown = self._text
                    await _give(stream, shown)
        finally:
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)
        await stream.close()

    async def _do(self, request: web.Request) -> web.StreamResponse:
        """Do what a confirmed request with the token asks for."""
        assert self._control is not None
        wish = await self._wish(request)
        try:
            action, mux = wish['action'], wish['mux']
            confirmed = wish['confirmed'] is True and action in ACTIONS
        except (LookupError, TypeError):
            confirmed = False
        if not confirmed:
            raise web.HTTPBadRequest(text=_NO_SENSE)
        _check_seen(wish, needed=action in _TOWARDS_MOTION)
        try:
            future = asyncio.wrap_future(self._control(action, mux, request.remote or '?'))
            done, answer = await asyncio.wait_for(future, _ANSWER_LIMIT)
        except asyncio.TimeoutError:
            done, answer = False, f'{mux} does not answer'
        return web.json_response({'done': done, 'answer': answer})

    async def _take(self, request: web.Request) -> web.StreamResponse:
        """Take an answer of whoever has the token."""
        assert self._desk is not None
        wish = await self._wish(request)
        try:
            hand, kind, text = (str(wish[name]) for name in ('hand', 'kind', 'text'))
            number = int(wish['number'])
        except (LookupError, OverflowError, TypeError, ValueError):
            raise web.HTTPBadRequest(text=_NO_SENSE) from None
        _check_seen(wish, needed=True)
        refusal = self._desk(hand, number, kind, text)
        if refusal:
            raise web.HTTPConflict(text=f'not done: {refusal}')
        return web.json_response({'done': True, 'answer': ''})

    async def _wish(self, request: web.Request) -> Any:
        """Return what somebody with the token wants, as it came."""
        self._check_origin(request)
        if not self._access.control:
            raise web.HTTPForbidden(text='this page only shows: allow_control is false')
        if not self._access.may_control(_token(request)):
            raise web.HTTPUnauthorized(text='wrong token: it was printed when the page started')
        try:
            return await request.json()
        except (LookupError, RecursionError, ValueError):
            raise web.HTTPBadRequest(text=_NO_SENSE) from None

    async def _recording(self, request: web.Request) -> web.StreamResponse:
        if not self._access.may_see(_token(request)):
            raise web.HTTPUnauthorized(text='wrong token: it was printed when the page started')
        path = recording(self._recordings, request.match_info['name'])
        if path is None:
            raise web.HTTPNotFound(text='there is no such recording')
        attachment = f'attachment; filename="{path.name}"' if path.name.isascii() else 'attachment'
        return web.FileResponse(path, headers={**_HEADERS, 'Content-Disposition': attachment})

    def _check_origin(self, request: web.Request) -> None:
        if not self._access.same_origin(request.headers.get('Origin'), request.host):
            raise web.HTTPForbidden(text='refused: this request comes from another site')


def _is_own_fault(record: logging.LogRecord) -> bool:
    """Leave out what is wrong with a request: that is told to whoever sent it."""
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))


_LOG.addFilter(_is_own_fault)


def _check_seen(wish: Any, *, needed: bool) -> None:
    """Refuse the wish of somebody who does not see how things are."""
    try:
        late = not abs(clock.now() - float(wish['seen'])) <= _SEEN_LIMIT
    except (LookupError, OverflowError, TypeError, ValueError):
        raise web.HTTPBadRequest(text=_NO_SENSE) from None
    if late and needed:
        raise web.HTTPConflict(text='not done: what you saw was not up to date; look again')


def address_of(host: str, port: int, token: str = '') -> str:
    """Return where a browser reaches the page, with the token behind the #."""
    if ipaddress.ip_address(host).is_unspecified:
        family = socket.AF_INET6 if ':' in host else socket.AF_INET
        with socket.socket(family, socket.SOCK_DGRAM) as probe, suppress(OSError):
            probe.connect(('2001:db8::1' if ':' in host else '192.0.2.1', 9))  # sends nothing
            host = probe.getsockname()[0]
    return f'http://{f"[{host}]" if ":" in host else host}:{port}/{token and f"#{token}"}'


def _token(request: web.Request) -> str:
    return request.headers.get('Authorization', '').removeprefix('Bearer ')


def _keep_little(request: web.Request) -> None:
    """Let the kernel keep little for a browser that does not take it."""
    if request.transport is not None:
        plug = request.transport.get_extra_info('socket')
        plug.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)


async def _give(stream: web.WebSocketResponse, text: str) -> None:
    """Send it. :raises asyncio.TimeoutError: it was not taken in time."""
    await asyncio.wait_for(stream.send_str(text), _TAKE_LIMIT)


async def _read(stream: web.WebSocketResponse) -> None:
    """Wait for the end; a browser has nothing to say."""
    async for _ in stream:
        pass
