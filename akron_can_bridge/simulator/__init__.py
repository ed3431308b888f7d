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

"""Units and joysticks for demos and tests; they share no codec with the bridge."""

from akron_can_bridge.simulator.controls import JOYSTICK_TIMEOUT
from akron_can_bridge.simulator.joystick import JoystickSimulator
from akron_can_bridge.simulator.motion import PERMISSIVE_TIMEOUT
from akron_can_bridge.simulator.unit import BOOT_TIME, Simulator, STATUS_PERIOD

__all__ = [
    'BOOT_TIME',
    'JOYSTICK_TIMEOUT',
    'PERMISSIVE_TIMEOUT',
    'STATUS_PERIOD',
    'JoystickSimulator',
    'Simulator',
]
