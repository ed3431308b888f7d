"""
The rules under any story, with any times: what the exploration's even steps cannot show.

Hypothesis tells an arbiter whatever may happen, in any order and with any gap, and holds each
decision against what was last told.
"""

from dataclasses import dataclass
import math

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import invariant
from hypothesis.stateful import precondition
from hypothesis.stateful import rule
from hypothesis.stateful import RuleBasedStateMachine

from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit
from safety_mux.limits import JointLimiter
from safety_mux.protocol import Autonomy
from safety_mux.protocol import EStopSource
from safety_mux.protocol import MuxConfig
from safety_mux.protocol import Operator
from safety_mux.protocol import OperatorSample
from safety_mux.protocol import State

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
    neutral_time=0.1,
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
class Told:
    """What was last told of one input."""

    at: float = -math.inf
    bad: bool = True
    calm_since: float | None = None  # an unbroken row of neutral since the last reset or stop
    calm_until: float = 0.0


class Stories(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.now = 100.0
        self.arbiter = Arbiter(CONFIG, JointLimiter([LIMIT]), self.now)
        self.told = {name: Told() for name in TIMEOUTS}
        self.lapsed: set[str] = set()  # was not well at some moment since the last tick
        self.pressed: set[str] = set()
        self.holding: set[str] = set()
        self.was_reset = self.was_selected = False
        self.bad_until = self.now  # when a source that always counts was last not clear
        self.owner_since = self.now
        self.decision = self.before = self.arbiter.tick(self.now)
        self.dt = 0.0
        self.last_tick = self.now

    def tell(self, name: str, bad: bool) -> Told:
        told = self.told[name]
        if bad or not self.fresh(name):
            self.lapsed.add(name)
            told.calm_since = None
        told.at, told.bad = self.now, bad
        return told

    def fresh(self, name: str) -> bool:
        return self.now - self.told[name].at <= TIMEOUTS[name]

    def well(self, name: str) -> bool:
        return self.fresh(name) and not self.told[name].bad

    # What may happen.

    @rule(name=sources, value=st.booleans())
    def estop(self, name: str, value: bool) -> None:
        self.tell(name, value)
        self.arbiter.estop_message(name, value, self.now)

    @rule(name=operators, sample=samples)
    def stick(self, name: str, sample: OperatorSample) -> None:
        told = self.tell(name, False)
        since, length = told.calm_since, told.calm_until - (told.calm_since or 0.0)
        self.holding.discard(name)
        if sample.deadman:
            told.calm_since = None
            if since is not None and length >= CONFIG.neutral_time - 1e-9:
                self.pressed.add(name)
        elif sample.at_rest:
            told.calm_since = self.now if since is None else since
            told.calm_until = self.now
        elif not sample.neutral:
            told.calm_since = None
        if sample.deadman:
            self.holding.add(name)
        else:
            self.pressed.discard(name)
        self.arbiter.operator_sample(name, sample, self.now)

    @rule(name=operators)
    def senseless(self, name: str) -> None:
        self.tell(name, True)
        self.holding.discard(name)
        self.arbiter.operator_invalid(name, 'axis 0 is nan', self.now)

    @rule(value=demands)
    def autonomy(self, value: float) -> None:
        told = self.tell('autonomy', False)
        told.calm_since = (told.calm_since or self.now) if value == 0.0 else None
        told.calm_until = self.now
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
        for _ in range(6):
            for name in ('low', 'high'):
                self.stick(name, OperatorSample(True, False, (0.0,)))
            self.everything_is_well()
            self.autonomy(0.0)
            self.pass_time(0.05)
        self.reset()

    @rule()
    def run_with_all_at_rest(self) -> None:
        for _ in range(4):
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
            told = self.told[name]
            assert not self.fresh(name) or (not told.bad and name not in self.holding)
            told.calm_since = None
        self.told['autonomy'].calm_since = None

    @rule()
    def select(self) -> None:
        told = self.told['autonomy']
        if self.arbiter.select_autonomy(True, self.now).ok:
            self.was_selected = True
            assert self.decision.state is State.READY
            assert told.calm_since is not None
            assert told.calm_until - told.calm_since >= CONFIG.neutral_time - 1e-9, 'rule 4'
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
        for told in self.told.values():
            told.at, told.calm_since = -math.inf, None

    @rule()
    def tick(self) -> None:
        self.before, self.decision = self.decision, self.arbiter.tick(self.now)
        self.dt, self.last_tick = max(0.0, self.now - self.last_tick), self.now
        self.judge()
        self.lapsed.clear()
        self.pressed.clear()
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
        if now.estop:
            for told in self.told.values():
                told.calm_since = None
        if was.owner == 'autonomy' != now.owner:
            self.told['autonomy'].calm_since = None

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


TestStories = Stories.TestCase
TestStories.settings = settings(max_examples=100, stateful_step_count=50)
