# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every state that the arbiter can reach, and every rule on every step from there.

The arbiter itself is explored, not a model of it: one arbiter is put into each state in turn, gets
one more input and a tick, and its output is checked against an independent log of all input
(``Log``). A step of time is an eighth of a second, exact in binary, and all limits are a few steps
long. Times longer ago than every limit are all the same. From every state, too, a quiet while, a
reset and a deadman must lead to motion: no way to stop may be one for ever.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any

import pytest

from assurance.explorer import check
from bridge_core.reasons import Coded
from rugged_teleop.why.rules import Monitor
from safety_mux.arbiter import Arbiter
from safety_mux.feedback import FeedbackInput
from safety_mux.inputs import DriveInput, SourceInput
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.owners import AutonomyInput, OperatorInput, OwnerInput
from safety_mux.protocol import Decision, Demand, OperatorSample, Reply, State
from safety_mux.settings import Autonomy, EStopSource, Feedback, MuxConfig, Operator

pytestmark = pytest.mark.computes
STEP = 0.125
TIMEOUT = 1.5 * STEP  # fresh after one silent step, stale after two
CLEAR = NEUTRAL = HOLD = STOP_TIME = 2 * STEP
OLD = 3 * STEP  # no limit looks further back, even from a sample that is a step old
QUIET = 8  # steps, longer than anything is remembered
LIMIT = JointLimit(magnitude=1.0, acceleration=1.0 / STEP, deceleration=0.5 / STEP)

CONFIG = MuxConfig(
    joints=1,
    sources=(
        EStopSource('always', timeout=TIMEOUT),
        EStopSource('soft', timeout=TIMEOUT, stop_category=1),
        EStopSource('remote', timeout=TIMEOUT, counts='when_owner', operator='high'),
    ),
    operators=(Operator('low', 1, TIMEOUT), Operator('high', 2, TIMEOUT)),
    autonomy=Autonomy(TIMEOUT),
    clear_time=CLEAR,
    neutral_time=NEUTRAL,
    hold_time=HOLD,
    stall_limit=1.5 * STEP,
    stop_time=STOP_TIME,
)
FEEDBACK = Feedback(('joint',), TIMEOUT, 0.1, 0.1, 2 * STEP)
SPEEDS = {'stand': 0.0, 'creep': 0.15, 'run': 0.5, 'reverse': -0.5}
SOURCES = ('always', 'soft', 'remote')
OPERATORS = ('low', 'high')
RANK = {'autonomy': 0, 'low': 1, 'high': 2}
WISH = {'autonomy': (1.0, 0.5), 'low': (1.5, 0.75), 'high': (-1.0, 1.0)}  # beyond one maximum
TURN = (-0.5, 1.0)  # the other curve that an operator can drive
DRIVING = ('drive', 'turn')
BAD = {'stop', 'doubled', 'bad', 'disabled'}
CALM = {'low': 'rest', 'high': 'rest', 'autonomy': 'zero'} | dict.fromkeys(SOURCES, 'clear')


@dataclass(frozen=True)
class Scene:
    """
    A world to explore.

    :param words: what devices may do, spaced; all others are calm. ``own`` is the own topic of
        'always'; ``mux`` is active or not; ``drive`` and ``joints`` say what is known of them.
    :param states: to be reached, and ``steps`` between them.
    :param most_uneasy: how many may do anything unusual at a time.
    :param timeouts: of those that differ from TIMEOUT, in s.
    :param zero: ticks that follow without any time between them.
    """

    words: dict[str, str]
    states: int
    steps: int
    most_uneasy: int = 9
    timeouts: dict[str, float] = field(default_factory=dict)
    stall_limit: float = 1.5 * STEP
    reset_silence: float = 0.0
    remote_category: int = 0
    joints: int = 1
    zero: bool = False

    @property
    def config(self) -> MuxConfig:
        always, soft, remote = CONFIG.sources
        changed = (
            replace(always, own_topic='own' in self.words),
            soft,
            replace(remote, stop_category=self.remote_category),
        )
        sources = tuple(replace(each, timeout=self.timeout(each.name)) for each in changed)
        operators = tuple(
            replace(each, timeout=self.timeout(each.name)) for each in CONFIG.operators
        )
        return replace(
            CONFIG,
            joints=self.joints,
            sources=sources,
            operators=operators,
            drives=('',) if 'drive' in self.words else (),
            drive_timeout=TIMEOUT,
            feedback=FEEDBACK if 'joints' in self.words else None,
            stall_limit=self.stall_limit,
            reset_silence=self.reset_silence,
        )

    @property
    def calm(self) -> dict[str, str]:
        others = {'own': 'clear', 'mux': 'active', 'drive': 'enabled', 'joints': 'stand'}
        return CALM | {name: what for name, what in others.items() if name in self.words}

    @property
    def old(self) -> float:
        return max(OLD, *self.timeouts.values(), 0.0) + STEP * bool(self.timeouts)

    def timeout(self, name: str) -> float:
        return self.timeouts.get('always' if name == 'own' else name, TIMEOUT)

    def wish(self, name: str, doing: str) -> Demand:
        wish = WISH[name] if doing != 'turn' else TURN
        return (wish if doing not in ('rest', 'zero') else (0.0, 0.0))[: self.joints]

    def target(self, name: str, doing: str) -> Demand:
        """Return what the limits leave of a wish; both joints are of one group."""
        wish = self.wish(name, doing)
        excess = max(1.0, *map(abs, wish))
        return tuple(each / excess for each in wish)

    def sample(self, name: str, doing: str) -> OperatorSample:
        demand = self.wish(name, doing)
        return OperatorSample(neutral=doing == 'rest', deadman=doing in DRIVING, demand=demand)


class Memory:
    """Takes, gives back and names everything that an arbiter remembers."""

    def __init__(self, arbiter: Arbiter, old: float) -> None:
        self.arbiter = arbiter
        self.old = old
        self.slots = list(self._slots(arbiter))

    @staticmethod
    def _slots(arbiter: Arbiter) -> Iterator[tuple[Any, str]]:
        fixed = {'config', 'sources', 'operators', 'guards', 'autonomy', 'inputs', 'limiter'}
        fixed |= {'drives', 'feedback', '_named', 'speed_limits', 'calls', 'trips'}
        yield from ((arbiter, name) for name in vars(arbiter) if name not in fixed)
        yield from ((arbiter.limiter, name) for name in ('_values', '_ramp'))
        yield from ((arbiter.calls, name) for name in ('last', 'go_on'))
        yield from ((arbiter.trips, name) for name in ('since', 'new'))
        for each in arbiter.inputs:
            yield from ((each, name) for name in ('faults', 'lapse'))
            yield each.watchdog, '_last'
            if isinstance(each, SourceInput):
                yield each.own_watchdog, '_last'
                yield from ((each, name) for name in ('value', 'own', 'own_lapse'))
            if isinstance(each, DriveInput):
                yield from ((each, name) for name in ('value', 'known'))
            if isinstance(each, FeedbackInput):
                names = ('speeds', '_at_zero', 'fault', '_told_at', '_fast_since')
                yield from ((each, name) for name in names)
            if isinstance(each, OwnerInput):
                yield from ((each.rest, 'since'), (each.rest, 'until'), (each, 'demand'))
            if isinstance(each, AutonomyInput):
                yield each, 'selected'
            if isinstance(each, OperatorInput):
                yield from ((each, name) for name in ('newest', 'pressed', 'holding'))

    def take(self) -> list[Any]:
        return [
            dict(value) if isinstance(value := getattr(owner, name), dict) else value
            for owner, name in self.slots
        ]

    def give(self, taken: Sequence[Any]) -> None:
        for (owner, name), value in zip(self.slots, taken, strict=True):
            setattr(owner, name, dict(value) if isinstance(value, dict) else value)

    def key(self, now: float) -> tuple[Any, ...]:
        """Name the state after a tick; moments by their age, words not at all."""

        def age(moment: float | None) -> float | None:
            return None if moment is None else min(now - moment, self.old)

        a = self.arbiter
        parts: list[Any] = [a.state, a.owner and a.owner.name, a.through_zero, a._settled]
        parts += [bool(a._hold), age(a.trips.since), bool(a.overruled)]
        silence = max(CLEAR, a.calls.go_on * a.config.reset_silence)
        parts.append(recent(a.calls.last, now, silence))
        parts.append(age(a._clear_since) if a.state is State.STOPPED else None)
        parts += [age(a._owner_since) if a.owner else None, a.limiter.output]
        parts.append(age(a._owned_until.get('high')))
        parts.append(age(a._stopping_since) if a.state is State.STOPPING else None)
        for each in a.inputs:
            fresh = each.fresh(now)
            parts += [age(each.watchdog._last) if fresh else each.watchdog.heard]
            parts += [bool(each.faults), bool(each.lapse)]
            if isinstance(each, SourceInput):
                own = each.own_watchdog
                parts += [fresh and each.value, not own.expired(now) and each.own]
                parts.append(age(own._last) if not own.expired(now) else None)
            if isinstance(each, DriveInput):
                parts.append(fresh and each.value)
            if isinstance(each, FeedbackInput):
                parts += [fresh and (each.speeds, each._at_zero)]
                parts += [bool(each.fault), age(each._told_at)]
                parts.append(age(each._fast_since.get('joint')))
            if isinstance(each, OwnerInput):
                parts.append(each.rested or age(each.rest.since) if fresh else None)
                parts.append(each.demand if each is a.owner else None)
            if isinstance(each, AutonomyInput):
                parts.append(each.selected)
            if isinstance(each, OperatorInput):
                parts += [each.newest if fresh else None, each.holding, each.pressed]
        return tuple(parts)


def age(moment: float | None, now: float, old: float) -> float | None:
    return None if moment is None else min(now - moment, old)


def recent(moment: float | None, now: float, limit: float) -> tuple[float, float] | None:
    return None if moment is None or now - moment >= limit else (now - moment, limit)


@dataclass(frozen=True)
class Event:
    """One step: who changes what it does, the service then called, the messages after that."""

    changes: tuple[tuple[str, str], ...] = ()
    service: str = ''
    late: tuple[tuple[str, str], ...] = ()
    steps: int = 1


@dataclass
class Log:
    """The input and the decisions so far, recorded without any use of the arbiter."""

    scene: Scene
    now: float
    doing: dict[str, str]
    said: dict[str, str]
    heard: dict[str, float]
    sample: dict[str, str]  # the last good one
    decision: Decision
    monitor: Monitor
    calm_since: dict[str, float | None] = field(default_factory=dict)  # since the reset
    clear_since: float | None = None
    reset_at: float | None = None
    silence: float = CLEAR  # of resets before one counts
    long_silence: float = CLEAR  # the same, once they go on with nothing to reset
    must_reach_zero: bool = False
    overruled: bool = False
    high_until: float = -math.inf  # when high last lost control
    trip: str = 'no'  # 'yes'; 'asked': a reset was asked for since
    told_at: float | None = None  # that the joints have to stand
    moved_at: float = -math.inf  # until when a command was not 0
    fast_since: float | None = None
    runs_on: bool = False

    def copy(self) -> 'Log':
        return replace(
            self,
            doing=dict(self.doing),
            said=dict(self.said),
            heard=dict(self.heard),
            sample=dict(self.sample),
            calm_since=dict(self.calm_since),
            monitor=replace(self.monitor),
        )

    def key(self) -> tuple[Any, ...]:
        old = self.scene.old
        calm = (age(self.calm_since.get(name), self.now, old) for name in RANK)
        clear = age(self.clear_since, self.now, old) if self.decision.estop else None
        asked = recent(self.reset_at, self.now, self.silence)
        samples = (self.sample[name] for name in OPERATORS)
        zero = self.must_reach_zero, self.overruled
        high = age(self.high_until, self.now, old)
        motion = (age(moment, self.now, old) for moment in (self.told_at, self.fast_since))
        at_zero = self.heard.get('joints', math.inf) > self.moved_at
        more = self.trip, self.monitor.waited, self.runs_on, at_zero, *motion
        return (*self.doing.values(), *samples, *calm, clear, *zero, asked, high, *more)

    def stands(self) -> bool:
        """Tell whether the joints are known to stand, where they are measured."""
        if 'joints' not in self.said:
            return True
        since = max(self.moved_at, -math.inf if self.told_at is None else self.told_at)
        seen = self.heard['joints'] > since
        return seen and self.said['joints'] == 'stand' and self.fresh('joints')

    def fresh(self, name: str) -> bool:
        return self.now - self.heard[name] < self.scene.timeout(name)


class World:
    """One arbiter, and the devices around it."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        limiter = JointLimiter([LIMIT] * scene.joints, max_dt=1.0)
        self.arbiter = Arbiter(scene.config, limiter, 0.0)
        self.memory = Memory(self.arbiter, scene.old)
        self.alphabet = events(scene)
        self.live: set[tuple[Any, ...]] = set()  # states from which motion is reached
        calm = scene.calm
        self.speak_all(calm, 0.0)
        decision = self.arbiter.tick(0.0)
        heard = dict.fromkeys(calm, 0.0)
        monitor = Monitor(scene.config, [LIMIT] * scene.joints)
        assert not [*monitor.decided(decision, 0.0)]
        self.log = Log(scene, 0.0, dict(calm), dict(calm), heard, dict(calm), decision, monitor)
        self.log.clear_since = 0.0
        self.log.long_silence = max(CLEAR, scene.reset_silence)

    def speak_all(self, doing: dict[str, str], now: float) -> None:
        for name, what in doing.items():
            self.speak(name, what, now)

    def speak(self, name: str, what: str, now: float) -> None:
        arbiter = self.arbiter
        if what == 'silent':
            return
        if name == 'mux':
            arbiter.hold(None if what == 'active' else Coded('mux.inactive', 'not active'))
        elif name == 'own':
            arbiter.own_estop_message('always', what == 'stop', now)
        elif name in SOURCES:
            doubled = 'two publishers are alive' if what == 'doubled' else None
            arbiter.set_invalid('e-stop source', name, 'publishers', doubled)
            arbiter.estop_message(name, what == 'stop', now)
        elif name == 'drive':
            arbiter.drive_enabled('', what == 'enabled', now)
        elif name == 'joints':
            arbiter.measured((SPEEDS.get(what, math.nan),), now)
        elif name == 'autonomy' and what == 'bad':
            arbiter.malformed('autonomy', 'autonomy', 'not finite', now)
        elif name == 'autonomy':
            arbiter.autonomy_command(self.scene.wish(name, what), now)
        elif what == 'bad':
            arbiter.malformed('operator', name, 'too few axes', now)
        else:
            arbiter.operator_sample(name, self.scene.sample(name, what), now)

    def call(self, service: str, now: float) -> Reply:
        if service == 'select':
            return self.arbiter.select_autonomy(True, now)
        if service == 'deselect':
            return self.arbiter.select_autonomy(False, now)
        if service == 'end trip':
            return self.arbiter.end_trip(now)
        return self.arbiter.trip(now) if service == 'trip' else self.arbiter.reset(now)

    def step(self, event: Event) -> None:
        """Advance by one step, and check the output against the log."""
        log = self.log
        log.now += STEP * event.steps
        now = log.now
        timeout = self.scene.timeout
        gaps = {n for n, heard in log.heard.items() if timeout(n) <= now - heard < math.inf}
        rested = {n: log.heard[n] - (log.calm_since.get(n) or math.inf) for n in OPERATORS}
        log.doing.update(event.changes)
        acted = {n for n in OPERATORS if acts(log, event, n, after_gap=n in gaps)}
        self.speak_all(log.doing, now)
        for name, what in log.doing.items():
            if what != 'silent':
                log.said[name] = what
                log.heard[name] = now
            if what not in ('silent', 'bad'):
                log.sample[name] = what
        reply = self.call(event.service, now) if event.service else Reply(False, '')
        if event.service == 'reset' and reply.ok:
            log.monitor.reset(now)
        for name, what in event.late:
            self.speak(name, what, now)
        before, decision = log.decision, self.arbiter.tick(now)
        Judge(log, event, gaps, acted, rested, reply, before, decision).judge()

    def possible(self) -> Iterator[Event]:
        return (event for event in self.alphabet if possible(self.log, event))

    def key(self) -> tuple[Any, ...]:
        return self.memory.key(self.log.now) + self.log.key()

    def take(self) -> Any:
        return self.memory.take(), self.log.copy()

    def give(self, memory: Any) -> None:
        taken, log = memory
        self.memory.give(taken)
        self.log = log.copy()

    def arrived(self) -> None:
        complete_status(self)
        self.check_liveness()

    def check_liveness(self) -> None:
        """See that all who behave get it to move, whatever was before."""
        now, calm = self.log.now, self.scene.calm

        def wait(steps: int, low: str = 'rest') -> Decision:
            nonlocal now
            for _ in range(steps):
                now += STEP
                self.speak_all(calm | {'low': low}, now)
                decision = self.arbiter.tick(now)
            return decision

        decision = wait(QUIET)
        key = self.memory.key(now)
        if key in self.live:
            return
        for _ in range(2):  # the first one may only end a trip
            if decision.state is State.STOPPED:
                self.arbiter.reset(now)
                decision = wait(QUIET)
        decision = wait(2, 'drive')
        assert decision.owner == 'low', f'no way to motion: {self.arbiter.status(now).inhibits}'
        assert any(decision.demand), 'in control, and nothing moves'
        self.live.add(key)


@dataclass
class Judge:
    """The rules, on one step from ``before`` to ``after``. Named as in the design."""

    log: Log
    event: Event
    gaps: set[str]  # inputs that were silent for too long before this step, whatever they say now
    acted: set[str]  # operators that left neutral, or pressed their deadman
    rested: dict[str, float]  # for how long operators had been neutral, up to the step before
    reply: Reply
    before: Decision
    after: Decision
    waited: bool = False  # for a drive, in the step before

    def judge(self) -> None:
        self.waited = self.log.monitor.waited
        waits = 'drive' in self.log.said and self.unwell('drive')
        for broken in self.log.monitor.decided(self.after, self.log.now, waits=waits):
            raise AssertionError(f'rule {broken.rule}: {broken.words}')
        self.note_motion()
        stops = self.stops(self.before.owner)
        self.note_clear(bool(stops))
        self.stop_beats_everything(stops)
        self.reset_is_an_edge_and_moves_nothing()
        self.control_is_acquired_or_taken_over()
        self.lost_or_released()
        self.nobody_drives_on_against_a_higher_operator()
        self.outputs()
        self.note_told_to_stand()
        self.note_calm()
        if self.before.owner == 'high' != self.after.owner:
            self.log.high_until = self.log.now
        if self.frozen:  # a frozen process heard nothing
            self.log.heard = dict.fromkeys(self.log.heard, -math.inf)
            self.log.sample |= dict.fromkeys(OPERATORS, 'rest')  # whatever comes next is new
        self.others_are_asked_to_stop()
        self.log.decision = self.after

    @property
    def scene(self) -> Scene:
        return self.log.scene

    @property
    def dt(self) -> float:
        return STEP * self.event.steps

    @property
    def frozen(self) -> bool:
        return self.dt > self.scene.stall_limit

    def unwell(self, name: str) -> bool:
        """Tell whether an input was, at any moment since the last tick, not what it should be."""
        lately = [what for who, what in self.event.late if who == name]
        said = self.log.said[name] in BAD or bool(BAD.intersection(lately))
        return name in self.gaps or not self.log.fresh(name) or said

    def stops(self, owner: str | None) -> set[str]:
        """Name what stops the machine with this owner; those of category 0 in upper case."""
        found = {
            name if self.category(name) else name.upper()
            for name in SOURCES
            if self.counts(name, owner) and self.unwell(name)
        }
        if owner is not None and self.unwell(owner):
            found.add('OWNER')
        if self.event.service == 'trip':
            found.add('TRIP')
        if self.log.said.get('mux') == 'inactive':
            found.add('HOLD')
        if owner is not None and 'joints' in self.log.said and self.unwell('joints'):
            found.add('JOINTS')
        if self.log.runs_on:
            found.add('MOTION')
        if self.frozen:
            found.add('FROZEN')
        return found

    def category(self, name: str) -> int:
        return {'always': 0, 'soft': 1, 'remote': self.scene.remote_category}[name]

    def counts(self, name: str, owner: str | None) -> bool:
        just_now = self.log.now - self.log.high_until < self.scene.timeout('remote')
        return name != 'remote' or owner == 'high' or just_now

    def others_are_asked_to_stop(self) -> None:
        """A source's own stop is passed on to all others, never its echo."""
        log = self.log
        if self.event.service == 'trip':
            log.trip = 'yes'
        elif self.event.service == 'reset' and log.trip == 'yes':
            log.trip = 'asked'
        if self.event.service in ('reset', 'end trip') and self.reply.ok:
            log.trip = 'no'
        own = {name: 'own' if name == 'always' and 'own' in log.said else name for name in SOURCES}
        demanding = set()
        for name in SOURCES:
            late = (name, 'stop') in self.event.late and own[name] == name
            well = all(log.fresh(each) for each in (name, own[name]))
            stop = log.said[own[name]] == 'stop' or log.said[name] == 'doubled' or late
            if (stop or not well) and self.counts(name, self.after.owner):
                demanding.add(name)
        for name, asked in self.after.stop_demand.items():
            wanted = bool(demanding - {name}) or log.runs_on
            if log.trip == 'no':
                assert asked == wanted, f'stop_demand of {name} is {asked}; {demanding} demand'
            elif log.trip == 'yes':
                assert asked, f'stop_demand of {name} is false in a trip'
            else:  # the reset may have ended the trip
                assert asked or not wanted, f'stop_demand of {name} is false for {demanding}'

    def note_motion(self) -> None:
        """Note motion that nobody asked for, until the joints stand."""
        log, asked = self.log, self.before.demand[0]
        if asked:
            log.moved_at = log.now
        if log.stands():
            log.told_at = log.fast_since = None
            log.runs_on = False
        elif log.told_at is not None:
            if log.now - log.told_at >= STOP_TIME:
                log.runs_on, log.told_at = True, None
        elif not log.runs_on:
            least, most = sorted((0.0, asked))
            speed = SPEEDS.get(log.said['joints'], 0.0) if log.fresh('joints') else 0.0
            margin = 0.1 if asked else 0.2
            if least - margin <= speed <= most + margin:
                log.fast_since = None
            elif log.fast_since is None:
                log.fast_since = log.now
            else:
                log.runs_on = log.now - log.fast_since >= FEEDBACK.overspeed_time

    def note_told_to_stand(self) -> None:
        """Note that the joints are told to stand; told again meanwhile, they have no more time."""
        log = self.log
        ended = self.before.enable and not self.after.enable
        waits = (log.must_reach_zero and not log.monitor.waited) or log.overruled
        at_zero = (
            self.after.state is State.ACTIVE
            and waits
            and not any(self.after.demand)
            and not log.stands()
        )
        if 'joints' in log.said and log.told_at is None and (ended or at_zero):
            log.told_at = log.now

    def note_clear(self, stopped: bool) -> None:
        log = self.log
        if stopped:
            log.clear_since = None
        elif log.clear_since is None:
            log.clear_since = log.now

    def stop_beats_everything(self, stops: set[str]) -> None:
        after = self.after.state
        if any(name.isupper() for name in stops):
            assert after is State.STOPPED, f'rules 1, 2: {stops} does not stop'
        elif stops:
            assert after in (State.STOPPED, State.STOPPING), f'rules 1, 2: {stops}'
        missed = self.stops(self.after.owner)
        if after in (State.READY, State.ACTIVE):
            assert not missed, f'rule 1: {after} in spite of {missed}'
        if after is State.STOPPING:
            assert not any(name.isupper() for name in missed), f'rule 1: ramp in spite of {missed}'
            assert self.before.enable, 'a ramp begins in ACTIVE'

    def reset_is_an_edge_and_moves_nothing(self) -> None:
        log = self.log
        was_reset = self.event.service == 'reset' and self.reply.ok
        if was_reset:
            assert self.before.state is State.STOPPED, 'rule 3: reset of what is not stopped'
            since = log.now if log.clear_since is None else log.clear_since
            assert log.now - since >= CLEAR or self.event.late, 'rule 3: before clear_time'
            for name in OPERATORS:
                if log.fresh(name) and name not in self.gaps:
                    assert log.said[name] == 'rest', f'rule 3: reset while {name} is not neutral'
            silent = math.inf if log.reset_at is None else log.now - log.reset_at
            assert silent >= log.silence, 'rule 3: repeated'
        if self.event.service == 'reset':
            if self.before.state is not State.STOPPED:
                log.silence = log.long_silence
            elif log.reset_at is None or log.now - log.reset_at >= log.silence:
                log.silence = CLEAR
            log.reset_at = log.now

    def control_is_acquired_or_taken_over(self) -> None:
        log, owner = self.log, self.after.owner
        if owner in (None, self.before.owner):
            return
        calm = log.calm_since.get(owner)  # up to the step before
        if owner == 'autonomy':
            assert self.event.service == 'select', 'rule 6: nobody selected autonomy'
            assert calm is not None, 'rule 4: autonomy was not at zero'
            assert log.heard[owner] - calm >= NEUTRAL, 'rule 4: autonomy too early'
        else:
            pressed = any(who == owner and what in DRIVING for who, what in self.event.changes)
            assert pressed, 'rule 4: no edge of the deadman'
            assert calm is not None, 'rule 4: was not neutral since the reset'
            assert self.rested[owner] >= NEUTRAL, 'rule 4: before neutral_time'
        log.must_reach_zero = True

    def lost_or_released(self) -> None:
        owner, state = self.before.owner, self.after.state
        if owner is None:
            return
        released = self.log.said[owner] not in DRIVING or (owner, 'rest') in self.event.late
        if self.unwell(owner):
            assert state is State.STOPPED, 'rule 6: a lost owner did not stop'
        elif owner in OPERATORS and released:
            assert state in (State.READY, State.STOPPED), 'a release did not release'
        elif self.event.service == 'deselect' and owner == 'autonomy':
            assert state in (State.READY, State.STOPPED), 'autonomy could not be deselected'

    def nobody_drives_on_against_a_higher_operator(self) -> None:
        log, owner = self.log, self.after.owner
        if owner is None or owner != self.before.owner or self.after.state is not State.ACTIVE:
            log.overruled = False
            return
        log.overruled |= any(RANK[name] > RANK[owner] for name in self.acted)
        if log.overruled:
            falls = (any(self.after.demand) or not log.stands()) and self.falls()
            assert falls, f'rule 7: {owner} drives on against {self.acted}'

    def falls(self) -> bool:
        """Tell whether each joint that is not at zero has come closer to it."""
        pairs = zip(map(abs, self.after.demand), map(abs, self.before.demand), strict=True)
        return all(
            value < was or value == 0.0 or self.dt == 0.0 == value - was for value, was in pairs
        )

    def outputs(self) -> None:
        """What the monitor cannot know: when it has to fall, and what the owner asks for."""
        log, before, after = self.log, self.before, self.after
        if not after.enable:
            return
        waits = 'drive' in log.said and self.unwell('drive')
        if waits or self.waited:
            assert after.state is State.ACTIVE, 'rule 10: a ramp that no drive follows'
        from_rest = waits and 'joints' in log.said
        log.must_reach_zero |= from_rest
        if after.state is State.STOPPING:
            assert self.falls(), 'rule 10: a ramp that does not go down'
        elif log.must_reach_zero:
            assert self.falls(), 'rule 7: not towards zero first'
            log.must_reach_zero = from_rest or any(after.demand) or not log.stands()
        elif after.owner is not None and not log.overruled:
            target = self.scene.target(after.owner, log.sample[after.owner])
            for was, value, goal in zip(before.demand, after.demand, target, strict=True):
                least, most = sorted((was, 0.0 if was * goal < 0.0 else goal))
                away = not (least <= value <= most or waits)
                assert not away, 'rule 5: away from what the owner demands'

    def note_calm(self) -> None:
        """Note since when each owner has been sending neutral; a stop and a reset forget it."""
        log = self.log
        forgotten = self.after.estop or (self.event.service == 'reset' and self.reply.ok)
        for name in RANK:
            deposed = name == self.before.owner != self.after.owner
            calm = log.said[name] == CALM[name] and log.fresh(name)
            late = any(who == name for who, _ in self.event.late)
            in_its_stop = name == 'high' and self.unwell('remote')
            if forgotten or deposed or not calm or late or in_its_stop:
                log.calm_since[name] = None
            elif name in self.gaps or log.calm_since.get(name) is None:
                log.calm_since[name] = None if log.doing[name] == 'silent' else log.now


def acts(log: Log, event: Event, name: str, *, after_gap: bool) -> bool:
    """Tell whether an operator leaves neutral, or presses its deadman; unseen counts, too."""
    said = 'rest' if after_gap else log.sample[name]
    if log.said[name] == 'bad' and said in DRIVING:
        said = 'off'  # it may have been let go of
    for who, what in (*event.changes, *event.late):
        if who == name and what in ('rest', 'off', *DRIVING):
            what = 'drive' if what in DRIVING else what
            if (said, what) in {('rest', 'off'), ('rest', 'drive'), ('off', 'drive')}:
                return True
            said = what
    return False


def events(scene: Scene) -> list[Event]:
    """Return all steps of a world."""
    free = scene.words
    changes = [((name, what),) for name, words in free.items() for what in words.split()]
    blips = [((name, 'stop'), (name, 'clear')) for name in free if name in SOURCES]
    blips += [(('drive', 'disabled'), ('drive', 'enabled'))] if 'drive' in free else []
    bounces = [((name, 'rest'), (name, 'drive')) for name in free if name in OPERATORS]
    presses = [change for change in changes if change[0][1] in DRIVING]
    services = ['reset', 'trip'] + (['select', 'deselect'] if 'autonomy' in free else [])
    services += ['end trip'] if 'own' in free else []
    found = [Event(), Event(steps=2)]
    found += [Event(changes=change) for change in changes]
    if 'high' in free and 'remote' in free:  # held through its own stop, in which it was neutral
        found.append(Event(changes=(('remote', 'clear'), ('high', 'drive'))))
    found += [Event(service=service) for service in services]
    found += [Event(late=late) for late in blips + bounces]
    found += [Event(service='reset', late=late) for late in blips[:1]]
    found += [Event(changes=change, late=late) for change in presses for late in blips[:1]]
    if scene.zero:
        found += [replace(event, steps=0) for event in found if event.steps == 1]
    return found


def possible(log: Log, event: Event) -> bool:
    """Tell whether a step makes sense here, with so many devices doing anything unusual."""
    doing = log.doing | dict(event.changes)
    if any(log.doing[name] == what for name, what in event.changes):
        return False
    calm = log.scene.calm
    if sum(what != calm[name] for name, what in doing.items()) > log.scene.most_uneasy:
        return False
    # What comes late in a step ends with what the device does anyway.
    return all(doing[name] == what for name, what in event.late[-1:])


def complete_status(world: World) -> None:
    """Rule 12: whatever does not move says why, and each input that is not well is named."""
    log, status = world.log, world.arbiter.status(world.log.now)
    words = '\n'.join(status.inhibits)
    if not any(log.decision.demand):
        assert status.inhibits, f'rule 12: nothing said in {log}'
    if status.state in (State.STOPPED, State.READY):
        for name in ('always', 'soft'):
            if log.said[name] != 'clear' or not log.fresh(name):
                assert f"e-stop source '{name}'" in words, f'rule 12: {name} not named: {words}'
        for name in OPERATORS:
            if log.said[name] != 'rest' or not log.fresh(name):
                assert f"'{name}'" in words, f'rule 12: {name} not named: {words}'
        assert ('call ~/reset' in words) == (status.state is State.STOPPED)


SCENES = {
    'autonomy': Scene(
        {'low': 'rest drive', 'autonomy': 'zero go silent bad', 'soft': 'clear stop'},
        states=5298,
        steps=72450,
    ),
    'remote': Scene(
        {'low': 'rest drive', 'high': 'rest drive silent', 'remote': 'clear stop silent'},
        states=19456,
        steps=218919,
    ),
    'stops': Scene(
        {'always': 'clear stop doubled silent', 'soft': 'clear stop', 'high': 'rest drive bad'},
        states=7032,
        steps=82148,
        reset_silence=OLD,  # here alone, as each moment to remember is many more states
    ),
    'owners': Scene(
        {'low': 'rest drive silent', 'high': 'rest off drive silent'}, states=13708, steps=128420
    ),
    'malformed': Scene(
        {'low': 'rest drive', 'high': 'rest off drive bad'}, states=4660, steps=40304
    ),
    'own topic': Scene(
        {'always': 'clear stop silent', 'own': 'clear stop silent', 'low': 'rest drive'},
        states=1753,
        steps=20638,
    ),
    'not active': Scene(
        {'mux': 'active inactive', 'low': 'rest drive', 'soft': 'clear stop'},
        states=399,
        steps=3762,
    ),
    'two joints': Scene(
        {'low': 'rest drive turn', 'high': 'rest drive', 'soft': 'clear stop'},
        states=4980,
        steps=60514,
        joints=2,
    ),
    'at the time-outs': Scene(
        {'always': 'clear silent', 'soft': 'clear silent', 'low': 'rest drive silent'},
        states=3739,
        steps=37722,
        timeouts={'always': 2 * STEP, 'soft': 3 * STEP, 'low': 2 * STEP},
        stall_limit=STEP,
    ),
    'short freezes': Scene(
        {'low': 'rest drive', 'high': 'rest drive silent', 'remote': 'clear stop'},
        states=25203,
        steps=280724,
        timeouts=dict.fromkeys(SOURCES, 3.5 * STEP) | dict.fromkeys(OPERATORS, NEUTRAL),
    ),
    'soft remote': Scene(
        {'low': 'rest drive', 'high': 'rest drive', 'remote': 'clear stop', 'soft': 'clear stop'},
        states=6353,
        steps=76147,
        remote_category=1,
    ),
    'no time': Scene(
        {'low': 'rest drive', 'always': 'clear stop', 'autonomy': 'zero go'},
        states=2752,
        steps=62176,
        zero=True,
    ),
    'drive': Scene(
        {'drive': 'enabled disabled silent', 'low': 'rest drive', 'soft': 'clear stop'},
        states=1512,
        steps=16448,
    ),
    'joints': Scene(
        {'joints': 'stand run silent bad', 'low': 'rest drive', 'soft': 'clear stop'},
        states=8730,
        steps=98590,
    ),
    'takeover': Scene(
        {'joints': 'stand creep reverse', 'low': 'rest drive', 'high': 'rest drive'},
        states=11627,
        steps=104560,
    ),
    'drive and joints': Scene(
        {
            'drive': 'enabled disabled',
            'joints': 'stand creep',
            'low': 'rest drive',
            'high': 'rest off',
        },
        states=5466,
        steps=53621,
    ),
    'together': Scene(
        {
            'always': 'clear stop',
            'soft': 'clear stop silent',
            'remote': 'clear stop',
            'low': 'rest drive',
            'high': 'rest drive',
            'autonomy': 'zero go',
        },
        states=18515,
        steps=295204,
        most_uneasy=2,
    ),
}


_NEAR = 150  # states


def visit(name: str, most: float = math.inf) -> None:
    scene = SCENES[name]
    check(World(scene), f'here.World(here.SCENES[{name!r}])', (scene.states, scene.steps), most)


@pytest.mark.parametrize('name', SCENES)
def test_every_state_near_the_start_keeps_every_rule(name: str) -> None:
    visit(name, _NEAR)


@pytest.mark.proof
@pytest.mark.parametrize('name', [name for name, each in SCENES.items() if each.states > _NEAR])
def test_every_reachable_state_keeps_every_rule(name: str) -> None:
    visit(name)
