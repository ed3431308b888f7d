# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ESI drive bridge: one or two servo axes on RS422 as ROS topics."""

from collections.abc import Mapping
from typing import Any, ClassVar

from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from bridge_core.managed_node import latched_qos
from bridge_core.node import BridgeNode, COMMAND_QOS, STOP_QOS
from bridge_core.parameters import ACTUATOR_PARAMETERS, Parameter
from bridge_core.runner import run
from bridge_core.session import Level
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Call
from esi_drive_bridge import convert
from esi_drive_bridge.axes import axes_of
from esi_drive_bridge.parameters import PARAMETERS
from esi_drive_bridge.session import (
    CLEAR_ERRORS,
    EnabledChanged,
    EnableRefused,
    Event,
    FaultsChanged,
    Feedback,
    Session,
    Stopped,
)
from esi_drive_bridge.wire import BRIDGE


class EsiDriveBridge(BridgeNode[Event]):
    """One drive; see docs/devices/esi_drive.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*ACTUATOR_PARAMETERS, *PARAMETERS)
    BRIDGE = BRIDGE
    LINK = ProcessLink
    SERVICES = {CLEAR_ERRORS: Call.of(Session.clear_errors)}

    def __init__(self, **options: Any) -> None:
        self._listened = True  # as the wire knows it: somebody listens to ~/joint_states
        self._is_enabled = False  # as the drive says
        super().__init__('esi_drive_bridge', **options)

    def create_interfaces(self) -> None:
        """Create what command and status become."""
        self._joint_states = self.create_publisher(JointState, '~/joint_states', 10)
        self._enabled = self.create_publisher(Bool, '~/enabled', latched_qos())
        # What comes first here is read first.
        self.watched_subscription(
            Bool, '~/estop_in', self._on_estop_in, STOP_QOS, is_stop=lambda m: bool(m.data)
        )
        self.watched_subscription(
            Bool, '~/enable', self._on_enable, STOP_QOS, is_stop=lambda m: not m.data
        )
        self.watched_subscription(JointState, '~/command', self._on_command, COMMAND_QOS)

    def take_parameters(self, values: Mapping[str, Any]) -> None:
        """Keep how the axes are scaled."""
        self._axes = axes_of(values)

    def pace(self, now: float) -> float:
        """Ask for statuses while somebody listens; repeat ~/enabled, behind the stop."""
        listened = self._joint_states.get_subscription_count() > 0
        # As a stop: it counts however late it comes, or a listener would wait for ever.
        if listened != self._listened and self.request(Session.set_reporting, listened, stop=True):
            self._listened = listened
        repeats = now >= self._repeat_at
        due = super().pace(now)
        if repeats:
            self._say_enabled(self._is_enabled)
        return due

    def _say_enabled(self, enabled: bool) -> None:
        # What came last of a wire may be lost: an inactive node has told the drive to disable.
        self._is_enabled = enabled and self.active
        self._enabled.publish(Bool(data=self._is_enabled))

    def forget_device(self) -> None:
        """Publish that the drive is not enabled; a new wire reports to whoever listens or not."""
        self._listened = True
        self._say_enabled(False)

    def on_event(self, event: Event) -> None:
        """Publish one event of the session."""
        if isinstance(event, Feedback):
            every = self.values['joint_state_fields'] == 'all'
            joint_states = convert.joint_state(
                event.status, self._axes, *self.header(), every_field=every
            )
            self._joint_states.publish(joint_states)
        elif isinstance(event, EnabledChanged):
            self._say_enabled(event.enabled)
        elif isinstance(event, Stopped):
            self.log(Level.WARN, f'disabled: {"; ".join(event.reasons)}')
        elif isinstance(event, EnableRefused):
            self.log(Level.WARN, f'not enabled: {"; ".join(event.reasons)}', site='not enabled')
        elif isinstance(event, FaultsChanged):
            self._log_faults(event)

    def _log_faults(self, event: FaultsChanged) -> None:
        if event.faults:
            text = f'the drive reports: {"; ".join(event.faults)}'
            self.log(Level.ERROR, text, site='faults')
        else:
            self.log(Level.OK, 'the drive reports no error any more', site='faults')

    # Requests.

    def on_distrusted(self, text: str) -> None:
        """Disable at once: two muxes, say, and each enable of one follows a stop of the other."""
        self.request(Session.distrust, text, stop=True)

    def _on_command(self, message: Any) -> None:
        if not self.active:
            return
        try:
            values = convert.command_values(message, self._axes)
        except ValueError as error:
            self.refuse(f'command: {error}')
            self.request(Session.refuse_command, str(error), key='command', stop=True)
        else:
            self.request(Session.set_command, values, key='command')

    def _on_enable(self, message: Any) -> None:
        self.request(Session.set_enable, message.data, stop=not message.data)

    def _on_estop_in(self, message: Any) -> None:
        self.request(Session.set_estop, message.data, stop=message.data)


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([EsiDriveBridge]))


if __name__ == '__main__':
    main()
