# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which packets are our base unit's, and how new they are: manual section 3.2."""

from __future__ import annotations

import math

from vm110_bridge.protocol import Input, Packet, PeriodicInput
from vm110_bridge.session.sender import Sender
from vm110_bridge.session.serials import Arrival, SerialNumbers

MEMORY = 5.0  # seconds for which what was heard last counts as being there
_MANY = 8  # other base units that are remembered


class Origin:
    """
    Follows one base unit on a group, by its ID, its address and its serial numbers.

    :param bu_id: 0: the first base unit that is heard. :param whole: see Sender.
    """

    def __init__(self, bu_id: int, *, whole: bool) -> None:
        self.bu_id = bu_id
        self.sender = Sender(whole=whole)
        self.serials = SerialNumbers()
        self.foreign = 0  # packets of other base units
        self.looped_back = 0  # packets that only a machine controller sends
        self._looped_back_at = -math.inf
        self._others: dict[int, float] = {}  # when another base unit was heard last

    def others(self, now: float) -> list[int]:
        """Return the IDs of other base units that were heard lately."""
        return [origin for origin, at in self._others.items() if now - at < MEMORY]

    def is_looped_back(self, now: float) -> bool:
        """Tell whether packets of a machine controller came lately."""
        return now - self._looped_back_at < MEMORY

    def forget_others(self) -> None:
        """Forget who else was heard, and do not count what was sent meanwhile as lost."""
        self._others.clear()
        self.serials.forgive_gap()

    def place(self, packet: Packet, now: float, *, silent: bool) -> Arrival | None:
        """
        Tell how new a packet is; None: our base unit did not send it.

        :param silent: our base unit has not been heard for so long that its link is lost.
        """
        message = packet.message
        if not isinstance(message, Input):
            self.looped_back += 1
            self._looped_back_at = now
            return None
        periodic = isinstance(message, PeriodicInput)
        if self.bu_id == 0 and periodic:
            self.bu_id = packet.origin
        if packet.origin != self.bu_id:
            self._note_foreign(packet.origin, now)
            return None
        moves = self.sender.moves
        ours = self.sender.is_ours(packet.source, now, silent=silent, periodic=periodic)
        if self.sender.moves > moves:
            self.serials.begin()
        if not ours:
            return None
        return self.serials.hear(packet.serial, now, silent=silent, content=message)

    def _note_foreign(self, origin: int, now: float) -> None:
        self.foreign += 1
        self._others = {each: self._others[each] for each in self.others(now)}
        if self.bu_id and (len(self._others) < _MANY or origin in self._others):
            self._others[origin] = now
