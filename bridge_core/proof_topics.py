# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""``~/proof`` and ``~/challenge``: a node proves how old its words are; see proof.py."""

from __future__ import annotations

import contextlib
from queue import Empty, SimpleQueue
import secrets
import threading
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import UInt8MultiArray

from bridge_core.proof import nanoseconds, Writer
from bridge_core.session import Verdict

# What is lost is asked again soon, and what is old is of no use.
PROOF_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class ProofTopics:
    """
    The writer of a bridge's node.

    Challenges come on the thread of the lane. Proofs are made by the thread of the link, which
    knows the verdict: if it hangs, there is none.
    """

    def __init__(self, node: Any) -> None:
        self._writer = Writer(secrets.randbits(64))
        self._lock = threading.Lock()  # of the writer: a verdict may come from any thread
        self._asked: SimpleQueue[bytes] = SimpleQueue()
        self._publisher = node.create_publisher(UInt8MultiArray, '~/proof', PROOF_QOS)
        node.lane.subscribe(UInt8MultiArray, '~/challenge', self._on_challenge, PROOF_QOS)

    def say(self, verdict: Verdict, now: float) -> None:
        """Note the verdict that holds from now on; a stop is proven at once."""
        with self._lock:
            begins = self._writer.say(estop=verdict.estop, own_estop=verdict.own_estop)
        if begins:
            self._publish(now)

    def vouch(self, message: Any) -> None:
        """Note the newest message with a header, such as a Joy."""
        self._writer.vouch(nanoseconds(message.header.stamp))

    def answer(self, now: float) -> None:
        """Answer what was asked since."""
        due = False
        with contextlib.suppress(Empty):
            while True:
                challenge = self._asked.get_nowait()
                with self._lock:
                    due |= self._writer.hear(challenge, now)
        if due:
            self._publish(now)

    def _on_challenge(self, message: Any, info: Any) -> None:
        del info
        if self._asked.qsize() < 64:  # the link's thread hangs
            self._asked.put(bytes(message.data))

    def _publish(self, now: float) -> None:
        # Not under the lock: a thread that hangs in there must not keep a stop of another one.
        # Of two that overtake each other the newer one has both stops, and counts.
        with self._lock:
            data = self._writer.proof(now)
        self._publisher.publish(UInt8MultiArray(data=data))
