# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Talking to the SSC's menus over its serial line (3), without a port or a clock.

A script says, step by step, which keys to press and what to wait for; a Dialogue carries it out.
The manual prints the menus, but a scan has lost blanks and letters of them, and nothing says what
stands between two menus. So titles are looked for without regard to blanks, case, colours and
cursor movements, and what was found counts only once the unit has fallen silent.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from enum import Enum
import math
import re
from typing import TypeVar

from ssc_bridge.config.image import Image

# Seconds of silence after which a screen is complete: 100 ms are 1152 bytes of line time.
SETTLE = 0.1
_KEPT = 16384  # characters; a menu has some 600, an image 500
# The manual gives <ESC> as 0x27; 27 is its decimal code. Both are taken.
_ANSI = re.compile(r"[\x1b']\[[0-9;]*[A-Za-z]")
_MENU_LINE = re.compile(r'\b[A-Z0-9]\) ')
_END_OF_IMAGE = re.compile(r'\bend\b.{0,8}\bimage\W*-', re.IGNORECASE)
_PROMPT = 'select:'
_WORDS = 5  # the main menu has 13


class MenuError(Exception):
    """The unit did not do what the manual says, or the user gave up."""


class Screen(Enum):
    """What the unit shows; the value tells it from others."""

    MAIN = 'mainmenu'
    CONFIG = 'savetonvmemory'
    WAITING = 'waitingforimage'
    OTHER = ''  # any other menu


_TITLED = (Screen.MAIN, Screen.CONFIG)


@dataclass(frozen=True, slots=True)
class Step:
    """
    Press keys, then wait.

    :param keys: sent at once. :param until: tells from the text since then whether it is over.
    :param seconds: to wait at most.
    """

    keys: bytes
    until: Callable[[str], bool]
    seconds: float


# Yields steps, and lines for the user. A step's answer is what the unit has said; None: it was not
# what the step waits for.
T = TypeVar('T')
Script = Generator[Step | str, str | None, T]


class Dialogue:
    """
    A script under way. Nothing raises: ``error`` tells how it ended.

    :ivar result: what the script returned; None until then, and after an error.
    """

    def __init__(self, script: Script[Image]) -> None:
        self.result: Image | None = None
        self.error: MenuError | None = None
        self._script = script
        self._step: Step | None = None
        self._ends_at = self._heard_at = -math.inf
        self._text = ''
        self._cancelled = False

    @property
    def done(self) -> bool:
        """The script has ended."""
        return self.result is not None or self.error is not None

    @property
    def deadline(self) -> float:
        """The moment at which poll should be called (seconds, monotonic)."""
        if self._step is None or self._cancelled:
            return -math.inf
        complete = self._step.until(self._text)
        return min(self._ends_at, self._heard_at + SETTLE) if complete else self._ends_at

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes of the unit, in any split."""
        self._text = (self._text + data.decode('latin-1'))[-_KEPT:]
        self._heard_at = now

    def poll(self, now: float) -> tuple[list[str], bytes]:
        """Return lines for the user, and the keys that are due."""
        lines: list[str] = []
        keys = b''
        while not self.done and now >= self.deadline:
            item = self._resume()
            if isinstance(item, str):
                lines.append(item)
                self._step = None
            elif item is not None:
                keys += item.keys
                self._step, self._ends_at, self._text = item, now + item.seconds, ''
        return lines, keys

    def cancel(self) -> None:
        """Have the script give up, in its own way."""
        self._cancelled = True

    def _resume(self) -> Step | str | None:
        """Run the script up to its next step; None: it has ended."""
        found = self._step is not None and self._step.until(self._text)
        try:
            if self._cancelled:
                self._cancelled = False
                return self._script.throw(MenuError('interrupted'))
            return self._script.send(self._text if found else None)
        except StopIteration as end:
            self.result = end.value
        except MenuError as error:
            self.error = error
        return None


def readable(text: str) -> str:
    """Return what was said before a menu came, in one line that can be printed."""
    shown = ''.join(sign if sign.isprintable() else ' ' for sign in _ANSI.sub(' ', text))
    return ' '.join(_MENU_LINE.split(shown)[0].split())


def _plain(text: str) -> str:
    return ''.join(_ANSI.sub('', text).split()).lower()


def screen_of(text: str) -> Screen | None:
    """Return the screen that was shown last; None: none was."""
    plain = _plain(text)
    head, prompt, tail = plain.rpartition(_PROMPT)
    if Screen.WAITING.value in tail:
        return Screen.WAITING
    if not prompt:
        return None
    menu = head.rpartition(_PROMPT)[2]
    place, title = max((menu.rfind(title.value), title.value) for title in _TITLED)
    return Screen(title) if place >= 0 else Screen.OTHER


def shows_menu(text: str) -> bool:
    """Tell whether any menu was shown."""
    return screen_of(text) not in (None, Screen.WAITING)


def talks(text: str) -> bool:
    """Tell whether there is text at all, and no binary messages, which have no words (4)."""
    return len(set(re.findall('[A-Za-z]{4,}', text))) >= _WORDS


def waits_for_image(text: str) -> bool:
    """Tell whether the unit asks for the image (3.1)."""
    return screen_of(text) is Screen.WAITING


def has_image(text: str) -> bool:
    """Tell whether the end of a printed image has come (3.1)."""
    return _END_OF_IMAGE.search(text) is not None


def image_in(text: str) -> Image:
    """Read a printed image. :raises ImageError: damaged on the way."""
    return Image.parse(_ANSI.sub('', text))


def has_words(text: str) -> bool:
    """Tell whether there is more than an echo of hex digits."""
    return re.search('[g-z]', _plain(text)) is not None


def never(text: str) -> bool:
    """Wait for the whole time."""
    del text
    return False
