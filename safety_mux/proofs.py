# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mux as a reader of proofs: how old at most is what it hears of each node?

A node has one reader, for the e-stop source and the operator that it may be. See
bridge_core/proof.py.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import secrets
from typing import Any

from bridge_core.proof import nanoseconds, Reader, Vouched
from safety_mux.arbiter import Arbiter
from safety_mux.protocol import Kind, State

SILENCE = 0.5  # s after which another process may be the node
ENDINGS = {'estop': '/estop', 'operator': '/joy'}  # of topics that have ~/proof beside them


class ProvenNode:
    """
    One node that may prove how old its words are.

    :param name: full name of the node.
    """

    def __init__(self, name: str, arbiter: Arbiter) -> None:
        self.name = name
        self.reader = Reader(secrets.randbits(64), SILENCE)
        self.sources: list[str] = []
        self.operators: list[str] = []
        self._arbiter = arbiter
        self._vouched = Vouched()
        self._held: dict[str, int] = {}  # by operator: the stamp of his newest Joy, ns
        self._is_doubled = False

    def challenge(self, now: float) -> bytes:
        """Return what to ask now, once each PERIOD."""
        self._look(now)
        return self.reader.challenge(now)

    def hear(self, data: bytes, now: float) -> bool:
        """Take a proof; tell whether it is a stop, for which to decide at once."""
        heard = self.reader.hear(data, now)
        self._look(now)
        if heard is None:
            return False
        for name in self.sources:
            self._arbiter.estop_proof(name, heard, now)
        if self.reader.writer is not None and not self._is_doubled:
            self._vouched.prove(heard.newest, heard.as_of)
        for name in self.operators:
            self._prove(name, now)
        return heard.stopped and self._arbiter.state is not State.STOPPED

    def joy(self, operator: str, stamp: Any, now: float) -> None:
        """Note the stamp of an operator's newest Joy."""
        self._held[operator] = nanoseconds(stamp)
        if self.reader.writer is not None:
            self._prove(operator, now)

    def _prove(self, operator: str, now: float) -> None:
        as_of = self._vouched.as_of(self._held.get(operator, -1))
        self._arbiter.operator_proof(operator, as_of, now)

    def _look(self, now: float) -> None:
        doubled = self.reader.is_doubled(now)
        if not (doubled or self._is_doubled):
            return
        self._is_doubled = doubled
        text = f'two nodes named {self.name} prove what they say: stop one of them'
        for name in self.sources:
            self._invalidate('e-stop source', name, text if doubled else None)
        for name in self.operators:
            self._invalidate('operator', name, text if doubled else None)

    def _invalidate(self, kind: Kind, name: str, text: str | None) -> None:
        self._arbiter.set_invalid(kind, name, 'two writers', text)


def proven_nodes(
    arbiter: Arbiter, values: Mapping[str, Any], resolved: Callable[[str], str]
) -> list[ProvenNode]:
    """
    Return the nodes that may prove what they say.

    :param values: every parameter. :param resolved: returns the full name of a topic.
    """
    nodes: dict[str, ProvenNode] = {}

    def node_of(prefix: str, name: str, policy: str) -> ProvenNode | None:
        topic = resolved(values[f'{prefix}.{name}.topic'])
        if policy == 'none' or not topic.endswith(ENDINGS[prefix]):
            return None
        name = topic.removesuffix(ENDINGS[prefix])
        return nodes.setdefault(name, ProvenNode(name, arbiter))

    for source in arbiter.config.sources:
        if node := node_of('estop', source.name, source.proof):
            node.sources.append(source.name)
    for operator in arbiter.config.operators:
        if node := node_of('operator', operator.name, operator.proof):
            node.operators.append(operator.name)
    return [*nodes.values()]
