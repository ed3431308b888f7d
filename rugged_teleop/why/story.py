# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The story of each stop in a recording: who asked, what came of it, whether the drive obeyed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bridge_core.parameters import full_topic
from bridge_core.reasons import advice, cause_of, causes, Coded, from_values, Severity, severity_of
from rugged_teleop.command_line import moment as time_in_words, time_of_day
from rugged_teleop.reasons import catalogue
from rugged_teleop.recordings import Said
from rugged_teleop.why.events import (
    Event,
    Events,
    fields_of,
    FRESH,
    Heard,
    reason_of,
    Roles,
    STANDSTILL,
    wire_events,
)

_BEFORE, _AFTER = 3.0, 10.0  # s of a story
_TOGETHER = 1.0  # s within which two ends of motion are one
_OBEYS_WITHIN = 1.0  # s from a stop on, as the drive's enable_timeout by default
_SLOW = 0.05  # s by which what was said at once may be heard in another order
# What is said of a drive that goes on, and of one that does not, by the event.
_OBEDIENCE = {
    'enabled': ('is enabled', 'was disabled'),
    'joints': ('moves', 'stood'),
    'wire': ('tells its drive to enable', 'told its drive to disable'),
}
_TOPICS = {'enabled': 'enabled', 'joints': 'joint_states', 'wire': 'raw/sent'}
_POINTS_ELSEWHERE = 'see /diagnostics of its node'  # in the words of a mux
_REASON = 'stop: '  # begins a line of a node's log


@dataclass(frozen=True)
class _Mux:
    """
    What one mux said of itself.

    :param statuses: times and fields.
    :param heard: what of all nodes was heard when. :param sources: node by name of e-stop source.
    """

    name: str
    statuses: Sequence[tuple[float, dict[str, str]]]
    heard: Heard
    sources: Mapping[str, str]


def story(
    said: Iterable[Said], parameters: Mapping[str, Mapping[str, Any]] | None = None
) -> list[str]:
    """
    Return the stories of all stops and of all other ends of control, in lines.

    :param said: the messages of a recording, in any order.
    :param parameters: of its nodes.
    """
    messages = sorted(said, key=lambda each: each.at)
    roles = Roles.of(each.topic for each in messages)
    if not roles.muxes:
        return ['no safety mux is in this recording']
    known = {name: (parameters or {}).get(name, {}) for name in roles.muxes}
    standstill = max(map(_standstill, known.values()))
    maker = Events(roles, standstill)
    events = [event for each in messages for event in maker.of(each)]
    heard = Heard(messages, events)
    events = [*map(heard.qualified, events), *wire_events(messages)]
    events.sort(key=lambda event: event.at)
    lines: list[str] = []
    for name in sorted(roles.muxes):
        statuses = [
            (each.at, fields)
            for each in messages
            if each.topic == f'{name}/status' and (fields := fields_of(each.message))
        ]
        mux = _Mux(name, statuses, heard, _sources(name, known[name]))
        lines += _of_mux(mux, events, messages[-1].at)
    return lines


def _standstill(values: Mapping[str, Any]) -> float:
    value = values.get('feedback.standstill')
    return float(value) if isinstance(value, int | float) else STANDSTILL


def _sources(mux: str, values: Mapping[str, Any]) -> dict[str, str]:
    """Return the nodes of the e-stop sources, by the parameters of a mux."""
    found = {}
    for parameter, topic in values.items():
        kind, _, rest = parameter.partition('.')
        name, _, last = rest.rpartition('.')
        if kind == 'estop' and last == 'topic' and isinstance(topic, str):
            found[name] = full_topic(mux, topic).rpartition('/')[0]
    return found


def _of_mux(mux: _Mux, events: Sequence[Event], end: float) -> Iterator[str]:
    moments = _ends_of_motion(mux.name, events)
    enables = [event.value for event in events if event.what == f'enable {mux.name}']
    if enables[-1:] == [True] and not mux.heard.is_fresh(f'{mux.name}/enable', end):
        moments.append(mux.heard.last(f'{mux.name}/enable', end) or end)  # it has died, say
    if not moments:
        yield f'{mux.name} stopped nothing in this recording'
        for values in _last(mux, end):
            yield f'  it is {values.get("state")}: {reason_of(values)}'
    for number, moment in enumerate(moments):
        before = moments[number - 1] if number else 0.0
        since = max(moment - _BEFORE, min(before + _TOGETHER, moment - _SLOW))
        until = min(moment + _AFTER, moments[number + 1] if number + 1 < len(moments) else end)
        if number:
            yield ''
        yield from _of_stop(mux, moment, [e for e in events if e.at <= until], since, until)


def _ends_of_motion(mux: str, events: Iterable[Event]) -> list[float]:
    """Return when the mux stopped the machine, or control ended; together what was together."""
    ends: list[float] = []
    again = True  # it has enabled the drives since
    for event in events:
        again |= (event.what, event.value) == (f'enable {mux}', True)
        stop = (event.what, event.value) in ((f'estop {mux}', True), (f'enable {mux}', False))
        if stop and event.text and (again or event.at > ends[-1] + _TOGETHER):
            ends.append(event.at)
            again = False
    return ends


def _last(mux: _Mux, moment: float) -> list[dict[str, str]]:
    """Return the newest fields up to a moment; empty if there are none."""
    return [values for at, values in mux.statuses if at <= moment][-1:]


def _of_stop(
    mux: _Mux, moment: float, events: Sequence[Event], since: float, until: float
) -> Iterator[str]:
    """Tell one stop. :param events: until then. :param since: what is older is not told."""
    told = [event for event in events if event.at >= since and event.text]
    changes = [event for event in told if event.what == f'state {mux.name}']
    caused = [event for event in changes if -_SLOW <= event.at - moment <= _TOGETHER]
    texts = [_with_cause(mux, event.text, moment, told) for event in caused]
    silent = mux.heard.last(f'{mux.name}/enable', until) == moment
    unsaid = f'{mux.name} {"is not heard any more" if silent else "stopped"}'
    yield f'{time_in_words(moment)}: {texts[0] if texts else unsaid}'
    later = [(at, values) for at, values in mux.statuses if moment - _SLOW <= at <= until]
    yield from _cause(values for at, values in later if at <= moment + _TOGETHER)
    for text in texts[1:]:
        yield f'  then {text}'
    for values in _last(mux, (caused[0].at if caused else moment) - 1e-6):
        owner = values.get('owner', 'none')
        control = 'nobody had control' if owner == 'none' else f"'{owner}' had control"
        yield f'  before it: {values.get("state")}, {control}'
    for values in [each for _, each in later if each.get('stopped by', 'none') != 'none'][:1]:
        yield f'  who asked: {values["stopped by"]}'
    for values in [each for at, each in later if not caused or at >= caused[0].at][:1]:
        yield f'  heard last: {_heard_last(values)}'
    for event in told:
        yield f'  {round((event.at - moment) * 1e3):+8} ms  {event.text}'
    for what in sorted({event.what for event in events}):
        about = [event for event in events if event.what == what]
        yield from _obeyed(mux.heard, what, moment, about, until)


def _cause(statuses: Iterable[Mapping[str, str]]) -> Iterator[str]:
    """Say what the mux named first as it stopped, in the words of the catalogue."""
    firsts = [each for v in statuses for each in causes(from_values(v), catalogue())[:1]]
    stops = [each for each in firsts if severity_of(each, catalogue()) is Severity.STOP]
    named = [each for each in stops if isinstance(each, Coded) and each.code in catalogue()]
    # A device says why a second later at most; the mux alone knows that it did.
    for reason in sorted(named, key=lambda each: each.code == 'mux.source.stop')[:1]:
        cause, steps = cause_of(reason, catalogue()), advice(reason, catalogue())
        yield f'  cause: {cause} [{reason.code}]: {steps}'


def _with_cause(mux: _Mux, text: str, moment: float, told: Sequence[Event]) -> str:
    """Return a text with what the node has said of its stop, in place of where to look."""
    if _POINTS_ELSEWHERE not in text:
        return text
    near = [event for event in told if abs(event.at - moment) <= _TOGETHER]
    stopped = [e.what.partition(' ')[2] for e in near if e.what.startswith('estop ') and e.value]
    named = [node for name, node in mux.sources.items() if f"'{name}'" in text]
    for node in named or [each for each in stopped if each != mux.name]:
        for event in near:
            if event.what == f'log {node}' and event.value.startswith(_REASON):
                return text.replace(_POINTS_ELSEWHERE, event.value.removeprefix(_REASON))
    return text


def _heard_last(values: Mapping[str, str]) -> str:
    """Return what the mux says of its inputs: how long ago, and what, at that moment."""
    ages = []
    for key, age in values.items():
        if key.startswith('age of '):
            name = key.removeprefix('age of ').removesuffix(' (s)')
            condition = values.get(f'condition of {name}', 'nothing said')
            proven = values.get(f'proven age of {name} (s)')
            old = f', up to {_age(proven)} old' if proven else ''
            ages.append(f'{name} {_age(age)} before ({condition}{old})')
    return ', '.join(ages) or 'nothing'


def _age(text: str) -> str:
    try:
        return f'{float(text) * 1e3:.0f} ms'
    except ValueError:  # never heard
        return text


def _obeyed(
    heard: Heard, what: str, moment: float, events: Sequence[Event], until: float
) -> Iterator[str]:
    """Say of a drive whether it was disabled, and of its joints whether they stood."""
    kind, _, node = what.partition(' ')
    if kind not in _OBEDIENCE:
        return
    on, off = _OBEDIENCE[kind]
    before = [event for event in events if event.at < moment]
    after = [event for event in events if event.at >= moment]
    ended = next((event for event in after if not event.value), None)
    told = ended or (before[-1] if before else None)
    if told is None:
        return
    if unknown := _unknown(heard, told, moment, until):
        yield f'  {node}: whether it {off} is not known: {unknown}'
    elif ended is not None:
        yield f'  {node} {off} {(ended.at - moment) * 1e3:.0f} ms after the stop'
        for event in [each for each in after if each.value and each.at > ended.at][:1]:
            yield f'  {node} {on} again {(event.at - moment):.1f} s after the stop'
    elif not told.value:
        yield f'  {node} {off} before the stop'
    elif until - moment < _OBEYS_WITHIN:
        ms = (until - moment) * 1e3
        yield f'  {node} {on} {ms:.0f} ms after the stop, where the recording ends'
    else:
        yield f'  {node} DID NOT OBEY: it {on} {until - moment:.1f} s after the stop'


def _unknown(heard: Heard, told: Event, moment: float, until: float) -> str:
    """Say since when nobody knows whether this is so; empty: it is known."""
    kind, _, node = told.what.partition(' ')
    topic, at = f'{node}/{_TOPICS[kind]}', until if told.value else moment
    if told.value:
        known = heard.is_fresh(topic, at)
    elif kind == 'enabled':  # which it says of a silent drive, too
        topic, at = f'{node}/{_TOPICS["joints"]}', max(told.at, moment - FRESH)
        known = heard.drive(node, at)
    else:
        known = told.at >= moment or heard.is_fresh(topic, moment)
    last = heard.last(topic, at)
    if known:
        return ''
    return 'never heard' if last is None else f'not heard since {time_of_day(last)}'
