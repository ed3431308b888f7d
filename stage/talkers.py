# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What node tests talk and listen with, in the observer's node."""

from __future__ import annotations

import itertools
import time
from typing import Any

from stage.rig import Observer


class Talker:
    """
    A publisher that repeats its message, in the observer's node; it talks while that is spun.

    :param rate: Hz. :param qos: by default reliable, volatile, and so deep that a reader which a
        busy machine holds up loses nothing: what is lost of a stop's topic is a stop.
    """

    def __init__(
        self,
        observer: Observer,
        kind: Any,
        topic: str,
        message: Any = None,
        *,
        rate: float = 50.0,
        qos: Any = 100,
    ) -> None:
        self.message = kind() if message is None else message
        self._node = observer.node
        self.publisher = observer.node.create_publisher(kind, topic, qos)
        self._timer = observer.node.create_timer(1.0 / rate, self.say)

    def say(self) -> None:
        """Publish now."""
        self.publisher.publish(self.message)

    def pause(self) -> None:
        """Fall silent, but stay."""
        self._timer.cancel()

    def resume(self) -> None:
        """Talk again."""
        self._timer.reset()

    def leave(self) -> None:
        """End as a program does that is interrupted."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self.publisher)


_namespaces = itertools.count()


def namespace() -> str:
    """Return a namespace that no other node of this run has."""
    return f'/bench{next(_namespaces)}'


class Diagnostics:
    """The newest statuses of one node. :param node: its full name."""

    def __init__(self, observer: Observer, node: str) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        self._node = node.lstrip('/')
        self._record = observer.record(DiagnosticArray, '/diagnostics')

    def status(self, part: str) -> Any:
        """Return the newest status of a part, 'link' or 'device'; None before the first."""
        for message in reversed(self._record.messages):
            for status in message.status:
                if status.name == f'{self._node}: {part}':
                    return status
        return None

    def clear(self) -> None:
        """Forget them."""
        self._record.clear()

    def value(self, part: str, key: str) -> str:
        """Return a value of a part's newest status; empty before the first."""
        status = self.status(part)
        return '' if status is None else values_of(status).get(key, '')


def values_of(status: Any) -> dict[str, str]:
    """Return the values of a DiagnosticStatus."""
    return {value.key: value.value for value in status.values}


def reset(observer: Observer, mux: str) -> None:
    """Call reset at a patient pace: one that follows another too soon counts as repeated."""
    from std_srvs.srv import Trigger

    at = [0.0]

    def accepted() -> bool:
        if time.monotonic() < at[0] + 0.7:
            return False
        reply = observer.call(Trigger, f'{mux}/reset')
        at[0] = time.monotonic()
        return bool(reply.success)

    observer.wait_for(accepted, 15.0, 'a reset')
