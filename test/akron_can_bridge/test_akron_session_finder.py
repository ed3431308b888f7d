# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which unit the Akron session follows, where to, and what its finder forgets and asks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from akron_can_bridge.protocol import AddressAnnouncement, Name
from akron_can_bridge.session import Settings, UnitChanged
from akron_can_bridge.session.finder import Finder
from bridge_core.j1939 import CanFrame
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
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
    OUTPUTS,
    PIN,
    REST,
    UNIT,
)

NOW = 100.0
OUR_PIN, OTHER = AddressAnnouncement(PIN), AddressAnnouncement(OTHER_PIN)
OUR_NAME = Name.from_data(NAME.data)
RENAMED = replace(OUR_NAME, function=OUR_NAME.function + 1)
STRANGE_NAME = Name(identity=1, manufacturer=0)
MANY = 32


def started() -> Finder:
    finder = Finder(Settings())
    finder.start(NOW)
    return finder


def test_unit_that_was_never_heard_has_no_type() -> None:
    assert Finder(Settings()).device_type == 0
    assert Finder(Settings(unit_address=UNIT, device_type=1032)).device_type == 1032


def test_new_start_forgets_the_devices() -> None:
    finder = started()
    finder.announced(0x81, OTHER, NOW)
    assert finder.devices == {OTHER_PIN: 0x81}
    finder.start(NOW + 1.0)
    assert finder.devices == {}


@pytest.mark.parametrize(
    ('asked', 'name', 'after', 'restarted'),
    [
        (False, OUR_NAME, 0.0, True),
        (True, OUR_NAME, 1.0, False),
        (True, OUR_NAME, 1.0 + 1e-6, True),
        (False, STRANGE_NAME, 0.0, False),
    ],
)
def test_claim_within_a_second_of_a_request_is_its_answer_and_no_restart(
    asked: bool, name: Name, after: float, restarted: bool
) -> None:
    finder = started()
    finder.announced(UNIT, OUR_PIN, NOW)
    if asked:
        finder.request_sent(NOW)
    finder.expect_reset()
    finder.claimed(UNIT, name, NOW + after)
    assert finder.is_back(OUR_PIN, NOW + 9.0) is restarted


def test_unit_of_a_session_before_is_the_only_one() -> None:
    finder = started()
    assert not finder.keep('')
    assert not finder.keep(PIN)
    finder.announced(0x81, AddressAnnouncement(OTHER_PIN), NOW)
    assert finder.unit is None
    finder.announced(UNIT, OUR_PIN, NOW)
    assert not finder.keep('')
    assert finder.keep(OTHER_PIN)
    assert finder.pin == OTHER_PIN
    finder.announced(UNIT, OUR_PIN, NOW)
    assert finder.unit is None


def test_unit_of_a_session_before_does_not_overrule_the_pin_that_is_given() -> None:
    finder = Finder(Settings(device_pin=PIN))
    assert not finder.keep(OTHER_PIN)
    assert finder.pin == PIN


def test_so_many_devices_are_remembered_and_followed_and_no_more() -> None:
    finder = started()
    pins = [f'1032AE{number:09}' for number in range(MANY + 1)]
    for address, pin in enumerate(pins):
        finder.announced(0x40 + address, AddressAnnouncement(pin), NOW)
    assert list(finder.devices) == pins[:MANY]
    finder.announced(0xA0, AddressAnnouncement(pins[5]), NOW)
    assert finder.devices[pins[5]] == 0xA0


def test_without_a_unit_there_are_no_rivals() -> None:
    finder = Finder(Settings(device_type=1042))
    finder.start(NOW)
    finder.announced(UNIT, OUR_PIN, NOW)
    assert finder.unit is None
    assert finder.devices
    assert finder.rivals() == []
    assert not finder.alone


# -- which address it has -------------------------------------------------------------------------

# Devices announce their PIN (ours, other, twin) or claim an address by a OUR_NAME.
PINS = {'ours': OUR_PIN, 'other': OTHER, 'twin': AddressAnnouncement('1032CE100801035')}
NAMES = {
    'Name': OUR_NAME,
    'Twin': replace(OUR_NAME, function_instance=1),  # the same identity number
    'Renamed': RENAMED,
    'Neighbour': replace(OUR_NAME, identity=OUR_NAME.identity + 1),
    'Stranger': replace(OUR_NAME, manufacturer=0),
}
AT = f'unit {PIN} is at address'
LOST = f'unit {PIN} has lost address 80'
TO_ANOTHER, CLAIMS_ANOTHER = f'{LOST} to another device', f'{LOST} and claims another'
# What is heard, the address then, and what was told of it.
STORIES: list[tuple[str, int | None, list[str]]] = [
    ('ours@80 ours@82 ours@82', 0x82, [f'{AT} 80', f'{AT} 82']),
    ('ours@FE', None, []),
    ('ours@80 Name@80 Stranger@81', 0x80, [f'{AT} 80']),
    ('ours@80 Name@80 Renamed@80', None, [f'{AT} 80', TO_ANOTHER]),
    ('ours@80 Neighbour@80', None, [f'{AT} 80', TO_ANOTHER]),
    ('ours@80 Stranger@80', None, [f'{AT} 80', TO_ANOTHER]),
    ('ours@80 Stranger@80 Name@80 ours@80', 0x80, [f'{AT} 80', TO_ANOTHER, f'{AT} 80']),
    ('ours@80 other@80', None, [f'{AT} 80', f'{LOST} to {OTHER_PIN}']),
    ('ours@80 Name@91', None, [f'{AT} 80', CLAIMS_ANOTHER]),
    ('ours@80 Name@FE', None, [f'{AT} 80', CLAIMS_ANOTHER]),  # it cannot claim any
    ('ours@80 Renamed@90', None, [f'{AT} 80', CLAIMS_ANOTHER]),
    ('ours@80 Renamed@90 ours@80 Name@80', 0x80, [f'{AT} 80', CLAIMS_ANOTHER, f'{AT} 80']),
    ('Name@80 restart ours@80 Renamed@80', 0x80, [f'{AT} 80']),
    ('Name@80 ours@80 Twin@91 twin@91', 0x80, [f'{AT} 80']),
    ('ours@80 twin@91 Name@91', 0x80, [f'{AT} 80']),
    ('Name@80 ours@80 Twin@80 ours@80 Twin@80', 0x80, [f'{AT} 80', TO_ANOTHER, f'{AT} 80']),
]
# The same where the unit is at an address that is given.
FIXED: list[tuple[str, int | None, list[str]]] = [
    ('ours@80 ours@80 other@81 ours@91 Name@91', 0x80, [f'{AT} 80']),
    ('other@81 Stranger@80 Name@90', None, ['unit at 80 has lost address 80 to another device']),
    ('Stranger@80 Name@80', 0x80, ['unit at 80 has lost address 80 to another device']),
    ('Stranger@90 Name@90', 0x80, []),
    ('ours@80 other@80 Name@80', None, [f'{AT} 80', f'{LOST} to {OTHER_PIN}']),
]


@pytest.mark.parametrize(
    ('options', 'story', 'address', 'told'),
    [
        *(({}, *row) for row in STORIES),
        *(({'unit_address': UNIT, 'device_type': 1032}, *row) for row in FIXED),
    ],
)
def test_address_is_followed_and_told_on_change(
    options: dict[str, Any], story: str, address: int | None, told: list[str]
) -> None:
    finder = Finder(Settings(**options))
    finder.start(NOW)
    texts = []
    for word in story.split():
        what, _, at = word.partition('@')
        if what == 'restart':
            finder.start(NOW)
        elif what in PINS:
            texts.append(finder.announced(int(at, 16), PINS[what], NOW))
        else:
            texts.append(finder.claimed(int(at, 16), NAMES[what], NOW))
    assert (finder.address, [text for text in texts if text]) == (address, told)


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
