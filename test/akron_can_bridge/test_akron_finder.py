# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron finder by itself: what it forgets, and whom it asks when."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from akron_can_bridge.protocol import AddressAnnouncement, Name
from akron_can_bridge.session import Settings
from akron_can_bridge.session.finder import Finder
from bridge_core.j1939 import NULL_ADDRESS
from stage.akron_session_rig import NAME as NAME_FRAME, OTHER_PIN, PIN, UNIT

NOW = 100.0
OURS, OTHER = AddressAnnouncement(PIN), AddressAnnouncement(OTHER_PIN)
NAME = Name.from_data(NAME_FRAME.data)
RENAMED = replace(NAME, function=NAME.function + 1)
STRANGER = Name(identity=1, manufacturer=0)
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


def test_name_claimed_before_a_new_start_is_not_held_against_the_unit() -> None:
    finder = started()
    finder.claimed(UNIT, NAME, NOW)
    finder.start(NOW + 1.0)
    finder.announced(UNIT, OURS, NOW + 1.0)
    assert finder.claimed(UNIT, RENAMED, NOW + 1.0) == ''
    assert finder.address == UNIT


def test_address_lost_after_a_new_start_is_asked_for_at_once() -> None:
    finder = started()
    assert finder.request_due(NOW, heard=False)
    finder.request_sent(NOW)
    finder.start(NOW + 0.01)
    finder.announced(UNIT, OURS, NOW + 0.01)
    assert 'has lost address 80' in finder.claimed(UNIT, STRANGER, NOW + 0.01)
    assert finder.request_due(NOW + 0.01, heard=True)


@pytest.mark.parametrize(
    ('asked', 'name', 'after', 'restarted'),
    [
        (False, NAME, 0.0, True),
        (True, NAME, 1.0, False),
        (True, NAME, 1.0 + 1e-6, True),
        (False, STRANGER, 0.0, False),
    ],
)
def test_claim_within_a_second_of_a_request_is_its_answer_and_no_restart(
    asked: bool, name: Name, after: float, restarted: bool
) -> None:
    finder = started()
    finder.announced(UNIT, OURS, NOW)
    if asked:
        finder.request_sent(NOW)
    finder.expect_reset()
    finder.claimed(UNIT, name, NOW + after)
    assert finder.is_back(OURS, NOW + 9.0) is restarted


def test_unit_of_a_session_before_is_the_only_one() -> None:
    finder = started()
    assert not finder.keep('')
    assert not finder.keep(PIN)
    finder.announced(0x81, AddressAnnouncement(OTHER_PIN), NOW)
    assert finder.unit is None
    finder.announced(UNIT, OURS, NOW)
    assert not finder.keep('')
    assert finder.keep(OTHER_PIN)
    assert finder.pin == OTHER_PIN
    finder.announced(UNIT, OURS, NOW)
    assert finder.unit is None


def test_unit_of_a_session_before_does_not_overrule_the_pin_that_is_given() -> None:
    finder = Finder(Settings(device_pin=PIN))
    assert not finder.keep(OTHER_PIN)
    assert finder.pin == PIN


def test_pin_of_the_unit_at_its_fixed_address_is_told_once() -> None:
    finder = Finder(Settings(unit_address=UNIT, device_type=1032))
    finder.start(NOW)
    assert finder.announced(UNIT, OURS, NOW) == f'unit {PIN} is at address 80'
    assert not finder.announced(UNIT, OURS, NOW)


def test_sender_without_an_address_is_not_followed() -> None:
    finder = started()
    assert finder.announced(NULL_ADDRESS, OURS, NOW) == ''
    assert finder.address is None
    assert finder.devices == {}


def test_so_many_devices_are_remembered_and_followed_and_no_more() -> None:
    finder = started()
    pins = [f'1032AE{number:09}' for number in range(MANY + 1)]
    for address, pin in enumerate(pins):
        finder.announced(0x40 + address, AddressAnnouncement(pin), NOW)
    assert list(finder.devices) == pins[:MANY]
    finder.announced(0xA0, AddressAnnouncement(pins[5]), NOW)
    assert finder.devices[pins[5]] == 0xA0


def test_only_a_change_of_the_address_counts_as_a_move() -> None:
    finder = started()
    moves = []
    for address in (UNIT, UNIT, 0x82, UNIT):
        finder.announced(address, OURS, NOW)
        moves.append(finder.moves)
    finder.claimed(UNIT, STRANGER, NOW)
    assert finder.address is None
    finder.announced(UNIT, OURS, NOW)
    assert [*moves, finder.moves] == [0, 0, 1, 2, 2]


# -- whose a claimed address is -------------------------------------------------------------------


def fixed() -> Finder:
    """Return one whose unit is at an address that was given, and of which nothing was heard."""
    finder = Finder(Settings(unit_address=UNIT))
    finder.start(NOW)
    return finder


def test_fixed_address_is_lost_to_another_maker_and_comes_back_with_the_unit() -> None:
    finder = fixed()
    finder.announced(0x81, OTHER, NOW)
    assert 'has lost address 80 to another device' in finder.claimed(UNIT, STRANGER, NOW)
    assert finder.address is None
    assert finder.claimed(0x90, NAME, NOW) == ''
    assert finder.address is None
    assert finder.claimed(UNIT, NAME, NOW) == ''
    assert finder.address == UNIT


def test_claims_of_other_addresses_leave_a_fixed_one() -> None:
    finder = fixed()
    for name in (STRANGER, NAME):
        assert finder.claimed(0x90, name, NOW) == ''
        assert finder.address == UNIT


def test_fixed_address_does_not_come_back_with_another_unit_of_the_maker() -> None:
    finder = fixed()
    finder.announced(UNIT, OURS, NOW)
    assert 'has lost address 80' in finder.announced(UNIT, OTHER, NOW)
    assert finder.claimed(UNIT, NAME, NOW) == ''
    assert finder.address is None


def test_name_that_was_heard_counts_in_whole() -> None:
    finder = started()
    finder.announced(UNIT, OURS, NOW)
    assert finder.claimed(UNIT, NAME, NOW) == ''
    assert 'has lost address 80' in finder.claimed(UNIT, RENAMED, NOW)


def test_name_at_another_address_is_not_kept_as_the_units() -> None:
    finder = started()
    finder.announced(UNIT, OURS, NOW)
    assert 'and claims another' in finder.claimed(0x90, RENAMED, NOW)
    finder.announced(UNIT, OURS, NOW)
    assert finder.claimed(UNIT, NAME, NOW) == ''
    assert finder.address == UNIT


@pytest.mark.parametrize('other', [{'manufacturer': 0}, {'identity': NAME.identity + 1}])
def test_name_of_another_maker_or_number_is_not_the_units(other: dict[str, Any]) -> None:
    finder = started()
    finder.announced(UNIT, OURS, NOW)
    assert 'has lost address 80' in finder.claimed(UNIT, replace(NAME, **other), NOW)


def test_without_a_unit_there_are_no_rivals() -> None:
    finder = Finder(Settings(device_type=1042))
    finder.start(NOW)
    finder.announced(UNIT, OURS, NOW)
    assert finder.unit is None
    assert finder.devices
    assert finder.rivals() == []
    assert not finder.alone


def test_without_a_unit_none_of_its_type_is_a_rival() -> None:
    finder = Finder(Settings())
    finder.start(NOW)
    finder.devices[OTHER_PIN] = 0x81
    assert finder.rivals() == []
