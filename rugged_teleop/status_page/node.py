# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The status page: listens to all bridges and muxes, and serves what it heard.

It takes part in no decision. It listens best effort: no writer waits for a page that hangs.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
import math
import os
from pathlib import Path
import secrets
import sys
import time
from typing import Any, ClassVar, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from rcl_interfaces.srv import GetParameters
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger

from bridge_core import clock
from bridge_core.managed_node import latched_qos, ManagedNode
from bridge_core.parameter_files import beside
from bridge_core.parameters import full_topic, MANAGED_PARAMETERS, names_of, Parameter
from bridge_core.polled import Polled
from bridge_core.runner import run
from rugged_teleop.devices import devices
from rugged_teleop.status_page.access import Access, recordings
from rugged_teleop.status_page.graph import find, Mux
from rugged_teleop.status_page.model import Diagnostic, Model
from rugged_teleop.status_page.parameters import PARAMETERS

if TYPE_CHECKING:
    from rugged_teleop.status_page.server import Server

_PERIOD = 0.1
_LOOK_PERIOD = 1.0
_ASK_AGAIN = 3.0  # s; the first answer may be lost, for a mux that does not know us yet
_LATCHED = latched_qos()
_EVERY = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)  # each change counts
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_TWISTS = {'geometry_msgs/msg/Twist': Twist, 'geometry_msgs/msg/TwistStamped': TwistStamped}
_SERVICES = {  # of each action
    'reset': ('reset', Trigger, Trigger.Request()),
    'trip': ('trip', Trigger, Trigger.Request()),
    'select autonomy': ('select_autonomy', SetBool, SetBool.Request(data=True)),
    'deselect autonomy': ('select_autonomy', SetBool, SetBool.Request(data=False)),
}
_NO_AIOHTTP = (
    'the page needs aiohttp: pip install aiohttp, or apt install python3-aiohttp '
    '(rosdep key python3-aiohttp)'
)


class StatusPage(ManagedNode):
    """Shows what is; see docs/status_page.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*MANAGED_PARAMETERS, *PARAMETERS)

    def __init__(self, **options: Any) -> None:
        super().__init__('status_page', **options)
        self._model = Model()  # of the lane's thread
        self._known: set[str] = set()
        self._callers: dict[str, Any] = {}  # by the name of their service
        self._asked: dict[str, float] = {}  # when a mux was asked for its operators
        self._recordings: list[dict[str, Any]] = []
        self._server: Server | None = None
        self._topics = Polled(self)
        self._topics.subscribe(DiagnosticArray, '/diagnostics', self._on_diagnostics, _EVERY)
        self.lane.every(_PERIOD, self._show)
        self.lane.every(_LOOK_PERIOD, self._look_around)
        self.lane.start()

    # Lifecycle.

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Serve the page, and print its address."""
        if self._transition(self._serve, 'serve') is not TransitionCallbackReturn.SUCCESS:
            return TransitionCallbackReturn.FAILURE
        self.active = True
        return super().on_activate(state)

    def leave(self) -> None:
        """Serve no more."""
        super().leave()
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def _serve(self) -> None:
        """:raises ValueError: aiohttp is missing, or the port cannot be had."""
        try:
            from rugged_teleop.status_page.server import address_of, Server
        except ImportError as error:
            raise ValueError(_NO_AIOHTTP) from error
        values = self.values
        token = secrets.token_urlsafe(18)
        host, port, folder = values['host'], values['port'], values['recordings']
        names = names_of(values, 'names')
        access = Access(host, names, token, control=values['allow_control'])
        server = Server(
            host,
            port,
            access,
            control=self._control,
            recordings=Path(folder) if folder else None,
        )
        try:
            port = server.start()
        except OSError as error:
            why = os.strerror(error.errno) if error.errno else error
            raise ValueError(f'{host} port {port}: {why}; set host or port') from error
        self._server = server
        # On the terminal alone: logs go to files, and over the network.
        address = address_of(host, port, access.needs_token * token)
        print(f'status page: {address}', file=sys.stderr)

    # What there is.

    def _look_around(self, now: float) -> None:
        """Find what has come; listen to it."""
        topics = dict(self.get_topic_names_and_types())
        published = {name: kinds for name, kinds in topics.items() if self.count_publishers(name)}
        found = find(published, devices().values(), self.get_namespace())
        self._model.found(found)
        for name, bridge in found.bridges.items():
            if name not in self._known:
                self._listen_to_bridge(name)
            for stream in bridge.streams:
                if f'{name}/{stream}' not in self._known:
                    self._listen_to_stream(name, stream)
        for name, mux in found.muxes.items():
            if name not in self._known:
                self._listen_to_mux(name, mux)
            self._ask_operators(name, now)
            self._model.listeners(name, self._listeners(f'{name}/estop'))
        self._known |= found.bridges.keys() | found.muxes.keys()
        folder = self.values['recordings']
        self._recordings = recordings(Path(folder) if folder else None)

    def _listeners(self, topic: str) -> set[str]:
        infos = self.get_subscriptions_info_by_topic(topic)
        return {f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos}

    def _listen_to_bridge(self, name: str) -> None:
        model, subscribe = self._model, self._topics.subscribe
        subscribe(Bool, f'{name}/estop', lambda m: model.estop(name, m.data, clock.now()), _EVERY)
        # Published on change alone, so rarely that nobody waits for us.
        subscribe(
            Bool, f'{name}/link_up', lambda m: model.link_up(name, m.data, clock.now()), _LATCHED
        )

    def _listen_to_stream(self, name: str, stream: str) -> None:
        self._known.add(f'{name}/{stream}')
        kind, callback = {
            'joy': (Joy, self._on_joy),
            'joint_states': (JointState, self._on_joint_states),
        }[stream]
        self._topics.subscribe(kind, f'{name}/{stream}', partial(callback, name), _NEWEST)

    def _listen_to_mux(self, name: str, mux: Mux) -> None:
        model, subscribe = self._model, self._topics.subscribe
        subscribe(
            String, f'{name}/state', lambda m: model.state(name, m.data, clock.now()), _EVERY
        )
        subscribe(DiagnosticStatus, f'{name}/status', partial(self._on_status, name), _EVERY)
        kind = _TWISTS.get(mux.kind, JointState)
        subscribe(kind, f'{name}/{mux.command}', partial(self._on_command, name), _NEWEST)
        services = {service: kind for service, kind, _ in _SERVICES.values()}
        wanted = services if self.values['allow_control'] else {}
        for service, kind in {**wanted, 'get_parameters': GetParameters}.items():
            self._callers[f'{name}/{service}'] = self.create_client(kind, f'{name}/{service}')

    def _ask_operators(self, mux: str, now: float) -> None:
        """Ask a mux which topics its operators are heard on: once, and after each silence."""
        if self._model.is_silent(mux, now):
            self._asked.pop(mux, None)
        elif now >= self._asked.get(mux, -math.inf) + _ASK_AGAIN:
            self._asked[mux] = now

            def on_names(operators: list[str]) -> None:
                names = [name for name in operators if name]
                topics = [f'operator.{name}.topic' for name in names]
                self._ask(
                    mux, topics, lambda *found: on_topics(dict(zip(names, found, strict=False)))
                )

            def on_topics(topics: dict[str, str]) -> None:
                self._asked[mux] = math.inf
                full = {name: full_topic(mux, topic) for name, topic in topics.items()}
                self._model.operators(mux, full)

            self._ask(mux, ['operators'], on_names)

    def _ask(self, node: str, names: list[str], on_values: Callable[..., None]) -> None:
        """Have the lane call ``on_values`` with the values of these parameters."""

        def on_answer(future: Any) -> None:
            values = [parameter_value_to_python(value) for value in future.result().values]
            self.lane.post(on_values, *values)

        client = self._callers[f'{node}/get_parameters']
        if client.service_is_ready():
            client.call_async(GetParameters.Request(names=names)).add_done_callback(on_answer)

    def _on_joy(self, name: str, message: Any) -> None:
        self._model.joy(name, message.axes, message.buttons, clock.now())

    def _on_joint_states(self, name: str, message: Any) -> None:
        self._model.speeds(
            name, dict(zip(message.name, message.velocity, strict=False)), clock.now()
        )

    def _on_status(self, name: str, message: Any) -> None:
        self._model.status(name, {v.key: v.value for v in message.values}, clock.now())

    def _on_command(self, name: str, message: Any) -> None:
        self._model.command(name, _demand(message), clock.now())

    def _on_diagnostics(self, message: Any) -> None:
        now = clock.now()
        for status in message.status:
            values = {value.key: value.value for value in status.values}
            diagnostic = Diagnostic(status.level[0], status.message, values)
            self._model.diagnostic(status.name, diagnostic, now)

    # What is shown, and done.

    def _show(self, now: float) -> None:
        self._topics.look()
        snapshot = self._model.snapshot(now, time.time())
        if self._server is not None:
            self._server.publish({**snapshot, 'recordings': self._recordings})

    def _control(self, action: str, mux: str, address: str) -> Future[tuple[bool, str]]:
        """Ask the mux, and note its answer; for the server's thread."""
        result: Future[tuple[bool, str]] = Future()

        def on_answer(future: Any) -> None:
            reply = future.result()
            self.lane.post(self._note, f'{mux}: {action}, by this page', reply.message)
            self.get_logger().info(f'page: {mux}: {action}, from {address}: {reply.message}')
            if result.set_running_or_notify_cancel():  # somebody still waits
                result.set_result((reply.success, reply.message))

        service, _, request = _SERVICES[action]
        client = self._callers.get(f'{mux}/{service}')
        if client is None or not client.service_is_ready():
            result.set_result((False, f'{mux}/{service} is not there'))
        else:
            client.call_async(request).add_done_callback(on_answer)
        return result

    def _note(self, text: str, reason: str) -> None:
        self._model.note(text, reason, clock.now())


def _demand(message: Any) -> dict[str, float]:
    """Return the numbers of a command, by the names that the mux has for its joints."""
    if isinstance(message, JointState):
        return dict(zip(message.name, message.velocity or message.effort, strict=False))
    twist = message.twist if isinstance(message, TwistStamped) else message
    return {'linear': twist.linear.x, 'angular': twist.angular.z}


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([StatusPage], beside('status_page', sys.argv), last=True))


if __name__ == '__main__':
    main()
