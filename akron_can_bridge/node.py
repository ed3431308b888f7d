# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron CAN bridge: a monitor of the 6000 series as ROS topics."""

from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import UInt8

from akron_can_bridge import convert
from akron_can_bridge.parameters import PARAMETERS
from akron_can_bridge.reasons import REASONS
from akron_can_bridge.session import (
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
    Session,
    Sticks,
    Stopped,
    UnitChanged,
)
from akron_can_bridge.wire import BRIDGE
from bridge_core.managed_node import latched_qos
from bridge_core.node import BridgeNode
from bridge_core.parameters import ACTUATOR_PARAMETERS, Parameter
from bridge_core.runner import run
from bridge_core.session import Level
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Call


class AkronCanBridge(BridgeNode[Event]):
    """One unit on a CAN bus; see docs/devices/akron.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*ACTUATOR_PARAMETERS, *PARAMETERS)
    BRIDGE = BRIDGE
    REASONS = REASONS
    LINK = ProcessLink
    TELLS_DEVICE = True
    SERVICES = {request.value: Call.of(Session.request, request) for request in Request}

    def __init__(self, **options: Any) -> None:
        self._unit = '', 0  # its PIN and type, as far as known
        self._device = DeviceChanged()
        self._streaming = False  # sticks that ask for something were published last
        self._limited = False  # ~/soe_directions was ever heard
        self._handover: Handover | None = None  # for the next session; None: there was none yet
        self._lost = False  # a wire whose unit nobody has taken over yet
        self._told = False  # a session of this activation has told what the next has to know
        super().__init__('akron_can_bridge', **options)

    def create_interfaces(self) -> None:
        """Create what the manual's messages become."""
        self._joint_states = self.create_publisher(JointState, '~/joint_states', 10)
        self._joy = self.create_publisher(Joy, '~/joy', 10)
        self._limits = self.create_publisher(DiagnosticStatus, '~/limits', latched_qos())
        self._outputs = self.create_publisher(DiagnosticStatus, '~/outputs', latched_qos())
        # What comes first here is read first.
        self.stop_input('~/estop_in', self._on_estop_in)
        self.command_input(Joy, '~/cmd_joy', self._on_cmd_joy)
        self.command_input(UInt8, '~/soe_directions', self._on_soe_directions)

    def forget_device(self) -> None:
        """Publish that nothing is known of the unit, and neutral sticks after others."""
        self._unit = '', 0
        self._device = DeviceChanged()
        self.publish_device()
        self._publish_limits(LimitsChanged())
        self._publish_outputs(OutputsChanged())
        if self._streaming:
            self._publish_sticks(Sticks())

    @property
    def hardware_name(self) -> str:
        """The device's name where the user gave none: its PIN, or else the channel."""
        return str(self.values['device_pin'] or self.values['channel'])

    def on_event(self, event: Event) -> None:
        """Publish or log one event of the session."""
        if isinstance(event, Positions):
            self._publish_joint_states(event)
        elif isinstance(event, DeviceChanged):
            self._device = event
            self.publish_device()
        elif isinstance(event, LimitsChanged):
            self._publish_limits(event)
        elif isinstance(event, OutputsChanged):
            self._publish_outputs(event)
        elif isinstance(event, Sticks):
            self._publish_sticks(event)
        elif isinstance(event, UnitChanged):
            self._unit = event.pin, event.device_type
            self.log(Level.OK, event.text, site='unit')
        elif isinstance(event, Stopped):
            self.log(Level.WARN, f'neutral: {"; ".join(event.reasons)}')
        elif isinstance(event, FaultsChanged):
            self._log_faults(event)
        elif isinstance(event, PausePressed):
            text = 'the stop presses switch 7 once, to pause the oscillation that ~/cmd_joy began'
            self.log(Level.WARN, text, site='pause')
        elif isinstance(event, Handover):
            self._handover, self._lost, self._told = event, False, True
        elif isinstance(event, HandoverWanted):
            self._hand_over()

    def on_lost(self) -> None:
        """Note it: the next one follows the same unit."""
        super().on_lost()  # it may have told something
        self._lost |= self.active and self._told  # else it followed no unit that anybody knows

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Begin anew: by now there may be another unit."""
        self._lost = self._told = False
        return super().on_activate(state)

    def _hand_over(self) -> None:
        if self._limited:  # first: once it has taken over, it may permit directions
            self.request(Session.limit_directions, stop=True)
        self.request(Session.take_over, self._handover, self._lost, stop=True)

    def _log_faults(self, event: FaultsChanged) -> None:
        if event.faults:
            text = f'the unit reports {"; ".join(event.faults)}'
            self.log(Level.ERROR, text, site='faults')
        else:
            self.log(Level.OK, 'the unit reports no fault any more', site='faults')

    def _publish_joint_states(self, event: Positions) -> None:
        self._joint_states.publish(
            convert.joint_state(
                (event.rotation, event.elevation),
                self.values['joint_names'],
                *self.header(),
                inverted=self.values['joint_inverted'],
            )
        )

    def _publish_limits(self, event: LimitsChanged) -> None:
        self._limits.publish(
            convert.limits(event.position, event.rotation, event.elevation, *self._unit_name())
        )

    def device_state(self) -> Any:
        """Return who the unit is on the bus."""
        said = self._device
        return convert.device(
            *(said.pin, said.device_type, said.address, said.name, said.namesake),
            self.values['source_address'],
            self.values['hardware_id'] or said.pin or self.hardware_name,
        )

    def _publish_outputs(self, event: OutputsChanged) -> None:
        name, _ = self._unit_name()
        self._outputs.publish(convert.outputs(event.outputs, event.mini, event.inputs, name))

    def _unit_name(self) -> tuple[str, int]:
        """Return the unit's hardware_id and type."""
        pin, kind = self._unit
        return self.values['hardware_id'] or pin or self.hardware_name, kind

    def _publish_sticks(self, sticks: Sticks) -> None:
        self._streaming = sticks != Sticks()
        joy = convert.joy(
            sticks.axes, sticks.switches, *self.header(), deadband=self.values['deadband']
        )
        self._joy.publish(self.vouched(joy))

    # Requests.

    def _on_cmd_joy(self, message: Any) -> None:
        if not self.active:
            return
        try:
            command = convert.command(
                message,
                self.values['button_switches'],
                extended=self.values['extended'],
                automatic=self.values['automatic_motion'],
            )
        except ValueError as error:
            self.refuse(f'cmd_joy: {error}')
            self.request(Session.refuse_command, str(error), key='cmd_joy', stop=True)
        else:
            self.request(Session.set_command, *command, key='cmd_joy')

    def on_distrusted(self, text: str) -> None:
        """Be neutral at once: it is not known what an input says."""
        del text
        self.request(Session.set_estop, True, stop=True)

    def _on_estop_in(self, message: Any) -> None:
        self.request(Session.set_estop, message.data, stop=message.data)

    def _on_soe_directions(self, message: Any) -> None:
        if not self._limited:  # however late it comes: what it says may be refused as old
            self._limited = True
            self.request(Session.limit_directions, stop=True)
        self.request(Session.set_directions, message.data, key='soe_directions')


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([AkronCanBridge]))


if __name__ == '__main__':
    main()
