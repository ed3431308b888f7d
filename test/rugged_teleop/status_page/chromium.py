# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A headless Chromium, by the DevTools protocol: load, evaluate, look.

Where there is none, tests are skipped, or fail if RUGGED_TELEOP_REQUIRE_CHROMIUM is 1, as CI
sets it.
"""

from __future__ import annotations

import asyncio
import base64
from collections.abc import Coroutine
import os
from pathlib import Path
import shutil
import subprocess
from typing import Any, TypeVar

import aiohttp
import pytest

from stage.rig import wait_for

_PROGRAMS = ('chromium', 'chromium-browser', 'google-chrome', 'chrome')
_OPTIONS = (
    *('--headless=new', '--remote-debugging-port=0', '--no-first-run', '--disable-gpu'),
    *('--disable-extensions', '--disable-background-networking', '--disable-component-update'),
    *('--disable-sync', '--hide-scrollbars', '--disable-dev-shm-usage', '--mute-audio'),
    '--no-sandbox',  # it does not start as root otherwise, and shows nothing but our own page
)
_LIMIT = 30.0  # s, of one answer
T = TypeVar('T')


class Browser:
    """One tab. :param folder: its profile, thrown away with the test."""

    def __init__(self, folder: Path) -> None:
        program = next(filter(None, map(shutil.which, _PROGRAMS)), None)
        if program is None:
            text = 'the page was not tested in a browser: there is no chromium'
            if os.environ.get('RUGGED_TELEOP_REQUIRE_CHROMIUM') == '1':
                pytest.fail(text)
            pytest.skip(text)
        self.problems: list[str] = []  # errors on the console, and exceptions
        self._count = 0
        self._loop = asyncio.new_event_loop()
        self._process = subprocess.Popen(
            [program, *_OPTIONS, f'--user-data-dir={folder}', 'about:blank'],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        told = folder / 'DevToolsActivePort'
        try:
            wait_for(lambda: told.exists() and '\n' in told.read_text(), 60.0, 'a browser')
            self._wait(self._open(told.read_text().split('\n')[0]))
        except BaseException:
            self._end()
            raise
        for domain in ('Page', 'Runtime', 'Log'):
            self.call(f'{domain}.enable')

    def _wait(self, what: Coroutine[Any, Any, T]) -> T:
        return self._loop.run_until_complete(asyncio.wait_for(what, _LIMIT))

    async def _open(self, port: str) -> None:
        self._session = aiohttp.ClientSession()
        async with self._session.get(f'http://127.0.0.1:{port}/json') as answer:
            (tab, *_) = [each for each in await answer.json() if each['type'] == 'page']
        self._wire = await self._session.ws_connect(tab['webSocketDebuggerUrl'], max_msg_size=0)

    def call(self, method: str, **parameters: Any) -> Any:
        """Return the result of a DevTools method. :raises AssertionError: it has none."""
        return self._wait(self._call(method, parameters))

    async def _call(self, method: str, parameters: dict[str, Any]) -> Any:
        self._count += 1
        await self._wire.send_json({'id': self._count, 'method': method, 'params': parameters})
        while True:
            message = await self._wire.receive_json()
            self._note(message)
            if message.get('id') == self._count:
                assert 'error' not in message, f'{method}: {message}'
                return message['result']

    def _note(self, message: dict[str, Any]) -> None:
        """Keep what a person would see in red on the console."""
        method, what = message.get('method'), message.get('params', {})
        if method == 'Runtime.exceptionThrown':
            self.problems.append(str(what['exceptionDetails']))
        elif method == 'Runtime.consoleAPICalled' and what['type'] in ('error', 'warning'):
            self.problems.append(str(what['args']))
        elif method == 'Log.entryAdded' and what['entry']['level'] == 'error':
            self.problems.append(f'{what["entry"]["text"]} {what["entry"].get("url", "")}')

    def show(self, width: int, height: int, *, dark: bool = False) -> None:
        """Be a screen of this size (px)."""
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 500,
        )
        scheme = {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}
        self.call('Emulation.setEmulatedMedia', features=[scheme])

    def load(self, address: str) -> None:
        """Go to an address; a change behind its # alone loads it anew, too."""
        self.call('Page.navigate', url='about:blank')
        self.call('Page.navigate', url=address)

    def evaluate(self, script: str) -> Any:
        """Return the value of an expression; of a promise, what it becomes."""
        result = self.call(
            'Runtime.evaluate', expression=script, returnByValue=True, awaitPromise=True
        )
        assert 'exceptionDetails' not in result, f'{script}: {result["exceptionDetails"]}'
        return result['result'].get('value')

    def text(self, selector: str) -> str:
        """Return the text that is seen of an element; empty if there is none."""
        return str(self.evaluate(f'document.querySelector({selector!r})?.innerText ?? ""'))

    def wait(self, script: str, what: str, timeout: float = 20.0) -> Any:
        """Wait until an expression is true; return it."""
        return wait_for(
            lambda: self.evaluate(script),
            timeout,
            lambda: f'{what}; the page says: {self.text("body")[:600]}; {self.problems}',
        )

    def says(self, selector: str, text: str) -> None:
        """Wait until an element that is seen has this text."""
        self.wait(
            f'((each) => each?.checkVisibility() && each.innerText.includes({text!r}))'
            f'(document.querySelector({selector!r}))',
            f'{text!r} in {selector}',
        )

    def press(self, key: str) -> None:
        """Press a key, such as Tab or Enter."""
        codes = {'Tab': 9, 'Enter': 13, 'Escape': 27}
        for kind in ('keyDown', 'keyUp'):
            text = {'text': '\r'} if key == 'Enter' and kind == 'keyDown' else {}
            code = codes[key]
            self.call(
                'Input.dispatchKeyEvent', type=kind, key=key, windowsVirtualKeyCode=code, **text
            )

    def picture(self, path: Path, *, whole: bool = False) -> None:
        """Write a PNG or a WebP of what is seen, or of the whole page."""
        kind = {'format': 'png'} if path.suffix == '.png' else {'format': 'webp', 'quality': 40}
        data = self.call('Page.captureScreenshot', captureBeyondViewport=whole, **kind)
        path.write_bytes(base64.b64decode(data['data']))

    def close(self) -> None:
        """End it."""
        self._wait(self._session.close())
        self._end()
        self._loop.close()

    def _end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
