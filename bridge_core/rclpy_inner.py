# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
All that is used of rclpy beside its public API, as it is in Jazzy (rclpy 7.1).

| of rclpy | for | where it is another |
| --- | --- | --- |
| ``_rclpy_pybind11.WaitSet``, ``handle`` | lanes wait without an executor | the public executor |
| ``Subscription.handle.take_message`` | a look without waiting | AttributeError |
| ``Node._parameter_overrides`` | what was given at the start | AttributeError, at the start |
| ``LifecycleNode._callbacks`` | a fault in a transition ends the node | it is answered alone |
| ``LifecycleNode._service_change_state`` | a transition that there is not | ends the process |
| ``Executor._take_service`` | how long a request has waited | nobody knows |
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.executors import await_or_execute, SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node

DISTRIBUTION = 'jazzy'  # of which all of this is known
LANE_NODE = '_{}_lane'  # the name of the small node of a node
_BATCH = 20  # messages of one topic before the next topic has its turn


def given_parameters(node: Any) -> dict[str, Any]:
    """Return the parameters that a node was given at its start, by name."""
    return {name: parameter.value for name, parameter in node._parameter_overrides.items()}


def wrap_transitions(node: Any, wrap: Callable[[Callable[..., Any]], Callable[..., Any]]) -> None:
    """Have what rclpy calls at each transition be called by what ``wrap`` makes of it."""
    callbacks: dict[Any, Any] = getattr(node, '_callbacks', {})
    callbacks.update({state: wrap(callback) for state, callback in callbacks.items()})


def wrap_change_state(node: Any, wrap: Callable[[Callable[..., Any]], Callable[..., Any]]) -> None:
    """The same for the service that changes the state."""
    service = getattr(node, '_service_change_state', None)
    if service is not None:
        service.callback = wrap(service.callback)


class DatingExecutor(SingleThreadedExecutor):
    """One whose services may ask when the middleware took in what they are asked."""

    received_timestamp = 0  # ns, of the request that is served now; 0: nobody knows

    def _take_service(self, service: Any) -> Callable[[], Any] | None:
        with suppress(InvalidHandle), service.handle:
            request, info = service.handle.service_take_request(service.srv_type.Request)
            if info is not None:
                return partial(self._serve, service, request, info)
        return None

    async def _serve(self, service: Any, request: Any, info: Any) -> None:
        self.received_timestamp = info.received_timestamp
        response = await await_or_execute(service.callback, request, service.srv_type.Response())
        service.send_response(response, info)


@dataclass(slots=True, eq=False)
class Topic:
    """A subscription of a lane."""

    kind: Any
    callback: Callable[[Any, dict[str, Any]], object]
    raw: bool
    urgent: bool
    subscription: Any = None
    wanted: bool = True


class Waiter(ABC):
    """What a lane waits by. Subscribing and waking may be done in any thread."""

    def __init__(self, node: Node, guard: Any, guarded: Callable[..., Any]) -> None:
        self._node = node  # that has the subscriptions
        self._guard = guard
        self._guarded = guarded

    @abstractmethod
    def subscribe(self, topic: Topic, name: str, qos: Any) -> None:
        """Make ``topic.subscription``."""

    def unsubscribe(self, topic: Topic) -> None:
        """Destroy it."""
        self._node.destroy_subscription(topic.subscription)

    def wake(self) -> None:
        """End a wait."""
        with suppress(InvalidHandle):  # the thread has ended
            self._guard.trigger()

    @abstractmethod
    def wait(self, topics: tuple[Topic, ...], timeout: float | None, *, urgent: bool) -> None:
        """
        Wait for messages, so many seconds at most, and call their callbacks.

        :param urgent: wait for urgent topics alone; the others are read after the wait.
        """

    @abstractmethod
    def close(self) -> None:
        """Wait no more."""


def wait_set_works(context: Any) -> bool:
    """Tell whether rclpy has the inner wait set that lanes were written for (rclpy 7.1)."""
    try:
        guard = GuardCondition(None, None, context=context)
        guard.trigger()
        wait_set = make_wait_set(context, 0)
        wait_set.clear_entities()
        wait_set.add_guard_condition(guard.handle)
        wait_set.wait(0)
        return bool(wait_set.is_ready('guard_condition', 0)) and all(
            hasattr(_rclpy.Subscription, name) for name in ('take_message', '__enter__')
        )
    except (AttributeError, TypeError):
        return False


def waiter_of(node: Node, name: str, guarded: Callable[..., Any]) -> Waiter:
    """
    Return what a lane waits by.

    :param name: of the lane. :param guarded: calls, and reports what fails.
    """
    if wait_set_works(node.context):
        return _WaitSetWaiter(node, guarded)
    node.get_logger().info(f'{name}: by the executor of rclpy, whose wait set is another')
    return _ExecutorWaiter(node, guarded)


def make_wait_set(context: Any, subscriptions: int, clients: int = 0) -> Any:
    """Return a wait set with room for so many, and for one guard condition."""
    with context.handle:
        return _rclpy.WaitSet(subscriptions, 1, 0, clients, 0, 0, context.handle)


def take_message(subscription: Any) -> tuple[Any, dict[str, Any]] | None:
    """Return the next message and its information, without waiting; None: there is none."""
    handle = subscription.handle
    with suppress(InvalidHandle), handle:  # it is being destroyed
        taken: tuple[Any, dict[str, Any]] | None = handle.take_message(
            subscription.msg_type, subscription.raw
        )
        return taken
    return None


class NotForExecutors(CallbackGroup):
    """Keeps subscriptions of a node away from the executor that spins it."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        del entity
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        del entity
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing was begun."""


class _WaitSetWaiter(Waiter):
    """
    Waits on the inner wait set of rclpy, as its executor does.

    The set holds raw pointers, so the lane's thread holds all handles for as long as it is in use:
    a subscription that is destroyed meanwhile is gone when the set is made anew.
    """

    def __init__(self, node: Node, guarded: Callable[..., Any]) -> None:
        super().__init__(node, GuardCondition(None, None, context=node.context), guarded)
        self._group = NotForExecutors()
        self._topics: tuple[Topic, ...] = ()  # as given for the set
        self._held: list[tuple[Topic, Any]] = []  # with their handles
        self._set: Any = None

    def subscribe(self, topic: Topic, name: str, qos: Any) -> None:
        topic.subscription = self._node.create_subscription(
            topic.kind,
            name,
            topic.callback,
            qos,
            callback_group=self._group,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )

    def wait(self, topics: tuple[Topic, ...], timeout: float | None, *, urgent: bool) -> None:
        if self._set is None or topics is not self._topics:
            self._make_set(topics)
        wait_set = self._set
        wait_set.clear_entities()  # a wait takes out what is not ready
        places = {
            topic: wait_set.add_subscription(handle)
            for topic, handle in self._held
            if topic.urgent or not urgent
        }
        wait_set.add_guard_condition(self._guard.handle)
        wait_set.wait(-1 if timeout is None else int(timeout * 1e9))
        for topic, handle in self._held:
            if topic not in places or wait_set.is_ready('subscription', places[topic]):
                self._take(topic, handle)

    def _take(self, topic: Topic, handle: Any) -> None:
        for _ in range(_BATCH):
            if not topic.wanted:
                return
            taken = self._guarded(handle.take_message, topic.kind, topic.raw)
            if taken is None:
                return
            self._guarded(topic.callback, *taken)

    def _make_set(self, topics: tuple[Topic, ...]) -> None:
        self._release()
        for topic in topics:
            handle = topic.subscription.handle
            try:
                handle.__enter__()
            except InvalidHandle:
                continue  # destroyed behind the lane's back
            self._held.append((topic, handle))
        self._topics = topics
        self._set = make_wait_set(self._node.context, len(self._held))

    def _release(self) -> None:
        self._set = None
        for _, handle in self._held:
            handle.__exit__(None, None, None)
        self._held = []

    def close(self) -> None:
        self._release()
        self._guard.destroy()


class _ExecutorWaiter(Waiter):
    """
    Waits by the public executor, on a small node of its own, where rclpy has no known wait set.

    Names are resolved by the node that the lane belongs to, with its namespace and remappings.
    """

    def __init__(self, node: Node, guarded: Callable[..., Any]) -> None:
        self._owner = node
        own = Node(
            LANE_NODE.format(node.get_name()),
            namespace=node.get_namespace(),
            context=node.context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        super().__init__(own, own.create_guard_condition(lambda: None), guarded)
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(own)

    def subscribe(self, topic: Topic, name: str, qos: Any) -> None:
        def on_message(message: Any, info: dict[str, Any]) -> None:
            if topic.wanted:
                self._guarded(topic.callback, message, info)

        topic.subscription = self._node.create_subscription(
            topic.kind,
            self._owner.resolve_topic_name(name),
            on_message,
            qos,
            raw=topic.raw,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )

    def wait(self, topics: tuple[Topic, ...], timeout: float | None, *, urgent: bool) -> None:
        del topics, urgent
        self._executor.spin_once(timeout_sec=timeout)

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
