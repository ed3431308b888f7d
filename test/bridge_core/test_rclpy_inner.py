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
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
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

    assert rclpy_inner.wait_set_works(context)
    assert rclpy_inner.given_parameters(node) == {'a': 3}
    rclpy_inner.wrap_transitions(node, wrap)
    assert node.on_activate in seen
    rclpy_inner.wrap_change_state(node, wrap)
    assert seen[-1] == node._service_change_state.callback
    node.destroy_node()
    assert hasattr(SingleThreadedExecutor, '_take_service')


def test_callbacks_that_are_elsewhere_are_left_alone() -> None:
    node = SimpleNamespace()
    rclpy_inner.wrap_transitions(node, lambda callback: pytest.fail('called'))
    rclpy_inner.wrap_change_state(node, lambda callback: pytest.fail('called'))
    assert vars(node) == {}
    with pytest.raises(AttributeError, match='_parameter_overrides'):
        rclpy_inner.given_parameters(node)


class OtherWaitSet:
    """As rclpy's, but for one method that it has not, or that finds nothing."""

    def __init__(self, lacks: str, *arguments: Any) -> None:
        self._lacks = lacks
        self._real = _rclpy.WaitSet(*arguments)

    def __getattr__(self, name: str) -> Any:
        if name == self._lacks:
            raise AttributeError(name)
        return (lambda *_: False) if f'{name} finds' == self._lacks else getattr(self._real, name)


def other_rclpy(lacks: str) -> Any:
    subscription = {'take_message': None, '__enter__': None}
    subscription.pop(lacks, None)
    found = {
        'WaitSet': lambda *arguments: OtherWaitSet(lacks, *arguments),
        'Subscription': SimpleNamespace(**subscription),
    }
    found.pop(lacks, None)
    if lacks == 'arguments':
        found['WaitSet'] = lambda context: None
    return SimpleNamespace(**found)


@pytest.mark.parametrize(
    'lacks',
    [
        *('WaitSet', 'arguments', 'Subscription', 'take_message', '__enter__'),
        *('clear_entities', 'add_guard_condition', 'wait', 'is_ready', 'is_ready finds'),
    ],
)
def test_wait_set_that_is_another_is_not_used(
    context: Context, monkeypatch: pytest.MonkeyPatch, lacks: str
) -> None:
    monkeypatch.setattr(rclpy_inner, '_rclpy', other_rclpy(lacks))
    assert not rclpy_inner.wait_set_works(context)
