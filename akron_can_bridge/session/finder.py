# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which address our unit has: manual Appendix A.

A unit claims its address (J1939-81), may lose it to another device, and announces its PIN from
each address that it gets. So the PIN is who it is, and the address where it was last. While the
address is not known, the NAME request has all units announce themselves.
"""

from __future__ import annotations

import math

from akron_can_bridge.parameters import CONTROLLERS
from akron_can_bridge.protocol import AddressAnnouncement, AKRON_BRASS, Message, Name
from akron_can_bridge.session.events import DeviceChanged
from akron_can_bridge.session.settings import Settings
from bridge_core.j1939 import NULL_ADDRESS

REQUEST_PERIOD = 1.0
LEAST_REQUEST_PERIOD = 0.1  # somebody who claims on and on must not make us flood the bus
# Longer than a change of address takes (0.25 s, J1939-81) and whatever comes every 100 ms.
_RESTART_SILENCE = 0.5
_MANY = 32  # other devices that are remembered


class Finder:
    """
    Follows one unit. Which PIN was chosen holds for life, which address until the port closes.

    A unit at ``unit_address`` need not announce itself; it loses the address to a device that is
    another one by its announcement or NAME.

    :param settings: whose ``unit_address``, ``device_pin`` or ``device_type`` chooses.
    """

    def __init__(self, settings: Settings) -> None:
        self.pin = settings.device_pin  # of our unit; empty: whichever comes first
        self.unit: AddressAnnouncement | None = None  # ours, once it was heard
        self.address: int | None = None
        self.moves = 0  # to another address
        self.devices: dict[str, int] = {}  # PIN and last address of every Akron Brass device
        self.namesake: Name | None = None  # another device that claims our own address
        self._settings = settings
        self._name: Name | None = None  # of our unit, once it was heard
        self._names: dict[int, Name] = {}  # the last that was claimed, by address
        self._last: int | None = None  # the address that it had last
        self._asked_at = -math.inf
        self._owes_request = True  # to all, since the start, whatever is heard
        self._due = math.inf
        self._restarted = False  # our unit, since its reset was asked for: it was silent for long
        self._claimed = False  # its address since then, with nobody asking

    @property
    def known(self) -> bool:
        """It is known which unit is ours."""
        return self.unit is not None or bool(self._settings.unit_address)

    @property
    def name(self) -> str:
        """What our unit is called."""
        if self.unit is not None:
            return self.unit.pin
        fixed = self._settings.unit_address
        return f'at {fixed:02X}' if fixed else 'not found yet'

    @property
    def device_type(self) -> int:
        """The key of DEVICE_TYPES; 0: not known yet."""
        if self.unit is not None:
            return self.unit.device_type
        return self._settings.unit_type if self._settings.unit_address else 0

    def describe(self) -> DeviceChanged:
        """Return who it is."""
        pin = '' if self.unit is None else self.unit.pin
        known = (pin, self.device_type, self.address, self._name)
        return DeviceChanged(*known, namesake=self.namesake)

    def start(self, now: float) -> None:
        """Begin, or begin anew: ask at once."""
        self.address, self.namesake = self._settings.unit_address or None, None
        self.devices.clear()
        self._names.clear()
        self._asked_at = -math.inf
        self._owes_request = True
        self._due = now

    def keep(self, pin: str) -> bool:
        """Follow the unit of a session before; tell whether another one was found already."""
        self.pin = self._settings.device_pin or pin or self.pin
        if self.unit is None or self.unit.matches(self.pin):
            return False
        self.unit = self._name = None
        return True

    def announced(self, source: int, device: AddressAnnouncement, now: float) -> str:
        """Take a type FF; say in words what it changed for our unit, if anything."""
        if source >= NULL_ADDRESS:
            return ''
        if len(self.devices) < _MANY or device.pin in self.devices:
            self.devices[device.pin] = source
        if self._settings.unit_address not in (0, source):
            return ''
        if self.unit is None and self._fits(device):
            self.unit, self.pin = device, device.pin
            if source == self.address:
                return f'unit {device.pin} is at address {source:02X}'
        if self.unit is None or device.pin != self.unit.pin:
            return self._lose(now, f'to {device.pin}') if source == self.address else ''
        before, self.address = self.address, source
        name = self._names.get(source)
        if name is not None and self._has_identity(name):
            self._name = name
        if before == source:
            return ''
        self.moves += self._last not in (None, source)
        self._last = source
        return f'unit {device.pin} is at address {source:02X}'

    def claimed(self, source: int, name: Name, now: float) -> str:
        """Take a PGN 60928; say in words what it changed for our unit, if anything."""
        if source == self._settings.source_address:
            self.namesake = name
        elif name == self.namesake:
            self.namesake = None
        self._names[source] = name
        is_ours = self._is_ours(source, name)
        self._claimed |= is_ours and not self._is_asked(now)
        if is_ours and source == self.address:
            self._name = name
        fixed = self._settings.unit_address
        if fixed:
            is_ours = name.manufacturer == AKRON_BRASS and source not in self._others()
            if source != fixed or is_ours:
                self.address = fixed if source == fixed else self.address
                return ''
        if is_ours == (source == self.address) or self.address is None:
            return ''
        return self._lose(now, 'and claims another' if is_ours else 'to another device')

    def asked(self, now: float) -> None:
        """Note that NAMEs are asked for, by us or by anybody."""
        self._asked_at = now

    def _is_asked(self, now: float) -> bool:
        """Tell whether what is claimed and announced may be an answer."""
        return now <= self._asked_at + REQUEST_PERIOD

    def expect_reset(self) -> None:
        """Look from now on for what tells that our unit was reset."""
        self._restarted = self._claimed = False

    def heard_after(self, silence: float) -> bool:
        """
        Note that our unit is heard; tell whether it may have restarted.

        :param silence: s since it was heard before.
        """
        restarted = silence >= _RESTART_SILENCE
        self._restarted |= restarted
        return restarted

    def is_back(self, message: Message, now: float) -> bool:
        """
        Tell whether the unit says this as one that was reset: it acknowledges nothing.

        It announces itself when anybody asks, too, and somebody may ask each second for ever; so
        does one that ignores the reset. A claim is less than a silence: it may defend its address.
        """
        if self.unit is None:  # at its fixed address; it never announced itself
            return self._restarted
        announced = isinstance(message, AddressAnnouncement)
        return announced and (self._restarted or (self._claimed and not self._is_asked(now)))

    def request_due(self, now: float, *, heard: bool) -> bool:
        """Tell whether a NAME request is to go out now. :param heard: our unit is."""
        found = heard and self.address is not None and not self._owes_request
        return not found and now >= self._due

    def request_sent(self, now: float) -> None:
        """Note that a NAME request went out."""
        self.asked(now)
        self._owes_request = False
        self._due = now + REQUEST_PERIOD

    def rivals(self) -> list[str]:
        """Return the PINs that ``device_type`` fits as well as it fits our unit's."""
        if self.unit is None or self._settings.device_pin:
            return []
        return [device.pin for device in self._neighbours() if self._has_type(device)]

    @property
    def alone(self) -> bool:
        """All were asked, and no other controller was heard that would obey our frames, too."""
        others = (device.device_type for device in self._neighbours())
        return not self._owes_request and all(kind not in CONTROLLERS for kind in others)

    def _neighbours(self) -> list[AddressAnnouncement]:
        others = (pin for pin in self.devices if self.unit is None or pin != self.unit.pin)
        return [AddressAnnouncement(pin) for pin in others]

    def _is_ours(self, source: int, name: Name) -> bool:
        """Tell a NAME by all of it: others may share the 21 bits that are left of our PIN."""
        if self.unit is None or source in self._others():
            return False
        return name == self._name if self._name is not None else self._has_identity(name)

    def _has_identity(self, name: Name) -> bool:
        return (
            self.unit is not None
            and name.manufacturer == AKRON_BRASS
            and name.identity == self.unit.identity
        )

    def _others(self) -> set[int]:
        """Return the addresses from which another PIN was announced last."""
        return {at for pin, at in self.devices.items() if self.unit and pin != self.unit.pin}

    def _fits(self, device: AddressAnnouncement) -> bool:
        return device.matches(self.pin) if self.pin else self._has_type(device)

    def _has_type(self, device: AddressAnnouncement) -> bool:
        wanted = self._settings.device_type
        return device.device_type in ((wanted,) if wanted else CONTROLLERS)

    def _lose(self, now: float, to_whom: str) -> str:
        text = f'unit {self.name} has lost address {self.address:02X} {to_whom}'
        self.address = None
        self._due = max(now, self._asked_at + LEAST_REQUEST_PERIOD)
        return text
