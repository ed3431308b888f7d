# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the phases of steps look for in what was heard of the machine. Pure; times in s."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import itertools
import math
from typing import Any

from bridge_core.reasons import causes, from_values
from rugged_teleop.commission.history import History
from rugged_teleop.commission.step import Look, Marks, Measured, Seen
from rugged_teleop.ledger.stopping import Drive, Stopped
from rugged_teleop.reasons import catalogue
from rugged_teleop.why.events import reason_of

_FULL = 0.95  # of an axis: its end
_AWAY = 0.5  # of an axis: pushed on purpose
_REST = 0.05
_HELD = 1.0  # s for which a button has to stay pressed
_RESTED = 0.5  # s for which all has to be at rest
_MOVES = 0.5  # s for which joints have to move, and to stand
_NEAR = 0.1  # of what is told, or of the way between soft ends
_BATCH = 0.3  # s; what ~/raw carries comes so late
_STEADY = 3.0  # s over which an age is watched

State = str
END_OF = 'end of '  # of a cause: a channel


def ready(operator: str = '', source: str = '') -> Look:
    """
    The mux is READY.

    :param operator: whose deadman counts then, too. :param source: of a stop that is clear then,
        too: READY says so only of those that always count.
    """

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        status = heard.last('status', {})
        rested = not operator or status.get(f"condition of operator '{operator}'") == 'rested'
        is_ready = heard.last('state') == status.get('state') == 'READY'
        clear = not source or heard.last(f'estop {source}') is False
        return Seen(True, 'ready') if is_ready and rested and clear else None

    return look


def pressed(source: str, node: str, bound: float, counts: bool = True) -> Look:
    """
    An e-stop source demands a stop, and the mux is STOPPED by it.

    :param counts: False: it belongs to an operator without control, so the mux goes on.
    """

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        said = heard.first(f'estop {source}', marks['since'], bool)
        stopped = heard.first('state', marks['since'], lambda state: state == 'STOPPED')
        ended = stopped if counts else said
        if said is None or ended is None or now < said + _BATCH:
            return None
        began, of_what = began_at(heard, marks['since'], said, node)
        what = 'STOPPED' if counts else 'its topic'
        if ended < began:
            return _too_early(heard, 'the mux was STOPPED', ended, began, of_what)
        took = Measured(f'from {of_what} to {what}', ended - began, limit=bound)
        measured = (took,) if of_what != what else ()
        return Seen(True, f'seen: {source} demands a stop', measured, {'began': began})

    return look


def _too_early(heard: History, what: str, ended: float, began: float, of_what: str) -> Seen:
    """Say that it stopped by itself, before the cause, and why."""
    said = (each for _, each in heard.since('status', ended) if each.get('state') != 'ACTIVE')
    why = reason_of(next(said, heard.last('status', {})))
    return Seen(False, f'{what} {began - ended:.2f} s before {of_what}: {why}')


def began_at(heard: History, since: float, said: float, node: str) -> tuple[float, str]:
    """Return when the stop came from the device, or it was heard last, if ~/raw is there."""
    frame = heard.on_wire('received', since, True).get(node)
    if frame is not None and frame <= said:
        return frame, "the device's frame"
    last = heard.last_frame(node, said)
    return (said, 'its topic') if last is None else (last, "the device's last frame")


def refused(heard: History, marks: Marks, now: float) -> Seen | None:
    """Tell whether the reset that was asked for was refused."""
    replies = [reply for _, reply in heard.since('reset', marks['since'])]
    if not replies or now < heard.heard_at('reset') + _RESTED:
        return None
    accepted, words = replies[-1]
    if accepted or heard.last('state') != 'STOPPED':
        return Seen(False, f'a reset was accepted while the stop is there: {words}')
    return Seen(True, 'a reset is refused')


def still(state: State, standstill: float, seconds: float = 0.6) -> Look:
    """The mux keeps this state, and nothing is enabled, told to move or seen to."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        since = marks['since']
        other = heard.first('state', since, lambda each: each != state)
        if other is not None:
            status = heard.last('status', {})
            if now < other + _BATCH:  # the status that says why may be the later one
                return None
            return Seen(False, f'the mux is {status.get("state")} by itself: {reason_of(status)}')
        if heard.first('enabled', since, bool) is not None:
            return Seen(False, 'the drive was enabled by itself')
        if heard.first('command', since, lambda each: any(each.values())) is not None:
            return Seen(False, 'motion was commanded')
        if heard.first('joints', since, lambda each: _fastest(each) > standstill) is not None:
            return Seen(False, 'a joint turned by itself')
        # What has fallen silent does not stand.
        silent = any(0.0 < heard.heard_at(each) < since for each in ('state', 'joints'))
        return Seen(True, 'nothing moves') if now - since >= seconds and not silent else None

    return look


def after(channel: str, wanted: Callable[[Any], bool], look: Look) -> Look:
    """Look until this was heard, and is so for a while: a person may take any time to do it."""

    def both(heard: History, marks: Marks, now: float) -> Seen | None:
        seen = look(heard, marks, now)
        at = heard.first(channel, marks['since'], wanted)
        is_so = at is not None and wanted(heard.last(channel)) and now >= at + _RESTED
        return seen if is_so or (seen and not seen.ok) else None

    return both


def released(source: str, standstill: float, state: State = 'STOPPED') -> Look:
    """The e-stop source is clear again, and the mux keeps its state."""
    return after(f'estop {source}', lambda value: not value, still(state, standstill))


# Operators


def at_rest(operator: str) -> Look:
    """All axes are in the middle, and no button is pressed, for a while."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        since = max(marks['since'], now - _RESTED)
        joys = [joy for _, joy in heard.since(f'joy {operator}', since)]
        if now - marks['since'] < _RESTED or not joys:
            return None
        rested = all(
            not any(buttons) and all(abs(axis) <= _REST for axis in axes) for axes, buttons in joys
        )
        return Seen(True, 'all is at rest') if rested else None

    return look


def axis_at_end(operator: str, axis: int, sign: int) -> Look:
    """An axis reaches its end, on this side."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        joys = [
            (at, axes)
            for at, (axes, _) in heard.since(f'joy {operator}', marks['since'] - _RESTED)
            if axis < len(axes)
        ]
        ways = [sign * axes[axis] for at, axes in joys if at >= marks['since']]
        if any(way >= _FULL for way in ways):
            return Seen(True, f'axis {axis} is at {sign:+d}')
        if any(way <= -_FULL for way in ways):
            return Seen(False, f'axis {axis} went to {-sign:+d}: its sign is wrong')
        held = [axes for at, axes in joys if at >= now - _RESTED]
        if held and now - marks['since'] > _RESTED and abs(held[-1][axis]) < _AWAY:
            ends = set.intersection(
                *({n for n, v in enumerate(axes) if abs(v) >= _FULL} for axes in held)
            )
            if ends:
                return Seen(False, f'axis {min(ends)} moved in the place of axis {axis}')
        return None

    return look


_ALL = slice(None)  # axes
Button = tuple[int, int]  # its place in buttons, and the least value of a pressed one


def is_pressed(joy: tuple[Sequence[float], Sequence[int]], button: Button) -> bool:
    """Tell whether a button is pressed, as the mux judges it."""
    index, least = button
    return any(value >= least for value in joy[1][index : index + 1])


def is_pushed(joy: tuple[Sequence[float], Sequence[int]], axes: slice = _ALL) -> bool:
    """Tell whether one of these axes is away from the middle."""
    return any(abs(axis) > _REST for axis in joy[0][axes])


def pressed_button(operator: str, button: Button) -> Look:
    """A button is pressed."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        at = heard.first(f'joy {operator}', marks['since'], lambda joy: is_pressed(joy, button))
        return None if at is None else Seen(True, f'button {button[0]} is pressed')

    return look


def held(operator: str, button: Button) -> Look:
    """A button stays pressed, without a gap, for a while."""
    index, _ = button

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        joys = [joy for _, joy in heard.since(f'joy {operator}', marks['since'])]
        if not joys:
            return None
        if not all(is_pressed(joy, button) for joy in joys):
            return Seen(False, f'button {index} slips: it was released while it was held')
        return Seen(True, f'button {index} holds') if now - marks['since'] >= _HELD else None

    return look


# Motion


def moving(operator: str, standstill: float) -> Look:
    """The operator has control, and a joint has moved for a while, by feedback if there is any."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        status = heard.last('status', {})
        owns = heard.last('state') == 'ACTIVE' and status.get('owner') == operator
        since = now - _MOVES
        joints = [each for _, each in heard.since('joints', since)]
        speeds = [_fastest(each) for each in joints if any(map(math.isfinite, each.values()))]
        told = [any(each.values()) for _, each in heard.since('command', since)]
        moves = min(speeds) > standstill if speeds else told and all(told)
        if not owns or not moves or now - marks['since'] <= _MOVES:
            return None
        return Seen(
            True, f'it moves, at {speeds[-1]:.2f} rad/s' if speeds else 'it is told to move'
        )

    return look


def in_control(operator: str) -> Look:
    """The operator has control."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        owner = heard.last('status', {}).get('owner')
        has = heard.last('state') == 'ACTIVE' and owner == operator
        return Seen(True, f'{operator} has control') if has else None

    return look


def held_still(operator: str, axis: int, *, at_once: bool) -> Look:
    """
    The operator has control and a pushed stick, and nothing is told to move for a while.

    :param at_once: False: a ramp may come before.
    """

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        owner = heard.last('status', {}).get('owner')
        moves = heard.first('command', marks['since'], lambda each: any(each.values()))
        if at_once and moves is not None:
            return Seen(False, 'motion was commanded without the button')
        told = [any(each.values()) for _, each in heard.since('command', now - _MOVES)]
        is_so = heard.last('state') == 'ACTIVE' and owner == operator and told and not any(told)
        pushed = _stays_pushed(heard, operator, slice(axis, axis + 1), now)
        return Seen(True, 'nothing is told to move') if pushed and is_so else None

    return look


def _stays_pushed(heard: History, operator: str, axes: slice, now: float) -> bool:
    """Tell whether a stick has been pushed for a while."""
    joys = [joy for _, joy in heard.since(f'joy {operator}', now - _MOVES)]
    return bool(joys) and all(is_pushed(joy, axes) for joy in joys)


def scaled(ratio: float) -> Look:
    """What is commanded has become so many times as fast."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        before = _fastest(heard.before('command', marks['since']) or {})
        since = max(marks['since'], now - _MOVES)
        told = [_fastest(each) for _, each in heard.since('command', since)]
        if not before or not told or now - marks['since'] < _MOVES:
            return None
        near = all(abs(each - ratio * before) <= _NEAR * ratio * before for each in told)
        words = f'{told[-1]:.2f} rad/s in the place of {before:.2f}'
        return Seen(True, words) if near else None

    return look


def at_soft_end(operator: str, joint: str, least: float, most: float) -> Look:
    """
    A joint stands at a soft end, of two looks the other one, though a stick is pushed.

    It must not be beyond one.
    """

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        since = max(marks['since'], now - _MOVES)
        places = [each[joint] for _, each in heard.since('positions', since) if joint in each]
        if not places or now - marks['since'] < _MOVES:
            return None
        near = _NEAR * (most - least)
        if not least - near <= places[-1] <= most + near:
            return Seen(False, f'{joint} is at {places[-1]:.3g} rad, beyond its soft end')
        ends = [end for end in (least, most) if abs(places[-1] - end) <= near]
        stands = max(places) - min(places) <= _NEAR * near
        told = heard.last('state') == 'ACTIVE' and _stays_pushed(heard, operator, _ALL, now)
        same = any(abs(marks.get('place', math.inf) - end) <= near for end in ends)
        if not ends or same or not stands or not told:
            return None
        ways = {'from': marks.get('place', places[-1]), 'place': places[-1]}
        return Seen(True, f'{joint} stands at {places[-1]:.3g} rad', (), ways)

    return look


def _fastest(joints: dict[str, float]) -> float:
    return max((abs(speed) for speed in joints.values() if math.isfinite(speed)), default=0.0)


def disabled(
    cause: str,
    node: str,
    bound: float,
    state: State = 'STOPPED',
    pushed: Button = (0, 1),
    remote: str = '',
) -> Look:
    """
    The drive is disabled, and the mux has the state that belongs to the cause.

    :param cause: 'estop NAME'; 'joy NAME', whose button ``pushed`` is released; 'end of CHANNEL';
        or empty: what was done.
    :param remote: the operator whose remote stops, if it is one: its sticks may rest before it
        says so, and then that is the cause.
    """

    def let_go(heard: History, joy: str, since: float) -> float | None:
        return heard.first(joy, since, lambda each: not is_pressed(each, pushed))

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        since = marks['since']
        off = heard.first('enabled', since, lambda value: not value)
        if off is None or now < off + _BATCH:
            return None
        if state and heard.first('state', since, lambda each: each == state) is None:
            return None
        sent = heard.on_wire('sent', since, False)
        drives = [each for each in heard.channels('enabled') if each] or [*sent]
        packet = max((sent.get(each, off) for each in drives), default=off)
        ended = min(packet, off)
        began, of_what = since, 'what was done'
        if cause.startswith('estop '):
            said = heard.first(cause, since, bool)
            if said is None:
                return None
            began, of_what = began_at(heard, since, said, node)
            rested = let_go(heard, f'joy {remote}', since)
            if rested is not None and rested < began:
                began, of_what = rested, 'its sticks at rest'
        elif cause.startswith('joy '):
            rested = let_go(heard, cause, since)
            if rested is None:
                return None
            began, of_what = rested, 'its message'
        elif cause.startswith(END_OF):
            channel = cause.removeprefix(END_OF)
            if heard.heard_at(channel) > ended:  # it goes on: something else has disabled it
                return None
            began, of_what = last_before(heard, channel, ended, since), f'the last {channel}'
        if ended < began:
            return _too_early(heard, 'the drive was disabled', ended, began, of_what)
        to_what = 'the first disable packet' if packet < off else 'disabled'
        took = Measured(f'from {of_what} to {to_what}', ended - began, limit=bound)
        return Seen(True, 'disabled', (took,), {'began': began, 'disabled': ended})

    return look


def last_before(heard: History, channel: str, at: float, otherwise: float) -> float:
    """Return when a channel was heard last up to then, within a second of the other moment."""
    return max(
        (when for when, _ in heard.since(channel, otherwise - 1.0) if when <= at),
        default=otherwise,
    )


def stands(standstill: float, time: float | None, angle: float | None) -> Look:
    """
    The joints stand; measured from the cause on.

    :param time: s that it may take. :param angle: rad that a joint may turn meanwhile.
    """

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        samples = [*heard.since('joints', marks['began'])]
        before = heard.before('joints', marks['began']) or (samples[0][1] if samples else {})
        known = [name for name, speed in before.items() if math.isfinite(speed)]
        courses = [[(at, each[name]) for at, each in samples if name in each] for name in known]
        # What is not measured any more does not stand.
        moved = [at for each in courses for at, speed in each if not abs(speed) <= standstill]
        last = max(moved, default=marks['began'])
        if not known or not all(each and each[-1][0] >= last + _MOVES for each in courses):
            return None
        measured = [Measured('from the cause to standstill', last - marks['began'], limit=time)]
        for name in known:
            far = sum(_areas(name, [(marks['began'], before), *samples]))
            measured.append(Measured(f'{name} turned meanwhile', far, 'rad', angle))
        stopping = {
            each.joint: {'speed': each.speed, 'time': each.time, 'angle': each.angle}
            for each in _stopped(heard, marks['began'])
            if each.time
        }
        return Seen(True, 'it stands', tuple(measured), {'stands': last}, stopping)

    return look


def _stopped(heard: History, began: float) -> Iterator[Stopped]:
    """Yield how joints stood after a stop of the mux, as the recorder measures it in use."""
    stopped = heard.first('state', began, lambda state: state in ('STOPPING', 'STOPPED'))
    # A remote that is stopped may let go of its deadman a moment before it says so.
    since = began - _MOVES
    stop = heard.first('state', since, lambda state: state != 'ACTIVE')
    if stopped is None or stop is None or heard.before('state', since) != 'ACTIVE':
        return
    drive = Drive()
    for at, joints in heard.since('joints', since):
        if at > stop:
            drive.stop(stop)
        yield from drive.hear_joints([*joints], [*joints.values()], [], at)
        if at > stop and not drive.is_stopping:
            return


def _areas(name: str, samples: Sequence[tuple[float, dict[str, float]]]) -> Iterator[float]:
    for (at, joints), (later, following) in itertools.pairwise(samples):
        speeds = abs(joints.get(name, 0.0)), abs(following.get(name, 0.0))
        yield (later - at) * sum(speeds) / 2.0


def turned(heard: History, joint: str, since: float) -> float:
    """Return how far a joint turned since then, by its feedback, forward positive; rad."""
    samples: list[tuple[float, float]] = [
        (at, each[joint]) for at, each in heard.since('joints', since) if joint in each
    ]
    return sum((b - a) * (v + w) / 2.0 for (a, v), (b, w) in itertools.pairwise(samples))


def passed(seconds: float, channel: str = '') -> Look:
    """Some time has passed, in which a channel was silent."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        began = max(marks['since'], heard.heard_at(channel))
        return Seen(True, '') if now - began >= seconds else None

    return look


def fresh_on_the_way(key: str, limit: float) -> Look:
    """
    What the mux proves of the age of all that is decided on stays below its limits.

    :param key: of the sum in its status. :param limit: of that.
    """

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        status = heard.last('status', {})
        states = {heard.last('state'), status.get('state')}
        if states == {'STOPPED'}:
            return Seen(False, f'the mux is STOPPED: {reason_of(status)}')
        if 'STOPPED' in states:  # what says why is on its way
            return None
        if now - marks['since'] < _STEADY:
            return None
        said = [each for _, each in heard.since('status', marks['since'])]
        ages = {name: (name.removesuffix(' (s)'), limit) for name in (key,)} | _of_links(said)
        measured = []
        for name, (what, most) in ages.items():
            values = [each.get(name, 'unknown') for each in said]
            if not values or 'unknown' in values:
                return Seen(False, f'{name} is unknown: proofs are off, or do not come')
            measured.append(Measured(what, max(map(float, values)), limit=most))
        for node in heard.channels('proof'):
            numbers = [number for _, number in heard.since(f'proof {node}', marks['since'])]
            gaps = (b - a - 1 for a, b in itertools.pairwise(numbers))
            measured.append(
                Measured(f'proofs of {node} lost', sum(gaps), f'of {len(numbers)} or more')
            )
        return Seen(True, 'words are fresh', tuple(measured))

    return look


def _of_links(said: Sequence[Mapping[str, str]]) -> dict[str, tuple[str, float]]:
    """Return keys of proven ages: of what, and its limit."""
    last = said[-1] if said else {}
    found = {}
    for key, limit in last.items():
        what = key.removeprefix('age limit of ').removesuffix(' (s)')
        if key.startswith('age limit of '):
            found[f'proven age of {what} (s)'] = f'age of {what}', float(limit)
    return found


def says(node: str, keys: Sequence[str], when: str = '') -> Look:
    """
    Keep what a device says of itself. :param keys: of its diagnostics.

    :param when: words before each key, where it is said while something is so.
    """

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        said = [*heard.since(f'device {node}', marks['since'] + _RESTED)]
        if not said:
            return None
        told = {key: said[-1][1].get(key, 'not told') for key in keys}
        if any(each.startswith('not ') for each in told.values()) and now < said[0][0] + _STEADY:
            return None
        facts = {f'{when}{key}': value for key, value in told.items()}
        return Seen(True, ', '.join(f'{key} {value}' for key, value in told.items()), facts=facts)

    return look


def instead(heard: History, since: float) -> str:
    """Say what changed since then in the place of what was expected."""
    found = []
    for source in heard.channels('estop'):
        if heard.last(f'estop {source}'):
            found.append(f'{source} demands a stop')
    for operator in heard.channels('joy'):
        joys = [joy for _, joy in heard.since(f'joy {operator}', since)]
        if not joys:
            found.append(f'{operator} sends no sticks')
            continue
        axes = [max(column, key=abs) for column in zip(*(joy[0] for joy in joys), strict=False)]
        found += [
            f"{operator}'s axis {n} was at {v:.2f}" for n, v in enumerate(axes) if abs(v) > _REST
        ]
        pushed = [n for n, value in enumerate(joys[-1][1]) if value]
        found += [f"{operator}'s button {n} is pressed" for n in pushed]
    state = heard.last('state', 'not heard')
    status = heard.last('status', {})
    inhibits = [each for key, each in status.items() if key.startswith('inhibit ')]
    why = causes(from_values(status, inhibits)[: len(inhibits)], catalogue())
    state += f': {why[0]}' if why and state in ('STOPPED', 'READY') else ''
    return f'{", ".join(found) or "nothing changed"}; the mux is {state}'
