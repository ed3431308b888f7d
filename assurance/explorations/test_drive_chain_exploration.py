# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Mux, drive node and drive together, in every state that they can reach; see assurance/explorer.py.

Each has been explored alone. Here the drive's motion is judged by what the operator and the stop
sources said: no motion but with a deadman pressed after the last reset, and by no older news than
the time-outs allow. In the scene *network* the drive's node has proofs, over a way that delays or
loses all that the mux says: there no news is older than the limit of age. From every state a quiet
while, a reset and the deadman lead to motion again.
"""

from collections.abc import Iterator
from dataclasses import dataclass
import math
from typing import Any

import pytest

from assurance.explorations.test_mux_gate_exploration import (
    carried,
    LATE,
    READER,
    renumber,
    Said,
)
from assurance.explorations.test_safety_mux_exploration import (
    CLEAR,
    Memory as ArbiterMemory,
    NEUTRAL,
    STEP,
    TIMEOUT,
)
from assurance.explorer import explore, Memory, Remembered, START, visits_of
from bridge_core.mux_words import MuxWords
from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.session import Session
from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import Decision, OperatorSample, State
from safety_mux.settings import EStopSource, MuxConfig, Operator
from stage.esi_drive_rig import axes, fields, IDLE, make_settings, RUNNING, status

pytestmark = pytest.mark.computes
FRESH, LINK, ENABLE, AGE = 2 * STEP, 3 * STEP, 4 * STEP, 2 * STEP
FULL, GROWTH = 8, 4  # counts; counts a packet
QUIET = 8  # steps
FAULT = status(2, errors=1)
SAMPLES = {
    'rest': OperatorSample(neutral=True, deadman=False, demand=(0.0,)),
    'drive': OperatorSample(neutral=False, deadman=True, demand=(1.0,)),
}
WORDS = {
    'operator': ('rest', 'drive', 'silent'),
    'source': ('clear', 'stop', 'silent'),
    'mux': ('runs', 'frozen'),
    'wire': ('joined', 'cut', 'deaf', 'off'),  # between mux and drive node; see TO, FRO
    'drive': ('well', 'lazy', 'faulty', 'mute'),  # lazy: it never enables
    'network': ('joined', 'late', 'cut'),  # from mux to drive node, in the scene that has one
}
TO, FRO = ('joined', 'deaf'), ('joined', 'cut')  # wires that carry commands, and what is said back
CONFIG = MuxConfig(
    joints=1,
    sources=(EStopSource('source', TIMEOUT), EStopSource('drive', TIMEOUT)),
    operators=(Operator('low', 1, TIMEOUT),),
    drives=('',),
    drive_timeout=TIMEOUT,
    clear_time=CLEAR,
    neutral_time=NEUTRAL,
    stall_limit=TIMEOUT,
    reset_silence=0.0,
)
SETTINGS = make_settings(
    axes=axes(Mode.VELOCITY, slew_limit=GROWTH / STEP),
    command_rate=1.0 / STEP,
    command_timeout=FRESH,
    link_timeout=LINK,
    enable_timeout=ENABLE,
)
APART = (
    'memory', 'naming', 'of_arbiter', 'live', 'now', 'words', 'config', 'settings', 'counters',
    '_format', 'last_stop', '_reported_at', '_sent_at', '_gap_at', '_gap',
    '_saturated', 'refused_commands', 'saturations', '_own_gap', '_garbage_since', '_transition',
    '_offered', '_astray_since', 'span', 'damaged', 'repeated', 'unasked', 'hold',
    '_worst_before', '_pacer', '_vouched', '_command_age', '_heard_at', '_second_at', '_worst',
)  # fmt: skip
UNNAMED = ('_quiet_until', '_stepped_at', 'status', '_status')
OLD = {'': LINK, '_at': STEP, '_until': 0.0, '_waits_until': 0.0, '_next_send': 0.0}  # see Memory
OLD |= {'at': (LATE + 1) * STEP, '_old_at': 0.0}
NEVER = ('_stopped_at', '_disabled_at', '_old_at')


@dataclass(slots=True)
class Told(Said):
    """What the mux said, and demanded."""

    demand: float = 0.0


class Motor:
    """The drive: it enables a step after it was told to, and disables in silence."""

    def __init__(self) -> None:
        self.told = False
        self.enabled = False
        self.value = 0

    def take(self, frames: list[bytes], doing: str) -> None:
        """Obey the packets of one step."""
        ready = self.told and doing in ('well', 'mute')
        self.enabled = bool(frames) and ready
        for frame in frames:
            (self.told, _, value), _ = fields(frame)
            self.enabled &= self.told
            assert not value or value * self.value >= 0.0
            assert abs(value) <= abs(self.value) + GROWTH, 'a step'
            self.value = value

    def status(self, doing: str) -> bytes:
        if doing == 'faulty':
            return FAULT
        return RUNNING if self.enabled else IDLE

    @property
    def moves(self) -> bool:
        return self.enabled and self.value != 0


class World(Remembered):
    """All three, and the log of what was said to the mux."""

    def __init__(self, **words: str) -> None:
        self.now = START
        limiter = JointLimiter([JointLimit(1.0, 1.0 / STEP, 0.5 / STEP)], max_dt=1.0)
        self.arbiter = Arbiter(CONFIG, limiter, self.now)
        mux = MuxWords('/mux', required=True, age_limit=AGE, identity=READER)
        mux._age.hold = 0.0  # it is in the world of test_mux_words_exploration
        self.session = Session(SETTINGS, mux if 'network' in words else None)
        self.newest = Told(self.now, True, False, 0, 0, 0, -math.inf)
        self.on_the_way: list[Told] = []
        self.motor = Motor()
        self.words = {name: each.split() for name, each in words.items()}
        self.doing = {name: each[0] for name, each in WORDS.items()}
        self.said = {'operator': 'rest', 'source': 'clear'}
        self.heard = dict.fromkeys(('operator', 'source', 'node', 'status'), self.now)
        self.reset = False  # since the last stop
        self.rest_since: float | None = None  # since when the operator has been at rest
        self.pressed = False  # since then, and held
        self.enables = False  # so the mux said last: somebody is in control
        self.granted_at = -math.inf  # the last news to the drive's node that permits motion
        self.live: set[Any] = set()
        self.memory = Memory(self, OLD, APART, UNNAMED, NEVER)
        self.naming = Memory(self, OLD, (*APART, 'arbiter'), UNNAMED, NEVER)
        self.of_arbiter = ArbiterMemory(self.arbiter, OLD[''])
        self.session.opened(self.now)
        self.step('')

    def possible(self) -> Iterator[str]:
        yield from ('', 'reset', 'trip')
        for name, words in self.words.items():
            yield from (f'{name} {what}' for what in words if what != self.doing[name])

    def step(self, event: str) -> None:
        self.now += STEP
        name, _, what = event.partition(' ')
        if name in WORDS:
            self.doing[name] = what
        if self.doing['mux'] == 'runs':
            self.tick(event)
        self.run_drive()
        self.judge()

    def tick(self, event: str) -> None:
        """Let the mux hear all, decide, and tell the drive's node."""
        arbiter, now, doing = self.arbiter, self.now, self.doing
        lapsed = {each for each in self.said if now - self.heard[each] >= TIMEOUT}
        self.reset &= not ('source' in lapsed or (lapsed and self.enables))
        self.pressed &= not lapsed
        if lapsed:
            self.rest_since = None
        rested = self.rest_since is not None
        if rested and event == 'operator drive':
            self.pressed = self.heard['operator'] - (self.rest_since or 0.0) >= NEUTRAL
        if doing['operator'] != 'silent':
            arbiter.operator_sample('low', SAMPLES[doing['operator']], now)
        if doing['source'] != 'silent':
            arbiter.estop_message('source', doing['source'] == 'stop', now)
        for each in ('operator', 'source'):
            if doing[each] != 'silent':
                self.said[each], self.heard[each] = doing[each], now
        if self.said['operator'] != 'rest':
            self.rest_since = None
        elif self.rest_since is None and doing['operator'] == 'rest':
            self.rest_since = now
        if doing['wire'] in FRO:
            self.heard['node'] = now
            arbiter.estop_message('drive', self.session.estop, now)
            arbiter.drive_enabled('', self.session.enabled, now)
        if event == 'trip':
            arbiter.trip(now)
        done = event == 'reset' and arbiter.reset(now).ok
        self.rest_since = None if done else self.rest_since
        decision = arbiter.tick(now)
        stopped = event == 'trip' or self.said['source'] == 'stop' or self.session.estop
        silent = any(now - self.heard[each] >= TIMEOUT for each in ('source', 'node'))
        self.reset = (self.reset or done) and not (stopped or silent)
        away = now - self.heard['operator'] >= TIMEOUT or self.said['operator'] != 'drive'
        self.pressed &= self.reset and not away
        self.enables = decision.enable
        if doing['wire'] in TO:
            if 'network' in self.words:
                self.granted_at = now if self.pressed else self.granted_at
                self.send(decision)
            else:
                self.granted_at = now if self.pressed else -math.inf
                self.tell(decision.estop, decision.demand[0], decision.enable)

    def tell(self, estop: bool, demand: float, enable: bool) -> None:
        """Have the drive's node hear what the mux says."""
        self.session.set_estop(estop, self.now)
        self.session.set_command((demand * FULL, 0.0), self.now)
        self.session.set_enable(enable, self.now)

    def send(self, decision: Decision) -> None:
        """Ask the mux for its age, and have the drive's node hear what comes of what it says."""
        mux, before = self.session.mux, self.newest
        mux.ask(self.now)
        self.newest = Told(
            *(self.now, decision.estop, decision.enable, before.number + 1),
            before.stops + (decision.estop and not before.estop),
            before.falls + (before.enable and not decision.enable),
            asked=self.now,
            demand=decision.demand[0],
        )
        for told in carried(self.on_the_way, self.newest, self.doing['network']):
            self.tell(told.estop, told.demand, told.enable)
            self.session.hear_proof(told.proof(), self.now)
        renumber(mux._reader, [self.newest, *self.on_the_way], self.now)

    def run_drive(self) -> None:
        """Let the drive and its node hear of each other."""
        if self.doing['drive'] != 'mute':
            self.heard['status'] = self.now
            self.session.receive(self.motor.status(self.doing['drive']), self.now)
        frames = self.session.poll(self.now)[1]
        for frame in frames:
            self.session.sent(frame, self.now)
        self.motor.take(frames, self.doing['drive'])
        if self.session.estop:
            self.reset = self.pressed = False

    def judge(self) -> None:
        motor = self.motor
        if motor.moves:
            assert motor.value > 0, 'the other way'
            oldest = AGE + STEP if 'network' in self.words else FRESH
            assert self.now - self.granted_at < oldest, f'unwanted motion: {self.doing}'
            assert self.now - self.heard['status'] < LINK, 'motion of a drive that is not heard'
            assert self.doing['drive'] in ('well', 'mute')

    def arrived(self) -> None:
        """Who all are well again bring it to motion."""
        for name, words in WORDS.items():
            if self.doing[name] != words[0]:
                self.step(f'{name} {words[0]}')
        for _ in range(QUIET):
            self.step('')
        key = self.key()
        if key in self.live:
            return
        for _ in range(2):  # the first one may only end a trip
            if self.arbiter.state is State.STOPPED:
                self.step('reset')
                for _ in range(QUIET):
                    self.step('')
        for event in ('operator drive', '', '', '', ''):
            self.step(event)
        inhibits = self.arbiter.status(self.now).inhibits, self.session.inhibits(self.now)
        assert self.motor.moves, f'no way to motion: {inhibits}'
        self.live.add(key)

    def key(self) -> tuple[Any, ...]:
        return self.naming.key() + self.of_arbiter.key(self.now)


SCENES: dict[str, dict[str, Any]] = {
    'operator': {'operator': 'rest drive silent', 'source': 'clear stop silent'},
    'processes': {'operator': 'rest drive', 'mux': 'runs frozen', 'wire': 'joined cut deaf off'},
    'drive': {'operator': 'rest drive', 'drive': 'well lazy faulty mute'},
}
COUNTS: dict[str, tuple[int, int]] = {
    'operator': (4935, 34545),
    'processes': (40818, 326544),
    'drive': (5777, 40439),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=200)
NETWORK = {'operator': 'rest drive', 'network': 'joined late cut'}


@pytest.mark.parametrize('most', [200, pytest.param(10_000, marks=pytest.mark.proof)])
def test_states_near_the_start_over_a_network(most: int) -> None:
    """There are more states than anybody has waited for."""
    explore(World(**NETWORK), 'here.World(**here.NETWORK)', most)


LATE_WAY = (*['network late', *8 * ['']], 'reset', *5 * [''], 'operator drive', *16 * [''])


@pytest.mark.parametrize('is_bounded', [True, False])
def test_deadman_that_is_let_go_of_over_a_late_network_moves_nothing(is_bounded: bool) -> None:
    """Deeper than the states above; the rule notices a drive that does not bound ages."""
    world = World(**NETWORK)
    if not is_bounded:
        world.session.mux._age.timeout = math.inf
    world.play(*8 * [''], *LATE_WAY)
    assert world.motor.moves is not is_bounded
    if is_bounded:
        world.play('operator rest', *8 * [''])
        return
    with pytest.raises(AssertionError, match='unwanted motion'):
        world.play('operator rest', *8 * [''])
