# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The inputs of a node that one publisher alone may feed, such as those that the mux feeds.

A stop on them always counts. Whatever makes it uncertain what they say is a stop by itself: two
publishers, messages that were lost and that no proof tells of, a publisher that is never heard.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import threading
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from bridge_core import clock
from bridge_core.lane import ASKED_LIMIT, waited
from bridge_core.proof import nanoseconds
from bridge_core.publishers import PublisherWatch
from bridge_core.reasons import Coded
from bridge_core.session import Level
from bridge_core.watchdog import FreezeWatch

# Of what an actuator is told. Neither a stop nor the one message of a second publisher
# may be overwritten before it was read.
STOP_QOS = QoSProfile(depth=100)
COMMAND_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
_LOOK_PERIOD = 0.1  # s; each request is a look, too
_LOOK_AROUND_PERIOD = 0.5  # s
_FREEZE = 0.2  # s without a look
_SETTLING_TIME = 0.25  # s in which all comes in that waited in the kernel during a freeze


class InputGuard:
    """
    Subscribes on the lane of a node, and watches who publishes.

    :param node: has ``on_distrusted``, ``on_unheard``, ``on_unheard_gone`` and ``mux``; see
        BridgeNode.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._watches: dict[str, PublisherWatch] = {}  # by topic
        self._stop_topics: list[str] = []
        self._unheard: dict[str, Coded] = {}  # by topic: who publishes there in vain
        self._was_unheard = False
        self._current = threading.local()  # of a thread that is in a callback
        self._freeze = FreezeWatch(_FREEZE, _SETTLING_TIME)
        node.lane.every(_LOOK_PERIOD, self._freeze.look)
        node.lane.every(_LOOK_AROUND_PERIOD, self._look_around)

    @property
    def received_at(self) -> float | None:
        """When the message came that this thread is in the callback of; none: it is in none."""
        return getattr(self._current, 'received_at', None)

    @property
    def stamp(self) -> int | None:
        """That of the command that this thread is in the callback of, ns; None: nobody vouches."""
        return getattr(self._current, 'stamp', None)

    @property
    def unheard(self) -> bool:
        """Tell whether somebody publishes stops that are never heard."""
        return bool(self._unheard)

    @contextmanager
    def asked(self, waited: float) -> Iterator[None]:
        """Serve what has waited so many s for the executor, which may hang alone."""
        self._current.late = waited > ASKED_LIMIT
        try:
            yield
        finally:
            self._current.late = False

    def settling(self, now: float) -> bool:
        """Tell whether what this thread is asked may be old: it waited, or in a freeze of all."""
        return self._freeze.settling(now) or getattr(self._current, 'late', False)

    def subscribe(
        self, kind: type, topic: str, callback: Callable[[Any], None], stop: bool | None = None
    ) -> None:
        """
        Subscribe to what one publisher alone may say.

        While two are heard, and until it is known that there is one, stops alone are passed on; so
        while somebody publishes there who is never heard.

        :param stop: of a Bool, the value that is a stop: no message of it may be lost.
        """
        watch, qos = PublisherWatch(), COMMAND_QOS if stop is None else STOP_QOS

        def on_message(message: Any, info: Any) -> None:
            now = clock.now()
            name = subscription.topic_name
            lost = watch.heard(info['publication_sequence_number'], now)
            if lost and stop is not None and not self._node.mux.proves(name):
                text = f'messages of {name} were lost: one may have been a stop'
                self._distrust(name, Coded('input.lost', text, topic=name))
            fault = self._fault_of(name, now)
            is_stop = stop is not None and bool(message.data) is stop
            if is_stop or (watch.settled(now) and not fault):
                self._current.received_at = now - waited(info)
                self._current.stamp = nanoseconds(message.header.stamp) if is_vouched else None
                try:
                    callback(message)
                finally:
                    self._current.received_at = self._current.stamp = None
            elif fault is not None:
                self._distrust(name, fault)

        subscription = self._node.lane.subscribe(kind, topic, on_message, qos)
        self._watches[subscription.topic_name] = watch
        has_stamp = 'header' in kind.get_fields_and_field_types()  # type: ignore[attr-defined]
        is_vouched = has_stamp and self._node.mux.vouches_for(subscription.topic_name)
        if stop is not None:
            self._stop_topics.append(subscription.topic_name)

    def _distrust(self, topic: str, fault: Coded) -> None:
        self._node.log(Level.ERROR, fault, site=topic)
        self._node.on_distrusted(fault)

    def _fault_of(self, topic: str, now: float) -> Coded | None:
        if self._watches[topic].doubled(now):
            found = f'stop one of the two publishers of {topic}'
            text = f'{found}: while both are heard, only stops count'
            return Coded('input.doubled', text, topic=topic)
        return self._unheard.get(topic)

    def faults(self, now: float) -> list[Coded]:
        """Return why inputs are not trusted."""
        return [fault for topic in self._watches if (fault := self._fault_of(topic, now))]

    def count_publishers(self) -> list[str]:
        """Count those of all inputs; return the wired inputs that have none."""
        counts = {topic: self._node.count_publishers(topic) for topic in self._watches}
        for topic, watch in self._watches.items():
            if watch.blind:  # else it knows better than discovery
                watch.counted(counts[topic])
        own = f'{self._node.get_fully_qualified_name()}/'  # an input that nobody has wired
        return [topic for topic, count in counts.items() if not (count or topic.startswith(own))]

    def _look_around(self, now: float) -> None:
        """Stop for whoever publishes stops that are never heard."""
        del now
        faults = {topic: self._node.unheard_publisher(topic) for topic in self._stop_topics}
        self._unheard = {topic: fault for topic, fault in faults.items() if fault is not None}
        for topic, fault in self._unheard.items():
            self._node.log(Level.ERROR, fault, site=topic)
            self._node.on_unheard(fault)
        self._was_unheard |= self.unheard
        if self._was_unheard and not self.unheard:  # again and again: a wire may begin meanwhile
            self._node.on_unheard_gone()
