# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mux's rules as monitors: exploration, fuzz, campaign and recordings are held against these.

A ``Monitor`` is told what one mux heard and what it decided, in the order of time, and says which
rule that breaks. ``slack`` is what times may be off: 0 for who steps the arbiter itself, some
periods for who only looked on. Each check needs nothing but what its arguments say: what was never
heard, as before a recording began, breaks no rule.

docs/safety_mux.md has the rules. SELDOM are those that need something to happen that is seldom.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
import math
import re
from typing import Final, NamedTuple

from bridge_core.proof import Proof
from safety_mux.limits import JointLimit
from safety_mux.protocol import AUTONOMY, Decision, OperatorSample, State
from safety_mux.settings import EStopSource, MuxConfig

SELDOM: Final = {
    8: 'a clock that steps',
    13: 'a remote whose node was held up for 1 s, and asked for proofs',
    14: 'a drive whose node began anew, and proves it',
}
HELD_UP = 1.0  # s; above bridge_core's FROZEN_TIME, after which what came meanwhile is discarded
_ASKED = 10  # challenges that a node which runs would have answered
_SAYS = 0.3  # s in which it says stop
_STEPPED = 5.0  # s for which a step of a clock may show
_QUIET = re.compile(r"(e-stop source|operator) '(.*?)' is (?:silent|stale)\b")

_NOTHING = 1e-6  # of a joint's unit: rounding


class Broken(NamedTuple):
    """A rule that is broken, and how. :param at: s, since when."""

    at: float
    rule: int
    words: str


# A rule, how it is broken, and whether that is wrong only if it lasts for longer than the slack.
_Found = tuple[int, str, bool]


@dataclass
class _Heard:
    """
    What is known of an input. Times in s. :param since: from when on it may be missed.

    :param last: infinite: never heard.
    """

    since: float
    last: float = math.inf
    gap: float = 0.0  # between the last two
    bad: float = -math.inf  # when a source said stop last, or an operator left rest
    value: bool | None = None
    rested: float = math.inf  # since when at rest; minus infinity: since before it was watched
    pressed: float = -math.inf  # when its deadman was, and since when it was at rest then
    was_rested: float = math.inf

    def silence(self, now: float) -> float:
        """Return for how long it may be missed."""
        return now - (self.since if math.isinf(self.last) else self.last)


@dataclass
class Monitor:
    """One mux, watched. :param begin: s, from when on."""

    config: MuxConfig
    limits: Sequence[JointLimit]
    slack: float = 0.0
    begin: float = 0.0
    stepped: float = -math.inf  # when a clock did
    before: Decision | None = None
    waited: bool = False  # for a drive, in the decision before
    owner_since: float = -math.inf
    _at: float = 0.0
    _state_since: float = -math.inf
    _most: tuple[float, ...] = ()  # how far from 0 each joint may be, and has to be
    _least: tuple[float, ...] = ()
    _through_zero: bool = False
    _asked: float = -math.inf
    _ready_since: float = -math.inf
    _due: dict[str, Broken] = field(default_factory=dict)  # by input: what no stop has followed
    _open: dict[tuple[int, str], tuple[float, bool]] = field(default_factory=dict)
    _inputs: dict[str, _Heard] = field(default_factory=dict)

    # What the mux heard.

    def source(self, name: str, stop: bool | None, now: float) -> None:
        """Hear an e-stop source. :param stop: None: proven to be as before."""
        heard = self._hear(f'e-stop {name}', now)
        heard.value = heard.value if stop is None else stop
        if heard.value:
            heard.bad = now
        runs = self.before is not None and self.before.state in (State.READY, State.ACTIVE)
        if stop and runs and self._counts(self._source(name)):
            self._due.setdefault(name, Broken(now, 2, f"'{name}' said stop, and it ran on"))

    def operator(self, name: str, sample: OperatorSample | None, now: float) -> None:
        """Hear an operator, or autonomy. :param sample: None: malformed."""
        is_first = name not in self._inputs
        was_silent = not is_first and self._inputs[name].silence(now) > self._timeout(name)
        heard = self._hear(name, now)
        if sample is None:
            if self.before is not None and self.before.owner == name:
                words = f"'{name}', in control, was malformed, and it ran on"
                self._due.setdefault(name, Broken(now, 9, words))
            heard.rested = math.inf
            return
        if was_silent:
            heard.rested = math.inf
        if sample.deadman and not heard.value:
            heard.pressed, heard.was_rested = now, -math.inf if is_first else heard.rested
        heard.value = sample.deadman
        if sample.at_rest:
            began = -math.inf if is_first else now
            heard.rested = began if heard.rested == math.inf else heard.rested
        elif not (sample.neutral and sample.partial):
            heard.bad = now if is_first or heard.rested < math.inf else heard.bad
            heard.rested = math.inf

    def proven(self, name: str, now: float) -> None:
        """Hear that what an operator said last is as old as that."""
        if name in self._inputs:
            self._hear(name, now)

    def reset(self, now: float) -> None:
        """Hear that somebody asked for a reset."""
        self._asked = now

    def missed(self, seconds: float) -> None:
        """Hear that nobody listened for so long: what was said meanwhile is not known."""
        for each in self._inputs.values():
            each.last += seconds
            each.since += seconds

    # What it decided.

    def status(self, state: str, inhibits: Sequence[str], now: float) -> Iterator[Broken]:
        """Judge what it says of itself."""
        if state != State.ACTIVE.value and not inhibits:
            yield Broken(now, 12, f'{state}, and nothing says why')
        for each in inhibits if now - self.stepped < _STEPPED else ():
            if not (found := _QUIET.match(each)):
                continue
            kind, name = found.groups()
            is_source = kind == 'e-stop source'
            heard = self._inputs.get(f'e-stop {name}' if is_source else name)
            timeout = self._source(name).timeout if is_source else self._timeout(name)
            if heard and max(heard.gap, heard.silence(now)) < timeout - self.slack:
                self.stepped = -math.inf  # once is enough
                yield Broken(now, 8, f'a clock stepped, and {each}')

    def decided(
        self, after: Decision, now: float, *, waits: bool | None = None
    ) -> Iterator[Broken]:
        """Judge a decision. :param waits: whether a drive is not enabled; None: unknown."""
        before, self.before = self.before or after, after
        if not self._most:
            self._at = self._state_since = now
            pairs = [*zip(self.limits, map(abs, after.demand), strict=True)]
            self._most = tuple(size + self.slack * limit.acceleration for limit, size in pairs)
            self._least = tuple(size - self.slack * limit.deceleration for limit, size in pairs)
        found = [
            *self._transition(before, after, now),
            *self._output(before, after, now, waits),
            *self._missing(after, now),
        ]
        self._at = now
        was_open, self._open = self._open, {}
        for rule, words, lasts in found:
            key = rule, words.partition(':')[0]
            since, told = was_open.get(key, (now, False))
            is_due = not lasts or now - since >= self.slack
            self._open[key] = since, told or is_due
            if is_due and not told:
                yield Broken(since, rule, words)
        if after.state in (State.STOPPED, State.STOPPING):
            self._due.clear()
        for key_of_due, broken in [*self._due.items()]:
            if now - broken.at > self.slack:
                del self._due[key_of_due]
                yield broken

    def _transition(self, before: Decision, after: Decision, now: float) -> Iterator[_Found]:
        """Judge a change of state or owner."""
        if before.state is not after.state:
            self._state_since = now
        if before.state is State.STOPPED is not after.state:
            if after.state is not State.READY:
                yield 4, f'from STOPPED to {after.state.value}', False
            yield from self._left_stopped(now)
            self._ready_since = now
        if before.state is State.STOPPING and after.owner is None and not after.estop:
            yield 10, 'a ramp did not end in STOPPED', False
        if after.owner in (None, before.owner):
            return
        if before.state not in (State.READY, State.ACTIVE):
            yield 4, f"'{after.owner}' took control in {before.state.value}", False
        if before.owner is not None:
            if self._rank(after.owner) < self._rank(before.owner):
                yield 6, f"control fell from '{before.owner}' to '{after.owner}'", False
            held = now - self.owner_since + self.slack
            if before.owner != AUTONOMY and held < self.config.hold_time:
                yield 7, f"'{after.owner}' took over within hold_time", False
            if after.state is not State.ACTIVE:
                yield 6, f"'{after.owner}' got control on a ramp", False
        self._through_zero = before.owner is not None
        self.owner_since = now
        pressed = self._inputs.get(after.owner or '')
        if after.owner != AUTONOMY and pressed is not None:
            rest = pressed.pressed - max(pressed.was_rested, self._ready_since)
            if rest + self.slack < self.config.neutral_time:
                yield 4, f"'{after.owner}' took control without neutral_time of rest", False

    def _left_stopped(self, now: float) -> Iterator[_Found]:
        """Judge a reset."""
        if now - self._asked > self.slack:
            yield 3, 'it left STOPPED, and nobody asked for a reset', False
        for source in self.config.sources:
            heard = self._inputs.get(f'e-stop {source.name}')
            if heard is None or source.counts != 'always':
                continue
            if now - heard.bad < self.config.clear_time - self.slack:
                yield 3, f"a reset counted before '{source.name}' was clear for clear_time", False
        for operator in self.config.operators:
            heard = self._inputs.get(operator.name)
            if heard is None or heard.silence(now) >= operator.timeout or heard.rested < math.inf:
                continue
            if now - heard.bad > self.slack:
                yield 3, f"a reset counted while '{operator.name}' was not at rest", False

    def _output(
        self, before: Decision, after: Decision, now: float, waits: bool | None
    ) -> Iterator[_Found]:
        """Judge what goes out. It may grow by the acceleration from 0 on, as it is enabled."""
        if after.enable != after.state.enables:
            yield 10, f'enable is {after.enable} in {after.state.value}', True
        if after.estop != (after.state is State.STOPPED):
            yield 10, f'e-stop is {after.estop} in {after.state.value}', True
        if (after.owner is not None) != after.state.enables:
            yield 10, f"owner is '{after.owner}' in {after.state.value}", True
        if not after.enable and any(after.demand):
            yield 5, f'motion is commanded, and not enabled: {_words(after.demand)}', True
        if after.enable and (waits or self.waited) and any(after.demand):
            yield 15, f'not at rest until the drive is enabled: {_words(after.demand)}', True
        self.waited = after.enable and bool(waits)
        dt, config = now - self._at, self.config
        is_first = not before.enable
        falls = after.state is State.STOPPING or self._through_zero
        since = now - self._state_since
        if after.state is State.STOPPING and since >= config.stop_time + self.slack:
            yield 10, 'a ramp without an end', False
        most, least = [], []
        for index, (limit, value) in enumerate(zip(self.limits, after.demand, strict=True)):
            size = abs(value)
            if not size <= limit.magnitude + _NOTHING:
                yield 10, f'joint {index} is beyond its limit: {value:.3g}', False
            highest = self.slack * limit.acceleration
            if not is_first:
                highest = self._most[index] + (not falls) * dt * limit.acceleration
            is_next = not self.slack or dt <= self.slack  # none was missed
            if is_next and before.demand[index] * value < 0.0:
                yield 7, f'joint {index} went through zero without being there', False
            if after.enable and size > highest + _NOTHING:
                rule = 5 if is_first else 7 if falls else 10
                yield rule, f'joint {index} grew too fast: {value:.3g}', False
            lowest = 0.0
            if waits is False and not (is_first or config.torques):
                lowest = max(0.0, self._least[index] - dt * limit.deceleration)
            if after.enable and size < lowest - _NOTHING:
                yield 10, f'joint {index} fell too fast: {value:.3g}', True
            most.append(min(highest, size + self.slack * limit.acceleration))
            least.append(max(lowest, size - self.slack * limit.deceleration))
        self._most, self._least = tuple(most), tuple(least)
        self._through_zero &= any(after.demand) and after.enable

    def _missing(self, after: Decision, now: float) -> Iterator[_Found]:
        """Judge whether it stops for what is missing."""
        for source in self.config.sources:
            heard = self._inputs.get(f'e-stop {source.name}')
            if heard is None or after.estop or not self._counts(source):
                continue
            if after.state is State.STOPPING and source.stop_category == 1:
                continue
            if heard.value:
                yield 1, f"it runs while '{source.name}' says stop", True
            elif heard.silence(now) > source.timeout + self.slack:
                yield 1, f"it runs while '{source.name}' is silent", True
        owner = self._inputs.get(after.owner or '')
        if owner is not None and owner.silence(now) > self._timeout(after.owner) + self.slack:
            yield 6, f"it runs while '{after.owner}', in control, is silent", True

    # What is known of the inputs.

    def _hear(self, name: str, now: float) -> _Heard:
        heard = self._inputs.setdefault(name, _Heard(now))
        heard.gap, heard.last = heard.silence(now), now
        return heard

    def expect(self, name: str) -> None:
        """Miss a source from the beginning on, though it was never heard."""
        self._inputs.setdefault(f'e-stop {name}', _Heard(self.begin))

    def _source(self, name: str) -> EStopSource:
        return next(each for each in self.config.sources if each.name == name)

    def _counts(self, source: EStopSource) -> bool:
        owner = self.before.owner if self.before is not None else None
        return source.counts == 'always' or owner == source.operator

    def _rank(self, name: str) -> float:
        ranks = {each.name: each.priority for each in self.config.operators}
        return ranks.get(name, -math.inf)

    def _timeout(self, name: str | None) -> float:
        found = {each.name: each.timeout for each in self.config.operators}
        if self.config.autonomy is not None:
            found[AUTONOMY] = self.config.autonomy.timeout
        return found.get(name or '', math.inf)


def _words(demand: Sequence[float]) -> str:
    return ', '.join(f'{value:.3g}' for value in demand)


@dataclass
class DriveMonitor:
    """Rule 11: a drive stops by itself. :param timeout: of what the mux says to it, s."""

    timeout: float
    slack: float
    _mux: dict[str, float] = field(default_factory=dict)

    def mux_said(self, what: str, now: float) -> None:
        """Hear one of the mux's words: command, enable, e-stop."""
        self._mux[what] = now

    def missed(self, seconds: float) -> None:
        """Hear that nobody listened for so long."""
        self._mux = {what: last + seconds for what, last in self._mux.items()}

    def says(self, enabled: bool, now: float) -> Iterator[Broken]:
        """Judge whether a drive may say that."""
        for what, last in self._mux.items():
            if enabled and now - last > self.timeout + self.slack:
                yield Broken(now, 11, f"the drive is enabled without the mux's {what}")


def enabled_again(
    packets: Iterable[tuple[float, bool]], presses: Sequence[float]
) -> Iterator[float]:
    """
    Yield when a drive was told to enable after a disable, and before a new press of the deadman.

    :param packets: when, and whether it enables.
    """
    later, was_on, is_over = list(presses), True, False
    for at, enables in packets:
        while later and at > later[0]:
            later.pop(0)
            was_on = is_over = False
        is_over |= was_on and not enables
        was_on |= enables
        if is_over and enables:
            yield at


@dataclass
class ProofMonitor:
    """
    Rules 13 and 14: a node, watched by what it is asked to prove and by its proofs.

    :param drives: it says whether a drive is enabled; else it has a remote on its own thread.
    """

    drives: bool
    is_judged: bool = False
    _asked: int = 0
    _last: Proof | None = None
    _times: tuple[float, float] = (0.0, 0.0)  # of that one: when it was heard, and sent
    _held: tuple[float, int] | None = None  # since when it was held up, and its stops until then
    _enable: bool = False
    _anew: bool = False  # it began anew, and the mux has not enabled since

    def asked(self) -> None:
        """Hear a challenge to it."""
        self._asked += 1

    def proves(self, proof: Proof, now: float, sent_at: float) -> Iterator[Broken]:
        """Hear its next proof. :param sent_at: when that was published, by its own clock."""
        last, self._last = self._last, proof
        gap = min(now - self._times[0], sent_at - self._times[1])
        self._times, asked, self._asked = (now, sent_at), self._asked, 0
        if last is None:
            return
        if last.writer != proof.writer:
            self._held, self._anew = None, self.drives
            self.is_judged |= self.drives
        elif (
            not (self.drives or last.estop)
            and proof.number == last.number + 1
            and asked >= _ASKED
            and gap > HELD_UP
        ):
            self._held, self.is_judged = (now, last.stops), True
        if self._held is None:
            return
        since, stops = self._held
        if proof.estop or proof.stops != stops:
            self._held = None
        elif now - since > _SAYS:
            self._held = None
            yield Broken(since, 13, 'it was held up, discarded what came, and said no stop')

    def enabled(self, value: bool, now: float) -> Iterator[Broken]:
        """Hear what a drive's node says of it."""
        if value and self._anew and not self._enable:
            self._anew = False
            yield Broken(now, 14, 'its drive is enabled still as its node begins anew')

    def mux_enables(self, value: bool) -> None:
        """Hear the mux."""
        self._enable, self._anew = value, self._anew and not value
