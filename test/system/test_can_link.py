# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A link on a CAN bus: each frame reaches the session, a lost bus is told and found again."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from bridge_core.j1939 import CanFrame
from stage.can_rig import activate, CanBus, CanSession, error_frame, HELLO, message, receive
from stage.link_rig import Bench
from stage.rig import wait_for


@pytest.fixture
def session(bench: Bench) -> Iterator[CanSession]:
    session = CanSession()
    bench.session = session
    yield session
    bench.link.stop()


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
