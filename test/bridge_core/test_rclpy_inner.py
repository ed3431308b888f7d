# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is used of rclpy beside its public API, and what happens where it is not there."""

from __future__ import annotations

from importlib.metadata import distributions
import os
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter

from bridge_core import rclpy_inner


def running() -> str:
    """Return the distribution that runs: the one that is sourced, or the one of the wheels."""
    names = [each.name.split('-') for each in distributions()]
    wheels = {name[1] for name in names if len(name) == 3 and name[::2] == ['ros', 'rclpy']}
    return os.environ.get('ROS_DISTRO') or ''.join(wheels)


def test_inner_api_is_known_of_the_distribution_that_runs(context: Context) -> None:
    """On another one, look at each row of the table in rclpy_inner, then name it there."""
    assert running() == rclpy_inner.DISTRIBUTION
    node = LifecycleNode('known', context=context, parameter_overrides=[Parameter('a', value=3)])
    seen: list[Any] = []

    def wrap(callback: Any) -> Any:
        seen.append(callback)
        return callback

    assert rclpy_inner.given_parameters(node) == {'a': 3}
    rclpy_inner.wrap_transitions(node, wrap)
    assert node.on_activate in seen
    rclpy_inner.wrap_change_state(node, wrap)
    assert callable(seen[-1])
    node.destroy_node()


def test_callbacks_that_are_elsewhere_are_left_alone() -> None:
    node = SimpleNamespace()
    rclpy_inner.wrap_transitions(node, lambda callback: pytest.fail('called'))
    rclpy_inner.wrap_change_state(node, lambda callback: pytest.fail('called'))
    assert vars(node) == {}
    with pytest.raises(AttributeError, match='_parameter_overrides'):
        rclpy_inner.given_parameters(node)
