"""Publishing and logging beside the link thread, which waits for nobody but the device."""

from collections import deque
from collections.abc import Callable
import threading
import time
import traceback
from typing import Any

_ROOM = 10_000  # calls: some seconds of the busiest node
_COMPLAINT_PERIOD = 1.0


class Outbox:
    """
    A thread that makes calls for another one, in the order in which they were posted.

    A publish may take seconds: see docs/decisions/0012. Nothing is dropped or replaced unless
    there is no room, then the oldest: a stop and its release come out as two messages.

    :param name: of the thread.
    """

    def __init__(self, name: str) -> None:
        self.lost = 0  # calls that there was no room for
        self.longest_wait = 0.0  # s, from a call's posting to its end
        self._waiting: deque[tuple[float, Callable[..., Any], tuple[Any, ...]]] = deque(
            maxlen=_ROOM
        )
        self._news = threading.Event()
        self._closing = False
        self._complain_at = 0.0
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def post(self, action: Callable[..., Any], *arguments: Any) -> None:
        """Have ``action(*arguments)`` called soon; returns at once."""
        if len(self._waiting) == _ROOM:
            self.lost += 1
        self._waiting.append((time.monotonic(), action, arguments))
        self._news.set()

    def close(self, timeout: float) -> None:
        """Have what waits called, within ``timeout`` s, and end the thread; may be repeated."""
        self._closing = True
        self._news.set()
        self._thread.join(timeout)

    def _run(self) -> None:
        while self._waiting or not self._closing:
            self._news.wait()
            self._news.clear()
            while self._waiting:
                posted_at, action, arguments = self._waiting.popleft()
                self._call(action, arguments)
                self.longest_wait = max(self.longest_wait, time.monotonic() - posted_at)

    def _call(self, action: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """Survive a fault: one message that cannot be sent must not silence all others."""
        try:
            action(*arguments)
        except Exception:
            if time.monotonic() >= self._complain_at:
                self._complain_at = time.monotonic() + _COMPLAINT_PERIOD
                traceback.print_exc()
