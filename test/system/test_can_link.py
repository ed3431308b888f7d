# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A link on a CAN bus: each frame reaches the session, a lost bus is told and found again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from bridge_core.j1939 import CanFrame
from bridge_core.transports.can import CanTransport
from stage.can_rig import CanBus, error_frame, message, receive
from stage.link_rig import Bench, FakeSession, Output
from stage.rig import holds_for, wait_for

HELLO = CanFrame(0x18EAFF33, b'\x00\xee\x00')


class CanSession(FakeSession):
    """Keeps the frames that come; says HELLO on an open bus."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[CanFrame] = []

    def opened(self, now: float) -> Output:
        super().opened(now)
        return [], [HELLO]

    def receive(self, data: Any, now: float) -> Output:
        self.heard.append(data)
        return super().receive(b'x', now)

    def farewell(self, now: float) -> list[Any]:
        return [CanFrame(0x0CFDD633, bytes(8))]


@pytest.fixture
def session(bench: Bench) -> Iterator[CanSession]:
    session = CanSession()
    bench.session = session
    yield session
    bench.link.stop()


def activate(bench: Bench, bus: CanBus) -> CanTransport:
    transport = CanTransport(bus.interface, bus.channel)
    bench.transport = transport
    bench.activate()
    wait_for(lambda: bench.status.is_open, 5.0, 'an open bus')
    return transport


@pytest.mark.real_can
def test_session_gets_one_frame_a_call(can_bus: CanBus, bench: Bench, session: CanSession) -> None:
    peer = can_bus.endpoint()
    activate(bench, can_bus)
    for number in range(100):
        peer.send(message(number, bytes((number,))))
    wait_for(lambda: len(session.heard) == 100, 5.0, lambda: f'100 frames of {session.heard}')
    assert session.heard == [CanFrame(number, bytes((number,))) for number in range(100)]
    assert receive(peer, HELLO.identifier) == HELLO


@pytest.mark.real_can
def test_leaving_says_farewell_on_the_bus(
    can_bus: CanBus, bench: Bench, session: CanSession
) -> None:
    peer = can_bus.endpoint()
    activate(bench, can_bus)
    bench.link.deactivate()
    assert receive(peer, 0x0CFDD633) == CanFrame(0x0CFDD633, bytes(8))


@pytest.mark.real_can
def test_bus_off_stops_is_told_and_the_bus_is_joined_again(
    can_bus: CanBus, bench: Bench, session: CanSession
) -> None:
    peer = can_bus.endpoint()
    transport = activate(bench, can_bus)
    peer.send(message(1))
    wait_for(lambda: not session.estop, 5.0, 'health')
    peer.send(error_frame(0x40))
    wait_for(lambda: True in bench.owner.told[bench.owner.told.index(False) :], 5.0, 'a stop')
    assert any('bus off' in line for line in bench.owner.log)
    wait_for(lambda: bench.status.opens == 2, 5.0, 'a bus joined again')
    assert receive(peer, HELLO.identifier) == HELLO
    assert receive(peer, HELLO.identifier) == HELLO
    assert transport.counts()['bus off'] == 1


def test_bus_that_goes_off_again_and_again_is_joined_ever_more_seldom(
    can_bus: CanBus, bench: Bench, session: CanSession
) -> None:
    """Nothing but error frames comes: the waits double up to the reconnect period, 0.4 s here."""
    peer = can_bus.endpoint()
    activate(bench, can_bus)
    opens: list[int] = []

    def break_it() -> bool:
        if bench.status.is_open and bench.status.opens not in opens:
            opens.append(bench.status.opens)
            peer.send(error_frame(0x40))
        return True

    holds_for(break_it, 2.0)
    assert 2 <= len(opens) <= 2 + 2.0 / 0.4 + 2


def test_quiet_bus_sleeps(can_bus: CanBus, bench: Bench, session: CanSession) -> None:
    activate(bench, can_bus)
    assert bench.steps_within(0.5) < 0.5 / 0.02 + 30
