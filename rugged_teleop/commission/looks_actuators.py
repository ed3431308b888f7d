# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What steps look for of actuators and processes; looks.py says how. Pure; times in s."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
import math
from typing import Any

from rugged_teleop.commission import looks
from rugged_teleop.commission.history import History
from rugged_teleop.commission.machine import Node
from rugged_teleop.commission.step import Fact, Look, Marks, Measured, Seen
from rugged_teleop.decode.protocols import recording_entries
from rugged_teleop.decode.recorded import pieces_of
from rugged_teleop.devices import protocols
from rugged_teleop.recordings import Said

TOLD_TO_STOP = 'e-stop input is true'  # in the diagnostics of every actuator
_BATCH = 0.3  # s; what ~/raw carries comes so late
_KNOWN = 0.8  # s for which a node doubts a new commander
_STANDS = 0.6  # s for which a place has to stay
_STILL = 0.01  # of a place, in rad or of a servo's way
_MOVED = 0.02
_TURNS = 1.0  # s after which it goes the way that it is told
_AGAIN = 2.0  # s in which a drive would start again
_PATIENCE = 2.0  # s beyond its bound after which what moves goes on

Places = Mapping[str, float]


def told_to_stop(node: str) -> Look:
    """An actuator's node says that it is told to stop."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        said = [each for _, each in heard.since(f'device {node}', marks['since'])]
        if any(TOLD_TO_STOP in text for each in said for text in each.values()):
            return Seen(True, 'every actuator hears a stop of the mux')
        return None

    return look


def obeys(node: Node) -> Look:
    """It is commanded for a while, and its node says that it obeys."""
    key, words = node.hands.obeys

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        told = heard.first(f'told {node.full}', marks['since'], lambda _: True)
        if told is None or now < told + _KNOWN:
            return None
        said = [each.get(key) for _, each in heard.since(f'device {node.full}', told)]
        return Seen(True, '') if said[-1:] == [words] else None

    return look


def _unless_stopped(look: Look) -> Look:
    """Look, for as long as the mux does not stop."""
    going = looks.still('READY', math.inf, math.inf)

    def either(heard: History, marks: Marks, now: float) -> Seen | None:
        return going(heard, marks, now) or look(heard, marks, now)

    return either


def moves(node: str) -> Look:
    """All joints of a node have moved since then."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        before, last = _around(heard, node, marks['since'])
        moved = {name: abs(last[name] - _known(before.get(name, 0.0))) for name in last}
        return Seen(True, '') if moved and min(moved.values()) >= _MOVED else None

    return _unless_stopped(look)


def goes_on(node: str) -> Look:
    """A joint moves, some time after commands have ended."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        samples = [each for _, each in heard.since(f'places {node}', now - _STANDS / 2.0)]
        columns = zip(*(each.values() for each in samples), strict=True)
        moving = any(max(each) - min(each) > _STILL for each in columns)
        return Seen(True, '') if moving and now >= marks['since'] + _STANDS else None

    return look


def at_end(node: str, joint: str, sign: int, most: float) -> Look:
    """A joint goes to its end on this side, and stands there. :param most: how far it may go."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        before, last = _around(heard, node, marks['since'])
        way = sign * (last.get(joint, math.nan) - _known(before.get(joint, 0.0)))
        if way <= -_MOVED and now >= marks['since'] + _TURNS:
            return Seen(False, f'{joint} goes the wrong way: it was told to go to {sign:+d}')
        if not way >= _MOVED or not _stand(heard, node, [joint], marks['since'], now):
            return None
        if abs(last[joint]) > most:
            return Seen(False, f'{joint} is at {last[joint]:.2f}, beyond its limits')
        place: Fact = round(last[joint], 3)
        facts = {f'{node}: {joint} ends, told {sign:+d}': place}
        going = [
            (at, each[joint])
            for at, each in heard.since(f'places {node}', marks['since'])
            if abs(each[joint] - before.get(joint, math.nan)) > _MOVED
            and abs(each[joint] - last[joint]) > _MOVED
        ]
        if most == math.inf and len(going) > 2:  # it moves by itself, at full push
            speed = abs(going[-1][1] - going[0][1]) / (going[-1][0] - going[0][0])
            facts[f'{node}: {joint} at full push (rad/s)'] = round(speed, 3)
        return Seen(True, f'{joint} has ends', facts=facts)

    return _unless_stopped(look)


def rests(node: Node, cause: str, bound: float, whose: str = '') -> Look:
    """
    Its node tells an actuator to rest.

    :param cause: 'estop NAME', 'end of CHANNEL', or empty: its last packet that does not.
    :param whose: the node of that e-stop.
    """
    wire = _Wire(node)

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        since = marks['since']
        found, to_what = wire.rest(heard, since, now), 'the first packet at rest'
        if found is None and not heard.heard_at('raw') >= since:  # without publish_raw
            if not node.hands.idle(node.values):
                return Seen(True, '', (), {'began': since}) if now >= since + bound else None
            found, to_what = _rest_by_topic(heard, node, since), 'the place where it rests'
        if found is None or now < found[1] + _BATCH:
            return None
        began, ended = found
        of_what = 'the last packet in motion'
        if cause.startswith('estop '):
            said = heard.first(cause, since, bool)
            if said is None:
                return None
            began, of_what = looks.began_at(heard, since, said, whose)
        elif cause:
            channel = cause.removeprefix(looks.END_OF)
            began, of_what = looks.last_before(heard, channel, ended, since), f'the last {channel}'
        took = Measured(f'from {of_what} to {to_what}', ended - began, limit=bound)
        return Seen(True, 'it is told to rest', (took,), {'began': began, 'rested': ended})

    return look


class _Wire:
    """What a node's ~/raw says; it is read now and then, for it takes time."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._since, self._next = 0.0, 0.0
        self._found: tuple[float, float] | None = None

    def rest(self, heard: History, since: float, now: float) -> tuple[float, float] | None:
        """Return when the last packet in motion went out, and the first at rest behind it."""
        if since != self._since:
            self._since, self._next, self._found = since, 0.0, None
        if self._found is None and now >= self._next:
            self._next = now + _BATCH
            self._found = self._read(heard, since)
        return self._found

    def _read(self, heard: History, since: float) -> tuple[float, float] | None:
        topic, moved = f'{self._node.full}/raw/sent', None
        said = [each for _, each in heard.since('raw', since - 1.0) if each.topic == topic]
        for at, at_rest in _packets(said, self._node.values):
            if not at_rest:
                moved = at - heard.epoch
            elif moved is not None and at - heard.epoch >= since:
                return moved, at - heard.epoch
        return None


def _packets(said: list[Said], values: Mapping[str, Any]) -> Iterator[tuple[float, bool]]:
    judges = _judges()
    for entry in recording_entries((piece for each in said for piece in pieces_of(each)), ''):
        judge = judges.get(entry.protocol)
        at_rest = judge(values, entry.content) if judge else None
        if at_rest is not None and entry.at is not None:
            yield entry.at, at_rest


@cache
def _judges() -> dict[str, Any]:
    return {each.name: each.rests for _, each in protocols() if hasattr(each, 'rests')}


def _rest_by_topic(heard: History, node: Node, since: float) -> tuple[float, float] | None:
    idle = node.hands.idle(node.values)
    for at, places in heard.since(f'places {node.full}', since):
        if all(_alike(places[name], place) for name, place in idle.items()) and idle:
            return since, at
    return None


def stands(node: Node, coast: float) -> Look:
    """
    The joints of an actuator go where they belong without commands, and stand there.

    :param coast: s that it may take.
    """
    idle = node.hands.idle(node.values)

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        began = marks['began']
        rested = max(began, marks.get('rested', 0.0))
        _, last = _around(heard, node.full, began)
        move = [each for each in last if not _stand(heard, node.full, [each], rested, now)]
        away = [name for name, place in idle.items() if not _alike(last[name], place)]
        if not move and not away:
            return _stopped(heard, node, began, rested, idle)
        if now < rested + coast + _STANDS + _PATIENCE:
            return None
        if move:
            return Seen(False, f'{" and ".join(move)} of {node.full} goes on moving')
        where = ' and '.join(f'{name} stays at {last[name]:.2f}' for name in away)
        facts = {_limp(node, name): False for name in away if math.isnan(idle[name])}
        words = f'{where} without commands: it does not go to its failsafe'
        return Seen(False, words, facts=facts)

    return look


def ended(node: Node, coast: float, what: str) -> Look:
    """Motion by itself has ended by a stop; whether it has is a fact."""
    stand = stands(node, coast)

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        seen = stand(heard, marks, now)
        fact = f'{node.full}: a stop ends its {what}'
        return seen and replace(seen, facts={**seen.facts, fact: seen.ok})

    return look


def _limp(node: Node, name: str) -> str:
    return f'{node.full}: {name} is limp without a pulse'


def _stopped(heard: History, node: Node, began: float, rested: float, idle: Places) -> Seen:
    samples = [*heard.since(f'places {node.full}', began)]
    facts: dict[str, Fact] = {}
    stopping, measured = {}, []
    before, last = _around(heard, node.full, began)
    told, _ = _around(heard, node.full, rested)
    for name in last:
        if name in idle:
            facts[_limp(node, name)] = math.isnan(last[name])
            continue
        if math.isnan(last[name]):
            continue
        moved = [at for at, each in samples if abs(each[name] - last[name]) > _STILL]
        took = max(moved, default=began) - began
        far = abs(last[name] - before.get(name, last[name]))
        speed = _speed(heard, node.full, name, began)
        stopping[name] = {'speed': speed, 'time': took, 'angle': far}
        if rested > began:
            coasts = abs(last[name] - told.get(name, last[name]))
            facts[f'{node.full}: {name} coasts, told to rest (rad)'] = round(coasts, 3)
        measured.append(Measured(f'{name} coasts', far, 'rad'))
    return Seen(True, 'it stands', tuple(measured), {}, stopping, facts)


def _speed(heard: History, node: str, name: str, at: float) -> float:
    samples = [
        (when, each[name]) for when, each in heard.since(f'places {node}', at - 0.5) if when <= at
    ]
    if not samples or samples[0][0] == samples[-1][0]:  # late ones come at one moment
        return 0.0
    (first, place), (last, end) = samples[0], samples[-1]
    return float(abs(end - place) / (last - first))


# Processes


def lost(channel: str, bound: float) -> Look:
    """Who was killed or frozen is missed: the mux is STOPPED, so long after its last word."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        stopped = heard.first('state', marks['since'], lambda state: state == 'STOPPED')
        if stopped is None or now < stopped + _BATCH or heard.heard_at(channel) > stopped:
            return None  # who goes on is not missed: something else has stopped it
        began = looks.last_before(heard, channel, stopped, marks['since'])
        took = Measured(f'from the last {channel} to STOPPED', stopped - began, limit=bound)
        return Seen(True, 'it is missed', (took,), {'began': began})

    return look


def replaced(node: str, bound: float) -> Look:
    """A drive's wire was killed; the next one disables the drive."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        packet = heard.on_wire('sent', marks['since'], False).get(node)
        off = heard.first(f'enabled {node}', marks['since'], lambda value: not value)
        if off is None or now < off + _BATCH or not _changed(heard, node, 'wire process', marks):
            return None
        ended = packet or off
        began = looks.last_before(heard, 'joints', ended, marks['since'])
        took = Measured('from its last report to the next disable', ended - began, limit=bound)
        return Seen(True, 'the next wire disables', (took,), {'began': began})

    return look


def _changed(heard: History, node: str, key: str, marks: Marks) -> bool:
    """Tell whether the diagnostics of a node have another value by now."""
    channel = f'device {node}'
    before = heard.before(channel, marks['since']) or {}
    return bool(heard.last(channel, before).get(key) != before.get(key))


# The drive's cable


def pulled(source: str, node: str, bound: float) -> Look:
    """Its cable was pulled; its speed at that moment is marked."""
    pressed = looks.pressed(source, node, bound)

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        seen = pressed(heard, marks, now)
        if seen is None:
            return None
        speeds = heard.before('joints', marks['since']) or {}
        speed = max((abs(each) for each in speeds.values() if math.isfinite(each)), default=0.0)
        return Seen(seen.ok, seen.text, seen.measured, {**seen.marks, 'speed': speed})

    return look


def stays_off(source: str, node: str, standstill: float) -> Look:
    """The cable is back, and nothing starts by itself."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        since = marks['since']
        starts = heard.first('enabled', since, bool) is not None or any(
            abs(speed) > standstill
            for _, each in heard.since('joints', since)
            for speed in each.values()
        )
        if starts:
            return Seen(
                False,
                'the drive starts again by itself',
                facts={f'{node}: starts again by itself': True},
            )
        if not _changed(heard, node, 'frames', marks):
            return None  # the joints may be heard of somebody else
        back = heard.first('joints', since, lambda _: True)
        if back is None or now < back + _AGAIN:
            return None
        facts = {
            f'{node}: starts again by itself': False,
            f'{node}: keeps its error until it is cleared': bool(heard.last(f'estop {source}')),
        }
        return Seen(True, 'nothing starts by itself', facts=facts)

    return look


# Places


def _around(heard: History, node: str, since: float) -> tuple[Places, Places]:
    """Return where the joints were then, and where they are."""
    channel = f'places {node}'
    return heard.before(channel, since) or {}, heard.last(channel, {})


def _known(place: float) -> float:
    return 0.0 if math.isnan(place) else place


def _alike(place: float, other: float) -> bool:
    return abs(place - other) <= _MOVED or (math.isnan(place) and math.isnan(other))


def _stand(heard: History, node: str, joints: list[str], since: float, now: float) -> bool:
    """Tell whether these joints stood for a while."""
    channel, start = f'places {node}', max(since, now - _STANDS)
    samples = [each for _, each in heard.since(channel, start)]
    if now < since + _STANDS or len(samples) < 2:
        return False
    samples.insert(0, heard.before(channel, start) or samples[0])  # it may be heard with gaps
    columns = ([each[joint] for each in samples] for joint in joints)
    return all(
        all(map(math.isnan, values)) or max(values) - min(values) <= _STILL for values in columns
    )
