# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The arbiter's state in words: everything that keeps the machine from moving, and what to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge_core.reasons import Coded, passed_on
from bridge_core.watchdog import in_words
from safety_mux.protocol import State, Status, Stop

if TYPE_CHECKING:
    from safety_mux.arbiter import Arbiter
    from safety_mux.owners import AutonomyInput, OperatorInput, OwnerInput

_RESET = Coded('mux.reset.due', 'waiting for reset: call ~/reset')
_TRIP = Coded(
    'mux.trip.active', 'a trip is active until ~/end_trip is called, or a reset succeeds'
)


def status_of(mux: Arbiter, now: float) -> Status:
    """Return the full answer to "why does it not move?"."""
    drives = mux.drives.values()
    enabled = all(each.condition(now) == 'enabled' for each in drives) if drives else None
    return Status(
        state=mux.state,
        owner=None if mux.owner is None else mux.owner.name,
        inhibits=tuple(_inhibits(mux, now)),
        ages={each.label: each.watchdog.age(now) for each in mux.inputs},
        conditions={each.label: each.condition(now) for each in mux.inputs},
        stops_clear=not mux.stops_at(now) and not mux.still_clearing(now),
        operators_at_rest=not mux.unrest(now),
        tripped=mux.trips.since is not None,
        last_transition=mux.transition,
        slowed=tuple(_slowed(mux, now)),
        drives_enabled=enabled,
        drives_ready=mux.drives_ready(now),
        refused=tuple(o.name for o in mux.operators.values() if _is_refused(mux, o, now)),
    )


def _is_refused(mux: Arbiter, operator: OperatorInput, now: float) -> bool:
    held = operator.newest is not None and operator.newest.deadman and operator.fresh(now)
    return held and operator is not mux.owner and not operator.pressed  # that waits for its tick


def _inhibits(mux: Arbiter, now: float) -> list[Coded]:
    if mux.state is State.STOPPING:
        text = f'stopping on a ramp: {mux.transition.reason}{_motion(mux, now)}'
        return [Coded('mux.stopping', text)]
    stops = mux.stops_at(now)
    why = [stop.reason for stop in stops]
    if mux.state is State.ACTIVE:
        return why if mux.owner is None else why + _why_still(mux, mux.owner, now)
    if mux.state is State.STOPPED:
        why.insert(0, _stopped_ago(mux, stops, now))
        why += _why_no_reset(mux, now)
    return list(dict.fromkeys(why + _why_no_owner(mux, now)))


def _stopped_ago(mux: Arbiter, stops: list[Stop], now: float) -> Coded:
    """Say since when, and why unless all of that is among the present stops."""
    last = mux.transition
    text = f'stopped {in_words(now - last.at)} ago'
    again = last.causes and set(last.causes) <= {stop.cause for stop in stops}
    text = text if again else f'{text}: {last.reason}'
    return Coded('mux.stopped', text, since_s=now - last.at)


def _why_still(mux: Arbiter, owner: OwnerInput, now: float) -> list[Coded]:
    if mux.overruled is not None:
        text = f'{owner.label} is losing control: {mux.overruled}{_motion(mux, now)}'
        return [Coded('mux.overruled', text, owner=owner.name)]
    for drive in mux.drives.values():
        if not drive.ready(now):
            problem = drive.problem(now)
            why = problem or f'{drive.lapse or "it says that it is not"}{drive.says}'
            text = f'{owner.label} waits for {drive.label} to be enabled: {why}'
            inner = problem or drive.device_words
            return [passed_on(inner, text, 'mux.drive.disabled', drive=drive.name)]
    if not mux.through_zero and not any(owner.demand):
        return [owner.idle]
    if not mux.through_zero and any(mux.limiter.output):
        return []
    if mux.scale(now) == 0.0:
        return _slowed(mux, now)
    if not mux.through_zero and mux.limiter.words:
        return mux.limiter.words
    first = f'the output passes through zero first{_motion(mux, now)}'
    return [Coded('mux.operator.starts', f'{owner.label} takes control: {first}')]


def _slowed(mux: Arbiter, now: float) -> list[Coded]:
    scale, limits = mux.scale(now), mux.speed_limits.values()
    return [each.words(now) for each in limits if each.scale(now) == scale < 1.0]


def _motion(mux: Arbiter, now: float) -> str:
    """Say, with feedback, how far the way to standstill is."""
    if mux.feedback is None:
        return ''
    ramps = 'ramping' if any(mux.limiter.output) else 'waiting for standstill'
    return f'; {ramps}, {mux.feedback.left(now)}'


def _why_no_reset(mux: Arbiter, now: float) -> list[Coded]:
    why: list[Coded] = []
    if mux.trips.since is not None:
        why.append(_TRIP)
    clearing = [] if mux.stops_at(now) else mux.still_clearing(now)
    script = mux.calls.script(now)
    why += mux.unrest(now) + clearing + ([script] if script else [])
    return [*why, _RESET]


def _why_no_owner(mux: Arbiter, now: float) -> list[Coded]:
    why = mux.unseen(now)
    if mux.feedback is not None and mux.feedback.awaited:
        why.append(Coded('mux.standstill', f'waiting for standstill: {mux.feedback.left(now)}'))
    why += [
        Coded(
            'mux.source.own_silent',
            f'own e-stop of {source.label}: {source.own_watchdog.describe(now)}; '
            'other devices are asked to stop',
            source=source.name,
        )
        for source in mux.sources.values()
        if source.config.own_topic and source.own_watchdog.expired(now) and mux.counts(source, now)
    ]
    for operator in mux.operators.values():
        stops = mux.guard_stops(operator, now)
        blocked = f'{operator.label} cannot take control'
        why += [passed_on(reason, f'{blocked}: {reason}') for reason in stops]
        why += _advice(mux, operator, now, stopped=bool(stops))
    return why if mux.autonomy is None else why + _advice(mux, mux.autonomy, now)


def _advice(
    mux: Arbiter, each: OperatorInput | AutonomyInput, now: float, *, stopped: bool = False
) -> list[Coded]:
    problem = each.problem(now)
    if problem is not None:
        stops = (source.stop_reason(now) or '' for source in mux.sources.values())
        told = any(stop.endswith(each.device_words) for stop in stops)
        return [passed_on(problem, problem.removesuffix(each.says)) if told else problem]
    return [each.advice(now)] if mux.state is State.READY and not stopped else []
