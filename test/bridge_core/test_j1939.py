# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Identifiers of SAE J1939-21, taken apart and put together."""

from hypothesis import given, strategies
import pytest

from bridge_core.j1939 import CanFrame, GLOBAL_ADDRESS, J1939Id


@pytest.mark.parametrize(
    ('identifier', 'parts'),
    [
        # Worked out by hand from the bit table of J1939-21.
        (0x0CFDD633, J1939Id(3, 64982, 0x33)),
        (0x18EAFFF9, J1939Id(6, 59904, 0xF9, GLOBAL_ADDRESS)),
        (0x18EF28F0, J1939Id(6, 0xEF00, 0xF0, 0x28)),
        (0x1DFFFF01, J1939Id(7, 0x1FFFF, 0x01)),
        # The last PDU format with a destination, and the first without.
        (0x18EFFF01, J1939Id(6, 0xEF00, 0x01)),
        (0x18F00101, J1939Id(6, 0xF001, 0x01)),
    ],
)
def test_identifier_known_by_hand(identifier: int, parts: J1939Id) -> None:
    assert J1939Id.from_identifier(identifier) == parts
    assert parts.identifier == identifier


@given(strategies.integers(0, 0x1FFFFFFF))
def test_every_identifier_comes_back(identifier: int) -> None:
    assert J1939Id.from_identifier(identifier).identifier == identifier


@pytest.mark.parametrize(
    'wrong',
    [
        {'priority': 8},
        {'priority': -1},
        {'pgn': 0x40000},
        {'pgn': 0xEF01},
        {'source': 256},
        {'source': -1},
        {'destination': 256},
        {'destination': -1},
        {'pgn': 64982, 'destination': 1},
    ],
)
def test_what_does_not_fit_is_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=r'priority|PGN|addresses'):
        J1939Id(**{'priority': 3, 'pgn': 0xEF00, 'source': 1, **wrong})


@pytest.mark.parametrize('identifier', [0, 0x1FFFFFFF])
def test_identifiers_have_29_bits(identifier: int) -> None:
    assert CanFrame(identifier, bytes(8)).identifier == identifier


def test_frame_that_can_does_not_have_is_refused() -> None:
    for identifier in (-1, 0x20000000):
        with pytest.raises(ValueError, match='29 bits'):
            CanFrame(identifier, b'')
    with pytest.raises(ValueError, match='8 are the most'):
        CanFrame(1, bytes(9))
