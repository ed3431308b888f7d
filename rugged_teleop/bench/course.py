# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The course of a trial: wait, neutral, enable, move, rest, disable, watch. Pure; times in s."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

ALONE_TIME = 1.5  # how long nobody else may be seen to publish; discovery is not instant
NEUTRAL_TIME = 0.5  # longer than the node doubts a new publisher
FIND_LIMIT = 10.0  # until the node listens and reports
HEALTHY_LIMIT = 3.0  # until its e-stop is clear
ENABLE_LIMIT = 12.0  # longer than the largest enable_timeout
REST_LIMIT = 2.0
DISABLE_TIME, DISABLE_LIMIT = 0.3, 3.0
WATCH_TIME, WATCH_LIMIT = 1.0, 5.0  # how long it has to stand; until it has
STALL_LIMIT = 0.2  # between two steps; all that was heard may have changed meanwhile
STANDSTILL = 0.2  # rad/s, as the mux's feedback.standstill by default


@dataclass(frozen=True)
class Facts:
    """
    What is known of the device's node; None: not heard yet.

    :param listens: to all of its inputs. :param others: topics that others publish.
    :param measured: of the joint, in the unit of what is asked. :param speed: rad/s, where the
        drive measures it. Neither is older than a report may be.
    :param reason: its own words.
    """

    listens: bool = False
    others: tuple[str, ...] = ()
    estop: bool | None = None
    enabled: bool | None = None
    measured: float | None = None
    speed: float | None = None
    reason: str = ''


@dataclass(frozen=True)
class Order:
    """What to publish: the joint's value, None at rest, ~/enable and ~/estop_in."""

    value: float | None = None
    enable: bool = False
    estop: bool = False


class Phase(Enum):
    """Values are what people read."""

    WAITING = 'looking for the node, and for others who command it'
    NEUTRAL = 'neutral'
    ENABLING = 'enabling'
    MOVING = 'moving'
    RESTING = 'to rest'
    DISABLING = 'disabling'
    WATCHING = 'watching whether it stands'
    DONE = 'done'


_STAYS_ENABLED = 'the drive does not say that it is disabled'
_ENDING = (Phase.DISABLING, Phase.WATCHING, Phase.DONE)  # another commander is no reason to wait
_LIMITS = {Phase.NEUTRAL: HEALTHY_LIMIT, Phase.ENABLING: ENABLE_LIMIT}


class Course:
    """
    Decides what to publish; ``problem`` says why it ended early, and is empty otherwise.

    :param value: of the joint while it moves. :param seconds: for which it does.
    :param is_measured: the device reports whether it is enabled, and how the joint moves.
    """

    def __init__(self, value: float, seconds: float, now: float, *, is_measured: bool) -> None:
        self.phase = Phase.WAITING
        self.problem = ''
        self.peak = 0.0  # the largest value measured
        self.end = ''  # what was measured at the end, in words; empty: nothing was
        self._is_measured = is_measured
        self._rest: list[float] = []  # speeds since it stands
        self._stands_since = now
        self._value, self._seconds = value, seconds
        self._since = self._alone_since = self._stepped_at = now

    def interrupt(self, problem: str, now: float) -> None:
        """Stop; where nothing was published yet, end."""
        if self.phase is Phase.WAITING:
            self._enter(Phase.DONE, now)
        elif self.phase in _ENDING:
            return
        else:
            self._enter(Phase.DISABLING, now)
        self.problem = problem

    def is_held_up(self, now: float) -> bool:
        """Tell whether the last step is so long ago that what it saw may have changed."""
        return now - self._stepped_at > STALL_LIMIT

    def step(self, facts: Facts, now: float) -> Order | None:
        """Return what to publish now; None is nothing."""
        problem = self._problem(facts, now)
        if self.is_held_up(now) and self.phase is not Phase.WAITING:
            problem = problem or f'this trial was held up for {now - self._stepped_at:.1f} s'
        self._stepped_at = now
        if problem:
            self.interrupt(problem, now)
        else:
            self._advance(facts, now)
        if self.phase in (Phase.WAITING, Phase.DONE):
            return None
        moving = self.phase is Phase.MOVING
        enable = self.phase in (Phase.ENABLING, Phase.MOVING, Phase.RESTING)
        estop = self.phase in _ENDING
        return Order(self._value if moving else None, enable, estop=estop)

    def _enter(self, phase: Phase, now: float) -> None:
        self.phase, self._since = phase, now

    def _problem(self, facts: Facts, now: float) -> str:
        """Say what ends the course early."""
        age = now - self._since
        if self.phase in _ENDING:
            return ''
        if facts.others:
            return (
                f'somebody else publishes {" and ".join(facts.others)}: stop the mux or the other '
                'commander; one that was killed is forgotten within 20 s'
            )
        if self.phase is Phase.WAITING and age > FIND_LIMIT:
            missing = 'reports its state' if facts.listens else 'listens to its inputs'
            return f'no node {missing}: is it running, with this name and in this domain?'
        in_motion = self.phase in (Phase.MOVING, Phase.RESTING)
        if facts.estop and (in_motion or self.phase is Phase.ENABLING):
            return f'the device demands a stop: {facts.reason}'
        if in_motion and not facts.enabled:
            why = facts.reason or 'see /diagnostics, its report comes once a second'
            return f'the drive is not enabled any more: {why}'
        limit = _LIMITS.get(self.phase)
        if limit is not None and age > limit:
            asked = 'its e-stop is' if facts.estop else 'it is'
            return f'{self.phase.value} for {limit:g} s, and {asked} not ready: {facts.reason}'
        return ''

    def _advance(self, facts: Facts, now: float) -> None:
        age = now - self._since
        measured = abs(facts.measured or 0.0)
        if self.phase is Phase.WAITING:
            heard = facts.listens and None not in (facts.estop, facts.enabled)
            if not heard:
                self._alone_since = now
            elif now - self._alone_since >= ALONE_TIME:
                self._enter(Phase.NEUTRAL, now)
        elif self.phase is Phase.NEUTRAL:
            if age >= NEUTRAL_TIME and not facts.estop and not facts.enabled:
                self._enter(Phase.ENABLING, now)
        elif self.phase is Phase.ENABLING:
            if facts.enabled:
                self._enter(Phase.MOVING, now)
        elif self.phase is Phase.MOVING:
            self.peak = max(self.peak, measured)
            if age >= self._seconds:
                self._enter(Phase.RESTING, now)
        elif self.phase is Phase.RESTING:
            stands = facts.speed is not None and abs(facts.speed) <= STANDSTILL
            if stands or not self._is_measured or age >= REST_LIMIT:
                self._enter(Phase.DISABLING, now)
        elif self.phase is Phase.DISABLING:
            self._disable(facts, age, now)
        elif self.phase is Phase.WATCHING:
            self._watch(facts, age, now)

    def _disable(self, facts: Facts, age: float, now: float) -> None:
        if not self._is_measured:
            if age >= DISABLE_TIME:
                self._enter(Phase.DONE, now)
        elif age >= DISABLE_TIME and facts.enabled is False and facts.measured is not None:
            self._rest, self._stands_since = [], now
            self._enter(Phase.WATCHING, now)
        elif age >= DISABLE_LIMIT:
            silent = facts.measured is None
            self._fail('nothing is heard of the drive' if silent else _STAYS_ENABLED, now)

    def _watch(self, facts: Facts, age: float, now: float) -> None:
        """Look whether it stands: nobody else notices a brake that does not hold."""
        if facts.speed is None:
            if facts.measured is None:
                self._fail('nothing is heard of the drive: whether it stands is not known', now)
            else:
                self.end = 'disabled; whether it stands is not known: its speed is not measured'
                self._enter(Phase.DONE, now)
            return
        self._rest.append(abs(facts.speed))
        if self._rest[-1] > STANDSTILL:
            self._rest, self._stands_since = [], now
            if age >= WATCH_LIMIT:
                speed = f'{abs(facts.speed):.3g} rad/s'
                self._fail(f'it is disabled and still turns at {speed} {age:.0f} s later', now)
        elif now - self._stands_since >= WATCH_TIME:
            self.end = f'disabled; stands: at most {max(self._rest):.2g} rad/s in {WATCH_TIME:g} s'
            self._enter(Phase.DONE, now)

    def _fail(self, problem: str, now: float) -> None:
        self.problem = '; '.join(filter(None, (self.problem, problem)))
        self._enter(Phase.DONE, now)
