"""The ROS side of a trial: what is published to a drive's node, and what is known of it."""

from __future__ import annotations

from types import TracebackType
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from bridge_core import clock
from bridge_core.managed_node import latched_qos
from bridge_core.runner import avoid_shared_memory
from rugged_teleop.bench.course import Facts
from rugged_teleop.bench.course import Order

_PARAMETERS = ('joint_names', 'mode', 'command_timeout')
_MODE = {'velocity': 'velocity', 'effort': 'torque'}  # by the field of ~/command
_OPTION = {'velocity': '--speed', 'effort': '--effort'}
_PERIODS = 3  # that command_timeout has to be long
_ACKNOWLEDGE_LIMIT = 0.2  # s


class Commander:
    """
    A node that commands a drive's; use it as a context manager.

    ``refusal`` says why the drive cannot do what is asked; empty until its parameters are known.

    :param node: the drive's full name. :param field: of ~/command, velocity or effort.
    :param rate: Hz.
    """

    def __init__(self, node: str, joint: str, field: str, rate: float) -> None:
        avoid_shared_memory()
        self.refusal = ''
        self._node_name, self._joint, self._field, self._rate = node, joint, field, rate
        self._joints: list[str] = []
        self._estop: bool | None = None
        self._enabled: bool | None = None
        self._measured: float | None = None
        self._reason = ''
        self._due = clock.now()
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node('bench', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._topics = [f'{node}/{name}' for name in ('command', 'enable', 'estop_in')]
        kinds = (JointState, Bool, Bool)
        self._publishers = [
            self._node.create_publisher(kind, topic, 10)
            for kind, topic in zip(kinds, self._topics, strict=True)
        ]
        self._listen()
        self._parameters = self._node.create_client(GetParameters, f'{node}/get_parameters')
        self._answer: Any = None

    def _listen(self) -> None:
        create, name = self._node.create_subscription, self._node_name
        create(Bool, f'{name}/estop', self._on_estop, latched_qos())
        create(Bool, f'{name}/enabled', self._on_enabled, latched_qos())
        create(JointState, f'{name}/joint_states', self._on_joints, 10)
        create(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)

    def facts(self) -> Facts:
        """Return what is known by now."""
        counts = {topic: self._node.count_publishers(topic) for topic in self._topics}
        listeners = [publisher.get_subscription_count() for publisher in self._publishers]
        return Facts(
            listens=all(listeners) and bool(self._joints),
            others=tuple(topic for topic, count in counts.items() if count > 1),
            estop=self._estop,
            enabled=self._enabled,
            measured=self._measured,
            reason=self._reason or 'see /diagnostics',
        )

    def publish(self, order: Order) -> None:
        """Publish, stops first."""
        values = [order.value if joint == self._joint else 0.0 for joint in self._joints]
        command, enable, estop = self._publishers
        estop.publish(Bool(data=order.estop))
        enable.publish(Bool(data=order.enable))
        command.publish(JointState(name=self._joints, **{self._field: values}))

    def spin(self) -> None:
        """Take in what comes, until it is time to publish again."""
        if self._answer is None and self._parameters.service_is_ready():
            self._answer = self._parameters.call_async(
                GetParameters.Request(names=list(_PARAMETERS))
            )
            self._answer.add_done_callback(self._on_parameters)
        self._due = max(self._due + 1.0 / self._rate, clock.now())
        while (left := self._due - clock.now()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def _on_estop(self, message: Any) -> None:
        self._estop = message.data

    def _on_enabled(self, message: Any) -> None:
        self._enabled = message.data

    def _on_joints(self, message: Any) -> None:
        measured = dict(zip(message.name, getattr(message, self._field), strict=False))
        self._measured = measured.get(self._joint)

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            if status.name == f'{self._node_name.lstrip("/")}: device':
                why = {value.key: value.value for value in status.values}
                self._reason = why.get('disabled because') or status.message

    def _on_parameters(self, answer: Any) -> None:
        joints, mode, timeout = answer.result().values
        names, modes = list(joints.string_array_value), list(mode.string_array_value)
        limit = timeout.double_value
        if self._joint not in names:
            self.refusal = f'there is no joint {self._joint!r}, but {", ".join(names)}'
        elif (modes * len(names))[names.index(self._joint)] != _MODE[self._field]:
            asked = _OPTION[self._field]
            self.refusal = f'{asked} is for the mode {_MODE[self._field]}; mode is {modes}'
        elif self._rate * limit < _PERIODS:
            self.refusal = (
                f'--rate has to be {_PERIODS / limit:g} Hz or more: command_timeout is {limit:g} s'
            )
        else:
            self._joints = names

    def __enter__(self) -> Commander:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None and self._joints:
            self.publish(Order(estop=True))
        for publisher in self._publishers:
            publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGE_LIMIT))
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
