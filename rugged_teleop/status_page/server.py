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
import json
import logging
from pathlib import Path
import socket
import threading
from typing import Any

from aiohttp import web, WSMsgType
from aiohttp.http import HttpProcessingError

from bridge_core import clock
from rugged_teleop.status_page.access import Access
from rugged_teleop.status_page.recordings import recording

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
Control = Callable[[str, str], 'Future[tuple[bool, str]]']
_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Server:
    """
    Serves until it is closed.

    :param port: 0 takes one that is free.
    :param control: does what the page asks for.
    """

    def __init__(
        self,
        host: str,
        port: int,
        access: Access,
        *,
        control: Control,
        recordings: Path | None = None,
    ) -> None:
        self._host, self._port = host, port
        self._access = access
        self._control = control
        self._recordings = recordings
        # Read once, and nothing else is ever served: no path leads anywhere.
        self._files = {f'/{path.name}': path.read_bytes() for path in STATIC.iterdir()}
        self._files['/'] = self._files.pop('/index.html')
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
        if not self._loop.is_closed():
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
        app.router.add_post('/control', self._do)
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
        start = {'history': list(self._samples), 'control': self._access.control}
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
        self._check_origin(request)
        if not self._access.control:
            raise web.HTTPForbidden(text='this page only shows: allow_control is false')
        if not self._access.may_control(_token(request)):
            raise web.HTTPUnauthorized(text='wrong token: it was printed when the page started')
        try:
            wish = await request.json()
            action, mux, seen = wish['action'], wish['mux'], float(wish['seen'])
            confirmed = wish['confirmed'] is True and action in ACTIONS
        except (LookupError, OverflowError, RecursionError, TypeError, ValueError):
            confirmed = False
        if not confirmed:
            raise web.HTTPBadRequest(text='not done: the request makes no sense')
        if action in _TOWARDS_MOTION and not abs(clock.now() - seen) <= _SEEN_LIMIT:
            raise web.HTTPConflict(text='not done: what you saw was not up to date; look again')
        try:
            future = asyncio.wrap_future(self._control(action, mux))
            done, answer = await asyncio.wait_for(future, _ANSWER_LIMIT)
        except asyncio.TimeoutError:
            done, answer = False, f'{mux} does not answer'
        return web.json_response({'done': done, 'answer': answer})

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
