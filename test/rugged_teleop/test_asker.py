# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node of a command keeps up with all topics of a machine."""

from __future__ import annotations

from typing import Any

import pytest
import rclpy.executors
from std_msgs.msg import Bool

from rugged_teleop.asker import Visitor
from stage.rig import own_domain, wait_for

TOPICS, EACH = 30, 10


def test_one_wait_serves_all_topics_that_have_something(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gathered anew for each message, the topics of a large machine came seconds late."""
    own_domain()
    waits = 0
    make = rclpy.executors._rclpy.WaitSet

    def wait_set(*arguments: Any) -> Any:
        nonlocal waits
        waits += 1
        return make(*arguments)

    monkeypatch.setattr(rclpy.executors._rclpy, 'WaitSet', wait_set)
    heard: list[Any] = []
    with Visitor('hears_all') as visitor:
        names = [f'topic_{n}' for n in range(TOPICS)]
        for name in names:
            visitor.node.create_subscription(Bool, name, heard.append, EACH)
        publishers = [visitor.node.create_publisher(Bool, name, EACH) for name in names]
        wait_for(lambda: all(each.get_subscription_count() for each in publishers), 10.0, 'all')
        for _ in range(EACH):
            for publisher in publishers:
                publisher.publish(Bool())
        waits = 0
        wait_for(lambda: len(heard) == TOPICS * EACH, 10.0, 'all', idle=visitor.spin_for)
    assert waits < TOPICS * EACH / 2


def test_both_hear_when_one_of_two_spins() -> None:
    """While bench turned a joint, the trial beside it took in one message a turn."""
    own_domain()
    heard: list[Any] = []
    with Visitor('trial') as trial:
        trial.node.create_subscription(Bool, 'topic', heard.append, EACH)
        publisher = trial.node.create_publisher(Bool, 'topic', EACH)
        wait_for(publisher.get_subscription_count, 10.0, 'a subscription')
        with Visitor('bench', beside=trial) as bench:
            for _ in range(EACH):
                publisher.publish(Bool())
            wait_for(lambda: len(heard) == EACH, 10.0, 'all', idle=bench.spin_for)
        publisher.publish(Bool())
        wait_for(lambda: len(heard) == EACH + 1, 10.0, 'one after it', idle=trial.spin_for)
