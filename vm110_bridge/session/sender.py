# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Where the base unit sends from: one ID, one address.

The manual (3.2) has an ID tell who a packet is from, and nothing keeps anybody else from using it.
So the first address that a VRPI comes from counts, and another one is a second sender. While both
are heard, nobody knows which of them is the base unit. An address from which nothing comes any
more may have changed: a base unit that was switched on again may have another lease.
"""

from __future__ import annotations

import math

DOUBLED_TIME = 3.0  # s for which two count as such after they were last heard beside each other


class Sender:
    """
    Follows the address of one base unit.

    :param whole: addresses differ by their UDP port, too.
    """

    def __init__(self, *, whole: bool) -> None:
        self.address: str | None = None  # None: not known yet
        self.second = ''  # the last other one
        self.doubles = 0  # packets of others
        self.moves = 0
        self._whole = whole
        self.doubled_until = -math.inf

    def is_doubled(self, now: float) -> bool:
        """Tell whether two were heard beside each other not long ago."""
        return now < self.doubled_until

    def is_ours(self, source: str, now: float, *, silent: bool, periodic: bool) -> bool:
        """
        Tell whether a packet with the base unit's ID is the base unit's.

        :param source: its sender, as 'address:port'. :param silent: the base unit has not been
            heard for so long that its link is lost. :param periodic: the packet is a VRPI.
        """
        source = source if self._whole else source.partition(':')[0]
        if source == self.address:
            return True
        if periodic and (self.address is None or silent):
            self.moves += self.address is not None
            self.address = source
            return True
        if self.address is None:
            return False
        self.second = source
        self.doubles += 1
        if not silent:
            self.doubled_until = now + DOUBLED_TIME
        return False
