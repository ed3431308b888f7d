# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""``~/proof`` and ``~/challenge``: a node proves how old its words are; see proof.py."""

from __future__ import annotations

import math
import threading
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import UInt8MultiArray

from bridge_core.polled import Polled
from bridge_core.proof import nanoseconds, new_identity, Writer
from bridge_core.session import Verdict

# What is lost is asked again soon, and what is old is of no use.
PROOF_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class ProofTopics:
    """
    The writer of a node.

    Proofs are made by the thread that knows the verdict, the link's of a bridge: if it hangs,
    there is none. It reads challenges as it answers, and none of them wakes it.

    :param apart: s, at least, between two answers, however many readers ask. A stop waits not.
    """

    def __init__(self, node: Any, apart: float = 0.0) -> None:
        self._apart = apart
        self._due = False  # somebody waits for an answer
        self._proven_at = -math.inf
        self._writer = Writer(new_identity())
        self._lock = threading.Lock()  # of all this: a verdict may come from any thread
        self._verdict = Verdict.stop()
        self._enable = False
        self._publisher = node.create_publisher(UInt8MultiArray, '~/proof', PROOF_QOS)
        self._asked: list[Any] = []
        self._challenges = Polled(node)
        self._challenges.subscribe(UInt8MultiArray, '~/challenge', self._asked.append, PROOF_QOS)

    def say(self, verdict: Verdict | None, now: float, *, enable: bool | None = None) -> None:
        """
        Note what holds from now on. A stop, and another ``enable``, is proven at once.

        :param verdict: None: as before, as of ``enable``.
        """
        with self._lock:
            self._verdict = verdict or self._verdict
            self._enable = self._enable if enable is None else enable
            estop, own_estop = self._verdict.estop, self._verdict.own_estop
            is_urgent = self._writer.say(estop=estop, own_estop=own_estop, enable=self._enable)
        if is_urgent:
            self._publish(now)

    def goes_by(self, age: float) -> None:
        """Note how old at most is what this node goes by, s; infinite: unknown."""
        self._writer.age = age

    def vouch(self, stamp: Any) -> None:
        """Note the stamp of the newest message, such as a Joy."""
        self._writer.vouch(nanoseconds(stamp))

    def answer(self, now: float) -> None:
        """Answer what was asked since, if it is time to."""
        self._challenges.look()
        for message in self._asked:
            with self._lock:
                self._due |= self._writer.hear(bytes(message.data), now)
        self._asked.clear()
        if self._due and not 0.0 <= now - self._proven_at < self._apart:
            self._publish(now)

    def _publish(self, now: float) -> None:
        # Not under the lock: a thread that hangs in there must not keep a stop of another one.
        # Of two that overtake each other the newer one has both stops, and counts.
        with self._lock:
            self._due, self._proven_at = False, now
            data = self._writer.proof(now)
        self._publisher.publish(UInt8MultiArray(data=data))
