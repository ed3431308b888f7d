# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The way of a stop through a node: a thread that waits for its topics without rclpy's executor.

The executor makes its wait set anew for each wake-up, out of every service, timer and event of the
node, which costs more than the message. A lane waits for what a stop needs alone, on a set that
stays. Whatever happens on it, happens in one thread: what its callbacks own needs no lock, and a
callback that hangs makes this node silent, which others take for a stop, and no other node. The
executor with a node of its own takes twice as long; Jazzy's EventsExecutor does not work.
"""

from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, wait
from dataclasses import dataclass
from functools import partial
import math
import threading
import time
import traceback
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile

from bridge_core import clock
from bridge_core.cdr import reader_of
from bridge_core.rclpy_inner import LANE_NODE, Topic, waiter_of
from bridge_core.thread_name import show_thread

_CALL_LIMIT = 0.4  # s that others wait for the lane's thread
_CAPACITY = 10_000  # calls that may wait; what is posted always may, as it may be a stop
_REPORT_PERIOD = 1.0  # s
# s that what is asked may wait for the executor's thread: who asked may have gone away since. What
# is older moves nothing and releases nothing; a stop counts however old it is.
ASKED_LIMIT = 1.0
_TOGETHER = 0.001  # s; a timer that is due so soon after another one needs no wake-up of its own


@dataclass(slots=True, eq=False)
class _Timer:
    period: float
    callback: Callable[[float], object]
    due: float
    rest: float  # the period while the lane rests


class Lane:
    """
    A thread for what a stop needs: topics, steady timers and the calls of other threads.

    :param node: whose subscriptions they are; its executor does not wait for them.
    :param name: of the thread.
    """

    def __init__(self, node: Node, name: str) -> None:
        self._node = node
        self._context = node.context
        self._name = name
        self._topics: tuple[Topic, ...] = ()
        self._timers: tuple[_Timer, ...] = ()
        self._calls: deque[tuple[Callable[..., object], tuple[Any, ...]]] = deque()
        self._lock = threading.Lock()  # of the two tuples, which are replaced and never changed
        self.thread: threading.Thread | None = None
        self._ending = False
        self.rests = False  # what is not urgent need not wake it; for its thread
        self._report_at = -math.inf
        self.malformed = 0  # messages that nobody can read, and nobody got
        self.fault: Future[None] = Future()  # that has ended the thread
        self._waiter = waiter_of(node, name, self._guarded)

    # What it waits for. All of this may be used in any thread, before and after the start.

    def subscribe(
        self,
        kind: Any,
        topic: str,
        callback: Callable[[Any, dict[str, Any]], object],
        qos: QoSProfile | int,
        *,
        raw: bool = False,
        urgent: bool = True,
    ) -> Any:
        """
        Subscribe; return the subscription.

        Of topics that have something, the one subscribed first is read first, all that it has.

        :param callback: gets the message, or what has its fields, and rclpy's dictionary of
            message information.
        :param raw: the message is bytes, as it came. :param urgent: if not, it is read with the
            next timer or urgent message while the lane ``rests``; the queue has to last so long.
        """
        read = None if raw else reader_of(kind)
        if read is not None:
            callback = partial(self._read, read, callback)
        entry = Topic(kind, callback, raw or read is not None, urgent)
        self._waiter.subscribe(entry, topic, qos)
        with self._lock:
            self._topics = (*self._topics, entry)
        self._waiter.wake()
        return entry.subscription

    @property
    def subscriptions(self) -> list[Any]:
        """Return those that there are."""
        return [entry.subscription for entry in self._topics]

    def unsubscribe(self, subscription: Any) -> None:
        """Destroy a subscription; but for a call that another thread is in, none follows."""
        with self._lock:
            (entry,) = (each for each in self._topics if each.subscription is subscription)
            entry.wanted = False
            self._topics = tuple(each for each in self._topics if each is not entry)
        self._waiter.unsubscribe(entry)
        self._waiter.wake()

    def _read(
        self,
        read: Callable[[bytes], Any],
        callback: Callable[[Any, dict[str, Any]], object],
        data: bytes,
        info: dict[str, Any],
    ) -> None:
        try:
            message = read(data)
        except Exception:
            self.malformed += 1
            raise
        callback(message, info)

    def every(
        self, period: float, callback: Callable[[float], object], *, rest: float | None = None
    ) -> None:
        """
        Call ``callback(now)`` each ``period`` s by ``clock.now``, from one period on.

        Those that are due within 1 ms come together. Calls that are late by a period or more are
        left out, not made up for. One that raises ends the thread, since the next would, too.

        :param rest: the period while the lane ``rests``; None: the same.
        """
        with self._lock:
            timer = _Timer(period, callback, clock.now() + period, rest or period)
            self._timers = (*self._timers, timer)
        self._waiter.wake()

    def post(self, function: Callable[..., object], *args: Any) -> None:
        """
        Have the lane's thread call ``function(*args)``, in the order of posting.

        However long it hangs, nothing is dropped: who posts often has to wait for it.
        """
        self._calls.append((function, args))
        if threading.current_thread() is not self.thread:
            self._waiter.wake()

    def call(self, function: Callable[..., Any], *args: Any) -> Any:
        """
        Have the lane's thread call ``function(*args)``; return its result or raise its exception.

        On that thread, and while there is none, it is called directly.

        :raises TimeoutError: it has not begun within 0.4 s, and never will; or it has, and takes
            another 0.4 s.
        """
        thread = self.thread
        if (
            thread is None
            or thread is threading.current_thread()
            or not thread.is_alive()
            or self.fault.done()
        ):
            return function(*args)
        nothing_done = f'nothing was done: {self._name} hangs or is overloaded'
        if len(self._calls) >= _CAPACITY:
            raise TimeoutError(nothing_done)
        future: Future[Any] = Future()
        self.post(_settle, future, function, args)
        if not wait([future], _CALL_LIMIT).done:
            if future.cancel():
                raise TimeoutError(nothing_done)
            if not wait([future], _CALL_LIMIT).done:
                raise TimeoutError(f'what was asked may still be done: {self._name} hangs amid it')
        return future.result()

    # The thread.

    def start(self) -> None:
        """Start the thread. It ends by ``stop``, and with the node or its context."""
        self._context.on_shutdown(self._wake)
        self.thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self.thread.start()

    def stop(self) -> None:
        """Have posted calls executed and the thread end; wait up to 0.4 s. May be repeated."""
        self._ending = True
        self._waiter.wake()
        if self.thread is None:
            self._waiter.close()
        elif self.thread is not threading.current_thread():
            self.thread.join(_CALL_LIMIT)

    def _wake(self) -> None:  # a context keeps methods only
        self._waiter.wake()

    def _run(self) -> None:
        show_thread(f'lane {self._name}')
        try:
            while not self._ending and self._context.ok() and _exists(self._node):
                self._waiter.wait(self._topics, self._timeout(), urgent=self.rests)
                self._call_posted()
                self._call_timers()
            self._call_posted()
        except BaseException as error:
            if self._context.ok():  # its end may come amid a wait
                self._node.get_logger().fatal(f'{self._name} ends: {traceback.format_exc()}')
                self.fault.set_exception(error)
        finally:
            self._waiter.close()

    def _timeout(self) -> float | None:
        if self._calls:
            return 0.0
        due = min((timer.due for timer in self._timers), default=None)
        return None if due is None else max(0.0, due - clock.now())

    def _call_posted(self) -> None:
        for _ in range(len(self._calls)):  # not those that they post themselves
            function, args = self._calls.popleft()
            self._guarded(function, *args)

    def _call_timers(self) -> None:
        for timer in self._timers:
            now = clock.now()
            if now >= timer.due - _TOGETHER:
                timer.callback(now)
                # Late or not, it keeps its phase, and with it its company.
                period = timer.rest if self.rests else timer.period
                timer.due += period * max(1, (now - timer.due) // period + 1)

    def _guarded(self, function: Callable[..., Any], *args: Any) -> Any:
        """Call it; report an exception and go on: one bad message must not silence all others."""
        try:
            return function(*args)
        except Exception:
            now = clock.now()
            if now >= self._report_at:
                self._report_at = now + _REPORT_PERIOD
                self._node.get_logger().error(f'{self._name}: {traceback.format_exc()}')
            return None


def waited(info: Mapping[str, Any]) -> float:
    """Return the seconds since the middleware took a message in; 0 if it does not tell."""
    received: int = info['received_timestamp']
    return max(0.0, (time.time_ns() - received) * 1e-9) if received else 0.0


def owner_of(name: str) -> str:
    """Return the node that a node of this name listens for: itself, or the one with the lane."""
    prefix, suffix = LANE_NODE.split('{}')
    if name.startswith(prefix) and name.endswith(suffix):
        return name.removeprefix(prefix).removesuffix(suffix)
    return name


def _settle(future: 'Future[Any]', function: Callable[..., Any], args: tuple[Any, ...]) -> None:
    if future.set_running_or_notify_cancel():
        try:
            future.set_result(function(*args))
        except Exception as error:
            future.set_exception(error)


def _exists(node: Node) -> bool:
    try:
        with node.handle:
            return True
    except InvalidHandle:
        return False
