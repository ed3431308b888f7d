# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ROS side of a trial: what is published to a node, and what is known of it."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import GetParameters
from rclpy.duration import Duration
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool

from bridge_core import clock
from bridge_core.managed_node import latched_qos
from rugged_teleop.asker import Visitor
from rugged_teleop.bench.course import Course, Facts, Order, Phase
from rugged_teleop.bench.targets import TARGETS

_KINDS = {'axes': Joy}  # by the field of the command; of all others JointState
_PERIODS = 3  # that command_timeout has to be long
_ACKNOWLEDGE_LIMIT = 0.2  # s
SILENCE_LIMIT = 0.5  # s; its e-stop comes at 5 Hz or more
_ASK_PERIOD = 1.0  # s; a node that has not discovered who asks first drops its response


def _number(value: float | None) -> float | None:
    return None if value is None or math.isnan(value) else value


class Commander(Visitor):
    """
    Commands another node.

    ``refusal`` says why that cannot do what is asked; empty until its parameters are known.

    :param option: a key of TARGETS. :param node: its full name. :param rate: Hz.
    :param beside: see Visitor.
    """

    def __init__(
        self, option: str, node: str, joint: str, rate: float, beside: Visitor | None = None
    ) -> None:
        super().__init__('bench', beside=beside)
        self.refusal = ''
        self._option, self._target = option, TARGETS[option]
        self._node_name, self._joint, self._rate = node, joint, rate
        self._joints: list[str] = []
        self._estop: bool | None = None
        self._estop_at = 0.0
        self._stopped = False  # since facts were asked for
        # Who does not say that it is enabled is taken to be what it was told.
        self._enabled: bool | None = None if self._target.trial.is_measured else False
        self._measured: float | None = None
        self._speed: float | None = None
        self._measured_at = -math.inf
        self._reason = ''  # empty where nothing is wrong as far as was told
        self.summary = ''  # of the device's diagnostic
        self._due = clock.now()
        kind = _KINDS.get(self._target.trial.field, JointState)
        inputs = {f'{node}/estop_in': Bool, f'{node}/{self._target.trial.command}': kind}
        if self._target.trial.is_measured:
            inputs[f'{node}/enable'] = Bool
        self._topics = list(inputs)
        self._beside = [f'{node}/{topic}' for topic in self._target.trial.beside]
        self._publishers = [
            self.node.create_publisher(kind, topic, 10) for topic, kind in inputs.items()
        ]
        create, qos = self.node.create_subscription, latched_qos()
        qos.depth = 100  # one that came and went while we were held up, too
        create(Bool, f'{node}/estop', self._on_estop, qos)
        if self._target.trial.is_measured:
            create(Bool, f'{node}/enabled', self._on_enabled, latched_qos())
            create(JointState, f'{node}/joint_states', self._on_joints, 10)
        create(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._parameters = self.node.create_client(GetParameters, f'{node}/get_parameters')
        self._ask_at = 0.0  # for its parameters, until it has answered

    def facts(self) -> Facts:
        """Return what is known by now."""
        ours = self._topics
        counts = {topic: self.node.count_publishers(topic) for topic in (*ours, *self._beside)}
        listeners = [publisher.get_subscription_count() for publisher in self._publishers]
        now = clock.now()
        silent = self._estop is not None and now - self._estop_at > SILENCE_LIMIT
        measures = now - self._measured_at <= SILENCE_LIMIT
        estop, self._stopped = self._stopped or silent or self._estop, False
        reason = 'its e-stop fell silent' if silent else self._reason or 'see /diagnostics'
        return Facts(
            listens=all(listeners) and bool(self._joints),
            others=tuple(topic for topic, count in counts.items() if count > (topic in ours)),
            estop=estop,
            enabled=self._enabled,
            measured=self._measured if measures else None,
            speed=self._speed if measures else None,
            reason=reason,
        )

    def publish(self, order: Order) -> None:
        """Publish, stops first."""
        estop, command, *enable = self._publishers
        estop.publish(Bool(data=order.estop))
        for publisher in enable:
            publisher.publish(Bool(data=order.enable))
        message = self._target.message(order, self._joints, self._joint)
        if message is not None:
            command.publish(message)
        if not self._target.trial.is_measured:
            self._enabled = order.enable

    def spin(self) -> None:
        """Take in what comes, until it is time to publish again."""
        if clock.now() >= self._ask_at and self._parameters.service_is_ready():
            self._ask_at = clock.now() + _ASK_PERIOD
            request = GetParameters.Request(names=self._target.parameters)
            self._parameters.call_async(request).add_done_callback(self._on_parameters)
        period = 1.0 / self._rate
        self._due = max(self._due + period, clock.now())
        self.spin_until(self._due, period / 4)

    def _on_estop(self, message: Any) -> None:
        self._estop, self._estop_at = message.data, clock.now()
        self._stopped |= message.data

    def _on_enabled(self, message: Any) -> None:
        self._enabled = message.data

    def _on_joints(self, message: Any) -> None:
        self._measured_at = clock.now()
        self._measured, self._speed = (
            _number(dict(zip(message.name, values, strict=False)).get(self._joint))
            for values in (getattr(message, self._target.trial.field), message.velocity)
        )

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            if status.name == f'{self._node_name.lstrip("/")}: device':
                why = {value.key: value.value for value in status.values}
                is_ok = status.level == DiagnosticStatus.OK
                self._reason = why.get('disabled because') or ('' if is_ok else status.message)
                self.summary = status.message

    def _on_parameters(self, answer: Any) -> None:
        self._ask_at = math.inf
        values = answer.result().values
        if not values:  # a node answers nothing where it does not have all of them
            wanted = ', '.join(self._target.parameters)
            self.refusal = f'--{self._option} is for a node with {wanted}, and this one is another'
            return
        joints, timeout, *mode = values
        names = list(joints.string_array_value)
        modes = [word for each in mode for word in each.string_array_value]
        limit = timeout.double_value
        if self._joint not in names:
            self.refusal = f'there is no joint {self._joint!r}, but {", ".join(names)}'
        elif modes and (modes * len(names))[names.index(self._joint)] != self._target.trial.mode:
            self.refusal = (
                f'--{self._option} is for the mode {self._target.trial.mode}; mode is {modes}'
            )
        elif self._rate * limit < _PERIODS:
            self.refusal = (
                f'--rate has to be {_PERIODS / limit:g} Hz or more: command_timeout is {limit:g} s'
            )
        else:
            self._joints = names

    def __exit__(self, *error: object) -> None:
        if any(error) and self._joints:
            self.publish(Order(estop=True))
        for publisher in self._publishers:
            publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGE_LIMIT))
        super().__exit__()


def follow(course: Course, commander: Any, on_step: Callable[[], None]) -> None:
    """Follow the course to its end. :param on_step: is called before each step."""
    while course.phase is not Phase.DONE:
        on_step()
        now = clock.now()
        if commander.refusal:
            course.interrupt(commander.refusal, now)
        order = course.step(commander.facts(), now)
        if order is not None and (order.estop or not course.is_held_up(clock.now())):
            commander.publish(order)
        commander.spin()
