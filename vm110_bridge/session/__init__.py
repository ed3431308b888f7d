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
from vm110_bridge.session.serials import Arrival, SerialNumbers
from vm110_bridge.session.session import Session
from vm110_bridge.session.settings import Settings

__all__ = [
    'ACKNOWLEDGED',
    'QUEUE_SIZE',
    'ArmedChanged',
    'Arrival',
    'Command',
    'CommandResult',
    'DeviceState',
    'EncoderTurned',
    'Event',
    'Remote',
    'RemoteState',
    'SerialNumbers',
    'Session',
    'Settings',
    'Sticks',
]
