# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Topics that are looked at now and then: for who shows what is, and would wake up in vain."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from bridge_core.rclpy_inner import NotForExecutors, take_message

_MOST = 100  # messages of a topic in a look


class Polled:
    """
    Subscriptions that neither an executor nor a lane waits for. What is deeper than the queue of
    the subscription, by its QoS, is lost until the next look. For one thread.

    :param node: whose subscriptions they are.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._group = NotForExecutors()
        self._topics: list[tuple[Any, Callable[[Any], None]]] = []

    def subscribe(
        self, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile
    ) -> None:
        """Have each message of the topic come to ``callback``, with the next look."""
        subscription = self._node.create_subscription(
            kind,
            topic,
            callback,
            qos,
            callback_group=self._group,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        self._topics.append((subscription, callback))

    def look(self) -> None:
        """Take what has come, topic after topic; of a flood a part, or it would never end."""
        for subscription, callback in self._topics:
            for _ in range(_MOST):
                if (taken := take_message(subscription)) is None:
                    break
                callback(taken[0])
