# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A 6035 joystick on the bus, without a port or a clock."""

from __future__ import annotations

import math
from typing import Any

from akron_can_bridge.simulator.claiming import Claim
from akron_can_bridge.simulator.controls import ADDRESSES
from akron_can_bridge.simulator.frames import (
    ABSENT,
    build_deflection,
    build_extended,
    build_joystick,
    ERROR,
    OFF,
    ON,
)
from bridge_core.j1939 import CanFrame
from bridge_core.simulation import Commands, obey, one_of, switch, within

JOYSTICK_PERIOD = 0.02  # Appendix B
_STATES = {'ok': ON, 'error': ERROR, 'unavailable': ABSENT}
_STICKS = ('x', 'y')
_GRIPS = ('grip_x', 'grip_y', 'theta')


class JoystickSimulator:
    """
    A joystick at rest. Its grip is unavailable until it is moved.

    :param address: 33 to 38 hex. :param extended: it sends PGN 64983 too.
    """

    def __init__(
        self, address: int = 0x33, *, extended: bool = False, pin: str = '1035AE100801036'
    ) -> None:
        if address not in ADDRESSES:
            raise ValueError(f'a joystick is at 33 to 38 hex, not {address:02X}')
        self.extended = extended
        self.claim = Claim(pin, address)
        self.deflections = dict.fromkeys((*_STICKS, *_GRIPS), 0)  # 0.1 %, right and forward +
        self.states = {**dict.fromkeys(_STICKS, ON), **dict.fromkeys(_GRIPS, ABSENT)}
        self.switches = [OFF] * 16
        self.muted = False
        self.sent = 0
        self._due = -math.inf
        self._now = 0.0

    @property
    def address(self) -> int:
        """Its present address; FE: it lost its own."""
        return self.claim.address

    def receive(self, frame: CanFrame, now: float) -> None:
        """Take a frame from the bus: claims and requests for NAMEs."""
        self._start(now)
        form, specific = frame.identifier >> 16 & 0x3FF, frame.identifier >> 8 & 0xFF
        if form == 0xEE and len(frame.data) == 8:
            self.claim.hear(frame.identifier & 0xFF, frame.data, now)
        elif form == 0xEA and specific in (0xFF, self.address) and frame.data == b'\0\xee\0':
            self.claim.answer(now)

    def poll(self, now: float) -> list[CanFrame]:
        """Return the frames that are due."""
        self._start(now)
        frames = self.claim.poll(now)
        if self.claim.has(now) and now >= self._due:
            on_time = self._due + JOYSTICK_PERIOD > now
            self._due = (self._due if on_time else now) + JOYSTICK_PERIOD
            frames += self._status()
        if self.muted:
            return []
        self.sent += len(frames)
        return frames

    def deadline(self) -> float:
        """Return when poll wants to be called next."""
        return min(self.claim.deadline(), self._due if self.claim.has(self._now) else math.inf)

    def _start(self, now: float) -> None:
        self._now = now
        if self._due == -math.inf:
            self._due = now
            self.claim.start(now)

    def _status(self) -> list[CanFrame]:
        words = {n: build_deflection(v, self.states[n]) for n, v in self.deflections.items()}
        source = self.address
        basic = build_joystick(source, words['x'], words['y'], self.switches[:12])
        if not self.extended:
            return [basic]
        grip_x, grip_y, theta = (words[name] for name in _GRIPS)
        return [basic, build_extended(source, grip_x, grip_y, theta, self.switches[12:])]

    # -- for people and tests --------------------------------------------------------------------

    def apply(self, text: str) -> None:
        """Obey one line, such as 'stick x 0.8'. :raises ValueError: one line of help."""
        obey(self, self.commands, text)

    def describe(self) -> dict[str, Any]:
        """Return what can be seen, as plain values."""
        return {
            'device': self.claim.pin,
            'address': f'{self.address:02X}',
            'deflections': {n: v / 1000 for n, v in self.deflections.items()},
            'faulty': [n for n, state in self.states.items() if state != ON],
            'switches': [n for n, state in enumerate(self.switches, 1) if state == ON],
            'sent': self.sent,
        }

    def _set_stick(self, name: str, value: str) -> None:
        self.deflections[one_of(self.deflections, name)] = round(1000 * within(value, -1, 1))
        self.states[name] = ON

    def _set_state(self, name: str, state: str) -> None:
        self.states[one_of(self.states, name)] = _STATES[one_of(_STATES, state)]

    def _set_switch(self, place: str, value: str) -> None:
        self.switches[int(within(place, 1, 16)) - 1] = ON if switch(value) else OFF

    def _break_switch(self, place: str, state: str) -> None:
        code = {**_STATES, 'ok': OFF}[one_of(_STATES, state)]
        self.switches[int(within(place, 1, 16)) - 1] = code

    def _release(self) -> None:
        self.deflections = dict.fromkeys(self.deflections, 0)
        self.switches = [OFF] * 16

    def _set_address(self, value: str) -> None:
        self.claim.move(int(within(str(int(value, 16)), ADDRESSES[0], ADDRESSES[-1])), self._now)

    def _set_mute(self, value: str) -> None:
        self.muted = switch(value)

    # Words: usage, and what obeys.
    commands: Commands = {
        'stick': ('x|y|grip_x|grip_y|theta -1..1', _set_stick),
        'fault': ('x|y|grip_x|grip_y|theta ok|error|unavailable', _set_state),
        'switch': ('1..16 on|off', _set_switch),
        'break': ('1..16 ok|error|unavailable', _break_switch),
        'release': ('', _release),
        'address': ('33..38', _set_address),
        'mute': ('on|off', _set_mute),
    }
