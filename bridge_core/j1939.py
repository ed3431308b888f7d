# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
CAN frames, and the fields of their 29-bit identifiers after SAE J1939-21.

=====  ================  =======================================================
bits   field             meaning
=====  ================  =======================================================
28-26  priority          0 is the highest
25     reserved          part of the PGN here, as in the standard's newer editions
24     data page         part of the PGN
23-16  PDU format        below 240: the next byte is an address (PDU1)
15-8   PDU specific      destination address (PDU1) or the PGN's low byte (PDU2)
7-0    source address    address of the sender
=====  ================  =======================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

GLOBAL_ADDRESS = 0xFF
NULL_ADDRESS = 0xFE
_PDU2 = 0xF0  # PDU formats from here on have no destination


@dataclass(frozen=True, slots=True)
class CanFrame:
    """
    One data frame of classic CAN with an extended identifier.

    :param identifier: 0 to 0x1FFFFFFF. :param data: 0 to 8 bytes.
    :raises ValueError: out of range.
    """

    identifier: int
    data: bytes

    def __post_init__(self) -> None:
        if not 0 <= self.identifier <= 0x1FFFFFFF:
            raise ValueError(f'identifier {self.identifier:#x} has more than 29 bits')
        if len(self.data) > 8:
            raise ValueError(f'{len(self.data)} bytes of data; 8 are the most')


@dataclass(frozen=True, slots=True)
class J1939Id:
    """
    The fields of an identifier.

    :param priority: 0 to 7. :param pgn: parameter group number, 18 bits; its low byte is 0
        if it has a destination. :param source: address of the sender.
    :param destination: address; GLOBAL_ADDRESS if the PGN has none.
    :raises ValueError: out of range, or contradictory.
    """

    priority: int
    pgn: int
    source: int
    destination: int = GLOBAL_ADDRESS

    def __post_init__(self) -> None:
        if not 0 <= self.priority <= 7:
            raise ValueError(f'priority must be 0 to 7, not {self.priority}')
        if not 0 <= self.pgn <= 0x3FFFF:
            raise ValueError(f'PGN {self.pgn:#x} has more than 18 bits')
        if not (0 <= self.source <= 0xFF and 0 <= self.destination <= 0xFF):
            raise ValueError('addresses must be 0 to 255')
        if self._has_destination(self.pgn):
            if self.pgn & 0xFF:
                raise ValueError(f'PGN {self.pgn:#x} has a destination: its low byte must be 0')
        elif self.destination != GLOBAL_ADDRESS:
            raise ValueError(f'PGN {self.pgn:#x} has no destination')

    @staticmethod
    def _has_destination(pgn: int) -> bool:
        return pgn >> 8 & 0xFF < _PDU2

    @staticmethod
    @lru_cache(maxsize=1024)  # a bus has few
    def from_identifier(identifier: int) -> J1939Id:
        """Split a 29-bit identifier into its fields."""
        pgn = identifier >> 8 & 0x3FFFF
        destination = GLOBAL_ADDRESS
        if J1939Id._has_destination(pgn):
            pgn, destination = pgn & 0x3FF00, pgn & 0xFF
        return J1939Id(identifier >> 26 & 7, pgn, identifier & 0xFF, destination)

    @property
    def identifier(self) -> int:
        """The 29 bits."""
        specific = self.destination if self._has_destination(self.pgn) else 0
        return self.priority << 26 | self.pgn << 8 | specific << 8 | self.source
