# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The writer of a node's proofs, between the threads that it belongs to."""

from __future__ import annotations

from collections.abc import Callable
import threading
from types import SimpleNamespace
from typing import Any

from bridge_core.proof import Challenge, Proof
from bridge_core.proof_topics import ProofTopics
from bridge_core.session import Verdict
from stage.rig import TIMEOUT_FACTOR

NOW = 64.0


class FakeNode:
    """Publishes into a list; ``on_publish`` comes before."""

    def __init__(self) -> None:
        self.said: list[Proof] = []
        self.on_publish: Callable[[], object] = lambda: None
        self.lane = SimpleNamespace(subscribe=self._subscribe)

    def create_publisher(self, *arguments: Any) -> Any:
        return SimpleNamespace(publish=self._publish)

    def _publish(self, message: Any) -> None:
        self.on_publish()
        self.said.append(Proof.from_bytes(bytes(message.data)))

    def _subscribe(self, kind: Any, topic: str, take: Callable[..., None], qos: Any) -> None:
        self.challenge = take


def asked(number: int) -> Any:
    return SimpleNamespace(data=Challenge(1, number).to_bytes())


def test_challenges_since_the_last_answer_get_one_proof() -> None:
    node = FakeNode()
    topics = ProofTopics(node)
    topics.say(Verdict(), NOW)
    topics.answer(NOW)
    assert node.said == []
    node.challenge(asked(1), None)
    node.challenge(asked(2), None)
    topics.answer(NOW)
    assert [each.answers for each in node.said] == [((1, 2),)]


def test_thread_that_hangs_as_it_answers_keeps_no_stop_of_another_one() -> None:
    node = FakeNode()
    topics = ProofTopics(node)
    topics.say(Verdict(), NOW)
    hangs, goes_on = threading.Event(), threading.Event()

    def hang() -> None:
        node.on_publish = lambda: None  # the next one does not
        hangs.set()
        goes_on.wait()

    node.on_publish = hang
    node.challenge(asked(1), None)
    link = threading.Thread(target=topics.answer, args=(NOW,), daemon=True)
    link.start()
    assert hangs.wait(5.0 * TIMEOUT_FACTOR)
    leaving = threading.Thread(target=topics.say, args=(Verdict.stop('left'), NOW), daemon=True)
    leaving.start()
    leaving.join(5.0 * TIMEOUT_FACTOR)
    stops = [each.estop for each in node.said]
    goes_on.set()
    link.join()
    assert stops == [True]
    assert [each.number for each in node.said] == [2, 1]  # a reader passes over the late one
