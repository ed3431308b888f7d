# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated remote as a USB game controller: manual section 9, reports built by hand."""

from __future__ import annotations

from fort_vsc_bridge.protocol.frames import MessageType
from fort_vsc_bridge.simulator.vsc import Vsc

_INTERVAL = 1 / 16
_NO_POSITION = 0x80  # of an axis: outside -127 to 127
_NO_DIRECTION = 15  # of the pad: outside 0 to 8
_HATS = {  # up, right, down, left, clockwise in eighths
    (1, 0, 0, 0): 0,
    (1, 1, 0, 0): 1,
    (0, 1, 0, 0): 2,
    (0, 1, 1, 0): 3,
    (0, 0, 1, 0): 4,
    (0, 0, 1, 1): 5,
    (0, 0, 0, 1): 6,
    (1, 0, 0, 1): 7,
}
_NUMBERED = ('right_down', 'right_right', 'right_up', 'right_left')  # buttons 1 to 4


class HidSimulator(Vsc):
    """A remote whose reports a hidraw device, a FIFO or a pty yields; it hears nothing."""

    MESSAGES = {MessageType.JOYSTICK: (True, _INTERVAL)}

    def _build(self, kind: int) -> list[bytes]:
        del kind
        axes = bytes(
            self._axis(f'{side}_{axis}', sign)
            for side in ('left', 'right')
            for axis, sign in (('x', 1), ('y', -1), ('z', -1))
        )
        numbered = sum(self._pressed(name) << 4 + bit for bit, name in enumerate(_NUMBERED))
        return [axes + bytes((self._hat() | numbered, self.mode, int(self.estop_bits > 0)))]

    def _axis(self, name: str, sign: int) -> int:
        """Return a byte, two's complement: to the right, near and low positive."""
        if self._active and name in self.faults:
            return _NO_POSITION
        value = self.sticks[name] if self._active else 0
        return sign * round(value * 127 / 1023) & 0xFF

    def _hat(self) -> int:
        names = ('left_up', 'left_right', 'left_down', 'left_left')
        if self._active and not self.faults.keys().isdisjoint(names):
            return _NO_DIRECTION
        up, right, down, left = map(self._pressed, names)
        return _HATS.get((up, right, down, left), 8)  # opposite ones press none

    def _pressed(self, name: str) -> int:
        return int(self._active and self.buttons[name])
