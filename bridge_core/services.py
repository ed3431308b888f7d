"""Services that wait for a device: a request goes to the session, and an Answer comes back."""

from __future__ import annotations

from typing import Any

from rclpy.task import Future

from bridge_core.session import Answer


class Waiting:
    """
    Who waits for the answers of a session, by the name of the request.

    All methods but ``future`` are for the link thread.

    :param node: whose executor goes on meanwhile.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._futures: dict[str, list[Future]] = {}

    def future(self) -> Future:
        """Return what the service's coroutine awaits; its result will be an Answer."""
        future = Future(executor=self._node.executor)
        # A coroutine that awaits is no callback: only one of these wakes an executor that waits.
        future.add_done_callback(lambda answered: None)
        return future

    def add(self, request: str, future: Future) -> None:
        """Have the next answer to ``request`` go to this future, too."""
        self._futures.setdefault(request, []).append(future)

    def remove(self, request: str, future: Future, text: str) -> None:
        """Answer one who waits: the request was refused, for this reason."""
        self._futures[request].remove(future)
        future.set_result(Answer(request, False, text))

    def answer(self, answer: Answer) -> bool:
        """Give the answer to all who wait for it; tell whether anybody does."""
        waiting = self._futures.pop(answer.request, [])
        for future in waiting:
            future.set_result(answer)
        return bool(waiting)

    def fail(self, text: str) -> None:
        """Tell all who wait that there will be no answer, and why."""
        for request in list(self._futures):
            self.answer(Answer(request, False, text))
