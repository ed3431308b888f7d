# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which unit the Akron session follows, and where to."""

from typing import Any

import pytest

from akron_can_bridge.session import Positions, UnitChanged
from bridge_core.j1939 import CanFrame
from bridge_core.session import StopChanged, Verdict
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    ef,
    joystick,
    LINK_LIMIT,
    MOVE,
    moved,
    MOVING,
    NAME,
    name,
    NO_FAULTS,
    NOT_ENABLED,
    of,
    OTHER_ANNOUNCED,
    OTHER_PIN,
    OURS,
    OUTPUTS,
    PIN,
    POSITION,
    REST,
    UNIT,
)

NAME_REQUEST = CanFrame(0x18EAFF38, bytes.fromhex('00EE00'))  # the manual's, from address 38
STRANGER = '0100000000000000'  # a NAME that is not Akron Brass's


def name_requests(bench: Bench, since: float = 0.0) -> list[float]:
    return [at for at, frame in bench.sent if frame == NAME_REQUEST and at >= since]


# -- finding it -----------------------------------------------------------------------------------


def test_name_request_goes_out_at_the_start_and_every_second_while_nothing_is_heard() -> None:
    bench = Bench()
    bench.open()
    assert name_requests(bench) == [100.0]
    bench.wait(10.0)
    assert len(name_requests(bench)) == 10
    bench.take(ANNOUNCED)
    start = bench.now
    bench.run(3.0)
    assert name_requests(bench, start) == []
    bench.wait(5.0)
    assert 4 <= len(name_requests(bench, start)) <= 5


def test_announcement_makes_the_unit_known_and_the_polls_go_to_its_address() -> None:
    bench = Bench()
    bench.open()
    assert bench.session.estop
    assert 'no unit was found (wanted: 6032 Universal II)' in bench.session.stop_reasons(0.0)[0]
    events = bench.take(ANNOUNCED)
    assert UnitChanged(f'unit {PIN} is at address 80', PIN, 1032) in events
    assert bench.session.link_up
    assert sorted(bench.asked()) == ['02', '03', '04', '05']
    assert bench.session.estop  # enable and faults are not known
    bench.take(OUTPUTS)
    assert bench.session.estop
    assert StopChanged(Verdict(False, False, True)) in bench.take(NO_FAULTS)
    assert not bench.session.estop
    assert bench.session.stop_reasons(bench.now) == []


def test_unit_that_was_not_announced_is_not_believed() -> None:
    bench = Bench()
    bench.open()
    bench.take(OUTPUTS, POSITION, NO_FAULTS, NAME)
    assert bench.session.estop
    assert not bench.session.link_up
    assert of(Positions, bench.events) == []
    assert bench.session.decoder.other_frames == 3


@pytest.mark.parametrize(
    ('options', 'unit'),
    [
        ({}, 0x80),
        ({'device_type': 0}, 0x80),
        ({'device_pin': OTHER_PIN}, 0x81),
        # Its highest bit counted, as the printed example does not: 26021A0B hex.
        ({'device_pin': '1032AE637671947'}, 0x80),
        ({'device_pin': OTHER_PIN, 'device_type': 1040}, 0x81),
        ({'device_type': 1052}, None),
        ({'device_pin': '1032AE100801037'}, None),
    ],
)
def test_choice_by_pin_or_type(options: dict[str, Any], unit: int | None) -> None:
    bench = Bench(**options)
    bench.open()
    bench.take(ANNOUNCED, OTHER_ANNOUNCED)
    assert bench.session.finder.address == unit
    if unit is None:
        reason = bench.session.stop_reasons(bench.now)[0]
        assert f'heard instead: {PIN}, {OTHER_PIN}' in reason


def test_joystick_of_the_same_maker_is_never_taken_for_the_unit() -> None:
    bench = Bench(device_type=0)
    bench.open()
    # By hand: digits 1-4 are 1035 = 40B hex instead of 408.
    bench.take(ef('FF831502E6021A0B', 0x82))
    assert bench.session.finder.devices == {'1035AE100801035': 0x82}
    assert bench.session.finder.address is None


def test_choice_by_type_stays_with_the_first_and_tells_of_the_other() -> None:
    bench = Bench().find_unit()
    bench.take(OTHER_ANNOUNCED)
    bench.wait(5.0)
    bench.take(OTHER_ANNOUNCED)
    assert bench.session.finder.address == 0x80
    assert bench.session.finder.rivals() == [OTHER_PIN]
    assert Bench(device_pin=PIN).find_unit().session.finder.rivals() == []


def test_two_units_each_with_its_session() -> None:
    one, two = Bench(device_pin=PIN), Bench(device_pin=OTHER_PIN, source_address=0x37)
    for bench in (one, two):
        bench.open()
        bench.take(ANNOUNCED, OTHER_ANNOUNCED)
    one.take(OUTPUTS, moved(NOT_ENABLED, 0x81), NO_FAULTS)
    two.take(OUTPUTS, moved(NOT_ENABLED, 0x81), CanFrame(0x18EF3781, NO_FAULTS.data))
    assert not one.session.estop
    assert 'enable input' in two.session.stop_reasons(two.now)[0]
    # Each one's frames are a foreign joystick to the other, unless they are told.
    one.take(joystick(source=0x37))
    assert one.session.estop
    told = Bench(device_pin=PIN, allowed_joysticks=frozenset({0x37})).find_unit()
    told.take(joystick(source=0x37))
    assert not told.session.estop


# -- moving it ------------------------------------------------------------------------------------


def test_readdressed_in_the_midst_of_motion_it_goes_on() -> None:
    bench = Bench(soe_permissive=True).moving()
    events = bench.take(moved(ANNOUNCED, 0x90))
    assert of(UnitChanged, events) == [UnitChanged(f'unit {PIN} is at address 90', PIN, 1032)]
    start = bench.now + 1e-9
    for _ in range(10):
        bench.wait(0.02)
        bench.take(moved(OUTPUTS, 0x90))
        bench.estop_in(False)
        bench.command(MOVE)
    assert not bench.session.estop
    assert set(bench.joystick_frames(start)) == {MOVING}
    assert bench.asked(start, 0x90) != []
    assert bench.asked(start, 0x80) == []
    assert bench.session.finder.moves == 1


def test_old_address_says_nothing_any_more() -> None:
    bench = Bench().find_unit()
    bench.take(moved(ANNOUNCED, 0x90))
    bench.take(NOT_ENABLED)
    assert not bench.session.estop
    bench.wait(LINK_LIMIT)
    bench.take(OUTPUTS)
    assert bench.session.estop


@pytest.mark.parametrize(
    ('frame', 'text'),
    [
        (name(STRANGER, 0x80), 'to another device'),
        (moved(OTHER_ANNOUNCED, 0x80), f'to {OTHER_PIN}'),
    ],
)
def test_lost_address_is_not_believed_any_more_and_names_are_asked_for(
    frame: CanFrame, text: str
) -> None:
    bench = Bench().find_unit()
    bench.run(0.5, REST)
    start = bench.now
    (lost,) = of(UnitChanged, bench.take(frame))
    assert lost == UnitChanged(f'unit {PIN} has lost address 80 {text}', PIN, 1032)
    assert name_requests(bench, start) == [start]
    bench.take(NOT_ENABLED)  # whoever that is now
    assert not bench.session.estop
    bench.wait(LINK_LIMIT)
    assert bench.session.estop
    assert 'has no address at present' in bench.session.stop_reasons(bench.now)[0]
    bench.take(moved(ANNOUNCED, 0x85), moved(OUTPUTS, 0x85), moved(NO_FAULTS, 0x85))
    assert not bench.session.estop
    assert bench.session.finder.moves == 1


def test_claims_on_and_on_do_not_make_us_flood_the_bus() -> None:
    bench = Bench().find_unit()
    start = bench.now
    for _ in range(1000):
        bench.take(name(STRANGER, 0x80))
        bench.take(ANNOUNCED)
        bench.now += 0.001
    assert 5 <= len(name_requests(bench, start)) <= 11


def test_another_device_that_claims_our_own_address_is_told() -> None:
    bench = Bench().find_unit()
    bench.take(name(STRANGER, OURS))
    assert bench.session.finder.namesake is not None
    bench.take(name(STRANGER, 0x99))  # it gave way
    assert bench.session.finder.namesake is None


# -- at a fixed address ---------------------------------------------------------------------------


def test_unit_that_announces_nothing_is_used_at_its_address() -> None:
    bench = Bench(unit_address=0x90)
    bench.open()
    assert 'check power and CAN wiring of unit at 90' in bench.session.stop_reasons(bench.now)[0]
    bench.take(OUTPUTS, POSITION, NO_FAULTS)  # from 80: somebody else
    assert bench.session.estop
    bench.take(moved(OUTPUTS, 0x90), moved(NO_FAULTS, 0x90))
    assert not bench.session.estop
    assert bench.session.values(bench.now)['unit'] == 'at 90'
    assert bench.session.values(bench.now)['type'] == '6032 Universal II'
    bench.take(moved(NOT_ENABLED, 0x90))
    assert 'not asserted' in bench.session.stop_reasons(bench.now)[0]


@pytest.mark.parametrize('frame', [name(STRANGER, UNIT), moved(OTHER_ANNOUNCED, UNIT)])
def test_another_device_at_the_fixed_address_is_not_believed(frame: CanFrame) -> None:
    bench = Bench(unit_address=UNIT, device_pin=PIN)
    bench.open()
    bench.take(OUTPUTS, NO_FAULTS)
    assert not bench.session.estop
    bench.take(frame)
    bench.run(0.5)
    assert bench.session.estop
    assert 'has no address at present' in bench.session.stop_reasons(bench.now)[0]
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    assert not bench.session.estop
