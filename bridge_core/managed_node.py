# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A lifecycle node with checked parameters: the base of the bridges and of the mux."""

from collections.abc import Callable, Sequence
import functools
from pathlib import Path
import traceback
from typing import Any, ClassVar

from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from bridge_core.lane import ASKED_LIMIT, Lane, waited
from bridge_core.parameter_files import check_sections
from bridge_core.parameters import (
    is_ros_parameter,
    MANAGED_PARAMETERS,
    Parameter,
    ParameterError,
    resolve,
)
from bridge_core.rclpy_inner import given_parameters, wrap_change_state, wrap_transitions
from bridge_core.reasons import Coded
from bridge_core.transports import TransportError
from bridge_core.watchdog import FROZEN

_REPORT_PERIOD = 1.0  # s, between two lines on messages that failed
_ACTIVATE = ('activate', Transition.TRANSITION_ACTIVATE)


def latched_qos(deadline: float | None = None) -> QoSProfile:
    """Return the QoS of a state: reliable, transient local, depth 1, and a deadline in seconds."""
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    if deadline is not None:
        qos.deadline = Duration(seconds=deadline)
    return qos


class Quiet:
    """
    A node's first base: publishers and subscriptions without rclpy's default event handlers.

    Each is one more thing that the executor waits for, at each wake-up, and all they do is log
    that a QoS does not match; what matters of that is in diagnostics.
    """

    def create_publisher(self, *args: Any, **options: Any) -> Any:
        """Create a publisher, without event handlers unless some are given."""
        quiet = {'event_callbacks': PublisherEventCallbacks(use_default_callbacks=False)}
        return super().create_publisher(*args, **{**quiet, **options})  # type: ignore[misc]

    def create_subscription(self, *args: Any, **options: Any) -> Any:
        """Create a subscription, without event handlers unless some are given."""
        quiet = {'event_callbacks': SubscriptionEventCallbacks(use_default_callbacks=False)}
        return super().create_subscription(*args, **{**quiet, **options})  # type: ignore[misc]


class ManagedNode(Quiet, LifecycleNode):
    """
    A lifecycle node with checked parameters.

    ``lane`` is for what a stop needs; who subscribes there starts it. All else is the executor's.

    :param parameter_files: those on the command line.
    :raises ParameterError: at construction, before anything is opened.
    """

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = MANAGED_PARAMETERS

    def __init__(self, name: str, *, parameter_files: Sequence[Path] = (), **options: Any) -> None:
        super().__init__(name, **options)
        self.own_name = name  # before __node:= has changed it
        self.active = False
        self.starting = False  # configured to be activated at once
        self._failure: Exception | None = None  # of the last transition
        self._fault: Exception | None = None  # of ours, in a transition
        wrap_transitions(self, self._telling)
        try:
            check_sections(self.get_fully_qualified_name(), parameter_files)
            self.values: dict[str, Any] = self._declare()
        except BaseException as error:
            if isinstance(error, ParameterError):
                error.node = self.get_fully_qualified_name()
            super().destroy_node()
            raise
        self.add_on_set_parameters_callback(self._on_set_parameters)
        wrap_change_state(self, lambda callback: self._checked(self._young(callback)))
        self.lane = Lane(self, f'{name} lane')

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[..., Any], *args: Any, **options: Any
    ) -> Any:
        """Create one, also of rclpy's own, that survives what its callback raises."""

        @functools.wraps(callback)  # rclpy looks at its parameters
        def survive(*message: Any) -> None:
            try:
                callback(*message)
            except Exception:
                text = f'{topic}: {traceback.format_exc()}'
                self.get_logger().error(text, throttle_duration_sec=_REPORT_PERIOD)

        return super().create_subscription(kind, topic, survive, *args, **options)

    def destroy_node(self) -> None:
        """End the lane, then the node."""
        self.lane.stop()
        super().destroy_node()

    def create_service(
        self, kind: type, name: str, callback: Callable[..., Any], **options: Any
    ) -> Any:
        """Create a service; what rclpy's own cannot read, such as a type of a parameter, fails."""
        if kind in (SetParameters, SetParametersAtomically):
            callback = self._checked(callback)
        return super().create_service(kind, name, callback, **options)

    def _checked(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Have what is asked of rclpy, and cannot be, be refused: it would end the process."""

        def checked(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except (RuntimeError, ValueError) as error:  # rcl's own error is a RuntimeError
                self.get_logger().warning(f'refused: {error}')
                return response

        return checked

    def waited(self) -> float:
        """Return the s that the request whose callback this is has waited for the executor."""
        received = getattr(self.executor, 'received_timestamp', 0)  # rclpy's own tells none
        return waited({'received_timestamp': received})

    def _young(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Have an activation that has waited be refused: it may release what a device holds."""

        def young(request: Any, response: Any) -> Any:
            wanted = request.transition.label or request.transition.id
            if wanted in _ACTIVATE and self.waited() > ASKED_LIMIT:
                self.get_logger().warning(f'refused activate: {FROZEN}')
                return response
            return callback(request, response)

        return young

    def unheard_publisher(self, topic: str) -> Coded | None:
        """Name who promises less than a stop needs there, so that nothing of it is ever heard."""
        for endpoint in self.get_publishers_info_by_topic(topic):
            if endpoint.topic_type != 'std_msgs/msg/Bool':
                text = f'{endpoint.node_name} publishes {endpoint.topic_type} on {topic}, not Bool'
                return Coded('input.wrong_type', text, topic=topic)
            if endpoint.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
                text = f'{endpoint.node_name} publishes {topic} best effort: make it reliable'
                return Coded('input.best_effort', text, topic=topic)
        return None

    @property
    def actuates(self) -> bool:
        """Whether it moves something: such a node is the first to leave."""
        return False

    def parameters_in_use(self) -> list[Parameter]:
        """Return the table, with the parameters of the names in its lists."""
        return list(self._table.values())

    def parameter_table(self, given: dict[str, Any]) -> tuple[Parameter, ...]:
        """Return all parameters; a node whose lists name further ones extends this."""
        del given
        return self.PARAMETERS

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse values that contradict each other. :raises ParameterError: naming both."""

    # Lifecycle: however the active state ends, a node leaves it by ``leave``.

    def leave(self) -> None:
        """Leave the device safe, and act no more; may be repeated."""
        self.active = False

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Leave."""
        result = self._transition(self.leave, 'deactivate')
        super().on_deactivate(state)
        return result

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """Leave."""
        del state
        return self._transition(self.leave, 'shut down')

    def on_error(self, state: Any) -> TransitionCallbackReturn:
        """Leave."""
        del state
        return self._transition(self.leave, 'recover')

    def shut_down(self) -> None:
        """Leave for good; called once a signal came, and before the node is destroyed."""
        self.leave()

    def autostart(self) -> None:
        """
        Configure and activate, unless the parameter leaves that to somebody else.

        :raises ParameterError: what the parameters ask for cannot be made; it was logged.
        :raises TransportError: the wire did not answer, on a computer that is too busy.
        :raises Exception: a fault of this software.
        """
        if not self.values['autostart']:
            return
        self.starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                self._raise_fault()
                if isinstance(self._failure, TransportError):
                    raise TransportError(f'give the computer less work: {self._failure}')
                why = f': {self._failure}' if self._failure else ' with these parameters'
                raise ParameterError(f'{self.get_name()} cannot start{why}')
        self.starting = False

    def _telling(self, callback: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """Have a fault in a transition end the executor, once it has answered; rclpy hides it."""

        def telling(state: Any) -> Any:
            try:
                return callback(state)
            except Exception as error:
                self._fault = self._fault or error
                if self.executor is not None:
                    self.executor.create_task(self._raise_fault)
                raise

        return telling

    def _raise_fault(self) -> None:
        if self._fault is not None:
            raise self._fault

    def _declare(self) -> dict[str, Any]:
        # rclpy cannot declare an empty list by itself: None, to the YAML parser of ROS.
        given = {
            name: [] if value is None else _plain(value)
            for name, value in given_parameters(self).items()
            if not is_ros_parameter(name)
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
        except (ValueError, TransportError, TimeoutError) as error:
            self._failure = error
            self.get_logger().error(f'cannot {what}: {error}')
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS


def _plain(value: Any) -> Any:
    """Return an array parameter, which rclpy keeps in several types, as a list."""
    is_one = value is None or isinstance(value, bool | int | float | str)
    return value if is_one else list(value)


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
