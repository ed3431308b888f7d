# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the lights and the horn show of the mux. Pure."""

from __future__ import annotations

from collections.abc import Sequence
import math

from bridge_core.watchdog import Watchdog
from io_bridge.protocol import HORN

STATE_TIMEOUT = 0.5  # s; a mux says its state at 10 Hz
_STATES = {'red': ('STOPPED', 'STOPPING'), 'yellow': ('READY',), 'green': ('ACTIVE',)}


class Outputs:
    """
    Outputs by the state of a mux; all are off while it is not heard.

    :param names: of OUTPUTS, in the order of ``wanted``. :param horn_time: s, before it moves.
    """

    def __init__(self, names: Sequence[str], horn_time: float) -> None:
        self.heard = Watchdog(STATE_TIMEOUT)
        self._names = names
        self._horn_time = horn_time
        self._horn_until = -math.inf
        self._state = ''

    def set_state(self, state: str, now: float) -> None:
        """Take the mux's state."""
        if state == 'ACTIVE' != self._state:
            self._horn_until = now + self._horn_time
        self._state = state
        self.heard.feed(now)

    def wanted(self, now: float) -> tuple[bool, ...]:
        """Return what is on."""
        return tuple(self._is_on(name, now) for name in self._names)

    def _is_on(self, name: str, now: float) -> bool:
        if self.heard.expired(now):
            return False
        if name == HORN:
            return self._state == 'ACTIVE' and now < self._horn_until
        return self._state in _STATES[name]

    @property
    def moments(self) -> tuple[float, float]:
        """When time alone changes what is wanted."""
        return self.heard.deadline, self._horn_until
