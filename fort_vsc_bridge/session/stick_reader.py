# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What counts of a joystick message: manual 6.1 to 6.5 and 7.4."""

from __future__ import annotations

from bridge_core.session import HeldButtons
from fort_vsc_bridge.protocol.messages import Joystick
from fort_vsc_bridge.protocol.values import Axis, AXIS_NAMES, Button, BUTTON_NAMES
from fort_vsc_bridge.session.events import Sticks

NEUTRAL = Sticks()


class StickReader(HeldButtons):
    """
    Makes sticks of joystick messages. A button that was held while none counted stays 0.

    :param memory: seconds; see HeldButtons.
    :param tolerate: a broken control is 0, and the others count.
    """

    def __init__(self, memory: float, *, tolerate: bool) -> None:
        super().__init__(memory, len(BUTTON_NAMES))
        self._tolerate = tolerate

    def read(self, message: Joystick, now: float, *, operational: bool, stopped: bool) -> Sticks:
        """Return what counts. :param operational: the mode, and no stop, let sticks count."""
        if not operational:
            self.miss(now, stopped=stopped)
            return NEUTRAL  # the VSC zeroes the whole message: nothing in it is the remote's
        if message.zeroed:  # its heartbeat may say why later, or was the first to say so
            self.miss(now, stopped=False)
            return Sticks(operational=True)
        controls: tuple[Axis | Button, ...] = message.axes + message.buttons
        faulty = tuple(
            f'{name} {control.state.value}'
            for name, control in zip(AXIS_NAMES + BUTTON_NAMES, controls, strict=True)
            if control.value is None
        )
        named = () if message.pausing else faulty
        buttons = tuple(button.value for button in message.buttons)
        if faulty and not self._tolerate:
            self.miss(now, stopped=False, buttons=buttons)
            return Sticks(operational=True, faulty=named)
        return Sticks(
            axes=tuple(axis.value or 0 for axis in message.axes),
            buttons=tuple(map(bool, self.of(buttons, now))),
            operational=True,
            faulty=named,
        )
