# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The last minute of what was heard, in memory: bounded by time and by bytes. Pure."""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

_OVERHEAD = 200  # bytes that Python takes for a message besides its data


class Channel(NamedTuple):
    """
    What the messages of a topic have in common.

    :param type: such as ``std_msgs/msg/Bool``.
    :param definition: its text, and that of every type in it, as MCAP's ``ros2msg`` has them.
    :param latched: it is published on change, so that the newest message stands for long.
    """

    topic: str
    type: str
    definition: str
    latched: bool = False


class Heard(NamedTuple):
    """
    One message.

    :param at: when it came, seconds of ``bridge_core.clock``.
    :param sent_at: when it was published, by the same clock. :param data: as CDR.
    """

    at: float
    sent_at: float
    channel: Channel
    data: bytes


class Ring:
    """
    Keeps what is not older than ``seconds``, and less of it where that were too many bytes; of a
    latched channel always the newest.

    :param size: bytes, 200 a message for Python itself included.
    """

    def __init__(self, seconds: float, size: int) -> None:
        self.size = 0
        self._seconds = seconds
        self._limit = size
        self._messages: deque[Heard] = deque()
        self._latched: dict[str, Heard] = {}  # the newest, by topic

    def add(self, message: Heard) -> None:
        """Keep a message, and forget what is too old or too much."""
        messages = self._messages
        if message.channel.latched:
            self._latched[message.channel.topic] = message
        messages.append(message)
        self.size += len(message.data) + _OVERHEAD
        oldest = message.at - self._seconds
        while messages and (messages[0].at < oldest or self.size > self._limit):
            self.size -= len(messages.popleft().data) + _OVERHEAD

    def messages(self, since: float = -math.inf) -> list[Heard]:
        """
        Return what is kept, in order, or what came since a moment.

        Of a latched channel it has what stood by then, with the first moment.
        """
        since = max(since, min((message.at for message in self._messages), default=0.0))
        standing = dict(self._latched)
        standing |= {
            m.channel.topic: m for m in self._messages if m.channel.latched and m.at < since
        }
        older = (m._replace(at=since) for m in standing.values() if m.at < since)
        newer = (message for message in self._messages if message.at >= since)
        return sorted([*older, *newer], key=lambda message: message.at)

    def clear(self) -> None:
        """Forget everything."""
        self._messages.clear()
        self._latched.clear()
        self.size = 0

    def __len__(self) -> int:
        return len(self._messages)
