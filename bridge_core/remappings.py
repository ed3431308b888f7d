# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Remappings: none that renames nothing is passed over in silence."""

from __future__ import annotations

from collections.abc import Collection, Sequence
import itertools
import os
import re

from bridge_core.managed_node import ManagedNode
from bridge_core.parameter_files import nearest
from bridge_core.parameters import full_topic, ParameterError

_RULE = re.compile(
    r'(?:(?P<node>\w+):(?!//))?(?:ros(?P<kind>topic|service)://)?(?P<name>[~/]*\w[\w/]*):='
)
# A node has the first without telling, and the others with publish_raw.
_MAYBE = {'~/transition_event', '~/raw/received', '~/raw/sent'}
# Launch files rename these for a whole robot. Nothing that moves or stops it is there.
_SHARED = {'clock', 'diagnostics', 'parameter_events', 'rosout', 'tf', 'tf_static'}
_OF_NODES = ('__node', '__name', '__ns')


def check_remappings(
    nodes: Sequence[ManagedNode], arguments: Sequence[str], wired: Collection[str] = ()
) -> None:
    """
    Refuse to remap a topic or service that none of the nodes has, or for a node that is not here.

    :param wired: names of nodes for which there may be rules although they are renamed.
    :raises ParameterError: it.
    """
    for option, rule in itertools.pairwise(arguments):
        found = _RULE.match(rule) if option in ('-r', '--remap') else None
        if found is None or found['name'] in _MAYBE or found['name'].lstrip('/') in _SHARED:
            continue
        of, name = found['node'], found['name']
        here = [node.get_name() for node in nodes]
        meant = [node for node in nodes if of in (None, node.get_name())]
        if name in _OF_NODES:
            known = {*here, *wired, *(node.own_name for node in nodes)}
            if of not in (None, *known):
                raise _error(rule, of, nearest(of, known))
        elif not meant and of not in wired:
            raise _error(rule, of, nearest(of, here))
        elif meant and not any(_has(node, name, found['kind']) for node in meant):
            if found['kind']:  # a topic may have the name of a service
                raise _error(rule, f'{found["kind"]} {name}', '')
            raise _unquoted(rule) or _error(rule, name, _like(meant, name))


def _error(rule: str, name: str, like: str) -> ParameterError:
    hint = f'did you mean {like}?' if like else 'see --help'
    return ParameterError(f'-r {rule}: there is no {name}; {hint}')


def _unquoted(rule: str) -> ParameterError | None:
    """Return what to say of a rule whose ~ a shell has taken for the home directory."""
    home = os.path.expanduser('~')
    if not rule.startswith(f'{home}/'):
        return None
    meant = '~' + rule.removeprefix(home)
    return ParameterError(
        f"-r {rule}: the shell has made {home} of ~: quote it, as in -r '{meant}'"
    )


def _like(nodes: Sequence[ManagedNode], name: str) -> str:
    """Return the name that is meant instead, ``~/`` for a node's own; empty: none is like it."""
    names: set[str] = set()
    own: dict[str, str] = {}  # without the node's name, by the full name
    for node in nodes:
        prefix = f'{node.get_fully_qualified_name()}/'
        found = set().union(*_names(node))
        names |= found
        own |= {each: each.removeprefix(prefix) for each in found if each.startswith(prefix)}
    like = nearest(name.rpartition('/')[2], [*own.values()])
    full = full_topic(nodes[0].get_fully_qualified_name(), name)
    return f'~/{like}' if like else nearest(full, names - own.keys())


def _has(node: ManagedNode, name: str, kind: str | None) -> bool:
    """Tell whether a topic or service of the node has the name that rules make of this one."""
    topics, services = _names(node)
    return (kind != 'service' and node.resolve_topic_name(name) in topics) or (
        kind != 'topic' and node.resolve_service_name(name) in services
    )


def _names(node: ManagedNode) -> tuple[set[str], set[str]]:
    """Return the full names of its topics and of its services."""
    topics = (*node.publishers, *node.subscriptions, *node.lane.subscriptions)
    services = (*node.services, *node.clients)
    return {each.topic_name for each in topics}, {each.service_name for each in services}
