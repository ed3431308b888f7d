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

__all__ = [
    'DeviceSettings',
    'Event',
    'GpsSentence',
    'ModeChanged',
    'RemoteState',
    'Session',
    'Settings',
    'Sticks',
    'UserValue',
    'wire_of',
]
