# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mux as a reader of proofs: how old at most is what it hears of each node?

A node has one reader, for the e-stop source, the operator and the drive that it may be, and for
what the drive measures. See bridge_core/proof.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import math
from typing import Any, NamedTuple

from bridge_core.parameters import names_of
from bridge_core.proof import Heard, nanoseconds, new_identity, Reader, Vouched, WorstAge
from bridge_core.reasons import Coded
from bridge_core.watchdog import in_words
from safety_mux.arbiter import Arbiter
from safety_mux.parameters import enabled_topic, telling_drives
from safety_mux.protocol import Age, Kind, ProofReport, State

SILENCE = 0.5  # s after which another process may be the node
_CREEPS_FROM, _CREEPS_UNTIL = 0.5, 0.4  # of the limit
# Of topics that have ~/proof beside them.
ENDINGS: dict[Kind, str] = {'e-stop source': '/estop', 'operator': '/joy', 'drive': '/enabled'}
STAMPED: tuple[Kind, ...] = ('operator', 'feedback')  # as old as the stamp of the newest message
_MEASURED = '/joint_states'


class Provable(NamedTuple):
    """
    An input whose node may prove ages.

    :param policy: the parameter that says whether it has to. :param topic: that names its topic.
    """

    kind: Kind
    name: str
    policy: str
    topic: str


def provable(values: Mapping[str, Any]) -> Iterator[Provable]:
    """Yield all such inputs. :param values: every parameter."""
    for name in names_of(values, 'estop_sources'):
        yield Provable('e-stop source', name, f'estop.{name}.proof', f'estop.{name}.topic')
    for name in names_of(values, 'operators'):
        yield Provable('operator', name, f'operator.{name}.proof', f'operator.{name}.topic')
    for name in telling_drives(values):
        yield Provable('drive', name, 'drive_enabled_proof', enabled_topic(name))


class ProvenNode:
    """
    One node that may prove how old its words are.

    :param name: full name of the node.
    """

    def __init__(self, name: str, arbiter: Arbiter) -> None:
        self.name = name
        self.reader = Reader(new_identity(), SILENCE)
        self.inputs: list[tuple[Kind, str]] = []
        self._arbiter = arbiter
        self._vouched = Vouched()
        self._held: dict[tuple[Kind, str], int] = {}  # the stamp of the newest message, ns
        self._is_doubled = False
        self._of_device = math.inf
        self._creeps = False
        self._worst: dict[tuple[Kind, str], WorstAge] = {}

    def continue_from(self, before: ProvenNode, now: float) -> None:
        """Go on as reader of the node; who proved its words has to prove them again."""
        self.reader, self._vouched = before.reader, before._vouched
        if self.reader.writer is not None:
            for each in self.inputs:
                self._arbiter.input_of(*each).prove(-math.inf, now)

    def challenge(self, now: float) -> bytes:
        """Return what to ask now, once each PERIOD."""
        self._look(now)
        return self.reader.challenge(now)

    def hear(self, data: bytes, now: float) -> bool:
        """Take a proof; tell whether it is a stop, for which to decide at once."""
        before = self.reader.writer
        heard = self.reader.hear(data, now)
        self._look(now)
        if heard is None:
            return False
        self._note_ages(now)  # the greatest, right before there is a newer one
        if not self._is_doubled:
            self._vouched.prove(heard.newest, heard.as_of)
            self._of_device = heard.age
        for kind, name in self.inputs:
            self._pass_on(kind, name, heard, now)
        if before not in (None, self.reader.writer):
            text = Coded('mux.input.restarted', f'{self.name} was restarted', node=self.name)
            for kind, name in self.inputs:
                self._arbiter.set_invalid(kind, name, 'restarted', text)
                self._arbiter.set_invalid(kind, name, 'restarted', None)
        return heard.stopped and self._arbiter.state is not State.STOPPED

    def _pass_on(self, kind: Kind, name: str, heard: Heard, now: float) -> None:
        if kind in STAMPED:
            self._prove(kind, name, now)
        elif kind == 'drive':
            self._arbiter.drive_proof(name, heard, now)
        else:
            self._arbiter.estop_proof(name, heard, now)

    def hear_stamp(self, kind: Kind, name: str, stamp: Any, now: float) -> None:
        """Note the stamp of the newest message of one of ``STAMPED``, if it is this node's."""
        if (kind, name) not in self.inputs:
            return
        self._held[kind, name] = nanoseconds(stamp)
        if self.reader.writer is not None:
            self._prove(kind, name, now)

    def _prove(self, kind: Kind, name: str, now: float) -> None:
        as_of = self._vouched.as_of(self._held.get((kind, name), -1))
        self._arbiter.input_of(kind, name).prove(as_of, now)

    def _look(self, now: float) -> None:
        doubled = self.reader.is_doubled(now)
        if not (doubled or self._is_doubled):
            return
        self._is_doubled = doubled
        text = f'two nodes named {self.name} prove what they say: stop one of them'
        text = Coded('input.two_nodes', text, node=self.name)
        for kind, name in self.inputs:
            self._arbiter.set_invalid(kind, name, 'two writers', text if doubled else None)

    def report(self, now: float) -> ProofReport:
        """Return what is known of its words."""
        self._note_ages(now)
        ages = []
        for key, worst in self._worst.items():
            each = self._arbiter.input_of(*key)
            ages.append(Age(key[0], each.label, worst.value, each.age_limit))
        reader = self.reader
        bad = reader.damaged, reader.repeated, reader.unasked
        return ProofReport(self.name, ages, self._of_device, bad, self._creeping(ages))

    def _creeping(self, ages: Sequence[Age]) -> Coded | None:
        known = [age for age in ages if age.worst < math.inf]
        most = max(known, key=lambda age: age.worst / age.limit, default=None)
        self._creeps = most is not None and most.worst / most.limit >= (
            _CREEPS_UNTIL if self._creeps else _CREEPS_FROM
        )
        if most is None or not self._creeps:
            return None
        text = (
            f'what {self.name} says was up to {in_words(most.worst)} old, the limit of '
            f'{most.label} is {in_words(most.limit)}: look at the network to it'
        )
        fields = {'age_s': most.worst, 'limit_s': most.limit}
        return Coded('mux.input.creeping', text, node=self.name, **fields)

    def _note_ages(self, now: float) -> None:
        for key in self.inputs:
            age = self._arbiter.input_of(*key).age
            if age is not None:
                self._worst.setdefault(key, WorstAge()).note(age.age(now), now)


def proven_nodes(
    arbiter: Arbiter, values: Mapping[str, Any], resolved: Callable[[str], str]
) -> list[ProvenNode]:
    """
    Return the nodes that may prove what they say.

    :param values: every parameter. :param resolved: returns the full name of a topic.
    """
    nodes: dict[str, ProvenNode] = {}
    for each in provable(values):
        topic, ending = resolved(values[each.topic]), ENDINGS[each.kind]
        if values[each.policy] != 'none' and topic.endswith(ending):
            name = topic.removesuffix(ending)
            node = nodes.setdefault(name, ProvenNode(name, arbiter))
            node.inputs.append((each.kind, each.name))
            measured = values['feedback.topic']
            if each.kind == 'drive' and measured and resolved(measured) == f'{name}{_MEASURED}':
                node.inputs.append(('feedback', 'feedback'))
    return [*nodes.values()]
