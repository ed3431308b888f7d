# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every state of a mux and of nodes that prove to it how old their words are; see explorer.py.

The arbiter is explored with its readers of proofs, between links that are late or lose words,
nodes that restart, clocks that are set, a mux that freezes or is activated anew.
Rules are about what was said when, whatever the mux believes: nothing moves on news beyond LIMIT,
nor on what was told before an activation or a freeze; a stop that is told is obeyed, any other
within LIMIT; after it nothing moves before a reset made once it was over, and a deadman pressed
after that. Once all is well, motion is possible again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
import math
from types import SimpleNamespace
from typing import Any

import pytest

from assurance.explorations.test_mux_gate_exploration import READER, renumber, Said
from assurance.explorer import explore, Memory, Remembered, START, visits_of
from bridge_core.parameters import MANAGED_PARAMETERS, resolve
from bridge_core.proof import Proof, Reader, TOGETHER_TIME, Vouched
from safety_mux.arbiter import Arbiter
from safety_mux.configuration import mux_config
from safety_mux.inputs import Input
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.parameters import parameter_table
from safety_mux.proofs import proven_nodes, ProvenNode
from safety_mux.protocol import OperatorSample, State

pytestmark = pytest.mark.computes
STEP = 0.125
LIMIT, TIMEOUT, SILENCE = 3 * STEP, 2.5 * STEP, STEP
LATE = 3  # steps that a word takes at most
CLOCK = 10_000_000_000  # ns by which a clock is set
SAMPLES = {
    'rest': OperatorSample(neutral=True, deadman=False, demand=(0.0,)),
    'hold': OperatorSample(neutral=False, deadman=True, demand=(1.0,)),
}
GIVEN: dict[str, Any] = {
    'joints': ['it'],
    'estop_sources': ['it'],
    'operators': ['it'],
    'estop.it.topic': '/remote/estop',
    'drive_enabled_topic': '/drive/enabled',
    **dict.fromkeys(('neutral_time', 'estop.it.timeout', 'operator.it.timeout'), TIMEOUT),
    **dict.fromkeys(('estop.it.age_limit', 'operator.it.age_limit'), LIMIT),
    'drive_enabled_timeout': TIMEOUT,
    'drive_enabled_age_limit': LIMIT,
    'clear_time': STEP,
    'stall_limit': 1.5 * STEP,
    'reset_silence': 0.0,
}

APART = (  # see Memory
    *('memory', 'events', 'horizon', 'values', 'now', 'live', 'told', 'config', '_config'),
    *('transition', '_owned_until', '_named', 'sources', 'operators', 'guards', 'drives'),
    *('speed_limits', 'label', 'name', 'device_words', '_of_device', '_creeps', '_worst'),
    *('damaged', 'repeated', 'unasked', '_least', 'go_on', '_limits', '_accelerations'),
    *('_together', '_magnitudes', '_rates'),
)
NEVER = (
    '_second_at', '_stopped_at', '_own_stopped_at', 'proved_at', 'unfair_since', 'stopped_at',
    'told_at', 'young_at', 'joy_at',
)  # fmt: skip


@dataclass(slots=True)
class Word(Said):
    """
    What a node said at a moment.

    :param joy: of its operator; '': none. :param stamp: of its newest Joy. :param stopped_at: when
        its newest stop had begun.
    """

    writer: int
    joy: str
    stamp: int
    stopped_at: float

    def proof(self) -> bytes:
        answers = () if self.asked == -math.inf else ((READER, round(self.asked * 1e9)),)
        numbers = (self.writer, self.number, self.stops, self.falls)
        flags = (self.estop, self.estop, self.enable)
        return Proof(*numbers, *flags, self.stamp, answers).to_bytes()


class Node:
    """
    A node, its link to the mux, and what the mux was told of it.

    Plain words and proofs take so many steps each ('0' to '3'), or never come ('cut').
    """

    def __init__(self, now: float, joy: str) -> None:
        self.clock = 4 * CLOCK  # ns
        self.newest = Word(now, False, False, 0, 0, 0, -math.inf, 0, joy, 0, -math.inf)
        self.ways = {'plain': '0', 'proofs': '0'}
        self.plain: list[Word] = []
        self.proofs: list[Word] = []
        self.proves = False  # a proof was heard
        self.proved_at = -math.inf  # when the newest was made
        self.forget()

    def forget(self) -> None:
        """Have nothing of before now trusted."""
        self.told_at = self.young_at = self.joy_at = -math.inf  # words, proofs, Joys
        self.says_stop, self.says_enable = True, False  # by the newest of all

    def carry(self, kind: str) -> list[Word]:
        """Return what arrives, in its order."""
        queue: list[Word] = getattr(self, kind)
        queue.append(replace(self.newest))
        if kind == 'plain':  # states differ by no more than it says
            queue[-1] = replace(
                queue[-1], number=0, stops=0, falls=0, asked=0.0, writer=0, stopped_at=0.0
            )
        way = self.ways[kind]
        arrives = [queue.pop(0) for _ in range(len(queue) - (0 if way == 'cut' else int(way)))]
        return [] if way == 'cut' else arrives


class World(Remembered):
    """
    A step: each node answers a challenge and speaks, what arrives is heard, the mux decides.

    ``remote`` is the stop source and the operator, or ``pad`` is the operator; ``drive`` says
    whether it is enabled. Events: 'NODE both WAY', or plain, or proofs; 'NODE restart'; 'NODE
    back', 'NODE forth' (its clock); of the source 'stop', 'clear', 'blip' (a stop that is over at
    once); of the operator 'rest', 'hold'; 'drive off', 'drive on' (it does what it is told);
    'reset', 'activate' (with other parameters), 'freeze'.
    """

    def __init__(self, events: str, operator: str = 'remote', proof: str = 'auto') -> None:
        self.now = START
        self.events = events.split(', ')
        late = max(int(event[-1]) for event in self.events if event[-1].isdigit())
        self.horizon = (late + 1) * STEP  # what is on the way is younger
        given = GIVEN | {'operator.it.topic': f'/{operator}/joy'}
        given |= {'estop.it.proof': proof, 'drive_enabled_proof': proof}
        given |= {'operator.it.proof': 'none' if operator == 'foreign' else proof}
        self.values = resolve((*MANAGED_PARAMETERS, *parameter_table(given)), given)
        names = dict.fromkeys(('remote', 'drive', operator))
        self.nodes = {name: Node(self.now, 'rest' * (name == operator)) for name in names}
        self.remote, self.drive = self.nodes['remote'], self.nodes['drive']
        self.operator = self.nodes[operator]
        self.began_at = math.inf  # of the stop that stands
        self.stop_since = math.inf  # the first stop that was not over at the last reset
        self.unfair_since = -math.inf  # no deadman is held that was pressed after the last reset
        self.off_since = self.restart_at = math.inf  # of the drive; until it was seen
        self.obeys = True  # the drive
        self.enable = False  # as it is told
        self.told: set[str] = set()  # in this step: 'stop', 'off'
        self.live: set[Any] = set()
        self.readers: dict[str, ProvenNode] = {}
        self.build()
        old = {
            '': self.horizon,
            'since': 5 * STEP,
            'until': 3 * STEP,
            '_second_at': TOGETHER_TIME,
            '_clear_since': STEP,
        }
        old |= {'_owner_since': 0.0, '_stopping_since': 0.0, 'last': STEP}
        old |= dict.fromkeys(
            ('began_at', 'stop_since', 'unfair_since', 'off_since', 'restart_at'), LIMIT
        )
        self.memory = Memory(self, old, APART, (), NEVER)
        self.step('')

    def build(self) -> None:
        """Make the arbiter, and who reads proofs for it."""
        limiter = JointLimiter([JointLimit(1.0, 1.0 / STEP, 1.0 / STEP)], max_dt=1.0)
        self.arbiter = Arbiter(mux_config(self.values), limiter, self.now)
        nodes = proven_nodes(self.arbiter, self.values, str)
        before, self.readers = self.readers, {each.name[1:]: each for each in nodes}
        for name, each in self.readers.items():
            each.reader = Reader(READER, SILENCE)
            if name in before:
                each.continue_from(before[name], self.now)

    def possible(self) -> Iterator[str]:
        yield ''
        for event in self.events:
            name, _, what = event.partition(' ')
            kind, _, way = what.partition(' ')
            node = self.nodes.get(name)
            same = False
            if node is not None:
                ways = {node.ways[k] for k in node.ways if kind in (k, 'both')}
                same = ways == {way} or what == {True: 'on', False: 'off'}[self.obeys]
            word = self.remote.newest
            same |= event == ('stop' if word.estop else 'clear') or event == self.doing
            if not same:
                yield event

    @property
    def doing(self) -> str:
        return self.operator.newest.joy or 'silent'

    def step(self, event: str) -> None:
        self.now += STEP * (2 if event == 'freeze' else 1)
        self.told = set()
        name, _, what = event.partition(' ')
        self.happen(self.nodes.get(name), what or event)
        for name, node in self.nodes.items():
            self.speak(name, node)
        for kind in ('plain', 'proofs'):
            for name, node in self.nodes.items():
                for word in node.carry(kind):
                    if self.hear(name, node, kind, word):
                        self.decide()
        if event == 'reset' and self.arbiter.reset(self.now).ok:
            self.stop_since, self.unfair_since = self.began_at, -math.inf
        self.decide()
        if event == 'freeze':
            self.forget()
        self.forget_what_decides_nothing()
        for name, node in self.nodes.items():
            self.renumber(name, node)

    def forget_what_decides_nothing(self) -> None:
        """Have states that behave alike be one."""
        arbiter, calls, rest = self.arbiter, self.arbiter.calls, self.arbiter.operators['it'].rest
        arbiter.stops, arbiter._owner_since = [], 0.0
        if arbiter.state is State.STOPPED:
            self.stop_since, self.unfair_since = math.inf, -math.inf  # until a reset
        else:
            arbiter._clear_since = None
        if calls.last is not None and self.now - calls.last >= arbiter.config.clear_time:
            calls.last = None
        if rest.since is None:
            rest.until = 0.0
        on_the_way = (*self.drive.plain, *self.drive.proofs)
        if not (self.drive.says_enable or any(word.enable for word in on_the_way)):
            self.off_since = -math.inf
        for node in self.nodes.values():
            for word in (node.newest, *node.proofs):
                if word.stopped_at <= node.proved_at:
                    word.stopped_at = -math.inf

    def happen(self, node: Node | None, what: str) -> None:
        now, word = self.now, self.remote.newest
        if node is not None:
            self.happen_to(node, *what.split(' '))
        elif what in ('stop', 'blip'):
            word.stops += not word.estop
            word.estop, word.stopped_at = what == 'stop', now
            self.stop_since = min(self.stop_since, now)
            self.began_at = now if word.estop else math.inf
        elif what == 'clear':
            word.estop, self.began_at = False, math.inf
        elif what == 'activate':
            before = self.arbiter
            self.build()
            self.arbiter.continue_from(before, now)
            self.forget()
        elif what in ('rest', 'hold', 'silent'):
            pressed = what == 'hold' and self.doing == 'rest'
            self.unfair_since = math.inf if pressed else min(self.unfair_since, now)
            self.operator.newest.joy = what.replace('silent', '')

    def happen_to(self, node: Node, what: str, way: str = '') -> None:
        now, word = self.now, node.newest
        if way:
            node.ways |= dict.fromkeys(node.ways if what == 'both' else [what], way)
        elif what in ('on', 'off'):
            self.obeys = what == 'on'
        elif what in ('back', 'forth'):
            node.clock += CLOCK + 1000 if what == 'forth' else -CLOCK
        elif what == 'restart':
            lives = {each.writer for each in (word, *node.proofs)}
            lives |= {each.reader.writer or 0 for each in self.readers.values()}
            word.writer = 1 + max(lives)
            word.number = word.stops = word.stamp = 0
            word.asked = -math.inf
            if node is self.operator:
                word.joy, self.unfair_since = '', min(self.unfair_since, now)
            if node is self.remote:
                word.estop, word.stopped_at, self.began_at = False, now, math.inf
                self.stop_since = min(self.stop_since, now)
            if node is self.drive:
                self.restart_at = min(self.restart_at, now)

    def forget(self) -> None:
        for node in self.nodes.values():
            node.forget()

    def speak(self, name: str, node: Node) -> None:
        word = node.newest
        word.at, word.number, word.falls = self.now, word.number + 1, word.stops
        if name in self.readers:
            self.readers[name].challenge(self.now)
            word.asked = self.now
        if word.joy:
            node.clock += 1
            word.stamp = node.clock
        if node is self.drive:
            word.enable = self.obeys and self.enable and self.restart_at != self.now
            since = math.inf if word.enable else min(self.off_since, self.now)
            self.off_since = since

    def hear(self, name: str, node: Node, kind: str, word: Word) -> bool:
        """Have the mux hear a word; tell whether it decides at once."""
        arbiter, now = self.arbiter, self.now
        if word.at >= node.told_at:
            node.told_at, node.says_stop, node.says_enable = word.at, word.estop, word.enable
        if node is self.remote and word.estop:
            self.told.add('stop')
        if node is self.drive and not word.enable:
            self.told.add('off')
        if kind == 'proofs':
            return name in self.readers and self.hear_proof(name, node, word)
        if node is self.remote:
            arbiter.estop_message('it', word.estop, now)
        if node is self.drive:
            arbiter.drive_enabled('', word.enable, now)
        if word.joy:
            node.joy_at = word.at
            arbiter.operator_sample('it', SAMPLES[word.joy], now)
            stamp = SimpleNamespace(sec=0, nanosec=word.stamp)
            for each in self.readers.values():
                each.hear_stamp('operator', 'it', stamp, now)
        released = node is self.operator and word.joy == 'rest' and arbiter.owner is not None
        return released or (node is self.remote and word.estop)

    def hear_proof(self, name: str, node: Node, word: Word) -> bool:
        if node is self.remote and node.proves and word.stopped_at > node.proved_at:
            self.told.add('stop')
        node.proves = True
        node.proved_at = node.young_at = word.at
        return self.readers[name].hear(word.proof(), self.now)

    def decide(self) -> None:
        decision = self.arbiter.tick(self.now)
        self.enable, moves = decision.enable, any(decision.demand)
        if not moves:
            self.restart_at = math.inf
        if decision.state is not State.STOPPED:
            self.judge_stop()
        if decision.enable:
            self.judge_control()
        if moves:
            assert decision.enable
            self.judge_drive()

    def judge_stop(self) -> None:
        node, oldest = self.remote, self.now - LIMIT
        assert 'stop' not in self.told, 'a stop that was told is not obeyed'
        assert not node.says_stop, 'what it was told last is a stop'
        assert not node.proves or self.stop_since > oldest, 'a stop that was not told'
        assert not node.proves or node.young_at > oldest, 'nothing young says that it is clear'

    def judge_control(self) -> None:
        node, oldest = self.operator, self.now - LIMIT
        assert self.unfair_since > oldest, 'no deadman was pressed since the reset, and is held'
        assert node.joy_at > oldest, 'nothing young says that the deadman is held'

    def judge_drive(self) -> None:
        node, oldest = self.drive, self.now - LIMIT
        assert node.says_enable, 'what it was told last is that the drive is disabled'
        assert 'off' not in self.told, 'that the drive is disabled is not obeyed'
        assert not node.proves or node.young_at > oldest, 'nothing young says that it is enabled'
        since = min(self.off_since, self.restart_at)
        assert not node.proves or since > oldest, 'the drive is disabled'

    def renumber(self, name: str, node: Node) -> None:
        """Have numbers, lives and stamps come from the same one on, as in every state."""
        if name not in self.readers:
            return
        of_node = self.readers[name]
        said = [node.newest, *node.proofs]
        renumber(of_node.reader, said, self.now)
        asked = of_node.reader._asked
        while asked and asked[0] <= self.now - self.horizon:
            asked.popleft()  # its answer is not on the way any more
        lives = list(dict.fromkeys((node.newest.writer, of_node.reader.writer)))
        lives = list(dict.fromkeys([*lives, *(each.writer for each in said)]))
        for each in said:
            each.writer = lives.index(each.writer)
        if of_node.reader.writer is not None:
            of_node.reader.writer = lives.index(of_node.reader.writer)
        if node is self.operator:
            self.restamp(of_node, [*said, *node.plain])

    def restamp(self, of_node: ProvenNode, said: list[Word]) -> None:
        known, node = of_node._vouched._known, self.operator
        while len(known) > 1 and known[1][1] < self.now - self.horizon:
            known.popleft()
        stamps = {node.clock, *(each.stamp for each in said), *of_node._held.values()}
        new, at, before = {0: 0}, 4 * CLOCK, 0
        for stamp in sorted((stamps | {stamp for stamp, _ in known}) - {0}):
            at += CLOCK if stamp - before > CLOCK / 2 else 1
            new[stamp], before = at, stamp
        node.clock = new[node.clock]
        for each in said:
            each.stamp = new[each.stamp]
        of_node._held.update({key: new[stamp] for key, stamp in of_node._held.items()})
        of_node._vouched._known = deque((new[stamp], as_of) for stamp, as_of in known)

    def arrived(self) -> None:
        """See that motion is possible again once all is well."""
        for node in self.nodes.values():
            self.happen(node, 'both 0')
        for what in ('clear', 'rest'):
            self.happen(None, what)
        self.obeys, way = True, set()
        for n in range(LATE + 4 + round(TOGETHER_TIME / STEP)):
            self.step('')
            if self.key() in self.live:
                break
            way.add(self.key())
            if n > LATE + 4 and not any(each._is_doubled for each in self.readers.values()):
                break
        else:
            raise AssertionError('two nodes of a name for ever')
        if self.key() not in self.live:
            if self.arbiter.state is State.STOPPED:
                self.play('reset')
            self.play(*4 * ('',), 'hold', *4 * ('',))
            assert any(self.arbiter.limiter.output), self.arbiter.status(self.now).inhibits
        self.live |= way


_REMOTE = 'stop, clear, blip, rest, hold, reset'
SCENES: dict[str, dict[str, Any]] = {
    'late': {'events': f'{_REMOTE}, remote both 0, remote both 2, remote both 3'},
    'apart': {
        'events': f'{_REMOTE}, remote plain 0, remote plain 2, remote plain 3, '
        'remote proofs 0, remote proofs 2, remote proofs 3'
    },
    'lost': {
        'events': f'{_REMOTE}, remote plain 0, remote plain cut, '
        'remote proofs 0, remote proofs cut',
        'proof': 'required',
    },
    'lives': {
        'events': f'{_REMOTE}, remote restart, activate, freeze, '
        'remote proofs 0, remote proofs cut'
    },
    'late lives': {
        'events': 'rest, hold, reset, remote restart, activate, '
        'remote plain 0, remote plain 2, remote proofs 0, remote proofs 1'
    },
    'clock': {
        'events': 'rest, hold, reset, remote back, remote forth, remote both 0, remote both 2'
    },
    'pad': {
        'events': 'rest, hold, reset, pad restart, pad both 0',
        'operator': 'pad',
    },
    'drive': {
        'events': 'rest, hold, reset, drive off, drive on, drive restart, '
        'drive plain 0, drive proofs 0, drive proofs cut'
    },
}
COUNTS = {
    'late': (5126, 35882),
    'apart': (19084, 171756),
    'lost': (2535, 17745),
    'lives': (5107, 49752),
    'late lives': (5486, 40558),
    'clock': (6993, 41958),
    'pad': (233, 1019),
    'drive': (698, 4188),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=100)


FAULTS: dict[str, tuple[str, Any, str, Any]] = {
    'hears no proof': ('late', Input, 'prove', lambda *_: None),
    'takes a Joy for as young as the newest proof': (
        *('apart', Vouched, 'as_of'),
        lambda self, stamp: self._known[-1][1] if self._known else -math.inf,
    ),
    'forgets with an activation who proves': ('lives', ProvenNode, 'continue_from', lambda *_: 0),
    'takes a restart for nothing': ('pad', Arbiter, 'set_invalid', lambda *_: None),
}


@pytest.mark.proof
@pytest.mark.parametrize('fault', FAULTS)
def test_rules_notice(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, owner, name, instead = FAULTS[fault]
    monkeypatch.setattr(owner, name, instead, raising=False)
    with pytest.raises(AssertionError, match='def test_this_way_is_safe'):
        explore(World(**SCENES[scene]), 'here.World()')
