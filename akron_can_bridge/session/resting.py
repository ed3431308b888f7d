"""What a node says that is configured but not active: neutral frames, never silence."""

from __future__ import annotations

import math

from akron_can_bridge.protocol import Counters
from akron_can_bridge.session.drive import Drive
from akron_can_bridge.session.settings import Settings
from bridge_core.j1939 import CanFrame
from bridge_core.session import StopChanged

Output = tuple[list[StopChanged], list[CanFrame]]


class Resting:
    """
    A session that hears nothing and commands nothing; see bridge_core.transports.link.Session.

    A unit takes 200 ms to forget a joystick that falls silent (manual, Appendix B). One that goes
    on saying neutral leaves no doubt, and is seen to be alive.
    """

    estop = own_estop = True
    link_up = False

    def __init__(self, settings: Settings) -> None:
        self.counters = Counters()
        self._drive = Drive(settings)

    def frame_age(self, now: float) -> float:
        """Return infinity: nothing is heard."""
        del now
        return math.inf

    def stop_reasons(self, now: float) -> list[str]:
        """Say why ``estop`` is true."""
        del now
        return ['the node is not active']

    def opened(self, now: float) -> Output:
        """Begin with a neutral frame."""
        self._drive.opened(now)
        return self.poll(now)

    def closed(self, now: float) -> list[StopChanged]:
        """Send no more."""
        del now
        self._drive.closed()
        return []

    def receive(self, frame: CanFrame, now: float) -> Output:
        """Ignore it."""
        del frame, now
        return [], []

    def poll(self, now: float) -> Output:
        """Send the neutral frames that are due."""
        return [], self._drive.joystick_frames(now)

    def deadline(self) -> float:
        """Return when the next frame is due."""
        return self._drive.deadline

    def farewell(self, now: float) -> list[CanFrame]:
        """Return the last neutral frames."""
        return self._drive.farewell(None, now)
