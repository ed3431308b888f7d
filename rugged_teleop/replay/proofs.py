# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Proofs of age, put to a mux of today.

It asks when the recorded one did, but by its own clock and identity. So what a proof answers is
put into its terms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import contextlib
from dataclasses import replace
from typing import Any

from bridge_core.proof import Challenge, Proof, ProofError
from safety_mux.arbiter import Arbiter
from safety_mux.proofs import proven_nodes
from safety_mux.protocol import Kind

_LATER = 1 << 32  # above the numbers of all proofs that were made up
_BEFORE = 1e-6  # s from a question to its answer, at least


class Proofs:
    """
    The nodes that proved to the recorded mux how old their words are.

    :param values: every parameter. :param resolved: returns the full name of a topic.
    """

    def __init__(
        self, arbiter: Arbiter, values: Mapping[str, Any], resolved: Callable[[str], str]
    ) -> None:
        self._nodes = {each.name: each for each in proven_nodes(arbiter, values, resolved)}
        self._asked: dict[tuple[int, int], tuple[int, int]] = {}  # then and now, by whom and when
        self._first: dict[str, Proof] = {}  # by node
        self._number = 0

    def begin(self, topic: str, message: Any) -> None:
        """Note a message from about the beginning; of proofs the last one counts."""
        name, _, what = topic.rpartition('/')
        if what == 'proof' and name in self._nodes:
            with contextlib.suppress(ProofError):
                self._first[name] = Proof.from_bytes(bytes(message.data))

    def make_up(self, now: float, *, clear: bool, enable: bool) -> None:
        """Have each node prove now what it said at the beginning. :param clear: no stop."""
        self._number += 1
        for name, first in self._first.items():
            node = self._nodes[name]
            asked = Challenge.from_bytes(node.challenge(now - _BEFORE))
            made = replace(
                first,
                number=self._number,
                estop=first.estop and not clear,
                own_estop=first.own_estop and not clear,
                enable=enable,
                newest=1,  # so that it is about every message
                answers=((asked.reader, asked.asked),),
            )
            node.hear(made.to_bytes(), now)

    def hear(self, topic: str, message: Any, now: float) -> bool:
        """Take a message of any topic; tell whether it is a stop, for which to decide at once."""
        name, _, what = topic.rpartition('/')
        node = self._nodes.get(name)
        if node is None:
            return False
        with contextlib.suppress(ProofError):
            if what == 'challenge':
                then = Challenge.from_bytes(bytes(message.data))
                ours = Challenge.from_bytes(node.challenge(now - _BEFORE))
                self._asked[then.reader, then.asked] = ours.reader, ours.asked
            elif what == 'proof':
                proof = Proof.from_bytes(bytes(message.data))
                answers = tuple(self._asked[each] for each in proof.answers if each in self._asked)
                proof = replace(proof, number=proof.number + _LATER, answers=answers)
                return node.hear(proof.to_bytes(), now)
        return False

    def hear_stamp(self, kind: Kind, name: str, stamp: Any, now: float) -> None:
        """Note the stamp of the newest message of an input."""
        for node in self._nodes.values():
            node.hear_stamp(kind, name, stamp, now)
