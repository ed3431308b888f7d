# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One simulated RU: what its operator does with it."""

from __future__ import annotations

from dataclasses import dataclass, field
import struct
from typing import Any

from vm110_bridge.protocol import RuState


@dataclass(slots=True)
class Remote:
    """One RU: what its operator does with it."""

    ru_id: int
    radio: bool = True
    stopped: bool = False  # its stop switch
    tripped: bool = False  # it has stopped, and was not armed again since
    tilted: bool = False
    inactive: bool = False
    docked: bool = False
    cable: bool = False
    battery: int = 100  # %
    rssi: int = 90  # %
    joysticks: list[int] = field(default_factory=lambda: [0] * 4)
    switches: list[int] = field(default_factory=lambda: [0] * 8)
    encoder: int = 0
    encoder_switch: bool = False

    @property
    def connected(self) -> bool:
        """The BU hears it, by radio or by cable."""
        return self.radio or self.cable

    @property
    def state(self) -> RuState:
        """Its own state while it is armed (4.1.3)."""
        if self.tripped:
            return RuState.STOPPED
        return RuState.ARMED if self.tilted or self.inactive else RuState.ENABLED

    def payload(self) -> bytes:
        """Return its part of a VRPI."""
        disabled = 1 if self.tilted else 2 if self.inactive else 0
        head = (self.state, self.battery, self.rssi, self.cable, self.docked, disabled)
        sticks = (*self.joysticks, *self.switches, self.encoder & 0xFF, self.encoder_switch)
        return struct.pack('<6B12h2B6x', *head, *sticks)

    def describe(self) -> dict[str, Any]:
        """Return what can be seen, as plain values."""
        flags = ('radio', 'stopped', 'tilted', 'inactive', 'docked', 'cable')
        return {
            'on': [name for name in flags if getattr(self, name)],
            'battery': self.battery,
            'sticks': [value / 1000 for value in self.joysticks],
            'switches': list(self.switches),
            'encoder': self.encoder & 0xFF,
        }
