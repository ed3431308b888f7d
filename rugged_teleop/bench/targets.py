# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a trial can move: a joint of a drive, a servo of an SSC, an axis of a fire monitor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bridge_core.device import Trial
from rugged_teleop.bench.course import Order
from rugged_teleop.devices import devices


@dataclass(frozen=True)
class Target:
    """What a device says of it. :param node: its full name, by default."""

    node: str
    trial: Trial

    @property
    def parameters(self) -> list[str]:
        """Those of the node that matter: the joints, the time-out, and the modes, if any."""
        return [self.trial.names, 'command_timeout', *(['mode'] if self.trial.mode else [])]

    def message(self, order: Order, joints: Sequence[str], joint: str) -> Any:
        """Return what to publish on the command's topic; None: nothing."""
        from sensor_msgs.msg import JointState, Joy

        shares = [order.value or 0.0 if each == joint else 0.0 for each in joints]
        values = self.trial.field_of(shares)
        if self.trial.field == 'axes':
            return Joy(axes=values)
        if self.trial.is_measured:
            return JointState(name=joints, **{self.trial.field: values})
        if order.value is None:  # not its centre, which would be motion, too
            return None
        return JointState(name=[joint], position=[order.value])


# By option.
TARGETS = {
    option: Target(f'/{device.name}', trial)
    for device in devices().values()
    for option, trial in device.trials.items()
}
