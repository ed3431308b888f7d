"""The ESI drive bridge: one or two servo axes on RS422 as ROS topics."""

import time
from typing import Any
from typing import ClassVar

from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from bridge_core.diagnostics import ERROR
from bridge_core.diagnostics import Status
from bridge_core.diagnostics import summarise
from bridge_core.diagnostics import WARN
from bridge_core.node import BridgeNode
from bridge_core.node import latched_qos
from bridge_core.parameters import BRIDGE_PARAMETERS
from bridge_core.parameters import Parameter
from bridge_core.parameters import ParameterError
from bridge_core.runner import run
from bridge_core.transports.serial import SerialTransport
from esi_drive_bridge import convert
from esi_drive_bridge.parameters import axes
from esi_drive_bridge.parameters import PARAMETERS
from esi_drive_bridge.parameters import settings
from esi_drive_bridge.session import EnabledChanged
from esi_drive_bridge.session import EnableRefused
from esi_drive_bridge.session import ErrorsCleared
from esi_drive_bridge.session import FaultsChanged
from esi_drive_bridge.session import Feedback
from esi_drive_bridge.session import Session
from esi_drive_bridge.session import Stopped

# A stop must not be overwritten by what follows it before it was read, hence the depth.
_STOP_QOS = QoSProfile(depth=10)
_COMMAND_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class EsiDriveBridge(BridgeNode):
    """One drive; see docs/devices/esi_drive.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *PARAMETERS)

    def __init__(self, **options: Any) -> None:
        self._clearing: list[Future] = []
        self._joint_states_at = 0.0
        super().__init__('esi_drive_bridge', **options)

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse lists that do not fit each other. :raises ParameterError: them."""
        try:
            settings(values)
        except ValueError as error:
            raise ParameterError(f'parameter {error}') from error

    def create_interfaces(self) -> None:
        """Create what command and status become."""
        self._joint_states = self.publisher(JointState, '~/joint_states', 10)
        self._enabled = self.publisher(Bool, '~/enabled', latched_qos())
        self._enabled.publish(Bool(data=False))
        self.create_subscription(JointState, '~/command', self._on_command, _COMMAND_QOS)
        self.create_subscription(Bool, '~/enable', self._on_enable, _STOP_QOS)
        self.create_subscription(Bool, '~/estop_in', self._on_estop_in, _STOP_QOS)
        self.create_service(Trigger, '~/clear_errors', self._on_clear_errors)

    def make_session(self) -> Session:
        """Return a session for the configured layout and scales."""
        self._axes = axes(self.values)
        return Session(settings(self.values))

    def make_transport(self) -> SerialTransport:
        """Return the serial port, not yet open."""
        return SerialTransport(self.values['port'], self.values['baud'])

    def on_event(self, event: Any) -> None:
        """Publish one event of the session."""
        if isinstance(event, Feedback):
            self._publish_joint_states(event)
        elif isinstance(event, EnabledChanged):
            self._enabled.publish(Bool(data=event.enabled))
        elif isinstance(event, Stopped):
            self.outbox.post(
                lambda: self.get_logger().warning(f'disabled: {"; ".join(event.reasons)}')
            )
        elif isinstance(event, EnableRefused):
            text = f'not enabled: {"; ".join(event.reasons)}'
            self.outbox.post(lambda: self.get_logger().warning(text, throttle_duration_sec=1.0))
        elif isinstance(event, FaultsChanged):
            self._log_faults(event)
        elif isinstance(event, ErrorsCleared):
            self._answer_clearing(event)

    def link_changed(self, text: str, ok: bool) -> None:
        """Log a change of the port's state; nobody waits for a drive that is gone."""
        super().link_changed(text, ok)
        if not ok:
            self._answer_clearing(ErrorsCleared(False, text))

    def _leave_active(self) -> None:
        super()._leave_active()
        self._answer_clearing(ErrorsCleared(False, 'the node is not active'))

    def _answer_clearing(self, event: ErrorsCleared) -> None:
        waiting, self._clearing = self._clearing, []
        for future in waiting:
            future.set_result(event)

    def device_status(self, now: float) -> Status:
        """Return every error bit, why the drive is disabled, and the counters of commands."""
        session: Session = self.session
        problems = [(WARN, text) for text in session.warnings(now)]
        if session.estop:
            problems += [(ERROR, text) for text in session.stop_reasons(now)]
        level, message = summarise(problems, 'ok')
        inhibits = session.inhibits(now)
        if inhibits:
            message += f'; disabled: {"; ".join(inhibits)}'
        values: dict[str, Any] = {
            'phase': session.phase.value,
            'enabled': session.enabled,
            'disabled because': '; '.join(inhibits) or 'enabled',
            'saturated commands': session.saturations,
            'refused commands': session.refused_commands,
        }
        if session.status is not None:
            values |= convert.diagnostic_values(session.status, self._axes)
        return Status(level, message, values)

    def _log_faults(self, event: FaultsChanged) -> None:
        if event.faults:
            self.outbox.post(
                lambda: self.get_logger().error(f'the drive reports: {"; ".join(event.faults)}')
            )
        else:
            self.outbox.post(lambda: self.get_logger().info('the drive reports no error any more'))

    def _publish_joint_states(self, event: Feedback) -> None:
        now = time.monotonic()  # ROS time may be paused
        # A small slack, or a drive at just this rate would lose every other message.
        if now - self._joint_states_at < 0.9 / self.values['joint_state_rate']:
            return
        self._joint_states_at = now
        self._joint_states.publish(
            convert.joint_state(event.status, self._axes, self.stamp(), self.values['frame_id'])
        )

    # Requests: on the executor's thread, posted to the link thread.

    def _on_command(self, message: Any) -> None:
        if self.session is None:
            return
        try:
            values = convert.command_values(message, self._axes)
        except ValueError as error:
            reason = str(error)
            self.refuse(f'command: {reason}')
            self.request('command', lambda s, now: s.refuse_command(reason, now), sticky=True)
        else:
            self.request('command', lambda s, now: s.set_command(values, now))

    def _on_enable(self, message: Any) -> None:
        value = message.data
        self.request('enable', lambda s, now: s.set_enable(value, now), sticky=not value)

    def _on_estop_in(self, message: Any) -> None:
        value = message.data
        self.request('estop_in', lambda s, now: s.set_estop(value, now), sticky=value)

    async def _on_clear_errors(self, request: Any, response: Any) -> Any:
        """Answer when the drive has: the executor goes on meanwhile."""
        del request
        if self.session is None or not self.link.status.is_open:
            response.message = '; '.join(self._stop_reasons(time.monotonic()))
            return response
        done = Future(executor=self.executor)

        def clear(session: Session, now: float) -> None:
            self._clearing.append(done)
            if self.link.status.is_open:
                session.clear_errors(now)
            else:
                self._answer_clearing(ErrorsCleared(False, self.link.status.error))

        self.request(f'clear_errors {id(done)}', clear)
        event = await done
        response.success, response.message = event.success, event.text
        return response


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([EsiDriveBridge]))


if __name__ == '__main__':
    main()
