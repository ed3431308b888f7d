# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bridge's node without its link, for tests of what the node knows and says by itself."""

from collections.abc import Callable, Iterator
import contextlib
from typing import Any, TypeVar

from rclpy.parameter import Parameter

from bridge_core.node import BridgeNode

NodeT = TypeVar('NodeT', bound=BridgeNode[Any])


@contextlib.contextmanager
def alone(kind: Callable[..., NodeT], context: Any, **parameters: Any) -> Iterator[NodeT]:
    """Give a node that counts as active; its link's part is the test's."""
    given = {'autostart': False, **parameters}
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    node = kind(context=context, parameter_overrides=overrides)
    node.link.stop()
    node.take_parameters(node.values)
    node.active = True
    yield node
    node.destroy_node()
