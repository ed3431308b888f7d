# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feed a mux of today with what one heard, tick by tick, and compare what it decides."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

from bridge_core.parameters import full_topic
from bridge_core.reasons import Coded
from rugged_teleop.recordings import Said
from rugged_teleop.replay.beginning import Beginning
from rugged_teleop.replay.proofs import Proofs
from rugged_teleop.replay.track import (
    differences,
    Fits,
    Found,
    is_among,
    Outcome,
    Track,
    within_range,
)
from rugged_teleop.why.events import demand_of, fields_of, mux_values, reason_of
from safety_mux.button import ResetButton
from safety_mux.configuration import joint_limits
from safety_mux.intake import Intake, Listened
from safety_mux.protocol import Decision, Kind, State

_ABOUT = 0.5  # s; what was heard so near to the beginning stands for what was before
_ANSWERED = 0.2  # s within which a service's answer is in the log
_SETTLED = 2.0  # s within which the output of a mux that was brought to a state is as it was
_STEADY = 0.1  # s for which it has to be
_SLACK = 0.01  # of a joint's maximum: times of decisions are known to milliseconds only
_ASKED = {  # by the beginning of an answer in the log: what came of it
    '~/reset: reset:': {'state': 'READY', 'e-stop': False},
    '~/trip: tripped': {'state': 'STOPPED', 'e-stop': True},
    '~/select_autonomy: autonomy has control': {'state': 'ACTIVE', 'enable': True},
}


class MuxReplay:
    """
    One mux of a recording.

    :param name: its full name. :param said: all messages, in the order of time.
    :param given: its recorded parameters.
    :param tolerance: seconds; None: two periods of its rate. What came just behind a decision
        may seem to have come before it, which is one period.
    :raises ValueError: it cannot be replayed, with the reason.
    """

    def __init__(
        self,
        name: str,
        said: Sequence[Said],
        given: Mapping[str, Any],
        tolerance: float | None = None,
    ) -> None:
        self._name = name
        resolved = partial(full_topic, name)
        self._values = mux_values(name, given)
        self._period = 1.0 / self._values['rate']
        self._tolerance = 2.0 * self._period if tolerance is None else tolerance
        self._said = said
        self._now = 0.0
        self._intake = Intake(self._values, 0.0, self._on_sound)
        self._proofs = Proofs(self._intake.arbiter, self._values, resolved)
        self._inputs: dict[str, Listened] = {
            resolved(self._values[each.parameter]): each for each in self._intake.topics()
        }
        joints = self._values['output'] == 'joints'
        self._command = f'{name}/{"command" if joints else "cmd_vel"}'
        self._button = ResetButton()
        self._button_topic = resolved(self._values['reset_topic'])
        self._recorded = self._course()
        self._replayed = {what: Track() for what in self._recorded}
        self._statuses = [
            (each.at, fields_of(each.message))
            for each in said
            if each.topic == f'{name}/status' and each.message is not None
        ]
        self._reasons = (Track(), Track())  # of states: recorded, and today's
        for at, fields in self._statuses:
            self._reasons[0].add(at, reason_of(fields))
        slack = [_SLACK * limit.magnitude for limit in joint_limits(self._values)]
        self._near: Fits = within_range(slack)
        self._offset = 0.0

    def run(self) -> Outcome:
        """Replay it. :raises ValueError: it cannot be."""
        since, state, owner = self._first()
        self._begin(since, State(state), owner)
        self._feed(since)
        until = self._said[-1].at
        notes = [f'begins {state}' + (f", '{owner}' has control" if owner else '')]
        if state != State.STOPPED.value:
            notes[0] += ": today's mux was brought there by inputs made up for that"
        since_command = since if state == State.STOPPED.value else self._agreed(since)
        if since_command > since:
            notes.append(f'commands are compared from {since_command - since:.2f} s on')
        found = [
            each
            for what in self._recorded
            for each in self._differences(what, since_command if what == 'command' else since)
        ]
        silent = [topic for topic in self._inputs if all(s.topic != topic for s in self._said)]
        notes += [f'nothing is recorded of {topic}' for topic in silent]
        found.sort(key=lambda each: each.since)
        return Outcome(self._name, since, until, notes, list(self._recorded), found)

    # What was recorded.

    def _course(self) -> dict[str, Track]:
        """Return the course of each recorded output."""
        topics = {
            f'{self._name}/state': 'state',
            f'{self._name}/estop': 'e-stop',
            f'{self._name}/enable': 'enable',
            self._command: 'command',
        }
        course = {what: Track() for what in topics.values()}
        for each in self._said:
            if each.topic in topics and each.message is not None:
                is_command = each.topic == self._command
                value = demand_of(self._values, each.message) if is_command else each.message.data
                course[topics[each.topic]].add(each.at, value)
        missing = [topic for topic, what in topics.items() if not course[what].points]
        if missing:
            raise ValueError(f'nothing is recorded of {", ".join(missing)}')
        return course

    def _first(self) -> tuple[float, str, str | None]:
        """Return the first moment at which all is known, the state and the owner."""
        known = max(track.points[0][0] for track in self._recorded.values())
        for at, fields in self._statuses:
            if at >= known and fields.get('state') in ('STOPPED', 'READY', 'ACTIVE'):
                owner = fields.get('owner', 'none')
                return at, fields['state'], None if owner == 'none' else owner
        raise ValueError(f'{self._name}/status does not say how it was')

    def _requests(self) -> Iterator[tuple[float, str]]:
        """Yield the services that somebody called, by their answers in the log."""
        for each in self._said:
            log = each.message
            if each.type != 'rcl_interfaces/msg/Log' or log is None:
                continue
            if '/' + log.name.replace('.', '/') != self._name or not log.msg.startswith('~/'):
                continue
            came = next((what for start, what in _ASKED.items() if log.msg.startswith(start)), {})
            effects = [
                at
                for what, value in came.items()
                for (_, before), (at, after) in pairwise(self._recorded[what].points)
                if before != after == value and each.at - _ANSWERED <= at <= each.at
            ]
            # Between the decision that shows it, which is heard first, and the one before.
            yield (min(effects) - self._period / 2 if effects else each.at), log.msg

    # What is done with it; ``now`` is of today's mux, ``at`` of the recording.

    def _begin(self, since: float, state: State, owner: str | None) -> None:
        """Come to the first state."""
        first: dict[Listened, Any] = {}
        for each in sorted(self._said, key=lambda said: -abs(said.at - since)):
            listened = self._inputs.get(each.topic)
            if listened and each.message is not None and abs(each.at - since) < _ABOUT:
                first[listened] = each.message  # the nearest comes last
            elif each.message is not None and abs(each.at - since) < _ABOUT:
                self._proofs.begin(each.topic, each.message)
        beginning = Beginning(self._intake, first, self._proofs, self._period)
        beginning.reach(state, owner, self._recorded['command'].at(since))
        self._offset = beginning.now - since
        self._note(beginning.decision, since, tick=True)

    def _feed(self, since: float) -> None:
        """Pass on all that came behind ``since``, and decide when the recorded mux did."""
        events: list[tuple[float, Said | str]] = [(each.at, each) for each in self._said]
        events += self._requests()
        for at, event in sorted(events, key=lambda each: each[0]):
            now = at + self._offset
            if at <= since:
                continue
            if isinstance(event, str):
                self._ask(event, now)
            elif event.topic == self._command:
                self._note(self._intake.decide(now), at, tick=True)
            elif event.message is not None:
                self._hear(event, now)

    def _on_sound(self, kind: Kind, name: str, message: Any) -> None:
        self._proofs.hear_stamp(kind, name, message.header.stamp, self._now)

    def _hear(self, said: Said, now: float) -> None:
        self._now = now
        listened = self._inputs.get(said.topic)
        if self._proofs.hear(said.topic, said.message, now) or (
            listened is not None and listened.take(said.message, now)
        ):
            self._note(self._intake.decide(now), said.at)
        elif said.topic == f'{self._name}/transition_event':
            active = said.message.goal_state.label == 'active'
            inactive = Coded('mux.inactive', 'the mux was not active')
            self._intake.arbiter.hold(None if active else inactive)
        elif self._values['reset_topic'] and said.topic == self._button_topic:
            stopped = self._replayed['state'].points[-1][1] == State.STOPPED.value
            trouble = '' if stopped else 'was pressed before the stop'
            if self._button.hear(said.message.data, now, trouble) == '':
                self._intake.arbiter.reset(now)

    def _ask(self, answer: str, now: float) -> None:
        """Ask again what was answered so. :param answer: such as '~/reset: not reset: ...'."""
        service, _, text = answer.partition(': ')
        arbiter = self._intake.arbiter
        if service == '~/select_autonomy':
            arbiter.select_autonomy(text != 'autonomy has no control', now)
        elif service in ('~/reset', '~/trip', '~/end_trip'):
            getattr(arbiter, service[2:])(now)

    def _note(self, decision: Decision, at: float, *, tick: bool = False) -> None:
        """Keep what was decided. :param tick: also what a stop does not bring out at once."""
        self._replayed['e-stop'].add(at, decision.estop)
        self._replayed['enable'].add(at, decision.enable)
        if tick:
            state = self._replayed['state'].points
            if not state or state[-1][1] != decision.state.value:
                transition = self._intake.arbiter.status(at + self._offset).last_transition
                self._reasons[1].add(at, transition.reason)
            self._replayed['state'].add(at, decision.state.value)
            self._replayed['command'].add(at, decision.demand)

    # What comes of it.

    def _agreed(self, since: float) -> float:
        """Return when the output of a mux that was brought to a state began to be as it was."""
        tracks = self._recorded['command'], self._replayed['command']
        agreed = None
        for at, _ in tracks[1].points:
            pairs = (tracks, tracks[::-1])
            if not all(
                self._near(one.at(at), other.around(at, self._tolerance)) for one, other in pairs
            ):
                agreed = None
            elif agreed is None:
                agreed = at
            if at > since + _SETTLED or (agreed is not None and at - agreed > _STEADY):
                break
        return since if agreed is None else agreed

    def _differences(self, what: str, since: float) -> Iterator[Found]:
        fits = self._near if what == 'command' else is_among
        tracks = self._recorded[what], self._replayed[what]
        for each in differences(*tracks, since, self._tolerance, fits):
            words = [_words(each.recorded), _words(each.replayed)]
            if what == 'state':
                # Such as READY, between a released deadman and a stop: none or one decision long.
                if any(track.held(each.since) < self._tolerance for track in tracks):
                    continue
                reasons = [track.at(each.since + self._tolerance) for track in self._reasons]
                words = [f'{word} ({why})' for word, why in zip(words, reasons, strict=True)]
            yield Found(each.since, each.until, what, *words)


def _words(value: Any) -> str:
    if isinstance(value, tuple):
        return '[' + ', '.join(f'{number:.3g}' for number in value) + ']'
    return str(value).lower() if isinstance(value, bool) else str(value)
