# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the trial itself commands: servos and monitors, which no mux gates."""

from __future__ import annotations

from typing import Any

from sensor_msgs.msg import JointState, Joy

from bridge_core import clock
from rugged_teleop.commission.history import History
from rugged_teleop.commission.machine import Machine
from rugged_teleop.commission.step import Command

_HELD_UP = 1.0  # s after which a command is an old one


class Mover:
    """
    Commands one actuator at a time, and is no publisher of its topic otherwise.

    :param node: a ROS node. :param history: where 'told NODE' is kept.
    """

    def __init__(self, node: Any, machine: Machine, history: History) -> None:
        self._ros, self._history = node, history
        self._nodes = {each.full: each for each in machine.bridges}
        self._command = Command('')
        self._publisher: Any = None
        self._looked_at = 0.0

    def command(self, command: Command | None) -> bool:
        """Command an actuator; None: be nobody who does. False: somebody else commands it."""
        if command is None or command.node != self._command.node:
            if self._publisher is not None:
                self._ros.destroy_publisher(self._publisher)
            self._publisher, self._command = None, Command('')
        if command is None:
            return True
        trial = self._nodes[command.node].trial
        topic = f'{command.node}/{trial.command}'
        if self._publisher is None:
            kind = Joy if trial.field == 'axes' else JointState
            self._publisher = self._ros.create_publisher(kind, topic, 10)
        if self._ros.count_publishers(topic) > 1:
            self.command(None)
            return False
        self._command, self._looked_at = command, clock.now()
        return True

    def publish(self) -> None:
        """Say again what is commanded, once somebody listens, unless this was held up."""
        now = clock.now()
        if now > self._looked_at + _HELD_UP:
            self.command(None)
        self._looked_at = now
        shares = self._command.shares
        if not shares or not self._publisher.get_subscription_count():
            return
        node = self._nodes[self._command.node]
        trial = node.trial
        values = trial.field_of(shares)
        if trial.field == 'axes':
            self._publisher.publish(Joy(axes=values))
        else:
            self._publisher.publish(JointState(name=node.joints, position=values))
        self._history.add(f'told {node.full}', now, shares)
