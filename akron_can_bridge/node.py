"""The Akron CAN bridge: a monitor of the 6000 series as ROS topics."""

from functools import partial
import time
from typing import Any
from typing import ClassVar

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from akron_can_bridge import convert
from akron_can_bridge.parameters import PARAMETERS
from akron_can_bridge.parameters import session_settings
from akron_can_bridge.session import Answer
from akron_can_bridge.session import Cause
from akron_can_bridge.session import FaultsChanged
from akron_can_bridge.session import FILTERS
from akron_can_bridge.session import LimitsChanged
from akron_can_bridge.session import OutputsChanged
from akron_can_bridge.session import Positions
from akron_can_bridge.session import report
from akron_can_bridge.session import Request
from akron_can_bridge.session import Resting
from akron_can_bridge.session import Session
from akron_can_bridge.session import Sticks
from akron_can_bridge.session import Stopped
from akron_can_bridge.session import UnitChanged
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
from bridge_core.transports.can import CanTransport

# A stop must not be overwritten by what follows it before it was read, hence the depth.
_STOP_QOS = QoSProfile(depth=10)
_COMMAND_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class AkronCanBridge(BridgeNode):
    """One unit on a CAN bus; see docs/devices/akron.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *PARAMETERS)

    def __init__(self, **options: Any) -> None:
        self._waiting: dict[Request, list[Future]] = {request: [] for request in Request}
        super().__init__('akron_can_bridge', **options)

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse values that contradict each other. :raises ParameterError: naming them."""
        session_settings(values)
        try:
            self._new_transport(values)
        except ValueError as error:
            raise ParameterError(f'parameter {error}') from error

    def create_interfaces(self) -> None:
        """Create what the manual's messages become."""
        self._joint_states = self.publisher(JointState, '~/joint_states', 10)
        self._joy = self.publisher(Joy, '~/joy', 10)
        self._limits = self.publisher(DiagnosticStatus, '~/limits', latched_qos())
        self._outputs = self.publisher(DiagnosticStatus, '~/outputs', latched_qos())
        self.create_subscription(Joy, '~/cmd_joy', self._on_cmd_joy, _COMMAND_QOS)
        self.create_subscription(Bool, '~/estop_in', self._on_estop_in, _STOP_QOS)
        self.create_service(
            Trigger, '~/zero_positions', partial(self._on_request, Request.ZERO_POSITIONS)
        )
        self.create_service(
            Trigger, '~/reset_controller', partial(self._on_request, Request.RESET_CONTROLLER)
        )
        self.create_service(
            Trigger, '~/enter_setup', partial(self._on_request, Request.ENTER_SETUP)
        )
        self.create_service(
            Trigger, '~/poll_faults', partial(self._on_request, Request.POLL_FAULTS)
        )
        self.create_service(
            Trigger, '~/poll_versions', partial(self._on_request, Request.POLL_VERSIONS)
        )
        self._publish_limits(LimitsChanged())
        self._publish_outputs(OutputsChanged())

    def make_session(self) -> Session:
        """Return a session for the unit that the parameters name."""
        return Session(session_settings(self.values))

    def make_resting_session(self) -> Resting:
        """Return what sends neutral frames while the node is inactive."""
        return Resting(session_settings(self.values))

    def make_transport(self) -> CanTransport:
        """Return the CAN port, not yet open."""
        return self._new_transport(self.values)

    def _new_transport(self, values: dict[str, Any]) -> CanTransport:
        return CanTransport(
            values['interface'],
            values['channel'],
            bitrate=values['bitrate'] or None,
            filters=FILTERS,
        )

    @property
    def hardware_name(self) -> str:
        """The device's name where the user gave none: its PIN, or else the channel."""
        return str(self.values['device_pin'] or self.values['channel'])

    def on_event(self, event: Any) -> None:
        """Publish or log one event of the session."""
        if isinstance(event, Positions):
            self._publish_joint_states(event)
        elif isinstance(event, LimitsChanged):
            self._publish_limits(event)
        elif isinstance(event, OutputsChanged):
            self._publish_outputs(event)
        elif isinstance(event, Sticks):
            self._publish_sticks(event)
        elif isinstance(event, Answer):
            self._answer(event)
        elif isinstance(event, UnitChanged):
            self.outbox.post(lambda: self.get_logger().info(event.text))
        elif isinstance(event, Stopped):
            self.outbox.post(
                lambda: self.get_logger().warning(f'neutral: {"; ".join(event.reasons)}')
            )
        elif isinstance(event, FaultsChanged):
            self._log_faults(event)

    def device_status(self, now: float) -> Status:
        """Return stops, warnings, why frames are neutral, and what is known of the unit."""
        session: Session = self.session
        level, message = summarise(self._problems(session, now), 'ok')
        inhibits = session.inhibits(now)
        if inhibits:
            message += f'; neutral: {"; ".join(inhibits)}'
        return Status(level, message, report.values(session, now))

    def _problems(self, session: Session, now: float) -> list[tuple[bytes, str]]:
        not_enabled = session.causes(now).get(Cause.ENABLE) if session.link_up else None
        stops = [
            (WARN if text == not_enabled else ERROR, text) for text in session.stop_reasons(now)
        ]
        return stops + [(WARN, text) for text in report.warnings(session, now)]

    def link_changed(self, text: str, ok: bool) -> None:
        """Log a change of the port's state; nobody waits for a unit that is gone."""
        super().link_changed(text, ok)
        if not ok:
            self._answer_all(text)

    def _leave_active(self) -> None:
        super()._leave_active()
        self._answer_all('the node is not active')

    def _answer_all(self, reason: str) -> None:
        for request in Request:
            self._answer(Answer(request, False, reason))

    def _answer(self, answer: Answer) -> None:
        waiting, self._waiting[answer.request] = self._waiting[answer.request], []
        for future in waiting:
            future.set_result(answer)

    def _log_faults(self, event: FaultsChanged) -> None:
        if event.faults:
            self.outbox.post(
                lambda: self.get_logger().error(f'the unit reports {"; ".join(event.faults)}')
            )
        else:
            self.outbox.post(lambda: self.get_logger().info('the unit reports no fault any more'))

    def _header(self) -> tuple[Any, str]:
        return self.stamp(), self.values['frame_id']

    def _publish_joint_states(self, event: Positions) -> None:
        self._joint_states.publish(
            convert.joint_state(
                (event.rotation, event.elevation),
                self.values['joint_names'],
                *self._header(),
                inverted=self.values['joint_inverted'],
            )
        )

    def _publish_limits(self, event: LimitsChanged) -> None:
        self._limits.publish(
            convert.limits(event.position, event.rotation, event.elevation, *self._unit_name())
        )

    def _publish_outputs(self, event: OutputsChanged) -> None:
        name, _ = self._unit_name()
        self._outputs.publish(convert.outputs(event.outputs, event.mini, event.inputs, name))

    def _unit_name(self) -> tuple[str, int]:
        """Return the unit's hardware_id and type."""
        session: Session | None = self.session
        unit = None if session is None else session.finder.unit
        pin = '' if unit is None else unit.pin
        kind = 0 if unit is None else unit.device_type
        return self.values['hardware_id'] or pin or self.hardware_name, kind

    def _publish_sticks(self, sticks: Sticks) -> None:
        self._joy.publish(
            convert.joy(
                sticks.axes, sticks.switches, *self._header(), deadband=self.values['deadband']
            )
        )

    # Requests: on the executor's thread, posted to the link thread.

    def _on_cmd_joy(self, message: Any) -> None:
        if self.session is None:
            return
        try:
            command = convert.command(message, extended=self.values['extended'])
        except ValueError as error:
            reason = str(error)
            self.refuse(f'cmd_joy: {reason}')
            self.request('cmd_joy', lambda s, now: s.refuse_command(reason, now), sticky=True)
        else:
            self.request('cmd_joy', lambda s, now: s.set_command(*command, now))

    def _on_estop_in(self, message: Any) -> None:
        value = message.data
        self.request('estop_in', lambda s, now: s.set_estop(value, now), sticky=value)

    async def _on_request(self, kind: Request, request: Any, response: Any) -> Any:
        """Answer when the unit has: the executor goes on meanwhile."""
        del request
        if self.session is None or not self.link.status.is_open:
            response.message = '; '.join(self._stop_reasons(time.monotonic()))
            return response
        done = Future(executor=self.executor)

        def ask(session: Session, now: float) -> None:
            try:
                session.request(kind, now)
            except ValueError as error:
                done.set_result(Answer(kind, False, str(error)))
                raise
            self._waiting[kind].append(done)

        self.request(f'{kind.value} {id(done)}', ask)
        answer = await done
        response.success, response.message = answer.success, answer.text
        return response


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([AkronCanBridge]))


if __name__ == '__main__':
    main()
