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

"""
The link to one unit over time.

Only a fresh frame from the address that our unit announced vouches for it. Its silence, a missing
enable input, a motor fault and a foreign joystick are stops where ``estop_on`` lists them.
"""

from akron_can_bridge.parameters import Cause
from akron_can_bridge.session.events import (
    AXIS_NAMES,
    DeviceChanged,
    Event,
    FaultsChanged,
    Handover,
    HandoverWanted,
    LimitsChanged,
    OutputsChanged,
    PausePressed,
    Positions,
    Request,
    Sticks,
    Stopped,
    UnitChanged,
)
from akron_can_bridge.session.resting import Resting
from akron_can_bridge.session.session import FILTERS, Session
from akron_can_bridge.session.settings import Settings

__all__ = [
    'AXIS_NAMES',
    'FILTERS',
    'Cause',
    'DeviceChanged',
    'Event',
    'FaultsChanged',
    'Handover',
    'HandoverWanted',
    'LimitsChanged',
    'OutputsChanged',
    'PausePressed',
    'Positions',
    'Request',
    'Resting',
    'Session',
    'Settings',
    'Sticks',
    'Stopped',
    'UnitChanged',
]
