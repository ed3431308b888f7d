# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""``~/estop``, ``~/own_estop`` and ``~/link_up``: what every bridge says of its device."""

from __future__ import annotations

from collections.abc import Callable
import threading
from typing import Any

from std_msgs.msg import Bool

from bridge_core.cdr import bool_message
from bridge_core.managed_node import latched_qos
from bridge_core.proof_topics import ProofTopics
from bridge_core.session import Verdict


class StopTopics:
    """
    Publishes a verdict at once when it changes, and again at a rate.

    :param node: that publishes. :param rate: in Hz. :param verdict: the first, published at once.
    """

    def __init__(self, node: Any, rate: float, verdict: Verdict) -> None:
        self._period = 1.0 / rate
        self._early = self._period / 4  # for which it may come with what wakes the link anyway
        qos = latched_qos(deadline=2.0 * self._period)
        self._estop = node.create_publisher(Bool, '~/estop', qos)
        self._own_estop = node.create_publisher(Bool, '~/own_estop', qos)
        self._link_up = node.create_publisher(Bool, '~/link_up', latched_qos())
        self.lock = threading.RLock()  # of the verdict, and the order in which it is published
        self.verdict = verdict  # as published last
        self.beside: Callable[[Verdict], None] = lambda verdict: None  # publishes parts of it
        self.repeat_at = 0.0
        self.proofs = ProofTopics(node)
        self.publish()
        self._link_up.publish(bool_message(verdict.link_up))

    def publish(self, *, again: bool = False) -> None:
        """
        Publish whether there is a stop, parts of it first.

        :param again: it was said before, and who comes later gets a latched one.
        """
        self.beside(self.verdict)
        self._estop.publish(bool_message(self.verdict.estop))
        if not again or self._own_estop.get_subscription_count():
            self._own_estop.publish(bool_message(self.verdict.own_estop))

    def repeat(self, now: float) -> bool:
        """Publish it again if it is time to; tell whether it was. Answer challenges."""
        self.proofs.answer(now)
        if now < self.repeat_at - self._early:
            return False
        with self.lock:  # or a stop of another thread comes between the two, and is undone
            self.publish(again=True)
        self.repeat_at = max(self.repeat_at + self._period, now + self._period / 2)
        return True

    def change(self, verdict: Verdict, now: float) -> Verdict:
        """Publish what has changed; return the verdict before. The caller holds the lock."""
        before, self.verdict = self.verdict, verdict
        if verdict != before:
            self.publish()
            self.proofs.say(verdict, now)
            if verdict.link_up != before.link_up:
                self._link_up.publish(bool_message(verdict.link_up))
            self.repeat_at = now + self._period
        return before
