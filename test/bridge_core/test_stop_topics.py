# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""When a verdict is said again, by a clock of the test's."""

from itertools import pairwise
from typing import Any
from unittest.mock import MagicMock

from bridge_core.session import Verdict
from bridge_core.stop_topics import StopTopics


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
