"""Publishing and logging in a thread of their own, so that the link thread never blocks."""

from collections import deque
from collections.abc import Callable
import threading
import time
import traceback
from typing import Any

_CAPACITY = 10_000  # calls: a few seconds of the busiest node
_REPORT_PERIOD = 1.0  # s


class Outbox:
    """
    A thread that executes the calls of another one, in the order of posting.

    A publish may block for seconds: see docs/decisions/0012. Calls are never merged, so a stop
    and its release are two messages; when the queue is full, the oldest call is dropped.

    :param name: of the thread.
    """

    def __init__(self, name: str) -> None:
        self.lost = 0  # calls that were dropped
        self.longest_wait = 0.0  # s, from posting a call to its end
        self._queue: deque[tuple[float, Callable[..., Any], tuple[Any, ...]]] = deque(
            maxlen=_CAPACITY
        )
        self._wake = threading.Event()
        self._closing = False
        self._report_at = 0.0
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def post(self, action: Callable[..., Any], *arguments: Any) -> None:
        """Queue the call ``action(*arguments)``; return at once."""
        if len(self._queue) == _CAPACITY:
            self.lost += 1
        self._queue.append((time.monotonic(), action, arguments))
        self._wake.set()

    def close(self, timeout: float) -> None:
        """Execute what is queued, for up to ``timeout`` s, and end the thread; may be repeated."""
        self._closing = True
        self._wake.set()
        self._thread.join(timeout)

    def _run(self) -> None:
        while self._queue or not self._closing:
            self._wake.wait()
            self._wake.clear()
            while self._queue:
                posted_at, action, arguments = self._queue.popleft()
                self._call(action, arguments)
                self.longest_wait = max(self.longest_wait, time.monotonic() - posted_at)

    def _call(self, action: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """Report an exception and go on: one bad message must not silence all others."""
        try:
            action(*arguments)
        except Exception:
            if time.monotonic() >= self._report_at:
                self._report_at = time.monotonic() + _REPORT_PERIOD
                traceback.print_exc()
