# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What a node says that is configured but not active: neutral frames, never silence."""

from __future__ import annotations

from akron_can_bridge.session.events import Event
from akron_can_bridge.session.session import Session
from bridge_core.j1939 import CanFrame
from bridge_core.session import Output


class Resting(Session):
    """
    A session that hears nothing, asks nothing and commands nothing.

    A unit takes 200 ms to forget a joystick that falls silent (manual, Appendix B). One that goes
    on saying neutral leaves no doubt, and is seen to be alive.
    """

    CLOSED = 'the node is not active'

    def _begin(self, now: float) -> None:
        self.drive.start(now)

    def receive(self, data: CanFrame, now: float) -> Output[Event, CanFrame]:
        """Ignore it."""
        del data, now
        return [], []

    def _due_frames(self, now: float) -> list[CanFrame]:
        return self.drive.joystick_frames(now)
