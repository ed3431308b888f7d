# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node of an Observer: it waits for what a test has asked of it, and for nothing else."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
import math
import time
from typing import Any

from rclpy.executors import SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.parameter import Parameter

from bridge_core.managed_node import Quiet
from bridge_core.rclpy_inner import make_wait_set, take_message, wait_set_works


class Beat:
    """Calls a function each ``period`` s; those of one period do at the same moments."""

    def __init__(self, period: float, call: Callable[[], object]) -> None:
        self._period = period
        self._call = call
        self.reset()

    def reset(self) -> None:
        """Go on, after ``cancel``."""
        self.due = (time.monotonic() // self._period + 1.0) * self._period

    def cancel(self) -> None:
        """Call no more."""
        self.due = math.inf

    def call(self) -> None:
        """Call once if it is due, and leave out what is overdue."""
        if self.due <= time.monotonic():
            self.reset()
            self._call()


class ObserverNode(Quiet, Node):
    """
    Without services for its parameters, which nobody asks for, and without event handlers.

    ``take`` waits on one wait set that stays, where rclpy has the one that lanes have, too: an
    executor's takes more than all messages do. Its timers are steady and have one phase.
    """

    def __init__(self, name: str, **options: Any) -> None:
        quiet = Parameter('start_type_description_service', value=False)
        super().__init__(
            name,
            start_parameter_services=False,
            enable_rosout=False,
            parameter_overrides=[quiet],
            **options,
        )
        self._beats: list[Beat] = []
        self._ready: deque[Callable[[], object]] = deque()
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self)
        self._guard = GuardCondition(None, None, context=self.context)  # of an empty set
        self._set: Any = None  # for what is waited for
        self._waited: tuple[tuple[Any, ...], tuple[Any, ...]] | None = None
        self._works = wait_set_works(self.context)

    def create_timer(self, period: float, callback: Callable[[], object]) -> Beat:
        """Have a function called each ``period`` s."""
        beat = Beat(period, callback)
        self._beats.append(beat)
        return beat

    def destroy_timer(self, timer: Beat) -> bool:
        """Have it called no more; tell whether it would have been."""
        timer.cancel()
        known = timer in self._beats
        self._beats = [beat for beat in self._beats if beat is not timer]
        return known

    def take(self, duration: float) -> None:
        """Process one message, response or timer; wait at most ``duration`` s for it."""
        if not self._ready:
            due = min((beat.due for beat in self._beats), default=math.inf)
            self._wait(max(0.0, min(duration, due - time.monotonic())))
            now = time.monotonic()
            self._ready.extend(beat.call for beat in self._beats if beat.due <= now)
        if self._ready:
            self._ready.popleft()()

    def _wait(self, seconds: float) -> None:
        """Note what has something, after so long at most; without a set, process it."""
        if not self._works:
            self._executor.spin_once(timeout_sec=seconds)
            return
        waited = subscriptions, clients = tuple(self.subscriptions), tuple(self.clients)
        if waited != self._waited:
            self._set = make_wait_set(self.context, len(subscriptions), len(clients))
            self._waited = waited
        self._set.clear_entities()
        for each in subscriptions:
            self._set.add_subscription(each.handle)
        for each in clients:
            self._set.add_client(each.handle)
        self._set.add_guard_condition(self._guard.handle)
        self._set.wait(int(seconds * 1e9))
        for index, each in enumerate(subscriptions):
            if self._set.is_ready('subscription', index):
                self._ready.append(partial(self._take, each))
        for index in range(len(clients)):
            if self._set.is_ready('client', index):
                self._ready.append(partial(self._executor.spin_once, 0.0))

    def _take(self, subscription: Any) -> None:
        taken = take_message(subscription)
        if taken is not None:
            subscription.callback(taken[0])

    def destroy_node(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._guard.destroy()
        super().destroy_node()
