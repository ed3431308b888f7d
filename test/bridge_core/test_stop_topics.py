# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a node says of its stops: when it is said again, and who proves it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
import threading
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

from bridge_core.proof import Challenge, Proof
from bridge_core.proof_topics import ProofTopics
from bridge_core.session import Verdict
from bridge_core.stop_topics import StopTopics
from stage.rig import TIMEOUT_FACTOR


def stop_topics() -> tuple[StopTopics, Any, Any]:
    """Return those of a node, at 20 Hz, and the publishers of both stops."""
    node = MagicMock()
    node.create_subscription().handle.take_message.return_value = None
    estop, own_estop = MagicMock(), MagicMock()
    own_estop.get_subscription_count.return_value = 0
    node.create_publisher.side_effect = [estop, own_estop, MagicMock(), MagicMock()]
    topics = StopTopics(node, 20.0, Verdict())
    topics.repeat(1000.0)
    estop.reset_mock()
    own_estop.reset_mock()
    return topics, estop, own_estop


def test_repeat_comes_with_what_wakes_the_link_and_keeps_its_rate() -> None:
    topics, *_ = stop_topics()
    moments = [1000.0 + 0.014 * n for n in range(1, 500)]
    repeated = [now for now in moments if topics.repeat(now)]
    gaps = [after - before for before, after in pairwise(repeated)]
    assert min(gaps) > 0.024
    assert max(gaps) < 0.0625 + 0.014
    assert abs(len(repeated) - 20 * 0.014 * 499) <= 1.0


def test_own_stop_is_said_again_to_listeners_alone_and_a_change_to_all() -> None:
    topics, estop, own_estop = stop_topics()
    assert topics.repeat(1001.0)
    assert (estop.publish.call_count, own_estop.publish.call_count) == (1, 0)
    topics.change(Verdict.stop(), 1001.01)
    assert (estop.publish.call_count, own_estop.publish.call_count) == (2, 1)
    own_estop.get_subscription_count.return_value = 1
    assert topics.repeat(1002.0)
    assert (estop.publish.call_count, own_estop.publish.call_count) == (3, 2)


# Proofs, between the threads that they belong to.


NOW = 64.0


class FakeNode:
    """Publishes into a list; ``on_publish`` comes before."""

    def __init__(self) -> None:
        self.said: list[Proof] = []
        self.on_publish: Callable[[], object] = lambda: None
        self.asked: list[tuple[Any, Any]] = []

    def create_publisher(self, *arguments: Any) -> Any:
        return SimpleNamespace(publish=self._publish)

    def _publish(self, message: Any) -> None:
        self.on_publish()
        self.said.append(Proof.from_bytes(bytes(message.data)))

    def create_subscription(self, kind: Any, *arguments: Any, **options: Any) -> Any:
        handle = MagicMock()
        handle.take_message = lambda *_: self.asked.pop(0) if self.asked else None
        return SimpleNamespace(handle=handle, msg_type=kind, raw=False)

    def challenge(self, number: int) -> None:
        self.asked.append((SimpleNamespace(data=Challenge(1, number).to_bytes()), {}))


def test_challenges_since_the_last_answer_get_one_proof() -> None:
    node = FakeNode()
    topics = ProofTopics(node)
    topics.say(Verdict(), NOW)
    topics.answer(NOW)
    assert node.said == []
    node.challenge(1)
    node.challenge(2)
    topics.answer(NOW)
    assert [each.answers for each in node.said] == [((1, 2),)]


def test_flood_of_challenges_keeps_no_thread_from_all_else_that_it_does() -> None:
    node = FakeNode()
    topics = ProofTopics(node)
    node.asked = Flood(())
    topics.answer(NOW)
    assert len(node.said) == 1


class Flood(list[Any]):
    """As fast as it is read there is another one."""

    taken = 0

    def __bool__(self) -> bool:
        return True

    def pop(self, index: Any = -1) -> Any:
        self.taken += 1
        assert self.taken < 1000, 'it reads for ever'
        return SimpleNamespace(data=Challenge(1, self.taken).to_bytes()), {}


def test_answers_are_apart_however_many_ask_and_stops_and_enables_are_proven_at_once() -> None:
    node = FakeNode()
    topics = ProofTopics(node, apart=0.02)
    for tick in range(20):
        now = NOW + tick / 128.0
        node.challenge(tick)
        topics.say(Verdict(estop=tick == 5, own_estop=False), now, enable=tick >= 10)
        topics.answer(now)
    said = [(each.answers[0][1], each.estop, each.enable) for each in node.said]
    at_once = [(4, True, False), (9, False, True)]  # answers come as it is asked, behind them
    apart = [(n, False, n >= 10) for n in (0, 3, 8, 13, 16, 19)]
    assert said == sorted(at_once + apart)


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
    node.challenge(1)
    link = threading.Thread(target=topics.answer, args=(NOW,), daemon=True)
    link.start()
    assert hangs.wait(5.0 * TIMEOUT_FACTOR)
    leaving = threading.Thread(target=topics.say, args=(Verdict.stop(), NOW), daemon=True)
    leaving.start()
    leaving.join(5.0 * TIMEOUT_FACTOR)
    stops = [each.estop for each in node.said]
    goes_on.set()
    link.join()
    assert stops == [True]
    assert [each.number for each in node.said] == [2, 1]  # a reader passes over the late one
