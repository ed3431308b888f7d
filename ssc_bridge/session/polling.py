"""Asking for the messages that do not come by themselves: manual 4.2.1."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Mapping
import math

from ssc_bridge.protocol import MessageType
from ssc_bridge.protocol import Poll

# What comes by itself may be late by this part of its period before it is asked for.
_PATIENCE = 1.5


class _Slot:
    """When one message is to be asked for. :param period: s."""

    __slots__ = ('asked', 'due', 'heard_at', 'period')

    def __init__(self, period: float) -> None:
        self.period = period
        self.due = 0.0
        self.asked = False  # and not answered yet
        self.heard_at = -math.inf

    def heard(self, now: float) -> None:
        self.heard_at = now
        if not self.asked:
            self.due = now + _PATIENCE * self.period
        self.asked = False


class Poller:
    """
    Polls. Which messages are wanted at the moment, its user says.

    :param rates: Hz; a message with 0 is never asked for.
    """

    def __init__(self, rates: Mapping[MessageType, float]) -> None:
        self._slots = {
            kind: _Slot(1.0 / rate if rate else math.inf) for kind, rate in rates.items()
        }

    def start(self, now: float) -> None:
        """Have all due at once, and none heard."""
        for slot in self._slots.values():
            slot.due = now if math.isfinite(slot.period) else math.inf
            slot.asked, slot.heard_at = False, -math.inf

    def heard(self, kind: MessageType, now: float) -> None:
        """Note that a message came."""
        self._slots[kind].heard(now)

    def age(self, now: float) -> float:
        """Return the seconds since any message was heard; infinite if none was."""
        return now - max(slot.heard_at for slot in self._slots.values())

    def take(self, now: float, wanted: Iterable[MessageType]) -> list[bytes]:
        """Return the polls that are due."""
        due = [kind for kind in wanted if now >= self._slots[kind].due]
        for kind in due:
            slot = self._slots[kind]
            slot.due, slot.asked = now + slot.period, True
        return [Poll(kind).to_bytes() for kind in due]

    def deadline(self, wanted: Iterable[MessageType]) -> float:
        """Return when the next of these is due."""
        return min(self._slots[kind].due for kind in wanted)
