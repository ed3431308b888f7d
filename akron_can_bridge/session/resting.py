# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a node says that is configured but not active: neutral frames, never silence."""

from __future__ import annotations

from akron_can_bridge.session.events import Event
from akron_can_bridge.session.session import Session
from bridge_core.j1939 import CanFrame
from bridge_core.reasons import Coded
from bridge_core.session import Output


class Resting(Session):
    """
    A session that hears nothing, asks nothing and commands nothing.

    A unit takes 200 ms to forget a joystick that falls silent (manual, Appendix B). One that goes
    on saying neutral leaves no doubt, and is seen to be alive.
    """

    CLOSED = Coded('node.inactive', 'the node is not active')

    def _begin(self, now: float) -> None:
        self.drive.start(now)

    def receive(self, data: CanFrame, now: float) -> Output[Event, CanFrame]:
        """Ignore it."""
        del data, now
        return [], []

    def _due_frames(self, now: float) -> list[CanFrame]:
        return self.drive.joystick_frames(now)
