# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Services that wait for a device: a request goes to the session, and an Answer comes back."""

from __future__ import annotations

from collections.abc import Callable
import threading
from typing import Any

from rclpy.task import Future

from bridge_core.session import Answer


class Waiting:
    """
    Who waits for the answers of a session, by the name of the request; for any thread.

    :param node: whose executor goes on meanwhile.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._lock = threading.Lock()
        self._futures: dict[str, dict[int, Future]] = {}  # by request and number

    def ask(self, request: str, send: Callable[[], int], inactive: str) -> Future:
        """
        Send a request; return what becomes its Answer.

        :param send: returns the request's number, and 0 if it is in vain because of ``inactive``.
        """
        future = Future(executor=self._node.executor)
        with self._lock:  # the answer may come before the number is noted
            number = send()
            if number:
                self._futures.setdefault(request, {})[number] = future
        if not number:
            future.set_result(Answer(request, False, inactive))
        return future

    def refuse(self, number: int, text: str) -> None:
        """Answer the one who waits for this request, if anybody does: it was refused."""
        with self._lock:
            found = [
                (request, futures.pop(number))
                for request, futures in self._futures.items()
                if number in futures
            ]
        for request, future in found:
            self._settle(future, Answer(request, False, text))

    def answer(self, answer: Answer) -> bool:
        """Give the answer to all who wait for it; tell whether anybody does."""
        with self._lock:
            futures = self._futures.pop(answer.request, {})
        for future in futures.values():
            self._settle(future, answer)
        return bool(futures)

    def fail(self, text: str) -> None:
        """Tell all who wait that there will be no answer, and why."""
        with self._lock:  # one that is just being sent waits, too
            requests = list(self._futures)
        for request in requests:
            self.answer(Answer(request, False, text))

    def _settle(self, future: Future, answer: Answer) -> None:
        future.set_result(answer)
        if self._node.executor is not None:
            self._node.executor.wake()  # which looks at its coroutines only when something else is
