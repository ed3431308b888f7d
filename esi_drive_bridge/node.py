# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ESI drive bridge: one or two servo axes on RS422 as ROS topics."""

from collections.abc import Mapping
import math
from typing import Any, ClassVar

from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from bridge_core import clock
from bridge_core.managed_node import latched_qos
from bridge_core.node import BridgeNode
from bridge_core.parameters import ACTUATOR_PARAMETERS, Parameter
from bridge_core.runner import run
from bridge_core.session import Level, Verdict
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Call
from esi_drive_bridge import convert
from esi_drive_bridge.axes import axes_of
from esi_drive_bridge.parameters import PARAMETERS
from esi_drive_bridge.protocol import AXIS_LETTERS
from esi_drive_bridge.reasons import REASONS
from esi_drive_bridge.session import (
    AxesVerdict,
    CLEAR_ERRORS,
    EnabledChanged,
    EnableRefused,
    Event,
    FaultsChanged,
    Feedback,
    own_topic,
    Session,
    Stopped,
)
from esi_drive_bridge.wire import BRIDGE


class EsiDriveBridge(BridgeNode[Event]):
    """One drive; see docs/devices/esi_drive.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*ACTUATOR_PARAMETERS, *PARAMETERS)
    BRIDGE = BRIDGE
    REASONS = REASONS
    LINK = ProcessLink
    SERVICES = {CLEAR_ERRORS: Call.of(Session.clear_errors)}

    def __init__(self, **options: Any) -> None:
        self._listened = True  # as the wire knows it: somebody listens to ~/joint_states
        self._is_enabled = [False]  # as the drive says, of all axes or each
        self._own: list[tuple[Publisher, Publisher]] = []  # ~/axis_a/estop and ~/axis_a/enabled
        super().__init__('esi_drive_bridge', **options)

    def create_interfaces(self) -> None:
        """Create what command and status become."""
        self._joint_states = self.create_publisher(JointState, '~/joint_states', 10)
        self._enabled = self.create_publisher(Bool, '~/enabled', latched_qos())
        # What comes first here is read first.
        self.stop_input('~/estop_in', self._on_estop_in)
        self.stop_input('~/enable', self._on_enable, stop=False)
        self.command_input(JointState, '~/command', self._on_command)
        if self._is_each:
            self._is_enabled = [False, False]
            self._own = list(map(self._create_axis_interfaces, range(len(self._is_enabled))))
            self._stops.beside = self._publish_axes
            self._stops.publish()

    @property
    def _is_each(self) -> bool:
        return bool(self.values['axes_enable'] == 'each')

    def _create_axis_interfaces(self, number: int) -> tuple[Publisher, Publisher]:
        def on_enable(message: Any) -> None:
            value = bool(message.data)
            self.request(
                Session.set_axis_enable, number, value, key=f'enable {number}', stop=not value
            )

        axis = AXIS_LETTERS[number].lower()
        name = own_topic(number, CLEAR_ERRORS)
        self._create_device_service(name, Call.of(Session.clear_axis_errors, number))
        self.stop_input(f'~/axis_{axis}/enable', on_enable, stop=False)
        qos = latched_qos(deadline=2.0 / self.values['estop_rate'])
        return (
            self.create_publisher(Bool, f'~/axis_{axis}/estop', qos),
            self.create_publisher(Bool, f'~/axis_{axis}/enabled', latched_qos()),
        )

    def take_parameters(self, values: Mapping[str, Any]) -> None:
        """Keep how the axes are scaled."""
        self._axes = axes_of(values)

    def pace(self, now: float) -> float:
        """Ask for statuses while somebody listens."""
        listened = self._joint_states.get_subscription_count() > 0
        # As a stop: it counts however late it comes, or a listener would wait for ever.
        if listened != self._listened and self.request(Session.set_reporting, listened, stop=True):
            self._listened = listened
        return super().pace(now)

    def on_repeat(self) -> None:
        """Repeat ``~/enabled``."""
        self._say_enabled()

    def _publish_axes(self, verdict: Verdict) -> None:
        axes = verdict.axes if isinstance(verdict, AxesVerdict) else (verdict.estop,) * 2
        for (estop, _), is_stopped in zip(self._own, axes, strict=True):
            estop.publish(Bool(data=is_stopped))

    def _say_enabled(self) -> None:
        # What came last of a wire may be lost: an inactive node has told the drive to disable.
        self._is_enabled = [each and self.active for each in self._is_enabled]
        for (_, enabled), value in zip(self._own, self._is_enabled, strict=False):
            enabled.publish(Bool(data=value))
        is_enabled = all(self._is_enabled)
        self._enabled.publish(Bool(data=is_enabled))
        self._stops.proofs.say(None, clock.now(), enable=is_enabled)

    def forget_device(self) -> None:
        """Publish that the drive is not enabled; a new wire reports to whoever listens or not."""
        self._listened = True
        self._is_enabled = [False] * len(self._is_enabled)
        self._say_enabled()

    def on_event(self, event: Event) -> None:
        """Publish one event of the session."""
        if isinstance(event, Feedback):
            every = self.values['joint_state_fields'] == 'all'
            joint_states = convert.joint_state(
                event.status, self._axes, *self.header(), every_field=every
            )
            self._joint_states.publish(self.vouched(joint_states))
        elif isinstance(event, EnabledChanged):
            self._is_enabled[event.group] = event.enabled
            self._say_enabled()
        elif isinstance(event, Stopped):
            self.log(Level.WARN, f'{event.axis} disabled: {"; ".join(event.reasons)}'.lstrip())
        elif isinstance(event, EnableRefused):
            text = f'{event.axis} not enabled'.lstrip()
            self.log(Level.WARN, f'{text}: {"; ".join(event.reasons)}', site=text)
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
            values = convert.command_values(message, self._axes, apart=self._is_each)
        except ValueError as error:
            self.refuse(f'command: {error}')
            self.request(Session.refuse_command, str(error), key='command', stop=True)
        else:
            sound = tuple(each if math.isfinite(each or 0.0) else None for each in values)
            if sound != values:  # a stop of that axis, and no news of the other one
                others = zip(values, sound, strict=True)
                unsound = tuple(None if each == value else each for each, value in others)
                self.request(Session.set_command, unsound, key='command', stop=True)
            self.request(Session.set_command, sound, key='command')

    def _on_enable(self, message: Any) -> None:
        self.request(Session.set_enable, message.data, stop=not message.data)

    def _on_estop_in(self, message: Any) -> None:
        self.request(Session.set_estop, message.data, stop=message.data)


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([EsiDriveBridge]))


if __name__ == '__main__':
    main()
