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

"""What a trial can move: a joint of a drive, a servo of an SSC, an axis of a fire monitor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from rugged_teleop.bench.course import Order


@dataclass(frozen=True)
class Target:
    """
    One kind of it.

    :param help: of its option. :param node: its full name, by default.
    :param names: the parameter that lists the joints. :param mode: what the parameter mode has to
        be; empty: there is none. :param command: its topic. :param field: of its message.
    :param limit: the greatest magnitude. :param is_measured: the node says whether it is enabled,
        and how the joint moves.
    """

    help: str
    node: str
    names: str
    command: str
    field: str
    mode: str = ''
    limit: float = math.inf
    is_measured: bool = False
    beside: tuple[str, ...] = ()

    @property
    def parameters(self) -> list[str]:
        """Those of the node that matter: the joints, the time-out, and the modes, if any."""
        return [self.names, 'command_timeout', *(['mode'] if self.mode else [])]

    def message(self, order: Order, joints: Sequence[str], joint: str) -> Any:
        """Return what to publish on the command's topic; None: nothing."""
        from sensor_msgs.msg import JointState, Joy

        values = [order.value or 0.0 if each == joint else 0.0 for each in joints]
        if self.field == 'axes':
            return Joy(axes=values)
        if self.is_measured:
            return JointState(name=joints, **{self.field: values})
        if order.value is None:  # not its centre, which would be motion, too
            return None
        return JointState(name=[joint], position=[order.value])


# By option.
TARGETS = {
    'speed': Target(
        'rad/s, of a drive where its mode is velocity',
        '/esi_drive_bridge',
        'joint_names',
        'command',
        'velocity',
        mode='velocity',
        is_measured=True,
    ),
    'effort': Target(
        'N·m, or A with torque_constant 0, of a drive where its mode is torque',
        '/esi_drive_bridge',
        'joint_names',
        'command',
        'effort',
        mode='torque',
        is_measured=True,
    ),
    'position': Target(
        '-1 to 1, of a servo on an SSC',
        '/ssc_bridge',
        'servos',
        'servo_command',
        'position',
        limit=1.0,
        beside=('pulse_command',),
    ),
    'stick': Target(
        '-1 to 1, left or up positive, of a fire monitor',
        '/akron_can_bridge',
        'joint_names',
        'cmd_joy',
        'axes',
        limit=1.0,
    ),
}
