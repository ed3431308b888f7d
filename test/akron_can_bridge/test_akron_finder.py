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


def test_without_a_unit_there_are_no_rivals() -> None:
    finder = Finder(Settings(device_type=1042))
    finder.start(NOW)
    finder.announced(UNIT, OURS, NOW)
    assert finder.unit is None
    assert finder.devices
    assert finder.rivals() == []
    assert not finder.alone


# -- which address it has -------------------------------------------------------------------------

# Devices announce their PIN (ours, other, twin) or claim an address by a NAME.
PINS = {'ours': OURS, 'other': OTHER, 'twin': AddressAnnouncement('1032CE100801035')}
NAMES = {
    'Name': NAME,
    'Twin': replace(NAME, function_instance=1),  # the same identity number
    'Renamed': RENAMED,
    'Neighbour': replace(NAME, identity=NAME.identity + 1),
    'Stranger': replace(NAME, manufacturer=0),
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
