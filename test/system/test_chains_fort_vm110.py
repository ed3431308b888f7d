# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
FORT and VM-110, or two FORTs, in each other's hardware chains by the mux: none holds another.

The arbiter, both sessions and both simulated devices are the real ones; only time, ports and
topics are played, at their real rates, each topic with a delay of its own. Properties: once nobody
presses anything, acknowledging and rearming the devices and then one reset reach READY; and as
long as a device's chain is open, the mux is STOPPED.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
import contextlib
import copy
from dataclasses import dataclass
import heapq
import itertools
import random
from typing import Any, Literal

import pytest

from bridge_core.session import RETRY
from fort_vsc_bridge.protocol import MessageType
from fort_vsc_bridge.session import (
    Session as FortSession,
    Settings as FortSettings,
    Sticks as FortSticks,
)
from fort_vsc_bridge.simulator import Simulator as Vsc
from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import Decision, OperatorSample, State
from safety_mux.settings import EStopSource, MuxConfig, Operator
from vm110_bridge.session import Session as VmSession, Settings as VmSettings, Sticks as VmSticks
from vm110_bridge.simulator import Simulator as BaseUnit

pytestmark = pytest.mark.computes
FORT, VM110, FORT2 = 'fort', 'vm110', 'fort2'
TICK = 0.01  # s, of the mux
REPEAT = 0.05  # s, of ~/estop and ~/own_estop
DELAYS = (0.0, 1e-3, 5e-3, 20e-3)  # s, that a topic may take
# s from an open chain to STOPPED: the device tells (VSC every 50 ms, base unit every 125 ms), the
# topic takes its time.
REACTIONS = {FORT: 0.1, VM110: 0.175, FORT2: 0.1}
ORDERS = [  # every order of two presses and two releases, each release after its press
    order
    for order in itertools.permutations(
        ('press fort', 'press vm110', 'release fort', 'release vm110')
    )
    if order.index('press fort') < order.index('release fort')
    and order.index('press vm110') < order.index('release vm110')
]
ROUNDS = 8  # of each order with either VSC
MANY = 85  # so more than 1 000 in all
COMMANDS = {
    'press fort': 'estop remote on',
    'release fort': 'estop remote off',
    'press vm110': 'stop 1 on',
    'release vm110': 'stop 1 off',
}
HOLDS = {
    FORT: ('button left_down 1', 'stick left_y 0.5'),
    VM110: ('switch 1 1 1', 'stick 1 2 0.5'),
}
LET_GO = {
    FORT: ('button left_down 0', 'stick left_y 0'),
    VM110: ('switch 1 1 0', 'stick 1 2 0'),
}


@dataclass
class Party:
    """A device, its session, and what the bridge around that publishes."""

    name: str
    device: Any
    session: Any
    ask: Callable[[bool, float], None]  # what ~/stop_demand is wired to
    publish: Callable[[str, str, Any], None]
    told: tuple[bool, bool] | None = None
    repeat_at: float = 0.0
    due: float = 0.0  # when step is wanted next
    open_since: float | None = None  # its hardware chain
    busy: bool = False  # its line takes no frame
    retry_at: float = 0.0  # not before, as the line took no frame

    def step(self, now: float) -> None:
        for data in self.device.poll(now):
            self.take(self.session.receive(data, now), now)
        self.take(self.session.poll(now), now)
        self.tell(now)
        due = max(self.session.deadline(), self.retry_at)
        self.due = min(self.repeat_at, self.device.deadline(), due)

    def take(self, output: Any, now: float) -> None:
        """Do as the link does: frames first, then the stop topics, then everything else."""
        events, frames = output
        for frame in frames:
            if self.busy:
                self.retry_at = now + RETRY
            else:
                self.session.sent(frame, now)
                self.device.receive(frame, now)
        if events:
            self.tell(now)
        for event in events:
            if isinstance(event, FortSticks | VmSticks):
                self.publish(self.name, 'joy', sample(event))

    def tell(self, now: float) -> None:
        state = (self.session.estop, self.session.own_estop)
        if state != self.told or now >= self.repeat_at:
            self.told, self.repeat_at = state, now + REPEAT
            self.publish(self.name, 'estop', state[0])
            self.publish(self.name, 'own_estop', state[1])

    @property
    def chain_open(self) -> bool:
        if isinstance(self.device, Vsc):
            return bool(self.device.unacknowledged)
        return not self.device.relays_closed


def sample(sticks: FortSticks | VmSticks) -> OperatorSample:
    """Return what the mux reads: the first button is the deadman, the second axis the speed."""
    speed = sticks.axes[1] / 1023
    return OperatorSample(neutral=speed == 0.0, deadman=sticks.buttons[0] == 1, demand=(speed,))


class Chains:
    """
    Devices, bridges, mux, and all topics between them.

    :param counts: of the VM-110's source. :param own_topics: the mux hears ``~/own_estop`` too.
    :param two_vscs: in place of the VM-110 there is another VSC.
    """

    def __init__(
        self,
        *,
        latch_bits: bool = True,
        counts: Literal['always', 'when_owner'] = 'always',
        own_topics: bool = True,
        two_vscs: bool = False,
    ) -> None:
        self.now = 10.0
        self.counts = counts
        self.delays: dict[tuple[str, str], float] = defaultdict(float)
        self.vsc, self.unit = Vsc(latch_bits=latch_bits), BaseUnit()
        self.vsc.messages[MessageType.JOYSTICK] = (True, 0.1)  # 50 Hz would only cost time
        self.vsc.messages[MessageType.GPS] = (False, 1.0)
        other = {FORT2: copy.deepcopy(self.vsc)} if two_vscs else {VM110: self.unit}
        self.devices: dict[str, Any] = {FORT: self.vsc, **other}
        self._own_topics = own_topics
        self._numbers = itertools.count()
        self.start()

    def start(self, *, mux_after: float = 0.0) -> None:
        """Start all nodes anew. :param mux_after: seconds; the mux decides so much later."""
        self.arbiter = _arbiter(self.devices, self.counts, self._own_topics, self.now)
        self.decision: Decision = self.arbiter.tick(self.now)
        self.parties = {name: self._party(name, device) for name, device in self.devices.items()}
        self._tick_at = self.now + mux_after
        self._mail: list[tuple[float, int, str, str, Any]] = []  # a heap
        self._arrived: dict[tuple[str, str], float] = defaultdict(float)
        for party in self.parties.values():
            party.take(party.session.opened(self.now), self.now)

    def _party(self, name: str, device: Any) -> Party:
        if name == VM110:
            unit = VmSession(VmSettings())
            return Party(name, device, unit, unit.set_hold_output, self._publish)
        vsc = FortSession(FortSettings())
        return Party(name, device, vsc, vsc.set_software_estop, self._publish)

    # Time.

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while True:
            due = min(self._tick_at, *(party.due for party in self.parties.values()))
            if self._mail:
                due = min(due, self._mail[0][0])
            if due > end:
                self.now = end
                return
            self.now = max(due, self.now + 1e-4)
            self._step()

    def _step(self) -> None:
        while self._mail and self._mail[0][0] <= self.now:
            self._deliver()
        for party in self.parties.values():
            if self.now >= party.due:
                party.step(self.now)
        if self.now >= self._tick_at:
            self._tick_at = self.now + TICK
            self._tick()

    # Topics.

    def _publish(self, name: str, topic: str, value: Any) -> None:
        """Deliver after the topic's delay, in order."""
        due = max(self.now + self.delays[name, topic], self._arrived[name, topic])
        self._arrived[name, topic] = due
        heapq.heappush(self._mail, (due, next(self._numbers), name, topic, value))

    def _deliver(self) -> None:
        _, _, name, topic, value = heapq.heappop(self._mail)
        hear: dict[str, Callable[[str, Any], None]] = {
            'estop': self._on_estop,
            'own_estop': self._on_own_estop,
            'joy': self._on_joy,
            'stop_demand': self._on_stop_demand,
        }
        hear[topic](name, value)

    def _on_estop(self, name: str, value: bool) -> None:
        self.arbiter.estop_message(name, value, self.now)
        if value and self.decision.state is not State.STOPPED:
            self._tick()

    def _on_own_estop(self, name: str, value: bool) -> None:
        self.arbiter.own_estop_message(name, value, self.now)

    def _on_joy(self, name: str, value: OperatorSample) -> None:
        self.arbiter.operator_sample(name, value, self.now)
        if name == self.decision.owner and not value.deadman:
            self._tick()

    def _tick(self) -> None:
        self.decision = self.arbiter.tick(self.now)
        for name, demanded in self.decision.stop_demand.items():
            self._publish(name, 'stop_demand', demanded)
        for party in self.parties.values():
            self._watch(party)

    def _on_stop_demand(self, name: str, value: bool) -> None:
        party = self.parties[name]
        party.ask(value, self.now)
        party.step(self.now)

    def _watch(self, party: Party) -> None:
        """Show that no stop is missed."""
        if not party.chain_open:
            party.open_since = None
            return
        if party.open_since is None:
            party.open_since = self.now
        if self.now - party.open_since < REACTIONS[party.name]:
            return
        assert self.decision.owner != party.name, f'{party.name} drives with its chain open'
        if party.name != VM110 or self.counts == 'always':
            assert self.decision.state is State.STOPPED, f'the stop of {party.name} is missed'

    # People.

    def apply(self, name: str, *commands: str) -> None:
        for command in commands:
            self.parties[name].device.apply(command)

    def do(self, step: str) -> None:
        """Press or release, as the key of COMMANDS says."""
        self.apply(step.split()[1], COMMANDS[step])

    def tend(self) -> None:
        """Let go of all; acknowledge and rearm, as far as the devices let it be done."""
        for name in self.parties:
            self.apply(name, *LET_GO[VM110 if name == VM110 else FORT])
            with contextlib.suppress(ValueError):
                self.apply(name, 'arm 1' if name == VM110 else 'ack')

    @property
    def clear(self) -> bool:
        parties = self.parties.values()
        return not any(party.chain_open or party.session.estop for party in parties)

    def recover(self) -> None:
        """Nobody presses anything: tend to the devices until they are clear, then reset once."""
        self.clear_up()
        if self.decision.state is State.STOPPED:
            self.run(self.arbiter.config.clear_time + 0.1)
            reply = self.arbiter.reset(self.now)
            assert reply.ok, reply.message
        self.run(0.2)
        assert self.decision.state is State.READY, self._why()

    def clear_up(self) -> None:
        """Tend to the devices until they are clear."""
        for _ in range(60):
            if self.clear and (self.unit.armed or VM110 not in self.parties):
                return
            self.tend()
            self.run(0.25)
        raise AssertionError(f'deadlock: {self._why()}')

    def drive(self, name: str) -> None:
        """Take control, from READY."""
        self.apply(FORT, 'mode operational')
        self.run(0.6)  # at rest for neutral_time, by a Joy every 0.125 s
        self.apply(name, *HOLDS[name])
        self.run(0.2)
        assert self.decision.owner == name, self._why()

    def _why(self) -> str:
        parties = self.parties.values()
        reasons = {party.name: party.session.stop_reasons(self.now) for party in parties}
        return f'{self.arbiter.status(self.now).inhibits}, {reasons}'


def _arbiter(
    names: Iterable[str], counts: Literal['always', 'when_owner'], own_topics: bool, now: float
) -> Arbiter:
    sources = {name: EStopSource(name, own_topic=own_topics) for name in (FORT, FORT2)} | {
        VM110: EStopSource(VM110, counts=counts, operator=VM110, own_topic=own_topics)
    }
    operators = {
        FORT: Operator(FORT, priority=2),
        FORT2: Operator(FORT2, priority=1),
        VM110: Operator(VM110, priority=1, timeout=0.5),
    }
    config = MuxConfig(
        joints=1,
        sources=tuple(sources[name] for name in names),
        operators=tuple(operators[name] for name in names),
        neutral_time=0.5,
        reset_silence=0.0,  # who resets here does so again and again
    )
    return Arbiter(config, JointLimiter([JointLimit(1.0, 2.0, 4.0)]), now)


def started(**how: Any) -> Chains:
    chains = Chains(**how)
    chains.run(1.0)
    chains.recover()
    return chains


def play(chains: Chains, order: tuple[str, ...], chance: random.Random) -> None:
    """Press and release in this order, with pauses and what hasty people do in between."""
    for party in chains.parties:
        for topic in ('estop', 'own_estop', 'joy', 'stop_demand'):
            chains.delays[party, topic] = chance.choice(DELAYS)
    driver = chance.choice((FORT, VM110, None))
    if driver is not None:
        chains.drive(driver)
    for step in order:
        chains.do(step)
        chains.run(chance.choice((0.0, 0.03, 0.2, 1.0, 2.4)))
        if chance.random() < 0.3:
            chains.tend()
            chains.arbiter.reset(chains.now)
    chains.recover()


@pytest.mark.parametrize('rounds', [ROUNDS, pytest.param(MANY, marks=pytest.mark.proof)])
@pytest.mark.parametrize('latch_bits', [True, False], ids=['latched', 'unlatched'])
@pytest.mark.parametrize('order', ORDERS, ids=lambda order: ', '.join(order))
def test_no_order_of_presses_and_releases_deadlocks_or_misses_a_stop(
    order: tuple[str, ...], latch_bits: bool, rounds: int
) -> None:
    chance = random.Random(f'{order} {latch_bits}')
    chains = started(latch_bits=latch_bits)
    for _ in range(rounds):
        play(chains, order, chance)


@pytest.mark.parametrize('order', ORDERS, ids=lambda order: ', '.join(order))
def test_a_source_that_counts_for_its_owner_only_deadlocks_nothing(order: tuple[str, ...]) -> None:
    chance = random.Random(str(order))
    chains = started(counts='when_owner')
    for _ in range(10):
        play(chains, order, chance)


def test_a_stop_of_one_reaches_the_chain_of_the_other() -> None:
    chains = started()
    fort, vm110 = (party.session for party in chains.parties.values())
    chains.do('press vm110')
    chains.run(1.0)
    assert chains.vsc.host_estop
    assert (fort.estop, fort.own_estop) == (True, False)
    chains.do('release vm110')
    chains.recover()
    chains.do('press fort')
    chains.run(1.9)
    assert chains.unit.relays_closed
    chains.run(0.5)
    assert not chains.unit.relays_closed
    assert (vm110.estop, vm110.own_estop) == (True, False)
    chains.do('release fort')
    chains.apply(FORT, 'ack')
    chains.run(1.0)
    assert not chains.unit.relays_closed, 'only rearming closes them'
    chains.recover()


def test_a_stop_of_the_owner_reaches_the_chain_of_the_other() -> None:
    """For the source's timeout (250 ms), which several heartbeats to a VSC (20 Hz) carry."""
    chains = started(counts='when_owner')
    chains.drive(VM110)
    chains.do('press vm110')
    chains.run(0.2)
    assert chains.decision.stop_demand[FORT]
    chains.run(0.5)
    assert not chains.decision.stop_demand[FORT]
    assert chains.parties[FORT].chain_open, 'it has to be acknowledged'


def two_vscs(*, latch_bits: bool) -> Chains:
    """Return two VSCs that stop by themselves without our heartbeat (key 85)."""
    chains = Chains(two_vscs=True, latch_bits=latch_bits)
    for device in chains.devices.values():
        device.eeprom[85] = 1
    chains.run(1.0)
    chains.recover()
    return chains


@pytest.mark.parametrize('latch_bits', [True, False], ids=['latched', 'unlatched'])
@pytest.mark.parametrize('transition', [0.05, 0.2, 1.0, 1.8])
def test_two_vscs_with_a_mode_between_their_modes_do_not_hold_each_other(
    transition: float, latch_bits: bool
) -> None:
    """A mode outside table 12 comes with every stop, acknowledgement and choice of a mode."""
    chains = two_vscs(latch_bits=latch_bits)
    for name in chains.devices:
        chains.apply(name, f'transition {transition}')
    for name in chains.devices:
        chains.apply(name, 'estop remote on')
        chains.run(transition + 1.0)
        assert chains.decision.state is State.STOPPED
        assert all(party.chain_open for party in chains.parties.values()), 'it is passed on'
        chains.apply(name, 'estop remote off')
        chains.run(transition + 1.0)
        for party in sorted(chains.parties, key=name.__ne__):
            chains.apply(party, 'ack')  # once; whose stop it was comes first
            chains.run(transition + 1.0)
        assert chains.clear, chains._why()
        chains.recover()


@pytest.mark.parametrize('latch_bits', [True, False], ids=['latched', 'unlatched'])
def test_two_vscs_whose_lines_were_busy_do_not_hold_each_other(latch_bits: bool) -> None:
    """Both say USER before their nodes ask for anything; then each asks for the other's."""
    chains = two_vscs(latch_bits=latch_bits)
    for busy in (True, False):
        for party in chains.parties.values():
            party.busy = busy
        chains.run(0.8)
    chains.recover()


@pytest.mark.parametrize('latch_bits', [True, False], ids=['latched', 'unlatched'])
def test_two_vscs_whose_nodes_were_gone_do_not_hold_each_other(latch_bits: bool) -> None:
    """Both tell their own node so before the mux is back."""
    chains = two_vscs(latch_bits=latch_bits)
    chains.now += 1.0
    for device in chains.devices.values():
        device.poll(chains.now)
    chains.start(mux_after=0.3)
    chains.run(0.8)
    chains.recover()
