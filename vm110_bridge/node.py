# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VM-110 bridge: a base unit with its remotes as ROS topics."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from diagnostic_msgs.msg import KeyValue
from sensor_msgs.msg import BatteryState, Joy
from std_msgs.msg import Bool, Int32, UInt8MultiArray, UInt16

from bridge_core import clock
from bridge_core.diagnostics import to_msg
from bridge_core.managed_node import latched_qos
from bridge_core.node import BridgeNode
from bridge_core.parameters import BRIDGE_PARAMETERS, Parameter
from bridge_core.report import Report, Status, summarise
from bridge_core.runner import run
from bridge_core.session import Level
from bridge_core.watchdog import FROZEN
from vm110_bridge import convert
from vm110_bridge.parameters import axis_signs, PARAMETERS
from vm110_bridge.reasons import REASONS
from vm110_bridge.session import (
    ArmedChanged,
    Command,
    CommandResult,
    DeviceState,
    EncoderTurned,
    Event,
    RemoteState,
    Session,
    Sticks,
)
from vm110_bridge.wire import BRIDGE, DELIVERED, HOLD_HEARD

_COMMAND_DEPTH = 50  # a burst of commands must not lose its first to a slow listener
_UNKNOWN = DeviceState(((Level.ERROR, 'the node is not active'),), '', {'BU state': 'Not heard'})


class Vm110Bridge(BridgeNode[Event]):
    """One base unit with its remotes; see docs/devices/vm110.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *PARAMETERS)
    BRIDGE = BRIDGE
    REASONS = REASONS
    TELLS_DEVICE = True

    def __init__(self, **options: Any) -> None:
        self._hold_heard = False  # ever, and so it has to be repeated for as long as this node is
        self._delivered: deque[tuple[Command, float]] = deque(maxlen=_COMMAND_DEPTH)
        super().__init__('vm110_bridge', **options)

    def create_interfaces(self) -> None:
        """Create what the manual's packets become."""
        self._joy = self.create_publisher(Joy, '~/joy', 10)
        self._armed = self.create_publisher(Bool, '~/armed', latched_qos())
        self._enabled = self.create_publisher(Bool, '~/enabled', latched_qos())
        self._battery = self.create_publisher(BatteryState, '~/battery', latched_qos())
        self._encoder = self.create_publisher(Int32, '~/encoder', latched_qos())
        self._command = self.create_publisher(UInt8MultiArray, '~/command', _COMMAND_DEPTH)
        self._result = self.create_publisher(KeyValue, '~/command_result', _COMMAND_DEPTH)
        self.asked_input(UInt8MultiArray, '~/periodic_output', self._on_periodic_output, 10)
        self.asked_input(UInt8MultiArray, '~/send_command', self._on_send_command, _COMMAND_DEPTH)
        self.stop_input('~/hold_output', self._on_hold_output)
        self.asked_input(UInt16, '~/command_done', self._on_command_done, _COMMAND_DEPTH)

    def forget_device(self) -> None:
        """Publish that nothing is known of the BU."""
        self.on_event(ArmedChanged(armed=False, enabled=False))
        self.on_event(RemoteState(None))
        self.on_event(_UNKNOWN)

    def take_parameters(self, values: Mapping[str, Any]) -> None:
        """Keep which axes are inverted."""
        self._axis_inverted = axis_signs(values)

    def carried_over(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """
        Return what a session has to know of those before it.

        What withholds VRPO does so from the first on, or its silence does. And a command that was
        delivered is not delivered again.
        """
        del values
        return {
            HOLD_HEARD: self._hold_heard or self.stop_unheard,
            DELIVERED: tuple(self._delivered),
        }

    @property
    def hardware_name(self) -> str:
        """The device's name where the user gave none: its group and port."""
        return f'{self.values["group"]}:{self.values["input_port"]}'

    def on_event(self, event: Event) -> None:
        """Publish one event of the session."""
        if isinstance(event, Sticks):
            self._publish_sticks(event)
        elif isinstance(event, ArmedChanged):
            self._publish_armed(event)
        elif isinstance(event, RemoteState):
            self._publish_battery(event)
        elif isinstance(event, DeviceState):
            self._state = Status(*summarise(event.problems, event.good), event.values)
            self.publish_device()
        elif isinstance(event, EncoderTurned):
            self._encoder.publish(convert.encoder(event.position))
        elif isinstance(event, Command):
            self._publish_command(event)
        elif isinstance(event, CommandResult):
            self._result.publish(convert.command_result(event.command_id, event.outcome))

    def _publish_sticks(self, sticks: Sticks) -> None:
        joy = convert.joy(
            sticks.axes,
            sticks.buttons,
            *self.header(),
            axis_inverted=self._axis_inverted,
            deadband=self.values['deadband'],
        )
        self._joy.publish(self.vouched(joy))

    def _publish_armed(self, event: ArmedChanged) -> None:
        self._armed.publish(Bool(data=event.armed))
        self._enabled.publish(Bool(data=event.enabled))

    def _publish_battery(self, event: RemoteState) -> None:
        remote = event.status
        percent = None if remote is None else remote.battery_percent
        docked = remote is not None and remote.docked
        self._battery.publish(convert.battery_state(percent, *self.header(), docked=docked))

    def device_state(self) -> Any:
        """Return what the BU says of itself and of its remotes."""
        return to_msg(self._state, self.full_name, self.hardware_id)

    def on_report(self, report: Report, now: float) -> None:
        """Have ``~/device`` say what the diagnostic says: why nothing is heard has no event."""
        self._state = report.device._replace(values=self._state.values, reasons=())
        super().on_report(report, now)

    def _publish_command(self, command: Command) -> None:
        """Publish a command, and report whether that counts."""
        heard = (
            self.values['acknowledge'] == 'always' or self._command.get_subscription_count() > 0
        )
        if heard:
            self._delivered.append((command, clock.now()))
            self._command.publish(convert.command(command.command_id, command.data))
        # As a stop: it counts however late it comes.
        self.request(Session.command_published, command, heard, each=True, stop=True)

    # Requests.

    def on_refused(self, number: int, key: str, text: str) -> None:
        """Count and log why a request makes no sense; a command's sender is told, too."""
        super().on_refused(number, key, text)
        self._tell_refused(key, text)

    def _tell_refused(self, key: str, text: str) -> None:
        if key == 'send_command':
            self._result.publish(convert.command_result(None, text))

    def on_distrusted(self, text: str) -> None:
        """Withhold VRPO at once: it is not known what ~/hold_output says."""
        del text
        self._ask_hold(True)

    def on_unheard(self, text: str) -> None:
        """Withhold VRPO; the topic is not in use by that."""
        del text
        self.request(Session.set_hold_output, True, stop=True)

    def on_unheard_gone(self) -> None:
        """Go on as before, if nobody was ever heard."""
        if not self._hold_heard:
            self.request(Session.forget_hold_output, stop=True)

    def _on_hold_output(self, message: Any) -> None:
        self._ask_hold(message.data)

    def _ask_hold(self, hold: bool) -> None:
        self._hold_heard = True
        self.request(Session.set_hold_output, hold, stop=hold)

    def _on_periodic_output(self, message: Any) -> None:
        self._request_with_data(Session.set_periodic_output, message, 'periodic_output')

    def _on_send_command(self, message: Any) -> None:
        self._request_with_data(Session.send_command, message, 'send_command', each=True)

    def _request_with_data(
        self,
        method: Callable[[Session, bytes, float], object],
        message: Any,
        key: str,
        **options: bool,
    ) -> None:
        try:
            data = convert.data_of(message)
        except ValueError as error:
            self.on_refused(0, key, str(error))
        else:
            if not self.request(method, data, key=key, **options):
                self._tell_refused(key, FROZEN if self.active else 'the node is not active')

    def _on_command_done(self, message: Any) -> None:
        self.request(Session.command_done, message.data, key=f'command_done {message.data}')


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([Vm110Bridge]))


if __name__ == '__main__':
    main()
