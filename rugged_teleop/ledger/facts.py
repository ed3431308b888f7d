# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What of all that the nodes say belongs into the ledger, and under which word. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import json
import re
from typing import Any

from bridge_core.fingerprint import fingerprint

Fact = tuple[str, dict[str, Any]]  # what, and the rest of a line
COMMISSIONING = 'commissioning'  # what a mux's status says of it has this key
_ERROR = 40  # of /rosout
# How the names of nodes end that are heard besides the bridges and muxes.
_OTHERS = ('/status_page', '/commission')
# What a line of a node's log begins with, and what it is.
_LOGGED = (
    ('stop', r'(?P<state>STOPPED|STOPPING): (?P<why>.*)|stop: (?P<reason>.*)'),
    ('control', r'ACTIVE: (?P<why>.*)'),
    ('no control', r'READY: (?P<why>.*)'),
    ('asked', r'(?P<by>~/\w+|reset button|page): (?P<answer>.*)'),
    ('daily check', r'daily check: (?P<says>.*)'),
    ('trial', r'trial: (?P<says>.*)'),
    ('refused', r'(?:refused|cannot \w+|cannot \w+ \w+): (?P<why>.*)'),
)
_PATTERNS = tuple((what, re.compile(pattern, re.DOTALL)) for what, pattern in _LOGGED)


class Facts:
    """:param written: newest lines of the ledger: what nodes have logged by then is no news."""

    def __init__(self, written: Iterable[Mapping[str, Any]] = ()) -> None:
        self._nodes: frozenset[str] = frozenset()
        self._written = {(str(each.get('node')), str(each.get('said'))) for each in written}
        self._parameters: dict[str, Mapping[str, str]] = {}
        self._commissioning: dict[str, str] = {}  # by mux

    def of_nodes(self, nodes: Iterable[str]) -> Iterator[Fact]:
        """Yield which nodes have come and gone."""
        before, self._nodes = self._nodes, frozenset(nodes)
        for what, names in (
            ('node found', self._nodes - before),
            ('node left', before - self._nodes),
        ):
            yield from ((what, {'node': name}) for name in sorted(names))

    def of_parameters(self, known: Mapping[str, Mapping[str, str]]) -> Iterator[Fact]:
        """
        Yield what nodes have answered, as fingerprints of each and of all that are there.

        :param known: by node and name, as JSON. The fingerprint of all is that of a commissioning
            report, once all nodes have answered.
        """
        for node, values in known.items():
            if self._parameters.get(node) == values:
                continue
            self._parameters[node] = values
            all_values = {
                name: {key: json.loads(text) for key, text in of.items()}
                for name, of in self._parameters.items()
                if name in self._nodes or name == node
            }
            own = fingerprint({node: all_values[node]})
            yield 'parameters', {'node': node, 'sha256': own, 'all': fingerprint(all_values)}

    def of(self, topic: str, message: Any) -> Iterator[Fact]:
        """Yield what a message says."""
        node, _, name = topic.rpartition('/')
        if topic == '/rosout':
            yield from self._of_log(message)
        elif topic == '/parameter_events' and message.node in self._nodes:
            for each in message.changed_parameters:
                facts = {'node': message.node, 'name': each.name, 'value': _plain(each.value)}
                yield 'parameter changed', facts
        elif name == 'transition_event' and node in self._nodes:
            yield 'lifecycle', {'node': node, 'state': message.goal_state.label}
        elif name == 'status':
            yield from self._of_status(node, message)

    def _of_log(self, message: Any) -> Iterator[Fact]:
        node = '/' + message.name.replace('.', '/')
        said = f'{message.stamp.sec}.{message.stamp.nanosec:09}'
        if (node, said) in self._written or not (node in self._nodes or node.endswith(_OTHERS)):
            return
        for what, pattern in _PATTERNS:
            found = pattern.fullmatch(message.msg)
            if found is not None:
                facts = {key: value for key, value in found.groupdict().items() if value}
                yield what, {'node': node, **facts, 'said': said}
                return
        if message.level >= _ERROR:
            yield 'fault', {'node': node, 'why': message.msg, 'said': said}

    def _of_status(self, node: str, message: Any) -> Iterator[Fact]:
        """Yield what a mux says of its commissioning, whenever that is another thing."""
        said = [each.value for each in message.values if each.key == COMMISSIONING]
        if said and self._commissioning.get(node) != said[0]:
            self._commissioning[node] = said[0]
            yield COMMISSIONING, {'node': node, 'says': said[0]}


def topics_of(nodes: Iterable[str], muxes: Iterable[str]) -> frozenset[str]:
    """Return the topics that may have a fact."""
    return frozenset(
        (
            *('/rosout', '/parameter_events'),
            *(f'{node}/transition_event' for node in nodes),
            *(f'{mux}/status' for mux in muxes),
        )
    )


def _plain(value: Any) -> Any:
    """Return a rcl_interfaces/ParameterValue; its fields are in the order of its types."""
    if not value.type:
        return None
    fields = [*value.get_fields_and_field_types()]
    plain = getattr(value, fields[value.type])
    return plain if isinstance(plain, bool | int | float | str) else [str(e) for e in plain]
