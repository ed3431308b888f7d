# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Address claiming of SAE J1939-81, as Akron Brass devices do it (Appendix A)."""

from __future__ import annotations

import math

from akron_can_bridge.simulator.frames import build_announcement, build_name
from bridge_core.j1939 import CanFrame, NULL_ADDRESS

CLAIM_TIME = 0.25  # for others to contend, until a claimed address is used
_FIRST, _LAST = 0x80, 0xF7  # dynamic addresses
_IO_CONTROLLER = 66


class Claim:
    """
    One device's way to its address.

    :param pin: 15 characters. :param address: the one wanted; a device that wants one below 80 hex
        keeps to it, or is silent once it has lost it.
    """

    def __init__(self, pin: str, address: int, *, top_bit: bool = True) -> None:
        self.pin = pin
        self.top_bit = top_bit
        self.wanted = address
        self.address = NULL_ADDRESS
        self._others: dict[int, bytes] = {}
        self._ready_at = math.inf  # when the address may be used
        self._unannounced = False
        self._out: list[CanFrame] = []

    @property
    def capable(self) -> bool:
        """It takes another address where it loses one."""
        return self.wanted >= _FIRST

    @property
    def name(self) -> CanFrame:
        """The NAME that goes out from the present address."""
        identity = int(self.pin[6:]) % (1 << 21)
        return build_name(self.address, identity, _IO_CONTROLLER, self.capable)

    def start(self, now: float) -> None:
        """Claim the wanted address, or the next free one."""
        self._out.clear()
        self._claim(self.wanted, now)

    def move(self, address: int, now: float) -> None:
        """Leave the present address for another."""
        self.wanted = address
        self.start(now)

    def has(self, now: float) -> bool:
        """Tell whether the address is ours to use."""
        return self.address != NULL_ADDRESS and now >= self._ready_at

    def hear(self, source: int, name: bytes, now: float) -> None:
        """Hear another device claim an address; it leaves the one that it had."""
        if name == self.name.data:
            return  # a twin or an echo: no rule says who yields, and both would, without end
        self._others = {place: held for place, held in self._others.items() if held != name}
        if source != self.address or source == NULL_ADDRESS:
            self._others[source] = name
        elif self._outranks(name):
            self._out.append(self.name)  # ours is the lower one: we keep the address, and say so
        else:
            self._others[source] = name
            self._claim(source, now)

    def answer(self, now: float) -> None:
        """Hear a request for NAMEs: who has an address tells it, and then its PIN."""
        self._out.append(self.name)
        if self.has(now):
            self._out.append(self._announcement)

    def poll(self, now: float) -> list[CanFrame]:
        """Return what is to be said: claims, and once an address is had, the announcement."""
        if self._unannounced and self.has(now):
            self._unannounced = False
            self._out.append(self._announcement)
        out, self._out = self._out, []
        return out

    def deadline(self) -> float:
        """Return when poll wants to be called."""
        if self._out:
            return -math.inf
        return self._ready_at if self._unannounced else math.inf

    @property
    def _announcement(self) -> CanFrame:
        return build_announcement(self.address, self.pin, self.top_bit)

    def _claim(self, address: int, now: float) -> None:
        places = (address, *range(_FIRST, _LAST + 1)) if self.capable else (address,)
        free = (place for place in places if self._may_claim(place))
        self.address = next(free, NULL_ADDRESS)
        self._out.append(self.name)  # from the null address: "cannot claim"
        self._unannounced = self.address != NULL_ADDRESS
        # Fixed addresses may be used at once.
        self._ready_at = now + (CLAIM_TIME if self.address >= _FIRST else 0.0)

    def _may_claim(self, address: int) -> bool:
        """Tell whether an address is free, or the wanted one and held by a higher NAME."""
        holder = self._others.get(address)
        return holder is None or (address == self.wanted and self._outranks(holder))

    def _outranks(self, name: bytes) -> bool:
        return int.from_bytes(self.name.data, 'little') < int.from_bytes(name, 'little')
