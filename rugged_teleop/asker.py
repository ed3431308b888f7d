# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ROS side of commands: a node for a while, and what asks one service or topic of another."""

from __future__ import annotations

import math
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from bridge_core import clock
from bridge_core.managed_node import latched_qos, Quiet
from bridge_core.runner import avoid_shared_memory

_STEP = 0.05  # s
_MEET_TIME = 0.5  # s in which a node gets to know who asks
_ASK_PERIOD = 1.0  # s
_VisitorT = TypeVar('_VisitorT', bound='Visitor')


class _QuietNode(Quiet, Node):
    pass


class Visitor:
    """
    A node for a while, in a context of its own, with no parameters and no log; a context manager.

    :param name: of the node; one that begins with an underscore is hidden from lists.
    :param beside: another one, whose context it shares: when either spins, both hear.
    """

    def __init__(self, name: str, beside: Visitor | None = None) -> None:
        self._is_alone = beside is None
        if beside is None:
            avoid_shared_memory()
            self._context = Context()
            no_signals = SignalHandlerOptions.NO  # they end it as any other command
            rclpy.init(args=[], context=self._context, signal_handler_options=no_signals)
            self._executor = SingleThreadedExecutor(context=self._context)
        else:
            self._context, self._executor = beside._context, beside._executor
        options: dict[str, Any] = {'start_parameter_services': False, 'enable_rosout': False}
        self.node = _QuietNode(name, context=self._context, use_global_arguments=False, **options)
        self._executor.add_node(self.node)

    def spin_once(self, seconds: float) -> None:
        """Process one message or response; wait for it for so long at most."""
        self._executor.spin_once(timeout_sec=seconds)

    def spin_for(self, seconds: float) -> None:
        """Process what comes for so long."""
        self.spin_until(clock.now() + seconds, min(seconds, _STEP))

    def spin_until(self, end: float, step: float) -> None:
        """Process what comes until then, once at least. :param step: s that it may end late."""
        while True:  # one step for all: with another one rclpy gathers all topics anew
            self.spin_once(step)
            if clock.now() >= end:
                return

    def __enter__(self: _VisitorT) -> _VisitorT:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.remove_node(self.node)
        self.node.destroy_node()
        if self._is_alone:
            self._executor.shutdown()
            self._context.try_shutdown()


class Asker(Visitor):
    """
    Asks another node.

    :param node: its full name. :param name: of its service or topic.
    :param wait: seconds, for all of it.
    """

    def __init__(self, node: str, name: str, wait: float) -> None:
        super().__init__(f'_rugged_teleop_{name}')
        self._full, self._name = f'{node}/{name}', name
        self._wait = wait
        self._end = clock.now() + wait

    def hear_status(self) -> dict[str, str] | None:
        """Return the values of the next ~/status; None if none comes."""
        heard: list[Any] = []
        self.node.create_subscription(DiagnosticStatus, self._full, heard.append, latched_qos())
        while not heard and clock.now() < self._end:
            self.spin_once(_STEP)
        return {pair.key: pair.value for pair in heard[0].values} if heard else None

    def ask(self, *, repeats: bool) -> tuple[bool, str]:
        """
        Call the service; return whether it was done, and the answer; empty: it is not there.

        :param repeats: call it again while no answer comes, and at once: the answer to a call that
            comes before the node knows us is lost.
        """
        client = self.node.create_client(Trigger, self._full)
        calls: list[Any] = []
        due: float | None = None  # none while the service is not there
        while (now := clock.now()) < self._end:
            if not client.service_is_ready():
                due = None
            elif due is None:
                due = now if repeats else now + _MEET_TIME
            elif now >= due:
                calls.append(client.call_async(Trigger.Request()))
                due = now + _ASK_PERIOD if repeats else math.inf
            self.spin_once(_STEP)
            for reply in (call.result() for call in calls if call.done()):
                return reply.success, reply.message
        return False, f'{self._full} was asked, and has not answered' if calls else ''

    def absence(self) -> str:
        """Say that nothing of the kind is there, and where there is."""
        found = self.node.get_topic_names_and_types() + self.node.get_service_names_and_types()
        kinds = ('diagnostic_msgs/msg/DiagnosticStatus', 'std_srvs/srv/Trigger')
        nodes = sorted(
            name.removesuffix(f'/{self._name}')
            for name, types in found
            if name.endswith(f'/{self._name}') and name != self._full and types[0] in kinds
        )
        hint = 'is its node running, in this ROS_DOMAIN_ID?'
        if nodes:
            hint = f'there is {", ".join(nodes)}, see --node'
        return f'nothing answers at {self._full} within {self._wait:g} s; {hint}'
