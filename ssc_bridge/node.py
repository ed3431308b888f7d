# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The SSC bridge: an RC receiver as operator, and servos as actuators."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import String, UInt16MultiArray

from bridge_core.managed_node import latched_qos
from bridge_core.node import BridgeNode
from bridge_core.parameters import ACTUATOR_PARAMETERS, Parameter
from bridge_core.runner import run
from bridge_core.session import Level
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Call
from ssc_bridge import convert
from ssc_bridge.parameters import parameter_table
from ssc_bridge.protocol import AuxFunction
from ssc_bridge.reasons import REASONS
from ssc_bridge.session import (
    AuxReading,
    CommandStateChanged,
    ConfigurationRead,
    Event,
    FailsafeBegun,
    LOCKOUT,
    neutral,
    OutputsSent,
    OutputState,
    PulsesIn,
    PulsesOut,
    Session,
    Settings,
    SourcesChanged,
    Sticks,
)
from ssc_bridge.wire import AUX_SET, BRIDGE, OUTPUTS_SENT


@dataclass
class _Sent:
    """
    What was sent to one port: it is in force until a session undoes it.

    :param outputs: as the newest session has sent them.
    :param commanded: outputs without a name were; no session after that one knows.
    :param aux: what the auxiliary channels are.
    :param aux_set: which were set, while they are that.
    """

    outputs: tuple[OutputState, ...] = ()
    commanded: bool = False
    aux: tuple[AuxFunction, ...] = ()
    aux_set: set[int] = field(default_factory=set)

    def note(self, aux: tuple[AuxFunction, ...]) -> None:
        """Note what the auxiliary channels are: others than before are of another device."""
        if self.aux not in ((), aux):  # none: it was set of these, while they were on their way
            self.aux_set.clear()
        self.aux = aux


class SscBridge(BridgeNode[Event]):
    """One SSC; see docs/devices/ssc.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*ACTUATOR_PARAMETERS, *parameter_table({}))
    BRIDGE = BRIDGE
    REASONS = REASONS
    LINK = ProcessLink
    SERVICES = {LOCKOUT: Call.of(Session.lock_out)}

    def __init__(self, **options: Any) -> None:
        self._streaming = False  # sticks that ask for something were published last
        self._ports: defaultdict[str, _Sent] = defaultdict(_Sent)
        self._sent = _Sent()  # to the port of now
        super().__init__('ssc_bridge', **options)

    def parameter_table(self, given: dict[str, Any]) -> tuple[Parameter, ...]:
        """Return all parameters, those of the named axes, buttons and servos included."""
        return (*ACTUATOR_PARAMETERS, *parameter_table(given))

    def create_interfaces(self) -> None:
        """Create what the manual's messages become."""
        self._joy = self.create_publisher(Joy, '~/joy', 10)
        self._pulse_inputs = self.create_publisher(UInt16MultiArray, '~/pulse_inputs', 10)
        self._pulse_outputs = self.create_publisher(UInt16MultiArray, '~/pulse_outputs', 10)
        self._command_state = self.create_publisher(String, '~/command_state', latched_qos())
        self._aux_inputs = self.create_publisher(DiagnosticStatus, '~/aux_inputs', 10)
        self._sources = self.create_publisher(DiagnosticStatus, '~/channel_sources', latched_qos())
        # What comes first here is read first.
        self.stop_input('~/estop_in', self._on_estop_in)
        self.command_input(UInt16MultiArray, '~/pulse_command', self._on_pulse_command)
        self.command_input(JointState, '~/servo_command', self._on_servo_command)
        self.asked_input(KeyValue, '~/aux_outputs', self._on_aux_outputs, 10)

    def forget_device(self) -> None:
        """Publish that nothing is known of the device, and neutral sticks after others."""
        self._command_state.publish(convert.command_state(None))
        self._publish_sources(())
        if self._streaming:
            self._publish_sticks(neutral(self._settings))

    def take_parameters(self, values: Mapping[str, Any]) -> None:
        """Keep the configured channels."""
        self._settings = Settings.from_parameters(values)
        self._sent = self._ports[values['port']]  # whatever is there, it was sent nothing else

    def carried_over(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """What was sent is in force until a session undoes it, or the next one on its port."""
        sent = self._ports[values['port']]
        return {
            **super().carried_over(values),
            OUTPUTS_SENT: sent.outputs,
            AUX_SET: (sent.aux, frozenset(sent.aux_set)),
        }

    def on_events(self, events: Sequence[Any], now: float) -> None:
        """Note at once what a wire that takes over has to know: it may do so behind a stop."""
        for event in events:
            if isinstance(event, OutputsSent):
                self._ports[event.port].outputs = event.states
            elif isinstance(event, ConfigurationRead):
                self._sent.note(event.configuration.aux)
        super().on_events(events, now)

    def on_event(self, event: Event) -> None:
        """Publish one event of the session."""
        if isinstance(event, Sticks):
            self._publish_sticks(event)
        elif isinstance(event, PulsesIn):
            self._pulse_inputs.publish(convert.pulses(event.us))
        elif isinstance(event, PulsesOut):
            self._pulse_outputs.publish(convert.pulses(event.us))
        elif isinstance(event, CommandStateChanged):
            self._command_state.publish(convert.command_state(event.state))
        elif isinstance(event, AuxReading):
            self._aux_inputs.publish(convert.aux_inputs(event.channels, *self._part('aux')))
        elif isinstance(event, SourcesChanged):
            self._publish_sources(event.sources)
        elif isinstance(event, FailsafeBegun):
            text = f'failsafe of {", ".join(event.names)}: {"; ".join(event.reasons)}'
            self.log(Level.WARN, text, site='failsafe')
        elif isinstance(event, ConfigurationRead):
            self._log_configuration(event)
            self._claim()

    def _claim(self) -> None:
        """Have a session that may be new undo what was commanded before it."""
        if self._sent.commanded:
            self.request(Session.claim_outputs, stop=True)
        if self._sent.aux_set:
            self.request(Session.claim_aux, self._sent.aux_set, stop=True)

    def _publish_sticks(self, sticks: Sticks) -> None:
        axes = self._settings.axes
        self._streaming = sticks != neutral(self._settings)
        joy = convert.joy(sticks.axes, sticks.buttons, axes, *self.header())
        self._joy.publish(self.vouched(joy))

    def _publish_sources(self, sources: Sequence[str]) -> None:
        self._sources.publish(convert.channel_sources(sources, *self._part('channel sources')))

    def _part(self, part: str) -> tuple[str, str]:
        """Return name and hardware_id of a DiagnosticStatus."""
        return f'{self.full_name}: {part}', self.hardware_id

    def _log_configuration(self, event: ConfigurationRead) -> None:
        read = event.configuration
        self.log(
            Level.OK,
            f'configuration {read.config_id}: {read.inputs} pulse inputs, {read.outputs} outputs, '
            f'aux: {", ".join(function.text for function in read.aux)}',
            site='configuration',
        )

    # Requests.

    def _on_pulse_command(self, message: Any) -> None:
        try:
            us = convert.pulse_command(message)
        except ValueError as error:
            self._refuse_command('pulse_command', str(error))
        else:
            self._sent.commanded |= self.active
            self.request(Session.set_pulses, us, key='pulse_command')

    def _on_servo_command(self, message: Any) -> None:
        if not self.active:
            return
        names = [servo.name for servo in self._settings.servos]
        try:
            positions = convert.servo_command(message, names)
        except ValueError as error:
            self._refuse_command('servo_command', str(error))
        else:
            # Commands to different servos must not replace each other.
            key = f'servo_command {sorted(positions)}'
            self.request(Session.set_servos, positions, key=key)

    def _refuse_command(self, what: str, reason: str) -> None:
        self.refuse(f'{what}: {reason}')
        self.request(Session.refuse_command, reason, key=what, stop=True)

    def on_distrusted(self, text: str) -> None:
        """Bring the failsafe at once: it is not known what an input says."""
        del text
        self.request(Session.set_estop, True, stop=True)

    def _on_estop_in(self, message: Any) -> None:
        self.request(Session.set_estop, message.data, stop=message.data)

    def _on_aux_outputs(self, message: Any) -> None:
        try:
            requests = convert.aux_requests(message)
        except ValueError as error:
            self.refuse(f'aux_outputs: {error}')
        else:
            if self.active:
                self._sent.aux_set |= {request.number for request in requests}
            self.request(Session.set_aux, requests, key='aux_outputs', each=True)


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([SscBridge]))


if __name__ == '__main__':
    main()
