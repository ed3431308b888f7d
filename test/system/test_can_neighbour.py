# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
An Akron bridge and its unit beside a real J1939 stack that claims addresses.

The unit's part in a contention is our simulator's, the neighbour's is can-j1939's: what they agree
on is J1939-81.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from std_msgs.msg import Bool

from akron_can_bridge.simulator import Simulator
from stage.akron_node_rig import Bench, bench_of, Station
from stage.can_rig import CanBus, error_frame, make_bus
from stage.rig import Observer
from test.system.neighbour_rig import Neighbour

UNIT, NEXT = 0x80, 0x81  # where the unit begins to claim, and what it takes then
OURS = 0x38


@pytest.fixture(scope='module')
def shared() -> Iterator[tuple[CanBus, Bench, Station]]:
    bus = make_bus()
    with (
        Observer() as observer,
        Station(Simulator(), bus) as station,
        bench_of(observer, bus) as bench,
    ):
        yield bus, bench, station
    bus.close()


@pytest.fixture
def bus(shared: tuple[CanBus, Bench, Station]) -> CanBus:
    return shared[0]


@pytest.fixture
def unit(shared: tuple[CanBus, Bench, Station]) -> Station:
    shared[2].exchange(Simulator())
    return shared[2]


@pytest.fixture
def bench(shared: tuple[CanBus, Bench, Station], unit: Station) -> Bench:
    result = shared[1].connect()
    result.wait(lambda: address_of(result) == UNIT, 'the unit at its first address')
    return result


def address_of(bench: Bench) -> int:
    """Return where the node takes its unit to be; 0: nowhere."""
    text = bench.value('address')
    return 0 if text in ('', 'none') else int(text, 16)


def test_neighbour_with_an_address_of_its_own_disturbs_nobody(
    bus: CanBus, bench: Bench, unit: Station
) -> None:
    before = len(bench.node.output)
    bench.drive(unit)
    with Neighbour(bus, 0x90, strong=True) as neighbour:
        neighbour.wait_address(0x90)
        for _ in range(50):
            neighbour.talk()
        neighbour.ask_names()
        bench.drive(unit)
    assert address_of(bench) == UNIT
    assert unit.look('address') == f'{UNIT:02X}'
    assert 'lost address' not in bench.node.output[before:]


def test_stronger_neighbour_moves_the_unit_and_the_node_follows(
    bus: CanBus, bench: Bench, unit: Station
) -> None:
    bench.drive(unit)
    with Neighbour(bus, UNIT, strong=True) as neighbour:
        neighbour.wait_address(UNIT)
        bench.wait(lambda: address_of(bench) == NEXT, 'the unit at its next address')
        bench.wait_stop(False)
        bench.drive(unit)


def test_weaker_neighbour_moves_on_and_the_unit_stays(
    bus: CanBus, bench: Bench, unit: Station
) -> None:
    bench.drive(unit)
    with Neighbour(bus, UNIT, strong=False) as neighbour:
        neighbour.wait_address(NEXT)
        assert unit.look('address') == f'{UNIT:02X}'
        bench.wait_stop(False)
        bench.drive(unit)
        assert address_of(bench) == UNIT


def test_neighbour_at_our_own_address_is_reported_and_we_go_on(
    bus: CanBus, bench: Bench, unit: Station
) -> None:
    with Neighbour(bus, OURS, strong=True) as neighbour:
        neighbour.wait_address(OURS)
        bench.wait(lambda: f'{OURS:02X}' in bench.told(), 'the report')
        bench.drive(unit)
        assert len(neighbour.claims) == 1  # nobody contends: our address is fixed


def test_trouble_of_the_bus_is_in_the_diagnostic_of_the_link(
    bus: CanBus, bench: Bench, unit: Station
) -> None:
    before = int(bench.value('error passive', 'link'))
    bus.endpoint().send(error_frame(0x04, controller=0x20))
    bench.wait(lambda: int(bench.value('error passive', 'link')) == before + 1, 'the count')
    bench.wait_stop(False)


def test_bus_off_is_a_stop_in_words_until_the_bus_is_back(
    bus: CanBus, bench: Bench, unit: Station
) -> None:
    bench.drive(unit)
    seen = len(bench.estop.messages)
    bus.endpoint().send(error_frame(0x40))
    bench.wait(lambda: Bool(data=True) in bench.estop.messages[seen:], 'a stop')
    bench.wait(lambda: not unit.plugged, 'a unit that is off as well')
    unit.apply('plug')
    bench.wait_stop(False)
    words = 'bus off; check bit rate, wiring and termination'
    bench.wait(lambda: words in bench.node.output, words)
    bench.drive(unit)
