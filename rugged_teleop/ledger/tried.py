# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
When stops and deadmen were last seen to work, by daily checks and ordinary use alike. Pure.

A stop works where a mux has heard it say clear, stop and clear again, while its node heard its
device all along: a link that is lost is a stop, too, and says nothing of the button; nor does the
echo of another source's. A deadman works where pressing it gave its operator control, releasing
it ended that, and all joints stand.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from datetime import datetime
import json
from typing import Any, NamedTuple

from bridge_core.parameters import full_topic

_CONDITION = "condition of e-stop source '"
_ECHO = 'mux.source.echo'  # code of a source that is stopped by the others alone
_MINUTE, _HOUR = 60.0, 3600.0
# By what a line of the ledger says: the field of its name.
_LINES = {'stop worked': 'source', 'deadman worked': 'operator'}
_STOP, _DEADMAN = _LINES


class Source(NamedTuple):
    """
    A stop of a mux, or the deadman of an operator, by the name that it has there.

    :param worked: what the ledger says when it did.
    """

    mux: str
    name: str
    worked: str = _STOP

    @property
    def facts(self) -> dict[str, str]:
        """The rest of such a line."""
        return {'node': self.mux, _LINES[self.worked]: self.name}

    @property
    def words(self) -> str:
        """For people."""
        return self.name if self.worked == _STOP else f'deadman of {self.name}'


class Tried:
    """
    :param interval: h within which each has to be seen to work; 0: it does not matter.

    :param actuators: names of nodes whose stop nobody can press.
    :param written: newest lines of the ledger.
    """

    def __init__(
        self, interval: float, actuators: Collection[str], written: Iterable[Mapping[str, Any]]
    ) -> None:
        self._interval, self._actuators = interval * _HOUR, actuators
        self._nodes: dict[Source, str] = {}
        self._said: dict[Source, tuple[str, ...]] = {}  # clear; then stop
        self._owners: dict[str, tuple[str, str]] = {}  # by mux: state, and who has or had control
        self._at: dict[Source, float] = {}
        for each in written:
            with suppress(KeyError, TypeError, ValueError):  # not written by this class
                name = each[_LINES[each['what']]]
                at = datetime.fromisoformat(each['at']).timestamp()
                self._at[Source(each['node'], name, each['what'])] = at

    def know(self, parameters: Mapping[str, Mapping[str, str]]) -> None:
        """Take the muxes' parameters, as JSON, which name their sources and operators."""
        for mux, values in parameters.items():
            for parameter, text in values.items():
                kind, _, rest = parameter.partition('.')
                name, _, last = rest.rpartition('.')
                if (kind, last) == ('estop', 'topic'):
                    topic = full_topic(mux, json.loads(text))
                    self._nodes[Source(mux, name)] = topic.rpartition('/')[0]
                elif (kind, last) == ('operator', 'topic'):
                    self._nodes[Source(mux, name, _DEADMAN)] = ''

    def hear_link(self, node: str, up: bool) -> None:
        """Take whether a node hears its device."""
        if not up:
            for source in [each for each, of in self._nodes.items() if of == node]:
                self._said.pop(source, None)

    def hear_status(self, mux: str, message: Any, at: float) -> Iterator[Source]:
        """Take a mux's status; yield what has just worked. :param at: s since 1970."""
        values = {each.key: each.value for each in message.values}
        operator = self._let_go(mux, values)
        if operator:
            deadman = Source(mux, operator, _DEADMAN)
            self._at[deadman] = at
            yield deadman
        echoes = {values.get(f'{key}.source') for key, code in values.items() if code == _ECHO}
        for key, word in values.items():
            if not key.startswith(_CONDITION):
                continue
            source = Source(mux, key[len(_CONDITION) : -1])
            if word == 'stop' and source.name in echoes:
                continue  # nobody has pressed it
            said = self._said.get(source, ())
            if word == 'clear' and said == ('clear', 'stop'):
                self._at[source] = at
                yield source
            if word == 'clear':
                self._said[source] = ('clear',)
            elif word == 'stop' and said:
                self._said[source] = ('clear', 'stop')
            else:
                self._said.pop(source, None)

    def _let_go(self, mux: str, values: Mapping[str, str]) -> str:
        """Return whose deadman has ended his control, once all stands; empty: nobody's."""
        before, owner = self._owners.pop(mux, ('', ''))
        state = values.get('state', '')
        if state == 'ACTIVE':
            now = values.get('owner', '')
            # Who had control already, or took it from another, was not seen to press it.
            self._owners[mux] = state, now if before == 'READY' or now == owner else ''
        elif state == 'READY':
            released = values.get('last transition', '').endswith(
                f"operator '{owner}' released its deadman"
            )
            if released and values.get('condition of the feedback') != 'moving':
                self._owners[mux] = state, ''
                return owner
            self._owners[mux] = state, owner * released
        return ''

    def said(self, now: float) -> list[str]:
        """Return when each was last seen to work, in words."""
        return [f'{source.words} {_ago(age)}' for source, age in self._ages(now)]

    def overdue(self, now: float) -> list[str]:
        """Return what was not seen to work for too long, in words."""
        return [
            f'{source.words} {_ago(age)}'
            for source, age in self._ages(now)
            if self._interval and (age is None or age > self._interval)
        ]

    def _ages(self, now: float) -> Iterator[tuple[Source, float | None]]:
        for source, node in sorted(self._nodes.items()):
            if node.rpartition('/')[2] not in self._actuators:
                at = self._at.get(source)
                # None too where it is in the future: the clock was wrong.
                yield source, None if at is None or at > now else now - at


def _ago(age: float | None) -> str:
    if age is None:
        return 'never'
    return f'{age / _HOUR:.0f} h ago' if age >= _HOUR else f'{age / _MINUTE:.0f} min ago'
