# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
From messages to the arbiter: what the node and a replay of recorded messages both use.

Made of the parameters alone. A message is anything with the fields of its ROS type.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

from bridge_core.reasons import Coded
from safety_mux.arbiter import Arbiter
from safety_mux.button import Presses
from safety_mux.configuration import joint_limits, joy_mapping, mux_config, soft_ends
from safety_mux.limits import JointLimiter
from safety_mux.mapping import DifferentialDrive, forward_and_turn, NamedJoints, over_the_ground
from safety_mux.parameters import enabled_topic
from safety_mux.protocol import AUTONOMY, Decision, Demand, Kind, MalformedInput, State
from safety_mux.soft_ends import EndedLimiter
from safety_mux.stamps import StampWatch

Take = Callable[[Any, float], bool]


class Listened(NamedTuple):
    """
    A topic that the mux listens to.

    :param parameter: the one that names the topic. :param type: the message's, such as 'Bool'.
    :param take: gets a message and the time of its arrival; returns whether it is a stop, for
        which to decide at once.
    """

    parameter: str
    kind: Kind
    name: str
    type: str
    take: Take


class Intake:
    """
    The arbiter with all that reads messages for it.

    :param values: every parameter. :param heard: gets kind and name of an operator, or of the
        feedback, and each message that is well-formed, before a decision that it may lead to.
    :raises ParameterError: values contradict each other.
    """

    def __init__(
        self,
        values: Mapping[str, Any],
        now: float,
        heard: Callable[[Kind, str, Any], object] = lambda kind, name, message: None,
    ) -> None:
        self.config = config = mux_config(values)
        joints, ends = tuple(values['joints']), soft_ends(values)
        self.ends = EndedLimiter(JointLimiter(joint_limits(values)), ends, joints)
        self._with_ends = NamedJoints(tuple(joints[n] for n in ends)) if ends else None
        self.arbiter = Arbiter(config, self.ends, now)
        self.mappings = {each.name: joy_mapping(values, each.name) for each in config.operators}
        self.presses = {
            name: Presses(each.deadman, each.pressed_at) for name, each in self.mappings.items()
        }
        self.stamps = {
            each.name: StampWatch(
                each.timeout, required=values[f'operator.{each.name}.require_moving_stamps']
            )
            for each in config.operators
        }
        self._values = values
        self._heard = heard
        self._decision: Decision | None = None  # the last
        self._named = NamedJoints(joints)
        wheels = DifferentialDrive(
            values['autonomy.wheel_separation'], values['autonomy.wheel_radius']
        )
        flat = forward_and_turn if len(joints) == 2 else over_the_ground
        self._of_twist = wheels.demand if values['output'] == 'joints' else flat

    @property
    def old_stamps(self) -> dict[str, str]:
        """By operator, why it may be gone."""
        warnings = {name: watch.warning for name, watch in self.stamps.items()}
        return {name: why for name, why in warnings.items() if why is not None}

    @property
    def _is_stopped(self) -> bool:
        return self._decision is not None and self._decision.state is State.STOPPED

    def decide(self, now: float) -> Decision:
        """Decide, by all that was taken; see ``Arbiter.tick``."""
        was_stopped = self._is_stopped
        self._decision = self.arbiter.tick(now)
        if was_stopped and not self._is_stopped:
            self.ends.trust()
        for name, presses in self.presses.items():
            presses.decided(name == self._decision.owner)
        return self._decision

    def topics(self) -> Iterator[Listened]:
        """Yield what to listen to; of topics that have something, the first is read first."""
        config, values, arbiter = self.config, self._values, self.arbiter

        def data(record: Callable[[str, Any, float], None], name: str) -> Take:
            def take(message: Any, now: float) -> bool:
                record(name, message.data, now)
                return False

            return take

        for source in config.sources:
            name = source.name
            if source.own_topic:  # first, so that a stop finds it in place
                own = data(arbiter.own_estop_message, name)
                yield Listened(f'estop.{name}.own_topic', 'e-stop source', name, 'Bool', own)
            estop = partial(self._estop, name)
            yield Listened(f'estop.{name}.topic', 'e-stop source', name, 'Bool', estop)
        for name in config.drives:
            take = data(arbiter.drive_enabled, name)
            yield Listened(enabled_topic(name), 'drive', name, 'Bool', take)
        for name in (limit.name for limit in config.speed_limits):
            take = data(arbiter.speed_limit, name)
            yield Listened(f'speed_limit.{name}.topic', 'speed limit', name, 'Float64', take)
        if config.feedback is not None:
            yield Listened('feedback.topic', 'feedback', 'feedback', 'JointState', self._feedback)
        for operator in config.operators:
            name, joy = operator.name, partial(self._joy, operator.name)
            yield Listened(f'operator.{name}.topic', 'operator', name, 'Joy', joy)
        if config.autonomy is not None:
            kind = values['autonomy.type']
            yield Listened('autonomy.topic', 'autonomy', AUTONOMY, kind, self._autonomy)

    def _estop(self, name: str, message: Any, now: float) -> bool:
        self.arbiter.estop_message(name, message.data, now)
        return bool(message.data) and not self._is_stopped

    def _feedback(self, message: Any, now: float) -> bool:
        try:
            speeds = self._named.among(message.name, message.velocity)
            if self._with_ends is not None:
                self.ends.hear(self._with_ends.among(message.name, message.position))
        except MalformedInput as error:
            self.arbiter.malformed('feedback', 'feedback', str(error), now)
        else:
            self.arbiter.measured(speeds, now)
            self._heard('feedback', 'feedback', message)
        return False

    def _joy(self, name: str, message: Any, now: float) -> bool:
        stamp, watch = message.header.stamp, self.stamps[name]
        watch.hear_stamp((stamp.sec, stamp.nanosec), now)
        fault = watch.fault and Coded('mux.operator.same_stamp', watch.fault, operator=name)
        self.arbiter.set_invalid('operator', name, 'stamps', fault)
        try:
            sample = self.mappings[name].sample(message.axes, message.buttons)
        except MalformedInput as error:
            self.arbiter.malformed('operator', name, str(error), now)
            return False
        self.arbiter.operator_sample(name, sample, now)
        self.presses[name].hear(message.buttons, now)
        self._heard('operator', name, message)
        owner = None if self._decision is None else self._decision.owner
        return name == owner and not sample.deadman  # a released deadman is a stop too

    def _autonomy(self, message: Any, now: float) -> bool:
        try:
            demand = self._autonomy_demand(message)
        except MalformedInput as error:
            self.arbiter.malformed('autonomy', AUTONOMY, str(error), now)
        else:
            self.arbiter.autonomy_command(demand, now)
        return False

    def _autonomy_demand(self, message: Any) -> Demand:
        kind = self._values['autonomy.type']
        if kind == 'JointState':
            values = getattr(message, self._values['interface'])
            return self._named.demand(message.name, values)
        twist = message.twist if kind == 'TwistStamped' else message
        speed, turn = twist.linear, twist.angular
        return self._of_twist((speed.x, speed.y, speed.z), (turn.x, turn.y, turn.z))
