# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Feeding the hardware chains, without a deadlock: mux and devices explored together.

Each device is stopped by its own button or by what the mux asks of it (``~/stop_demand``, wired
for all of them: the worst case). It reports both as its e-stop, one step late, and the first alone
as its own. The end of each stop goes through a mode that is neither, which is an e-stop, but not
its own. Property: from every reachable state, once no device demands a stop by itself, a reset
can succeed.
"""

from dataclasses import dataclass, field
import math
import pickle
from typing import Any, Literal

import pytest

from assurance.explorer import check, explore
from safety_mux.arbiter import Arbiter
from safety_mux.inputs import SourceInput
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import Decision, OperatorSample, State
from safety_mux.settings import EStopSource, MuxConfig, Operator

STEP = 0.125
TIMEOUT = 1.5 * STEP
CLEAR = 2 * STEP
PASSING = 2  # steps
PATIENCE = 16  # steps after which a reset must have succeeded
COUNTS = {'always': (5011, 50110), 'when_owner': (8042, 80420)}  # states, and steps between them
NEAR = 1000  # states
SAMPLES = {
    'rest': OperatorSample(neutral=True, deadman=False, demand=(0.0,)),
    'drive': OperatorSample(neutral=False, deadman=True, demand=(1.0,)),
}
EVENTS = (
    '', 'press vsc', 'press vm110', 'cut vsc', 'cut vm110', 'rest', 'drive', 'trip', 'end trip',
    'reset',
)  # fmt: skip


@dataclass
class Device:
    """A VSC or a VM-110 with its bridge, as the mux sees it."""

    pressed: bool = False
    alive: bool = True
    asked: bool = False
    stopped: bool = False  # what it was asked has taken effect
    passing: int = 0  # steps left between two modes
    passing_is_own: bool = False  # its bridge takes that for the device's own stop

    def step(self, press: bool) -> None:
        """Let what was asked take effect; a stop ends by way of another mode."""
        before = self.pressed or self.stopped
        self.pressed ^= press
        self.stopped = self.asked
        after = self.pressed or self.stopped
        self.passing = PASSING if before and not after else max(0, self.passing - 1)

    def report(self, arbiter: Arbiter, name: str, now: float) -> None:
        if self.alive:
            passing = self.passing > 0
            arbiter.own_estop_message(name, self.pressed or (passing and self.passing_is_own), now)
            arbiter.estop_message(name, self.pressed or self.stopped or passing, now)


@dataclass
class Plant:
    arbiter: Arbiter
    now: float = 0.0
    operator: str = 'rest'
    devices: dict[str, Device] = field(
        default_factory=lambda: {'vsc': Device(), 'vm110': Device()}
    )
    decision: Decision | None = None

    def step(self, event: str) -> bool:
        """Let one step pass; tell whether a reset succeeded."""
        self.now += STEP
        verb, _, name = event.partition(' ')
        if verb == 'cut':
            self.devices[name].alive ^= True
        elif verb in SAMPLES:
            self.operator = verb
        for each, device in self.devices.items():
            device.step(verb == 'press' and name == each)
            device.report(self.arbiter, each, self.now)
        self.arbiter.operator_sample('fort', SAMPLES[self.operator], self.now)
        if verb == 'trip':
            self.arbiter.trip(self.now)
        if event == 'end trip':
            self.arbiter.end_trip(self.now)
        done = verb == 'reset' and self.arbiter.reset(self.now).ok
        self.decision = self.arbiter.tick(self.now)
        if self.decision.state in (State.READY, State.ACTIVE):
            stopped = [n for n, source in self.arbiter.sources.items() if source.value]
            counted = [n for n in stopped if self.arbiter.sources[n].config.counts == 'always']
            assert not counted, f'{self.decision.state} with {counted} stopped'
        for name, device in self.devices.items():
            device.asked = self.decision.stop_demand[name]
        return done

    def key(self) -> tuple[Any, ...]:
        a = self.arbiter
        parts: list[Any] = [a.state, a.through_zero, a.limiter.output, self.operator]
        for moment in (a.trips.since, a.calls.last, a._clear_since):
            parts.append(None if moment is None else min(self.now - moment, CLEAR))
        for device in self.devices.values():
            parts += [device.pressed, device.alive, device.asked, device.stopped, device.passing]
        for source in a.sources.values():
            parts += [source.fresh(self.now), source.value, source.own]
            parts.append(source.fresh(self.now) and self.now - (source.watchdog._last or 0.0))
        operator = a.operators['fort']
        since = operator.rest.since
        parts += [operator.rested, operator.holding]
        parts.append(None if since is None else min(self.now - since, CLEAR))
        return tuple(parts)

    def possible(self) -> tuple[str, ...]:
        return EVENTS

    def take(self) -> bytes:
        return pickle.dumps(vars(self), pickle.HIGHEST_PROTOCOL)

    def give(self, memory: bytes) -> None:
        vars(self).update(pickle.loads(memory))

    def arrived(self) -> None:
        """See that a reset succeeds, with a call of ~/reset every now and then."""
        self.let_go()
        for step in range(PATIENCE):
            state = self.decision.state if self.decision else State.STOPPED
            if state is State.READY or self.step('' if step % 4 else 'reset'):
                return
        raise AssertionError(f'no reset succeeds: {self.arbiter.status(self.now).inhibits}')

    def let_go(self) -> None:
        """Nobody demands a stop by himself any more."""
        self.operator = 'rest'
        for device in self.devices.values():
            device.pressed, device.alive = False, True


def plant(own_topic: bool, counts: Literal['always', 'when_owner']) -> Plant:
    config = MuxConfig(
        joints=1,
        sources=(
            EStopSource('vsc', TIMEOUT, own_topic=own_topic),
            EStopSource('vm110', TIMEOUT, counts, 'fort', stop_category=1, own_topic=own_topic),
        ),
        operators=(Operator('fort', 1, TIMEOUT),),
        clear_time=CLEAR,
        neutral_time=CLEAR,
        stall_limit=1.5 * STEP,
        reset_silence=0.0,  # who resets here does so again and again
    )
    limit = JointLimit(1.0, 1.0 / STEP, 0.5 / STEP)
    return Plant(Arbiter(config, JointLimiter([limit], max_dt=1.0), 0.0))


@pytest.mark.computes
@pytest.mark.parametrize('counts', ['always', 'when_owner'])
@pytest.mark.parametrize('most', [NEAR, pytest.param(math.inf, marks=pytest.mark.proof)])
def test_no_chain_of_stops_holds_itself(
    counts: Literal['always', 'when_owner'], most: float
) -> None:
    check(plant(True, counts), f'here.plant(True, {counts!r})', COUNTS[counts], most)


def test_a_device_without_an_own_estop_is_held_by_its_echo() -> None:
    """The property can fail: this is the deadlock that ``~/own_estop`` is there against."""
    with pytest.raises(AssertionError, match='no reset succeeds'):
        explore(plant(False, 'always'), "here.plant(False, 'always')")


def test_modes_between_modes_that_count_as_own_hold_both() -> None:
    """The property can fail: this is the deadlock that ``transition_time`` is there against."""
    world = plant(True, 'always')
    for device in world.devices.values():
        device.passing_is_own = True
    for event in ('', 'press vsc', '', '', '', 'press vsc'):
        world.step(event)
    with pytest.raises(AssertionError, match='no reset succeeds'):
        world.arrived()


def test_a_stop_is_passed_on_to_the_others_and_never_back() -> None:
    world = plant(True, 'always')
    world.step('')
    world.step('press vsc')
    assert world.decision is not None
    assert world.decision.stop_demand == {'vsc': False, 'vm110': True}
    for _ in range(4):
        world.step('')
    assert world.decision.stop_demand == {'vsc': False, 'vm110': True}
    world.step('press vsc')  # let go again
    assert world.decision.stop_demand == {'vsc': False, 'vm110': False}


def test_silence_of_an_own_estop_is_a_demand() -> None:
    world = plant(True, 'always')
    world.step('')
    world.step('cut vm110')
    world.step('')
    assert world.decision is not None
    assert world.decision.stop_demand == {'vsc': True, 'vm110': False}
    assert isinstance(world.arbiter.sources['vm110'], SourceInput)


def test_a_trip_wired_to_devices_is_ended_and_takes_one_reset() -> None:
    world = plant(True, 'always')
    for event in ('', '', '', 'trip', '', '', '', ''):
        world.step(event)
    assert world.decision is not None
    assert world.decision.stop_demand == {'vsc': True, 'vm110': True}
    world.step('end trip')
    assert world.decision.stop_demand == {'vsc': False, 'vm110': False}
    for _ in range(4):
        world.step('')
    assert world.decision.state is State.STOPPED, 'the end of a trip is no reset'
    assert world.step('reset')


def test_a_trip_wired_to_devices_that_nobody_ends_takes_two_resets() -> None:
    """The first ends the trip, whose echo would refuse every reset; the second counts."""
    world = plant(True, 'always')
    for _ in range(3):
        world.step('')
    world.step('trip')
    for _ in range(4):
        world.step('')
    assert world.decision is not None
    assert world.decision.stop_demand == {'vsc': True, 'vm110': True}
    assert not world.step('reset')
    assert world.decision.stop_demand == {'vsc': False, 'vm110': False}
    for _ in range(4):
        world.step('')
    assert world.decision.state is State.STOPPED, 'ending the trip is no reset'
    assert world.step('reset')
