# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the page shows, made of what was heard. Time is an argument, in seconds of one steady clock.

What is not fresh is never shown as if it were: it becomes 'silent', whatever it said last. A node
that is gone stays on the page, silent, for that is what one wants to see of it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, field
import math
from typing import Any

from bridge_core.reasons import from_values, Severity, severity_of
from rugged_teleop.reasons import catalogue, explained, to_do
from rugged_teleop.status_page.graph import Bridge, Found

SILENT = 0.5  # s; e-stops come at 20 Hz, the state of a mux at 10 Hz
_OLD = 3.0  # s, for diagnostics, which come at 1 Hz
_EVENTS = 60
_MOST_AXES = 8
# What a recorder's last stops are under.
_STOPS_OF, _STOPS_UNITS = 'stops of ', ' (rad/s, s, commissioned s)'

Sample = dict[str, float]


@dataclass
class Heard:
    """The newest of something, and when it came."""

    value: Any = None
    at: float = -math.inf

    def put(self, value: Any, now: float) -> None:
        """Take what has come."""
        self.value, self.at = value, now

    def fresh(self, now: float, limit: float = SILENT) -> Any:
        """Return it; None if it is older than ``limit`` s."""
        return self.value if now - self.at <= limit else None


@dataclass
class Diagnostic:
    """One status of a bridge: level 0 to 3, words, and values as text."""

    level: int
    message: str
    values: dict[str, str]


@dataclass
class _Event:
    at: float
    kind: str  # 'stop', 'good' or 'note'
    text: str
    reason: str = ''
    number: int = 0


@dataclass
class _BridgeState:
    bridge: Bridge
    estop: Heard = field(default_factory=Heard)
    link_up: bool | None = None  # published on change alone
    joy: Heard = field(default_factory=Heard)
    speeds: Heard = field(default_factory=Heard)
    link: Heard = field(default_factory=Heard)
    device: Heard = field(default_factory=Heard)
    shown: str = 'silent'
    unexplained: _Event | None = None

    def said(self, now: float) -> str:
        """Return what its e-stop says: stop, clear, or silent."""
        value = self.estop.fresh(now)
        return 'silent' if value is None else 'stop' if value else 'clear'


@dataclass
class _MuxState:
    state: Heard = field(default_factory=Heard)
    status: Heard = field(default_factory=Heard)
    command: Heard = field(default_factory=Heard)
    operators: dict[str, str] = field(default_factory=dict)  # topic, by the operator's name
    listeners: frozenset[str] = frozenset()  # nodes that listen to its e-stop
    shown: tuple[str, str] = ('silent', 'none')

    def said(self, now: float) -> str:
        """Return its state; silent if it has none."""
        return self.state.fresh(now) or 'silent'


class Model:
    """Begins with nothing heard."""

    def __init__(self) -> None:
        self._bridges: dict[str, _BridgeState] = {}
        self._muxes: dict[str, _MuxState] = {}
        self._ledgers: dict[str, Heard] = {}  # what recorders say of theirs
        self._events: deque[_Event] = deque(maxlen=_EVENTS)
        self._count = 0

    # What was found and heard.

    def found(self, found: Found) -> None:
        """Take in bridges and muxes that are there."""
        for name, bridge in found.bridges.items():
            state = self._bridges.setdefault(name, _BridgeState(bridge))
            state.bridge = state.bridge.and_now(bridge)
        for name in found.muxes:
            self._muxes.setdefault(name, _MuxState())

    def operators(self, mux: str, topics: Mapping[str, str]) -> None:
        """Take in which topic each operator of a mux is heard on, as full names."""
        self._muxes[mux].operators = dict(topics)

    def listeners(self, mux: str, nodes: Iterable[str]) -> None:
        """Take in which nodes listen to the e-stop of a mux."""
        self._muxes[mux].listeners = frozenset(nodes)

    def estop(self, bridge: str, value: bool, now: float) -> None:
        """Hear ~/estop of a bridge."""
        self._bridges[bridge].estop.put(value, now)
        self._note_estop(bridge, now)

    def link_up(self, bridge: str, value: bool, now: float) -> None:
        """Hear ~/link_up of a bridge."""
        state = self._bridges[bridge]
        if value != state.link_up is not None:
            text = 'link is up' if value else 'link is down'
            self._add(now, 'good' if value else 'stop', f'{self._title(bridge)}: {text}')
        state.link_up = value

    def joy(self, bridge: str, axes: Sequence[float], buttons: Sequence[int], now: float) -> None:
        """Hear ~/joy of a bridge."""
        self._bridges[bridge].joy.put((list(axes)[:_MOST_AXES], list(buttons)), now)

    def speeds(self, bridge: str, speeds: Mapping[str, float], now: float) -> None:
        """Hear the velocities in ~/joint_states of a bridge, rad/s by joint."""
        self._bridges[bridge].speeds.put(dict(speeds), now)

    def state(self, mux: str, state: str, now: float) -> None:
        """Hear ~/state of a mux."""
        self._muxes[mux].state.put(state, now)

    def status(self, mux: str, values: Mapping[str, str], now: float) -> None:
        """Hear ~/status of a mux. It comes with each change of state, with the reason."""
        state = self._muxes[mux]
        state.status.put(dict(values), now)
        self._note_mux(mux, (values.get('state', ''), values.get('owner', 'none')), now)

    def is_silent(self, mux: str, now: float) -> bool:
        """Tell whether nothing is heard of a mux."""
        return self._muxes[mux].said(now) == 'silent'

    def command(self, mux: str, demand: Mapping[str, float], now: float) -> None:
        """Hear what a mux commands, by joint."""
        self._muxes[mux].command.put(dict(demand), now)

    def diagnostic(self, name: str, diagnostic: Diagnostic, now: float) -> None:
        """Hear one status of /diagnostics; what is of no bridge or recorder is left out."""
        node, _, part = name.partition(': ')
        if part == 'ledger':
            self._ledgers.setdefault(node, Heard()).put(diagnostic, now)
        state = self._bridges.get(f'/{node}')
        if state is None or part not in ('link', 'device'):
            return
        (state.link if part == 'link' else state.device).put(diagnostic, now)
        if part == 'device' and state.unexplained is not None:
            state.unexplained.reason = diagnostic.message
            state.unexplained = None

    def note(self, text: str, reason: str, now: float) -> None:
        """Add what was done by the page itself to the events."""
        self._add(now, 'note', text, reason)

    # Events.

    def _add(self, now: float, kind: str, text: str, reason: str = '') -> _Event:
        self._count += 1
        event = _Event(now, kind, text, reason, self._count)
        self._events.appendleft(event)
        return event

    def _title(self, bridge: str) -> str:
        """Return a bridge's title, with its name where there are two of a kind."""
        title = self._bridges[bridge].bridge.title
        alike = [each for each in self._bridges.values() if each.bridge.title == title]
        return f'{title} ({bridge})' if len(alike) > 1 else title

    def _note_estop(self, bridge: str, now: float) -> None:
        state = self._bridges[bridge]
        said = state.said(now)
        if said == state.shown:
            return
        words = {'stop': 'demands a stop', 'clear': 'is clear', 'silent': 'has fallen silent'}
        kind = 'good' if said == 'clear' else 'stop'
        event = self._add(now, kind, f'{self._title(bridge)} {words[said]}')
        state.unexplained = event if said == 'stop' else None
        state.shown = said

    def _note_mux(self, mux: str, said: tuple[str, str], now: float) -> None:
        state = self._muxes[mux]
        if said == state.shown:
            return
        reason = ''
        if said[0] == 'silent':
            text = 'safety mux has fallen silent'
        else:
            owner = f', {said[1]} has control' if said[1] != 'none' else ''
            text = f'{said[0]}{owner}'
            last = (state.status.value or {}).get('last transition', '')
            reason = last.partition(' ago: ')[2]
        if len(self._muxes) > 1:
            text = f'{mux}: {text}'
        kind = 'good' if said[0] in ('READY', 'ACTIVE') else 'stop'
        self._add(now, kind, text, reason)
        state.shown = said

    # What is shown.

    def sample(self, now: float) -> Sample:
        """Return the numbers of this moment that are drawn over time."""
        sample: Sample = {}
        for name, bridge in self._bridges.items():
            axes, _ = bridge.joy.fresh(now) or ((), ())
            sample |= {f'axis|{name}|{i}': value for i, value in enumerate(axes)}
            speeds = bridge.speeds.fresh(now) or {}
            sample |= {f'speed|{joint}|{name}': value for joint, value in speeds.items()}
        for name, mux in self._muxes.items():
            demand = mux.command.fresh(now) or {}
            sample |= {f'command|{joint}|{name}': value for joint, value in demand.items()}
        return {key: round(v, 3) for key, v in sample.items() if math.isfinite(v)}

    def snapshot(self, now: float, wall: float) -> dict[str, Any]:
        """
        Return all that the page shows.

        :param wall: the time of day at ``now``, in seconds since 1970.
        """
        for name in self._bridges:
            self._note_estop(name, now)
        for name, mux in self._muxes.items():
            if mux.said(now) == 'silent':
                self._note_mux(name, ('silent', 'none'), now)
        muxes = [self._mux(name, mux, now) for name, mux in self._muxes.items()]
        told = {
            (first['code'], name)
            for mux in muxes
            for first in mux['now']
            for name in first['names']
        }
        return {
            'now': round(now, 3),
            'at': round(wall, 3),
            'muxes': muxes,
            'bridges': [
                self._bridge(name, state, told, now) for name, state in self._bridges.items()
            ],
            'ledgers': [_ledger(name, each, now) for name, each in sorted(self._ledgers.items())],
            'sample': self.sample(now),
            'events': [
                {
                    'number': event.number,
                    'at': round(wall - (now - event.at), 3),
                    'kind': event.kind,
                    'text': event.text,
                    'reason': event.reason,
                }
                for event in self._events
            ],
        }

    def _mux(self, name: str, mux: _MuxState, now: float) -> dict[str, Any]:
        state = mux.said(now)
        values = mux.status.value if state != 'silent' and mux.status.value else {}

        inhibits, warnings = (
            [text for key, text in values.items() if key.startswith(f'{kind} ')]
            for kind in ('inhibit', 'warning')
        )
        reasons = from_values(values, [*inhibits, *warnings])
        held = reasons[: len(inhibits)]
        told = [
            {'text': text, 'code': code, 'todo': todo} for text, code, todo in explained(reasons)
        ]
        return {
            'name': name,
            'state': state,
            'owner': values.get('owner', 'none'),
            'now': [first._asdict() for first in [to_do(held, state)] if first is not None],
            'inhibits': told[: len(inhibits)],
            'warnings': told[len(inhibits) :],
            'slowed': values.get('slowed', ''),
            'last_reset': values.get('last reset', ''),
            'sources': [
                {
                    'label': label,
                    'condition': text,
                    'age': values.get(f'age of {label} (s)', ''),
                    'proven_age': values.get(f'proven age of {label} (s)', ''),
                }
                for key, text in values.items()
                if (label := key.removeprefix('condition of ')) != key
            ],
            'from_button': values.get('from button to wire, at most (s)', ''),
            'joints': sorted(mux.command.value or {}),
            'autonomy': 'condition of autonomy' in values,
        }

    def _bridge(
        self, name: str, state: _BridgeState, told: Set[tuple[str, str]], now: float
    ) -> dict[str, Any]:
        """:param told: codes and nodes of what to do now: it is not said again."""
        bridge, node = state.bridge, name.lstrip('/')
        estop = state.said(now)
        joy = state.joy.fresh(now)
        owned, operated = self._operated(f'{name}/joy', now)
        link, device = (heard.fresh(now, _OLD) for heard in (state.link, state.device))
        return {
            'name': name,
            'title': bridge.title,
            'remote': 'joy' in bridge.streams and (bool(operated) or not bridge.actuates),
            'actuates': bridge.actuates,
            'estop': estop,
            'link_up': state.link_up if estop != 'silent' else None,
            'operators': operated,
            'owner': owned,
            'wired': any(name in mux.listeners for mux in self._muxes.values()),
            'axes': [] if joy is None else [_number(value) for value in joy[0]],
            'buttons': [] if joy is None else joy[1],
            'joints': sorted(state.speeds.value or {}),
            'link': _shown(link, node, told),
            'device': _shown(device, node, told),
        }

    def _operated(self, topic: str, now: float) -> tuple[bool, list[str]]:
        """Return whether an operator on this topic has control, and the operators there are."""
        names, owned = [], False
        for mux in self._muxes.values():
            owner = (mux.status.value or {}).get('owner') if mux.said(now) != 'silent' else None
            mine = [name for name, heard_on in mux.operators.items() if heard_on == topic]
            names += mine
            owned |= owner in mine
        return owned, names


def _ledger(name: str, heard: Heard, now: float) -> dict[str, Any]:
    """Return what a recorder remembers, and the last stops of each joint."""
    said: Diagnostic | None = heard.fresh(now, _OLD)
    values = said.values if said else {}
    stops = {
        key.removeprefix(_STOPS_OF).removesuffix(_STOPS_UNITS): [*_points(text)]
        for key, text in values.items()
        if key.startswith(_STOPS_OF)
    }
    return {
        'name': name,
        'warning': said.message if said and said.level else '',
        'worked': values.get('last seen to work', 'not heard: is the recorder running?'),
        'stops': [{'joint': joint, 'points': points} for joint, points in stops.items() if points],
    }


def _points(text: str) -> Iterator[list[float | None]]:
    """Yield speed, time and commissioned time of each stop; None: not known."""
    for stop in text.split('; '):
        with suppress(ValueError):  # not a recorder's
            speed, *times = stop.split()
            known = [None if word == '-' else _number(float(word)) for word in times]
            if len(known) == 2:
                yield [_number(float(speed)) or 0.0, *known]


def _number(value: float) -> float | None:
    """Return what JSON can say."""
    return round(value, 3) if math.isfinite(value) else None


def _shown(diagnostic: Diagnostic | None, node: str, told: Set[tuple[str, str]]) -> dict[str, Any]:
    if diagnostic is None:
        return {'level': 3, 'message': 'no diagnostics are heard', 'values': []}
    codes = {
        (getattr(each, 'code', ''), node)
        for each in from_values(diagnostic.values)
        if severity_of(each, catalogue()) is not Severity.ECHO
    }
    return {
        'level': diagnostic.level,
        'message': '' if codes and codes <= told else diagnostic.message,
        'values': list(diagnostic.values.items()),
    }
