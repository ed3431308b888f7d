"""
The common node: parameters, lifecycle, e-stop, link and diagnostics topics.

What a stop needs is here once, for all bridges: ``~/estop`` is true from construction, published
at once on change and at ``estop_rate`` always, by the link thread, port or no port, active or not.
"""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import asdict
import math
from pathlib import Path
import time
from typing import Any
from typing import ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import FloatingPointRange
from rcl_interfaces.msg import IntegerRange
from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.msg import SetParametersResult
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool

from bridge_core.diagnostics import ERROR
from bridge_core.diagnostics import OK
from bridge_core.diagnostics import Status
from bridge_core.diagnostics import WARN
from bridge_core.outbox import Outbox
from bridge_core.parameter_files import check_sections
from bridge_core.parameters import BRIDGE_PARAMETERS
from bridge_core.parameters import MANAGED_PARAMETERS
from bridge_core.parameters import Parameter
from bridge_core.parameters import ParameterError
from bridge_core.parameters import resolve
from bridge_core.transports import Transport
from bridge_core.transports import TransportError
from bridge_core.transports.link import Link

# ROS declares these by itself; nobody else may use an unknown name.
_ROS_PARAMETERS = ('use_sim_time', 'start_type_description_service')
_DIAGNOSTICS_PERIOD = 1.0
_LAST_WORDS_TIME = 0.3  # s


def latched_qos(deadline: float | None = None) -> QoSProfile:
    """Return the QoS of a state: reliable, transient local, depth 1, and a deadline in seconds."""
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    if deadline is not None:
        qos.deadline = Duration(seconds=deadline)
    return qos


class ManagedNode(LifecycleNode):
    """
    A lifecycle node with checked parameters.

    :param parameter_files: those on the command line.
    :raises ParameterError: at construction, before anything is opened.
    """

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = MANAGED_PARAMETERS

    def __init__(self, name: str, *, parameter_files: Sequence[Path] = (), **options: Any) -> None:
        super().__init__(name, **options)
        self.active = False
        self.starting = False  # configured to be activated at once
        try:
            check_sections(self.get_fully_qualified_name(), parameter_files)
            self.values: dict[str, Any] = self._declare()
        except BaseException:
            super().destroy_node()
            raise
        self.add_on_set_parameters_callback(self._on_set_parameters)

    def parameter_table(self, given: dict[str, Any]) -> tuple[Parameter, ...]:
        """Return all parameters; a node whose lists name further ones extends this."""
        del given
        return self.PARAMETERS

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse values that contradict each other. :raises ParameterError: naming both."""

    def shut_down(self) -> None:
        """Leave the device safe; called on SIGINT and SIGTERM and before the node is destroyed."""

    def autostart(self) -> None:
        """
        Configure and activate, unless the parameter leaves that to somebody else.

        :raises ParameterError: what the parameters ask for cannot be made; it was logged.
        """
        if not self.values['autostart']:
            return
        self.starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise ParameterError(f'{self.get_name()} cannot start with these parameters')
        self.starting = False

    def _declare(self) -> dict[str, Any]:
        # rclpy has no public name for what was given, and cannot declare an empty list by itself.
        given = {
            name: _plain(parameter.value)
            for name, parameter in self._parameter_overrides.items()
            if not _is_ros_parameter(name)
        }
        self._table = {p.name: p for p in self.parameter_table(given)}
        values = resolve(self._table.values(), given)
        self.check_parameters(values)
        for name, value in values.items():
            self.declare_parameter(name, value, _descriptor(self._table[name]), True)
        return values

    def _on_set_parameters(self, parameters: Sequence[Any]) -> Any:
        changes = {p.name: _plain(p.value) for p in parameters if p.name in self._table}
        try:
            for name, value in changes.items():
                parameter = self._table[name]
                if parameter.fixed:
                    raise ParameterError(f'parameter {name}: restart the node to change it')
                if self.active and not parameter.runtime:
                    raise ParameterError(f'parameter {name}: deactivate the node to change it')
                changes[name] = parameter.validate(value)
            values = {**self.values, **changes}
            self.check_parameters(values)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.values = values
        return SetParametersResult(successful=True)

    def _transition(self, action: Callable[[], None], what: str) -> TransitionCallbackReturn:
        try:
            action()
        except (ValueError, TransportError) as error:
            self.get_logger().error(f'cannot {what}: {error}')
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS


class BridgeNode(ManagedNode):
    """
    A node that joins one device: the room adds its session, its transport and its topics.

    Callbacks of the executor never touch the session: they post requests to ``self.link``.
    ``on_event`` and ``device_status`` run on the link thread, which never waits for the
    middleware: publishers come from ``publisher``, and logs there go by ``self.outbox``.
    """

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = BRIDGE_PARAMETERS

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.outbox = Outbox(f'{name} outbox')
        period = 1.0 / self.values['estop_rate']
        qos = latched_qos(deadline=2.0 * period)
        self._estop_publisher = self.publisher(Bool, '~/estop', qos)
        self._own_estop_publisher = self.publisher(Bool, '~/own_estop', qos)
        self._link_up_publisher = self.publisher(Bool, '~/link_up', latched_qos())
        self._diagnostics_publisher = self.publisher(DiagnosticArray, '/diagnostics', 10)
        self._period = period
        self._repeat_at = self._diagnose_at = 0.0
        self._told: tuple[bool, bool, bool] | None = None
        self._levels: list[bytes] = []
        self.refused = 0
        self.refusal = ''
        self.session: Any = None  # the room's own Session while active
        self.link = Link(name, self, reconnect_period=self.values['reconnect_period'])
        self.create_interfaces()
        self.link.start()

    def publisher(self, kind: type, topic: str, qos: QoSProfile | int) -> 'OutboxPublisher':
        """Return a publisher for use on the link thread; parameters as of ``create_publisher``."""
        return OutboxPublisher(self.create_publisher(kind, topic, qos), self.outbox)

    # What a room provides.

    def create_interfaces(self) -> None:
        """Create the room's publishers, subscriptions and services."""

    def make_session(self) -> Any:
        """Return a new session made from the parameters."""
        raise NotImplementedError

    def make_resting_session(self) -> Any:
        """Return what runs on the port while the node is inactive; None: the port is closed."""
        return None

    def make_transport(self) -> Transport:
        """Return the transport that the parameters name, not yet open."""
        raise NotImplementedError

    def on_event(self, event: Any) -> None:
        """Publish one event of the session."""

    def device_status(self, now: float) -> Status:
        """Return the device's own diagnostic."""
        raise NotImplementedError

    def request(
        self, key: str, action: Callable[[Any, float], None], *, sticky: bool = False
    ) -> None:
        """
        Have ``action(session, now)`` done on the link thread; of one key the latest wins.

        A ValueError is a refusal of what somebody asked: it is counted and logged, nothing else.

        :param sticky: a stop: nothing that is asked later replaces it.
        """
        session = self.session
        if session is None:
            return

        def act(now: float) -> None:
            try:
                action(session, now)
            except ValueError as error:
                self.refuse(f'{key}: {error}')

        self.link.post(key, act, sticky=sticky)

    def refuse(self, text: str) -> None:
        """Count and log a request that makes no sense."""
        self.refused += 1
        self.refusal = text
        self.outbox.post(
            lambda: self.get_logger().warning(f'refused {text}', throttle_duration_sec=1.0)
        )

    # The owner's side of the link.

    def pace(self, now: float) -> float:
        """Publish stop and link states on change and at ``estop_rate``, diagnostics at 1 Hz."""
        changed = self._state() != self._told
        if changed or now >= self._repeat_at:
            self._tell(now, changed)
        return self._repeat_at  # diagnostics go out with one of these

    def link_changed(self, text: str, ok: bool) -> None:
        """Log a change of the port's state."""
        if ok:  # on a line of its own: rclpy refuses a change of severity within one call site
            self.outbox.post(lambda: self.get_logger().info(text))
        else:
            self.outbox.post(lambda: self.get_logger().error(text))

    def stamp(self) -> Any:
        """Return the time for a header, in ROS time: it never decides anything."""
        return self.get_clock().now().to_msg()

    def _state(self) -> tuple[bool, bool, bool]:
        """Return estop, own_estop and link_up; without a session or a port all is stopped."""
        session = self.session
        if session is None or not self.link.status.is_open:
            return True, True, False
        return session.estop, session.own_estop, session.link_up

    def _tell(self, now: float, changed: bool) -> None:
        estop, own_estop, link_up = state = self._state()
        self._estop_publisher.publish(Bool(data=estop))
        self._own_estop_publisher.publish(Bool(data=own_estop))
        if self._told is None or link_up != self._told[2]:
            self._link_up_publisher.publish(Bool(data=link_up))
        if changed:
            self._log_stop(estop, now)
        self._told = state
        self._repeat_at = now + self._period
        self._diagnose(now)

    def _log_stop(self, estop: bool, now: float) -> None:
        if self._told is not None and estop == self._told[0]:
            return
        if not estop:
            self.outbox.post(lambda: self.get_logger().info('no stop demanded any more'))
        else:
            text = f'stop: {"; ".join(self._stop_reasons(now))}'
            self.outbox.post(lambda: self.get_logger().warning(text))

    def _stop_reasons(self, now: float) -> list[str]:
        if self.session is None:
            return ['the node is not active']
        if not self.link.status.is_open:
            return [self.link.status.error]
        return list(self.session.stop_reasons(now))

    def _diagnose(self, now: float) -> None:
        statuses = [self._link_status(now), self._checked_device_status(now)]
        levels = [status.level for status in statuses]
        if levels == self._levels and now < self._diagnose_at:
            return
        self._levels, self._diagnose_at = levels, now + _DIAGNOSTICS_PERIOD
        hardware_id = self.values['hardware_id'] or self.hardware_name
        name = self.get_fully_qualified_name().lstrip('/')
        array = DiagnosticArray(
            status=[
                status.to_msg(f'{name}: {part}', hardware_id)
                for part, status in zip(('link', 'device'), statuses, strict=True)
            ]
        )
        array.header.stamp = self.stamp()
        self._diagnostics_publisher.publish(array)

    @property
    def hardware_name(self) -> str:
        """The device's name where the user gave none: its port."""
        return str(self.values.get('port', self.get_name()))

    def _checked_device_status(self, now: float) -> Status:
        if self.session is None:
            return Status(WARN, 'the node is not active; ~/estop is true')
        return self.device_status(now)

    def _link_status(self, now: float) -> Status:
        port, session = self.link.status, self.session
        if session is None:
            texts = dict.fromkeys(['the node is not active', *filter(None, [port.error])])
            return Status(WARN, '; '.join(texts), {})
        if not port.is_open:
            level, message = ERROR, port.error
        elif not session.link_up:
            level, message = ERROR, '; '.join(self._stop_reasons(now))
        else:
            level, message = OK, 'ok'
        counters = session.counters
        values = {key.replace('_', ' '): value for key, value in asdict(counters).items()}
        age = session.frame_age(now)
        values['age of last frame (s)'] = age if math.isfinite(age) else 'never'
        values |= {
            'reconnects': max(0, port.opens - 1),
            'sent': port.sent,
            'dropped': port.dropped,
            **self.link.transport_counts(),
            'refused requests': self.refused,
            'last refusal': self.refusal or 'none',
            'longest wait for the middleware (s)': round(self.outbox.longest_wait, 3),
            'not published': self.outbox.lost,
        }
        return Status(level, message, values)

    # Lifecycle. Every way out of active leaves the device safe first.

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Check that session and transport can be made from the parameters."""
        del state

        def configure() -> None:
            self.make_session()
            self.make_transport()
            if not self.starting:
                self._rest()

        return self._transition(configure, 'configure')

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Open the port, and keep it open."""

        def activate() -> None:
            self.session = self.make_session()
            self.active = True
            self.link.activate(self.make_transport(), self.session)

        result = self._transition(activate, 'activate')
        if result != TransitionCallbackReturn.SUCCESS:
            self.active = False
            self._forget_session()
            return result
        return super().on_activate(state)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Leave the device safe, close the port, demand a stop."""

        def deactivate() -> None:
            self._leave_active()
            self._rest()

        result = self._transition(deactivate, 'deactivate')
        super().on_deactivate(state)
        return result

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Close what an inactive node may have open."""
        del state
        return self._transition(self._leave_active, 'clean up')

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """Leave the device safe."""
        del state
        return self._transition(self._leave_active, 'shut down')

    def on_error(self, state: Any) -> TransitionCallbackReturn:
        """Leave the device safe."""
        del state
        return self._transition(self._leave_active, 'recover')

    def _rest(self) -> None:
        resting = self.make_resting_session()
        if resting is not None:
            self.link.activate(self.make_transport(), resting)

    def _leave_active(self) -> None:
        try:
            self.link.deactivate()
        finally:
            self.active = False
            self._forget_session()

    def _forget_session(self) -> None:
        def forget(now: float) -> None:
            del now
            self.session = None

        try:
            self.link.call(forget)  # there, as the link thread may be just asking the session
        except TransportError:
            self.session = None

    def shut_down(self) -> None:
        """Leave the device safe, say so, end the thread."""
        try:
            self._leave_active()
        except TransportError as error:
            self.get_logger().error(f'no farewell: {error}')
        self.link.stop()
        self._tell(time.monotonic(), True)
        self.outbox.close(_LAST_WORDS_TIME)

    def destroy_node(self) -> None:
        """End the threads before what they publish on goes away."""
        self.link.stop()
        self.outbox.close(_LAST_WORDS_TIME)
        super().destroy_node()


class OutboxPublisher:
    """A publisher of a node whose messages go out by its outbox."""

    def __init__(self, publisher: Any, outbox: Outbox) -> None:
        self._publisher = publisher
        self._outbox = outbox

    def publish(self, message: Any) -> None:
        """Have it published soon."""
        self._outbox.post(self._publisher.publish, message)


def _plain(value: Any) -> Any:
    """Return an array parameter, which rclpy keeps in several types, as a list; so for ``[]``."""
    if value is None:  # what an empty list and nothing at all are to the YAML parser of ROS
        return []
    return value if isinstance(value, bool | int | float | str) else list(value)


def _is_ros_parameter(name: str) -> bool:
    return name in _ROS_PARAMETERS or name.startswith('qos_overrides.')


def _descriptor(parameter: Parameter) -> Any:
    """Return the ROS description; the ranges there are inclusive, ours are checked besides."""
    descriptor = ParameterDescriptor(
        name=parameter.name,
        description=parameter.description,
        additional_constraints=parameter.allowed,
        dynamic_typing=isinstance(parameter.default, list),  # an empty list has no type in ROS
    )
    low, high = parameter.minimum, parameter.maximum
    if low is not None and high is not None:
        if type(parameter.default) is float:
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif type(parameter.default) is int:
            descriptor.integer_range = [
                IntegerRange(from_value=int(low), to_value=int(high), step=1)
            ]
    return descriptor
