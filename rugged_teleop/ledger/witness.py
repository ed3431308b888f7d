# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Hears what the recorder hears, and has the lines written. Pure, but for the messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from rugged_teleop.ledger.facts import Fact, Facts, topics_of
from rugged_teleop.ledger.stopping import Stopped, Stops, Trend
from rugged_teleop.ledger.tried import Tried

_STEP = 0.5  # s by which a clock is set, at least, to be worth a line
_STOOD = 'stood'
_OF_NODES = ('link_up', 'enabled', 'joint_states')
_TYPES = {
    'rosout': 'rcl_interfaces/msg/Log',
    'parameter_events': 'rcl_interfaces/msg/ParameterEvent',
    'transition_event': 'lifecycle_msgs/msg/TransitionEvent',
    'status': 'diagnostic_msgs/msg/DiagnosticStatus',
}


class Witness:
    """
    :param read: makes a message of its type and its bytes. :param note: has a line written.
    :param written: the newest lines of the ledger. :param trend: how joints stop.
    :param tried: when stops and deadmen were seen to work.
    """

    def __init__(
        self,
        read: Callable[[str, bytes], Any],
        note: Callable[..., None],
        written: Sequence[Mapping[str, Any]],
        trend: Trend,
        tried: Tried,
    ) -> None:
        self._read, self._note, self.trend, self.tried = read, note, trend, tried
        self._facts = Facts(written)
        self._stops = Stops(read)
        self._facts_in: frozenset[str] = frozenset()  # topics
        self._heard: frozenset[str] = frozenset()  # all topics that say something
        self._offset: float | None = None  # of the wall clock
        self.last_stop = ''
        for each in written:
            with suppress(KeyError, TypeError):  # not written by this class
                if each['what'] == _STOOD:
                    unheard = each.get('unheard', 0.0)
                    trend.judge(each['joint'], each['speed'], each['time'], unheard)

    def know(
        self,
        nodes: Sequence[str],
        muxes: Sequence[str],
        parameters: Mapping[str, Mapping[str, str]],
    ) -> None:
        """Take which nodes there are, and what they have answered."""
        self._facts_in = topics_of(nodes, muxes)
        of_nodes = (f'{node}/{name}' for node in nodes for name in _OF_NODES)
        self._heard = self._facts_in.union(of_nodes, (f'{mux}/state' for mux in muxes))
        self._stops.know(nodes, muxes)
        self.tried.know({mux: parameters.get(mux, {}) for mux in muxes})
        self._write(self._facts.of_nodes(nodes))
        self._write(self._facts.of_parameters(parameters))

    def hear(self, topic: str, data: bytes, at: float) -> None:
        """Take a message."""
        if topic not in self._heard:  # most are not
            return
        node, _, name = topic.rpartition('/')
        if topic in self._facts_in:
            message = self._read(_TYPES[name], data)
            self._write(self._facts.of(topic, message))
            if name == 'status':
                for source in self.tried.hear_status(node, message, at + (self._offset or 0.0)):
                    self._note(source.worked, **source.facts)
        elif name == 'link_up':
            self.tried.hear_link(node, data[4] != 0)  # behind the head of CDR
        self._stood(self._stops.hear(topic, data, at))

    def look(self, now: float, wall: float) -> None:
        """Take the time by both clocks."""
        offset, self._offset = self._offset, wall - now
        if offset is not None and abs(wall - now - offset) >= _STEP:
            self._note('clock stepped', seconds=round(wall - now - offset, 3))
        self._stood(self._stops.look(now))

    def _write(self, facts: Iterable[Fact]) -> None:
        for what, values in facts:
            self._note(what, **values)

    def _stood(self, found: Iterable[tuple[str, Stopped]]) -> None:
        for node, stopped in found:
            values = {
                k: round(v, 3) if isinstance(v, float) else v for k, v in stopped._asdict().items()
            }
            slow = self.trend.judge(stopped.joint, stopped.speed, stopped.time, stopped.unheard)
            self._note(_STOOD, node=node, **values, **({'slow': slow} if slow else {}))
            time = 'did not stand' if stopped.time is None else f'{stopped.time:.2f} s'
            self.last_stop = f'{stopped.joint}: {time} from {stopped.speed:.1f} rad/s'
