# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The link to a base unit over time: manual sections 4 and 5.

Only a fresh VRPI of our own base unit vouches for anything. Without one there is no remote, no
stick and no permission, whatever else still comes. Which reading of the CRC and which base unit
were locked to holds for a session's whole life.
"""

from vm110_bridge.session.events import (
    ArmedChanged,
    Command,
    CommandResult,
    DeviceState,
    EncoderTurned,
    Event,
    Remote,
    RemoteState,
    Sticks,
)
from vm110_bridge.session.outbox import ACKNOWLEDGED, QUEUE_SIZE
from vm110_bridge.session.serials import SerialNumbers
from vm110_bridge.session.session import Session
from vm110_bridge.session.settings import Settings
