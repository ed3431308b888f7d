# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The rules under any sequence of inputs and times, which the exploration's even steps do not cover.

Hypothesis gives an arbiter all kinds of input, in any order and with any gap, and checks each
decision against the newest input.
"""

from dataclasses import dataclass, replace
import math

from hypothesis import settings, strategies as st
from hypothesis.stateful import invariant, precondition, rule, RuleBasedStateMachine

from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import OperatorSample, State
from safety_mux.settings import Autonomy, EStopSource, MuxConfig, Operator

CONFIG = MuxConfig(
    joints=1,
    sources=(
        EStopSource('always', timeout=0.2),
        EStopSource('soft', timeout=0.3, stop_category=1),
        EStopSource('remote', timeout=0.25, counts='when_owner', operator='high'),
    ),
    operators=(Operator('low', 1, timeout=0.2), Operator('high', 2, timeout=0.3)),
    autonomy=Autonomy(timeout=0.25),
    clear_time=0.2,
    neutral_time=0.3,
    hold_time=0.15,
    stall_limit=0.1,
    stop_time=0.2,
)
LIMIT = JointLimit(magnitude=1.0, acceleration=5.0, deceleration=10.0)
TIMEOUTS = {source.name: source.timeout for source in CONFIG.sources}
TIMEOUTS |= {'low': 0.2, 'high': 0.3, 'autonomy': 0.25}
RANK = {'autonomy': 0, 'low': 1, 'high': 2}

sources = st.sampled_from(['always', 'soft', 'remote'])
operators = st.sampled_from(['low', 'high'])
demands = st.sampled_from([0.0, 0.5, 1.0, -1.0, 1e9])
samples = st.builds(
    OperatorSample,
    neutral=st.booleans(),
    deadman=st.booleans(),
    demand=demands.map(lambda value: (value,)),
    partial=st.booleans(),
)


@dataclass
class Heard:
    """The newest message of one input."""

    at: float = -math.inf
    bad: bool = True
    calm_since: float | None = None  # unbroken neutral since the last reset or stop
    calm_until: float = 0.0


class Sequences(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.now = 100.0
        self.arbiter = Arbiter(CONFIG, JointLimiter([LIMIT]), self.now)
        self.heard = {name: Heard() for name in TIMEOUTS}
        self.lapsed: set[str] = set()  # was not well at some moment since the last tick
        self.pressed: set[str] = set()
        self.newest: dict[str, OperatorSample] = {}
        self.acted: set[str] = set()  # left neutral or pressed a deadman, since the last tick
        self.overruled = False
        self.holding: set[str] = set()
        self.was_reset = self.was_selected = False
        self.bad_until = self.now  # when a source that always counts was last not clear
        self.owner_since = self.now
        self.decision = self.before = self.arbiter.tick(self.now)
        self.dt = 0.0
        self.last_tick = self.now

    def hear(self, name: str, bad: bool) -> Heard:
        heard = self.heard[name]
        if bad or not self.fresh(name):
            self.lapsed.add(name)
            heard.calm_since = None
        heard.at, heard.bad = self.now, bad
        return heard

    def fresh(self, name: str) -> bool:
        return self.now - self.heard[name].at <= TIMEOUTS[name]

    def well(self, name: str) -> bool:
        return self.fresh(name) and not self.heard[name].bad

    # What may happen.

    @rule(name=sources, value=st.booleans())
    def estop(self, name: str, value: bool) -> None:
        self.hear(name, value)
        self.arbiter.estop_message(name, value, self.now)

    @rule(name=operators, sample=samples)
    def stick(self, name: str, sample: OperatorSample) -> None:
        before = self.newest.get(name) if self.fresh(name) else None
        heard = self.hear(name, False)
        since, length = heard.calm_since, heard.calm_until - (heard.calm_since or 0.0)
        self.holding.discard(name)
        self.newest[name] = sample
        if (not sample.neutral and (before is None or before.neutral)) or (
            sample.deadman and (before is None or not before.deadman)
        ):
            self.acted.add(name)
        if sample.deadman:
            heard.calm_since = None
            if since is not None and length >= CONFIG.neutral_time - 1e-9:
                self.pressed.add(name)
        elif sample.at_rest:
            heard.calm_since = self.now if since is None else since
            heard.calm_until = self.now
        elif not sample.neutral:
            heard.calm_since = None
        if sample.deadman:
            self.holding.add(name)
        else:
            self.pressed.discard(name)
        self.arbiter.operator_sample(name, sample, self.now)

    @rule(name=operators)
    def senseless(self, name: str) -> None:
        self.hear(name, True)
        self.holding.discard(name)
        if name in self.newest:  # it may be let go of, and pressed anew
            self.newest[name] = replace(self.newest[name], deadman=False)
        self.arbiter.malformed('operator', name, 'axis 0 is nan', self.now)

    @rule(value=demands)
    def autonomy(self, value: float) -> None:
        heard = self.hear('autonomy', False)
        heard.calm_since = (heard.calm_since or self.now) if value == 0.0 else None
        heard.calm_until = self.now
        self.arbiter.autonomy_command((value,), self.now)

    @rule()
    def everything_is_well(self) -> None:
        for name in ('always', 'soft', 'remote'):
            self.estop(name, False)
        for name in ('low', 'high'):
            if name not in self.holding:
                self.stick(name, OperatorSample(True, False, (0.0,)))
            else:
                self.stick(name, OperatorSample(False, True, (1.0,)))

    @rule()
    def run_and_reset(self) -> None:
        for _ in range(8):
            for name in ('low', 'high'):
                self.stick(name, OperatorSample(True, False, (0.0,)))
            self.everything_is_well()
            self.autonomy(0.0)
            self.pass_time(0.05)
        self.reset()

    @rule()
    def run_with_all_at_rest(self) -> None:
        for _ in range(8):
            for name in ('low', 'high'):
                if name != self.decision.owner:
                    self.stick(name, OperatorSample(True, False, (0.0,)))
            self.everything_is_well()
            self.autonomy(0.0)
            self.pass_time(0.05)

    @rule(name=operators, demand=demands)
    def acquire(self, name: str, demand: float) -> None:
        if self.decision.state is State.STOPPED:
            self.run_and_reset()
            self.tick()
        self.run_with_all_at_rest()
        self.stick(name, OperatorSample(False, True, (demand,)))
        self.tick()

    @precondition(lambda self: self.decision.owner != 'high')
    @rule(demand=demands)
    def hold_through_own_stop(self, demand: float) -> None:
        if self.decision.state is State.STOPPED:
            self.run_and_reset()
            self.tick()
        for _ in range(8):
            self.everything_is_well()
            self.estop('remote', True)
            self.stick('high', OperatorSample(True, False, (0.0,)))
            self.autonomy(0.0)
            self.pass_time(0.05)
        self.estop('remote', False)
        self.stick('high', OperatorSample(False, True, (demand,)))
        self.tick()

    @precondition(lambda self: self.decision.owner is None)
    @rule(demand=demands)
    def hand_to_autonomy(self, demand: float) -> None:
        if self.decision.state is State.STOPPED:
            self.run_and_reset()
            self.tick()
        self.run_with_all_at_rest()
        self.select()
        self.autonomy(demand)
        self.tick()

    @precondition(lambda self: self.decision.owner is not None)
    @rule(demand=demands)
    def drive_on(self, demand: float) -> None:
        for _ in range(3):
            self.everything_is_well()
            self.autonomy(demand)
            self.pass_time(0.05)

    @precondition(lambda self: self.decision.owner is not None)
    @rule()
    def soft_stop(self) -> None:
        self.everything_is_well()
        self.autonomy(1.0)
        self.estop('soft', True)
        self.pass_time(0.01)

    @rule()
    def reset(self) -> None:
        reply = self.arbiter.reset(self.now)
        if not reply.ok:
            return
        self.was_reset = True
        assert self.decision.state is State.STOPPED
        for name in ('always', 'soft'):
            assert self.well(name)
            assert name not in self.lapsed
        assert self.now - self.bad_until >= CONFIG.clear_time - 1e-9, 'rule 3'
        for name in ('low', 'high'):
            heard = self.heard[name]
            assert not self.fresh(name) or (not heard.bad and name not in self.holding)
            heard.calm_since = None
        self.heard['autonomy'].calm_since = None

    @rule()
    def select(self) -> None:
        heard = self.heard['autonomy']
        if self.arbiter.select_autonomy(True, self.now).ok:
            self.was_selected = True
            assert self.decision.state is State.READY
            assert heard.calm_since is not None
            assert heard.calm_until - heard.calm_since >= CONFIG.neutral_time - 1e-9, 'rule 4'
            assert self.well('autonomy')

    @rule()
    def deselect(self) -> None:
        self.arbiter.select_autonomy(False, self.now)

    @rule()
    def trip(self) -> None:
        self.arbiter.trip(self.now)
        self.lapsed.add('trip')

    @rule(seconds=st.sampled_from([0.0, 0.001, 0.01, 0.05, 0.1]))
    def pass_time(self, seconds: float) -> None:
        self.now += seconds
        self.tick()

    @rule(seconds=st.sampled_from([0.11, 0.5, 3600.0, -0.01, -3600.0]))
    def freeze(self, seconds: float) -> None:
        self.now += seconds
        self.lapsed.add('frozen')
        self.tick()
        for heard in self.heard.values():
            heard.at, heard.calm_since = -math.inf, None

    @rule()
    def tick(self) -> None:
        self.before, self.decision = self.decision, self.arbiter.tick(self.now)
        self.dt, self.last_tick = max(0.0, self.now - self.last_tick), self.now
        self.judge()
        self.lapsed.clear()
        self.pressed.clear()
        self.acted.clear()
        self.was_reset = self.was_selected = False

    # What must hold.

    def unwell(self, *names: str) -> bool:
        return any(name in self.lapsed or not self.well(name) for name in names)

    def judge(self) -> None:
        now, was = self.decision, self.before
        edge = bool(self.lapsed & {'trip', 'frozen'})
        if edge or self.unwell('always', 'soft'):
            self.bad_until = self.now
        if now.state in (State.READY, State.ACTIVE):
            assert not edge, 'rule 2'
            assert not self.unwell('always', 'soft'), 'rules 1, 2'
        if now.owner is not None:
            assert not edge, 'rule 2'
            assert not self.unwell('always', now.owner), 'rules 1, 6'
            assert now.owner != 'high' or not self.unwell('remote'), 'rule 1: when_owner'
            assert now.owner == 'autonomy' or now.owner in self.holding, 'no deadman'
        if was.estop and not now.estop:
            assert self.was_reset, 'rule 3'
        if now.owner not in (None, was.owner):
            self.judge_new_owner()
        self.judge_overruled()
        if now.estop:
            for heard in self.heard.values():
                heard.calm_since = None
        if was.owner == 'autonomy' != now.owner:
            self.heard['autonomy'].calm_since = None
        if self.unwell('remote'):
            self.heard['high'].calm_since = None

    def judge_new_owner(self) -> None:
        owner, previous = self.decision.owner, self.before.owner
        assert owner is not None
        if owner == 'autonomy':
            assert self.was_selected, 'rule 6'
        else:
            assert owner in self.pressed, 'rule 4'
        if previous is not None:
            assert RANK[owner] > RANK[previous], 'rule 7'
            held = self.now - self.owner_since >= CONFIG.hold_time - 1e-9
            assert held or previous == 'autonomy', 'rule 7: hold_time'
        else:
            assert self.before.state is State.READY, 'rule 4'
            assert self.decision.demand == (0.0,), 'rule 5'
        self.owner_since = self.now

    def judge_overruled(self) -> None:
        now, was = self.decision, self.before
        if now.owner is None or now.owner != was.owner or now.state is not State.ACTIVE:
            self.overruled = False
            return
        self.overruled |= any(RANK[name] > RANK[now.owner] for name in self.acted)
        if self.overruled:
            value, before = abs(now.demand[0]), abs(was.demand[0])
            assert value > 0.0, 'rule 7: not READY at zero'
            assert value < before or self.dt == 0.0, 'rule 7: against a higher operator'

    @invariant()
    def outputs_agree(self) -> None:
        now, was = self.decision, self.before
        active = now.state in (State.ACTIVE, State.STOPPING)
        assert now.enable == active == (now.owner is not None)
        assert now.estop == (now.state is State.STOPPED)
        value, before = now.demand[0], was.demand[0]
        if not active:
            assert value == 0.0
            return
        assert abs(value) <= LIMIT.magnitude
        assert value * before >= 0.0
        rate = LIMIT.deceleration if abs(value) <= abs(before) else LIMIT.acceleration
        assert abs(value - before) <= rate * self.dt + 1e-9

    @invariant()
    def status_has_the_answer(self) -> None:
        status = self.arbiter.status(self.now)
        assert status.inhibits or any(self.decision.demand) or status.state is State.ACTIVE


TestSequences = Sequences.TestCase
TestSequences.settings = settings(max_examples=100, stateful_step_count=50)
