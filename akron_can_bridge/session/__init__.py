# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The link to one unit over time.

Only a fresh frame from the address that our unit announced vouches for it. Its silence, a missing
enable input, a motor fault and a foreign joystick are stops where ``estop_on`` lists them.
"""

from akron_can_bridge.parameters import Cause
from akron_can_bridge.session.decoder import FILTERS
from akron_can_bridge.session.events import (
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
from akron_can_bridge.session.session import Session
from akron_can_bridge.session.settings import Settings
