"""FORT and VM-110 wired into each other's hardware chains: neither holds the other for ever."""

from collections.abc import Iterator
import contextlib
import itertools
import random
from typing import Any

import pytest

from fort_vsc_bridge.protocol import MessageType
from fort_vsc_bridge.session import Session as FortSession
from fort_vsc_bridge.simulator import Simulator as Vsc
from vm110_bridge.session import Session as VmSession
from vm110_bridge.session import Sticks
from vm110_bridge.simulator import Simulator as BaseUnit

MUX_PERIOD = 0.05
ORDERS = [  # every order of two presses and two releases, each release after its press
    order
    for order in itertools.permutations(('press fort', 'press vm', 'release fort', 'release vm'))
    if order.index('press fort') < order.index('release fort')
    and order.index('press vm') < order.index('release vm')
]
COMMANDS = {
    'press fort': 'estop remote on',
    'release fort': 'estop remote off',
    'press vm': 'stop 1 on',
    'release vm': 'stop 1 off',
}


class Chains:
    """
    Both devices, both sessions, and the mux's rule between them.

    Each device is asked to stop while the other one demands a stop by itself (design: a source's
    ``stop_demand`` is true while any *other* source's ``own_estop`` is).
    """

    def __init__(self, *, latch_bits: bool) -> None:
        self.now = 10.0
        self.vsc, self.unit = Vsc(latch_bits=latch_bits), BaseUnit()
        self.vsc.messages[MessageType.JOYSTICK] = (False, 1.0)  # nothing here depends on them
        self.vsc.messages[MessageType.GPS] = (False, 1.0)
        self.fort, self.vm = FortSession(), VmSession()
        self._mux_due = self.now
        self.moved_while_stopped = False
        self._to_device(self.fort.opened(self.now), self.vsc)
        self._to_device(self.vm.opened(self.now), self.unit)

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        parties = ((self.fort, self.vsc), (self.vm, self.unit))
        while self.now < end:
            due = min(
                self._mux_due,
                *(party.deadline() for pair in parties for party in pair),
            )
            self.now = min(max(due, self.now + 1e-3), end)
            if self.now >= self._mux_due:
                self._mux_due = self.now + MUX_PERIOD
                self.fort.set_software_estop(self.vm.own_estop, self.now)
                self.vm.set_hold_output(self.fort.own_estop, self.now)
            for session, device in parties:
                for data in device.poll(self.now):
                    self._to_device(session.receive(data, self.now), device)
                self._to_device(session.poll(self.now), device)

    def _to_device(self, output: Any, device: Any) -> None:
        events, frames = output
        for frame in frames:
            device.receive(frame, self.now)
        if device is self.unit and self.vm.estop:
            moved = (any(e.axes) for e in events if isinstance(e, Sticks))
            self.moved_while_stopped = self.moved_while_stopped or any(moved)

    def try_to_restart(self) -> None:
        """What both operators do: acknowledge, rearm, as far as the devices let them."""
        for device, line in ((self.vsc, 'ack'), (self.unit, 'arm 1')):
            with contextlib.suppress(ValueError):
                device.apply(line)

    @property
    def clear(self) -> bool:
        return not (self.fort.estop or self.vm.estop) and self.unit.relays_closed

    def recover(self) -> None:
        for _ in range(60):
            if self.clear and self.vm.armed:
                return
            self.try_to_restart()
            self.run(0.25)
        reasons = self.fort.stop_reasons(self.now) + self.vm.stop_reasons(self.now)
        raise AssertionError(f'deadlock: {reasons}')


@pytest.fixture(scope='module', params=[True, False], ids=['latched', 'unlatched'])
def chains(request: pytest.FixtureRequest) -> Iterator[Chains]:
    chains = Chains(latch_bits=request.param)
    chains.run(1.0)
    chains.recover()
    chains.unit.apply('stick 1 1 1')
    yield chains
    assert not chains.moved_while_stopped


def test_a_stop_of_one_reaches_the_chain_of_the_other(chains: Chains) -> None:
    chains.recover()
    chains.unit.apply('stop 1 on')
    chains.run(1.0)
    assert chains.fort.estop
    assert not chains.fort.own_estop
    chains.unit.apply('stop 1 off')
    chains.recover()
    chains.vsc.apply('estop remote on')
    chains.run(1.0)
    assert chains.unit.relays_closed
    chains.run(1.5)
    assert not chains.unit.relays_closed
    assert chains.vm.estop
    assert not chains.vm.own_estop
    chains.vsc.apply('estop remote off')
    chains.recover()


@pytest.mark.parametrize('order', ORDERS, ids=lambda order: ', '.join(order))
def test_no_order_of_presses_and_releases_deadlocks(
    chains: Chains, order: tuple[str, ...]
) -> None:
    """Each order 85 times with either VSC, so more than 1 000 in all; the pauses are random."""
    source = random.Random(str(order))
    for _ in range(85):
        for step in order:
            device = chains.vsc if 'fort' in step else chains.unit
            device.apply(COMMANDS[step])
            chains.run(source.choice((0.0, 0.03, 0.2, 1.0, 2.4)))
            if source.random() < 0.3:
                chains.try_to_restart()
        chains.recover()
