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

"""Remappings of private topics: none is passed over in silence."""

from __future__ import annotations

from collections.abc import Collection, Sequence
import itertools
import re

from bridge_core.managed_node import ManagedNode
from bridge_core.parameter_files import nearest
from bridge_core.parameters import ParameterError

_RULE = re.compile(r'(?:(?P<node>\w+):)?(?P<name>~/[\w/]+):=')
# A node has the first without telling, and the others with publish_raw.
_MAYBE = {'~/transition_event', '~/raw/received', '~/raw/sent'}


def check_remappings(
    nodes: Sequence[ManagedNode], arguments: Sequence[str], wired: Collection[str] = ()
) -> None:
    """
    Refuse to remap a private topic or service that none of the nodes has.

    :param wired: names of nodes for which there may be rules although they are renamed.
    :raises ParameterError: it.
    """
    for option, rule in itertools.pairwise(arguments):
        found = _RULE.match(rule) if option in ('-r', '--remap') else None
        if found is None or found['name'] in _MAYBE:
            continue
        of, name = found['node'], found['name']
        meant = [node for node in nodes if of in (None, node.get_name())]
        if not meant and of not in wired:
            raise _error(rule, of, [node.get_name() for node in nodes])
        if meant and not any(_has(node, name) for node in meant):
            raise _error(rule, name, [name for node in meant for name in _private(node)])


def _error(rule: str, name: str, names: Sequence[str]) -> ParameterError:
    like = nearest(name, names)
    hint = f'did you mean {like}?' if like else 'see --help'
    return ParameterError(f'-r {rule}: there is no {name}; {hint}')


def _has(node: ManagedNode, name: str) -> bool:
    """Tell whether a topic or service of the node has the name that rules make of this one."""
    return not _names(node).isdisjoint(
        {node.resolve_topic_name(name), node.resolve_service_name(name)}
    )


def _private(node: ManagedNode) -> list[str]:
    own = f'{node.get_fully_qualified_name()}/'
    return [f'~/{name.removeprefix(own)}' for name in _names(node) if name.startswith(own)]


def _names(node: ManagedNode) -> set[str]:
    topics = (*node.publishers, *node.subscriptions, *node.lane.subscriptions)
    services = (*node.services, *node.clients)
    return {each.topic_name for each in topics} | {each.service_name for each in services}
