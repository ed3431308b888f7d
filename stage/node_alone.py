# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A bridge's node without its link, for tests of what the node knows and says by itself."""

from collections.abc import Callable, Iterator
import contextlib
from typing import Any, TypeVar

from rclpy.parameter import Parameter

from bridge_core.node import BridgeNode

NodeT = TypeVar('NodeT', bound=BridgeNode[Any])


@contextlib.contextmanager
def alone(kind: Callable[..., NodeT], context: Any) -> Iterator[NodeT]:
    """Give a node that counts as active; its link's part is the test's."""
    node = kind(context=context, parameter_overrides=[Parameter('autostart', value=False)])
    node.link.stop()
    node.take_parameters(node.values)
    node.active = True
    yield node
    node.destroy_node()
