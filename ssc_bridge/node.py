"""The SSC bridge: an RC receiver as operator, and servos as actuators."""

import itertools
import time
from typing import Any
from typing import ClassVar

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool
from std_msgs.msg import String
from std_msgs.msg import UInt16MultiArray
from std_srvs.srv import Trigger

from bridge_core.diagnostics import ERROR
from bridge_core.diagnostics import Status
from bridge_core.diagnostics import summarise
from bridge_core.diagnostics import WARN
from bridge_core.node import BridgeNode
from bridge_core.node import latched_qos
from bridge_core.parameters import BRIDGE_PARAMETERS
from bridge_core.parameters import names_of
from bridge_core.parameters import Parameter
from bridge_core.parameters import ParameterError
from bridge_core.runner import run
from bridge_core.transports.serial import SerialTransport
from ssc_bridge import convert
from ssc_bridge.parameters import calibrations
from ssc_bridge.parameters import parameter_table
from ssc_bridge.parameters import settings
from ssc_bridge.session import AuxReading
from ssc_bridge.session import CommandStateChanged
from ssc_bridge.session import ConfigurationRead
from ssc_bridge.session import FailsafeBegun
from ssc_bridge.session import LockoutDone
from ssc_bridge.session import PulsesIn
from ssc_bridge.session import PulsesOut
from ssc_bridge.session import Session
from ssc_bridge.session import Sticks

# A stop must not be overwritten by what follows it before it was read, hence the depth.
_STOP_QOS = QoSProfile(depth=10)
_COMMAND_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class SscBridge(BridgeNode):
    """One SSC; see docs/devices/ssc.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *parameter_table({}))

    def __init__(self, **options: Any) -> None:
        self._lockouts: list[Future] = []
        self._numbers = itertools.count()  # of requests that must not replace each other
        super().__init__('ssc_bridge', **options)

    def parameter_table(self, given: dict[str, Any]) -> tuple[Parameter, ...]:
        """Return all parameters, those of the named axes, buttons and servos included."""
        return (*BRIDGE_PARAMETERS, *parameter_table(given))

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse what contradicts itself. :raises ParameterError: it."""
        try:
            settings(values)
            calibrations(values)
        except ValueError as error:
            raise ParameterError(f'parameter {error}') from error

    def create_interfaces(self) -> None:
        """Create what the manual's messages become."""
        self._joy = self.publisher(Joy, '~/joy', 10)
        self._pulse_inputs = self.publisher(UInt16MultiArray, '~/pulse_inputs', 10)
        self._pulse_outputs = self.publisher(UInt16MultiArray, '~/pulse_outputs', 10)
        self._command_state = self.publisher(String, '~/command_state', latched_qos())
        self._aux_inputs = self.publisher(DiagnosticStatus, '~/aux_inputs', 10)
        self._command_state.publish(convert.command_state(None))
        self.create_subscription(
            UInt16MultiArray, '~/pulse_command', self._on_pulse_command, _COMMAND_QOS
        )
        self.create_subscription(
            JointState, '~/servo_command', self._on_servo_command, _COMMAND_QOS
        )
        self.create_subscription(KeyValue, '~/aux_outputs', self._on_aux_outputs, 10)
        self.create_subscription(Bool, '~/estop_in', self._on_estop_in, _STOP_QOS)
        self.create_service(Trigger, '~/lockout', self._on_lockout)

    def make_session(self) -> Session:
        """Return a session for the configured channels."""
        self._calibrations = calibrations(self.values)
        self._servos = names_of(self.values, 'servos')
        return Session(settings(self.values))

    def make_transport(self) -> SerialTransport:
        """Return the serial port, not yet open."""
        return SerialTransport(self.values['port'], self.values['baud'])

    def on_event(self, event: Any) -> None:
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
            self._publish_aux(event)
        elif isinstance(event, FailsafeBegun):
            text = f'failsafe of {", ".join(event.names)}: {"; ".join(event.reasons)}'
            self.outbox.post(lambda: self.get_logger().warning(text, throttle_duration_sec=1.0))
        elif isinstance(event, ConfigurationRead):
            self._log_configuration(event)
        elif isinstance(event, LockoutDone):
            self._answer_lockouts(event)

    def link_changed(self, text: str, ok: bool) -> None:
        """Log a change of the port's state; nobody waits for a device that is gone."""
        super().link_changed(text, ok)
        if not ok:
            self._answer_lockouts(LockoutDone(False, text))

    def _leave_active(self) -> None:
        super()._leave_active()
        self._answer_lockouts(LockoutDone(False, 'the node is not active'))

    def device_status(self, now: float) -> Status:
        """Return command state, sources, what is wrong, and why no command is obeyed."""
        session: Session = self.session
        level, message = summarise(self._problems(session, now), 'ok')
        inhibits = session.inhibits(now)
        if inhibits and not session.estop:
            message += f'; outputs at failsafe: {"; ".join(inhibits)}'
        values: dict[str, Any] = {
            'command state': convert.command_state(session.command_state).data,
            'faulty controls': ', '.join(session.faulty) or 'none',
            'outputs commanded': ', '.join(session.outputs.commanded().values()) or 'none',
            'commands not obeyed because': '; '.join(inhibits) or 'they are',
            'limited commands': session.outputs.limited,
            'refused commands': session.refused_commands,
            'messages before the configuration': session.unchecked,
            'messages against the configuration': session.mismatches,
        }
        return Status(level, message, values | _configuration_values(session))

    def _problems(self, session: Session, now: float) -> list[tuple[bytes, str]]:
        stop_level = WARN if session.link_up else ERROR
        problems = [(stop_level, reason) for reason in session.stop_reasons(now)]
        if session.faulty:
            text = f'no believable pulse: {", ".join(session.faulty)}; check the receiver'
            problems.append((ERROR, f'{text}, its cables and the calibration'))
        problems += [(WARN, text) for text in session.warnings()]
        if session.looped_back:
            problems.append((WARN, 'our own frames come back: is RX wired to TX, or echo on?'))
        return problems

    def _publish_sticks(self, sticks: Sticks) -> None:
        header = self.stamp(), self.values['frame_id']
        self._joy.publish(convert.joy(sticks.axes, sticks.buttons, self._calibrations, *header))

    def _publish_aux(self, reading: AuxReading) -> None:
        rows = (
            (aux.function, aux.level, aux.measurement, aux.total, aux.overflowed)
            for aux in reading.channels
        )
        name = f'{self.get_fully_qualified_name().lstrip("/")}: aux'
        hardware_id = self.values['hardware_id'] or self.hardware_name
        self._aux_inputs.publish(convert.aux_inputs(rows, name, hardware_id))

    def _log_configuration(self, event: ConfigurationRead) -> None:
        told = event.configuration
        text = (
            f'configuration {told.config_id}: {told.inputs} pulse inputs, {told.outputs} outputs, '
            f'aux: {", ".join(function.text for function in told.aux)}'
        )
        self.outbox.post(lambda: self.get_logger().info(text))

    def _answer_lockouts(self, event: LockoutDone) -> None:
        waiting, self._lockouts = self._lockouts, []
        for future in waiting:
            future.set_result(event)
        if event.success:
            self.outbox.post(lambda: self.get_logger().info(event.text))
        elif not waiting and self.link.status.is_open:
            text = f'lockout: {event.text}'
            self.outbox.post(lambda: self.get_logger().warning(text, throttle_duration_sec=1.0))

    # Requests: on the executor's thread, posted to the link thread.

    def _on_pulse_command(self, message: Any) -> None:
        try:
            us = convert.pulse_command(message)
        except ValueError as error:
            self._refuse_command('pulse_command', str(error))
        else:
            self.request('pulse_command', lambda s, now: s.set_pulses(us, now))

    def _on_servo_command(self, message: Any) -> None:
        if self.session is None:
            return
        try:
            positions = convert.servo_command(message, self._servos)
        except ValueError as error:
            self._refuse_command('servo_command', str(error))
        else:
            # Commands to different servos must not replace each other.
            key = f'servo_command {sorted(positions)}'
            self.request(key, lambda s, now: s.set_servos(positions, now))

    def _refuse_command(self, what: str, reason: str) -> None:
        self.refuse(f'{what}: {reason}')
        self.request(what, lambda s, now: s.refuse_command(reason, now), sticky=True)

    def _on_estop_in(self, message: Any) -> None:
        value = message.data
        self.request('estop_in', lambda s, now: s.set_estop(value, now), sticky=value)

    def _on_aux_outputs(self, message: Any) -> None:
        def act(session: Session, now: float) -> None:
            number, what, value = convert.aux_request(message)
            if what == 'level':
                session.set_level(number, bool(value), now)
            elif what == 'pulse':
                session.set_pulse(number, value, now)
            else:
                session.set_period(number, value, now)

        self.request(f'aux_outputs {next(self._numbers)}', act)

    async def _on_lockout(self, request: Any, response: Any) -> Any:
        """Answer when the SSC has: the executor goes on meanwhile."""
        del request
        if self.session is None or not self.link.status.is_open:
            response.message = '; '.join(self._stop_reasons(time.monotonic()))
            return response
        done = Future(executor=self.executor)

        def lockout(session: Session, now: float) -> None:
            self._lockouts.append(done)
            if self.link.status.is_open:
                session.lockout(now)
            else:
                self._answer_lockouts(LockoutDone(False, self.link.status.error))

        self.request(f'lockout {next(self._numbers)}', lockout)
        event = await done
        response.success, response.message = event.success, event.text
        return response


def _configuration_values(session: Session) -> dict[str, Any]:
    """Return how the SSC is set up, and where each output gets its pulses from now."""
    told = session.configuration
    if told is None:
        return {'configuration': 'not read yet'}
    sources = enumerate(session.source_texts(), 1)
    return {
        'configuration ID': told.config_id,
        'pulse inputs': told.inputs,
        'pulse outputs': told.outputs,
        'configuration menus': _menus(session),
        **{f'aux {number}': function.text for number, function in enumerate(told.aux, 1)},
        **{f'source of output {number}': text for number, text in sources},
    }


def _menus(session: Session) -> str:
    if session.status is None:
        return convert.UNKNOWN
    return 'available' if session.status.config_available else 'locked out'


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([SscBridge]))


if __name__ == '__main__':
    main()
