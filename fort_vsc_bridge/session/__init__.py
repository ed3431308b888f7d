# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The link to a VSC over time: manual sections 6 to 9.

Only a fresh heartbeat of the VSC vouches for anything (on HID every report is one). Without one
there is no remote, no stick and no permission, whatever else still comes.
"""

from fort_vsc_bridge.session.events import (
    Event,
    GpsSentence,
    ModeChanged,
    RemoteState,
    Sticks,
    UserValue,
)
from fort_vsc_bridge.session.session import Session
from fort_vsc_bridge.session.settings import DeviceSettings, Settings, wire_of
