# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ROS side: what is heard of the machine, its reset, and a joint that bench moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import contextlib
from functools import partial
import json
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, String, UInt8MultiArray, UInt16MultiArray
from std_srvs.srv import Trigger

from bridge_core import clock
from bridge_core.managed_node import latched_qos
from bridge_core.parameters import names_of
from bridge_core.proof import Proof, ProofError
from bridge_core.proof_topics import PROOF_QOS
from rugged_teleop.asker import Visitor
from rugged_teleop.bench.commander import Commander, follow
from rugged_teleop.bench.course import Course, Phase
from rugged_teleop.commission.engine import Benched
from rugged_teleop.commission.folder import new_piece
from rugged_teleop.commission.history import History
from rugged_teleop.commission.looks import turned
from rugged_teleop.commission.machine import Machine
from rugged_teleop.commission.mover import Mover
from rugged_teleop.commission.step import Command
from rugged_teleop.recorder.definitions import definition_of
from rugged_teleop.recorder.folder import UNFINISHED
from rugged_teleop.recorder.ring import Channel, Heard, Ring
from rugged_teleop.recorder.writer import RecordingFile
from rugged_teleop.recordings import Said

_ANSWER_LIMIT = 3.0  # s
_LEDGER_LIMIT, _FIND_LIMIT, _STEP = 6.0, 2.0, 0.3  # s
_RATE = 50.0  # Hz, of bench
_SPEED = 2.0  # rad/s
_SECONDS = 3.0
_ONE_CLOCK = 0.5  # s; a message that is older was kept, or sent by another clock
_QUIET = 0.3  # s, in which what was said before has come
_FRESH = 2.5  # s, of diagnostics that come each second
_PLACES = {each.__name__: each for each in (JointState, UInt16MultiArray)}
_COMMANDS: dict[str, tuple[str, Any, Callable[[Mapping[str, Any], Any], dict[str, float]]]] = {
    'joints': (
        'command',
        JointState,
        lambda values, m: dict(zip(m.name, getattr(m, values['interface']), strict=False)),
    ),
    'twist': ('cmd_vel', Twist, lambda _, m: _of_twist(m)),
    'twist_stamped': ('cmd_vel', TwistStamped, lambda _, m: _of_twist(m.twist)),
}
_KEPT, _KEPT_SIZE = 120.0, 50_000_000  # s and bytes of what was heard, for the recordings


def _of_twist(twist: Twist) -> dict[str, float]:
    linear = twist.linear
    return {'linear': linear.x, 'lateral': linear.y, 'angular': twist.angular.z}


class Running(Visitor):
    """
    The machine, heard.

    :param without_mux: has a drive's node run alone for as long as it is entered.
    :param folder: for the recordings, which its report takes; None: none are kept.
    """

    def __init__(
        self,
        machine: Machine,
        without_mux: Callable[[str], contextlib.AbstractContextManager[Any]],
        folder: Path | None = None,
    ) -> None:
        super().__init__('_commission')
        self.history = History(time.time() - clock.now())
        self._machine, self._without_mux, self._folder = machine, without_mux, folder
        self.on_spin: Callable[[], None] = lambda: None
        self._ring = Ring(_KEPT, _KEPT_SIZE)
        self._at = 0.0  # when the message that is taken was sent
        values, mux = machine.values, machine.mux
        self._bool = self._subscriber(Bool, lambda message: message.data)
        joy = self._subscriber(Joy, lambda message: ([*message.axes], [*message.buttons]))
        self._hear(String, f'{mux.full}/state', latched_qos(), self._on_state)
        self._subscriber(
            DiagnosticStatus, lambda message: {each.key: each.value for each in message.values}
        )('status', f'{mux.full}/status', latched_qos())
        name, kind, read = _COMMANDS[values['output']]
        self._subscriber(kind, partial(read, values))('command', f'{mux.full}/{name}', 10)
        feedback = values['feedback.topic']
        own = [f'{each.full}/joint_states' for each in machine.drives]
        for topic in [mux.topic(feedback)] if feedback else own:
            self._hear(JointState, topic, 10, self._on_joints)
        self._enabled: dict[str, bool] = {}
        for topic in machine.enabled_topics:
            self._hear(Bool, topic, latched_qos(), partial(self._on_enabled, topic))
        for name in names_of(values, 'estop_sources'):
            qos = latched_qos()
            qos.depth = 100
            self._bool(f'estop {name}', mux.topic(values[f'estop.{name}.topic']), qos)
        for name in machine.operators:
            joy(f'joy {name}', mux.topic(values[f'operator.{name}.topic']), 10)
        self._bool('stop', f'{mux.full}/estop', latched_qos())
        if values['reset_topic']:
            self._bool('button', mux.topic(values['reset_topic']), 10)
        self._mover = Mover(self.node, machine, self.history)
        for node in machine.bridges:
            places = node.hands.places
            if places is not None:
                hear = self._subscriber(_PLACES[places.kind], partial(places.read, node.values))
                hear(f'places {node.full}', f'{node.full}/{places.topic}', 10)
            for way in ('received', 'sent'):
                self._hear_raw(f'{node.full}/raw/{way}')
            self._hear_proofs(node.full)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._reset = self.node.create_client(Trigger, f'{mux.full}/reset')

    def _subscriber(self, kind: Any, value_of: Callable[[Any], Any]) -> Any:
        def subscribe(channel: str, topic: str, qos: Any) -> None:
            def add(message: Any) -> None:
                self.history.add(channel, self._at, value_of(message))

            self._hear(kind, topic, qos, add)

        return subscribe

    def _on_state(self, message: Any) -> None:
        self.history.add('state', self._at, message.data)
        if not self._machine.enabled_topics:
            self.history.add('enabled', self._at, message.data not in ('STOPPED', 'READY'))

    def _on_enabled(self, topic: str, message: Any) -> None:
        self._enabled[topic] = message.data
        owner = self._machine.owner_of(topic)
        if owner:
            self.history.add(f'enabled {owner.full}', self._at, message.data)
        self.history.add('enabled', self._at, any(self._enabled.values()))

    def _on_joints(self, message: Any) -> None:
        for channel, values in (('joints', message.velocity), ('positions', message.position)):
            self.history.add(channel, self._at, dict(zip(message.name, values, strict=False)))

    def _hear(self, kind: Any, topic: str, qos: Any, take: Callable[[Any], None]) -> None:
        """Subscribe to a topic, once: it is recorded so often. :param qos: a depth, or more."""
        name = f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'
        latched = getattr(qos, 'durability', None) == DurabilityPolicy.TRANSIENT_LOCAL
        channel = None
        with contextlib.suppress(LookupError):  # a type without its definition is not recorded
            channel = Channel(topic, name, definition_of(name), latched)

        def on_message(data: bytes, info: Any) -> None:
            at, received = clock.now(), info['received_timestamp']
            sent = info['source_timestamp'] or received
            if channel:
                self._ring.add(Heard(at, at - (received - sent) * 1e-9, channel, data))
            waited = time.time() - sent * 1e-9  # for this process, which may be a busy one
            self._at = at - waited if 0.0 <= waited < _ONE_CLOCK else at
            take(deserialize_message(data, kind))

        self.node.create_subscription(kind, topic, on_message, qos, raw=True)

    def _hear_raw(self, topic: str) -> None:
        def add(message: Any) -> None:
            # Its labels are of this computer's clock, or it is left out; see decode.recorded.
            at = time.time()
            said = Said(at, topic, 'std_msgs/msg/UInt8MultiArray', message, at)
            self.history.add('raw', clock.now(), said)

        self._hear(UInt8MultiArray, topic, qos_profile_sensor_data, add)

    def _hear_proofs(self, node: str) -> None:
        def add(message: Any) -> None:
            with contextlib.suppress(ProofError):
                number = Proof.from_bytes(bytes(message.data)).number
                self.history.add(f'proof {node}', clock.now(), number)

        self.node.create_subscription(UInt8MultiArray, f'{node}/proof', add, PROOF_QOS)

    def _on_diagnostics(self, message: Any) -> None:
        """Keep what a bridge says of itself: of link and device in one message."""
        told: dict[str, dict[str, str]] = {}
        for status in message.status:
            values = told.setdefault('/' + status.name.partition(':')[0].lstrip('/'), {})
            values |= {'hardware_id': status.hardware_id}
            values |= {each.key: each.value for each in status.values}
        for node, values in told.items():
            self.history.add(f'device {node}', clock.now(), values)

    def pid_of(self, node: str, process: str) -> int:
        """Return the pid of a process of a node; 0: it is not known yet."""
        values = [each for _, each in self.history.since(f'device {node}', clock.now() - _FRESH)]
        said = str(values[-1].get(process, '')) if values else ''
        return int(said) if said.isdigit() else 0

    def command(self, command: Command | None) -> bool:
        """Command an actuator; None: be nobody who does. False: somebody else commands it."""
        return self._mover.command(command)

    now = staticmethod(clock.now)

    def spin(self, seconds: float) -> None:
        """Take in what comes for so long."""
        self._mover.publish()
        self.on_spin()
        self.spin_for(seconds)

    def wait_for_nodes(self, limit: float) -> None:
        """Take in what comes until every bridge says what its device is, or so long (s)."""
        end = clock.now() + limit
        names = [f'device {each.full}' for each in self._machine.bridges]
        while clock.now() < end and not all(map(self.history.heard_at, names)):
            self.spin(0.1)

    def reset(self) -> tuple[bool, str]:
        """Call the mux's reset; what it answers is heard, too."""
        if not self._reset.service_is_ready():
            return False, 'nobody offers ~/reset'
        call = self._reset.call_async(Trigger.Request())
        end = clock.now() + _ANSWER_LIMIT
        while not call.done() and clock.now() < end:
            self.spin(0.01)
        if not call.done():
            return False, 'no answer'
        reply = call.result()
        answer = bool(reply.success), str(reply.message)
        self.history.add('reset', clock.now(), answer)
        return answer

    def say(self, text: str) -> bool:
        """Say it in the log, of which recorders write a ledger; return whether one has it."""
        written: list[str] = []
        ledgers: set[str] = set()
        log = self.node.create_publisher(Log, '/rosout', latched_qos())
        said = Log(name='commission', msg=text, level=Log.INFO)
        said.stamp = self.node.get_clock().now().to_msg()
        stamp = f'"{said.stamp.sec}.{said.stamp.nanosec:09}"'
        begin = clock.now()
        log.publish(said)  # latched, for a recorder that does not know us yet
        while clock.now() < begin + (_LEDGER_LIMIT if ledgers else _FIND_LIMIT):
            topics = {topic for topic, _ in self.node.get_topic_names_and_types()}
            for topic in {each for each in topics if each.endswith('/ledger')} - ledgers:
                ledgers.add(topic)
                self.node.create_subscription(
                    String, topic, lambda line: written.append(line.data), latched_qos()
                )
            self.spin(_STEP)
            if any(stamp in line for line in written):
                return True
        return False

    def bench(self, node: str, joint: str, heed: Callable[[], object]) -> Benched:
        """Turn a joint forward at _SPEED for _SECONDS, without the mux. See ``engine.Machine``."""
        phases: dict[Phase, float] = {}
        with (
            self._without_mux(node),
            Commander('speed', node, joint, _RATE, beside=self) as commander,
        ):
            course = Course(_SPEED, _SECONDS, clock.now(), is_measured=True)

            def on_step() -> None:
                phases.setdefault(course.phase, clock.now())
                heed()

            follow(course, commander, on_step)  # as it spins, both hear
        self.spin(_QUIET)
        began = phases.get(Phase.ENABLING, clock.now())
        enabling = phases.get(Phase.MOVING, clock.now()) - began
        return Benched(course.problem, enabling, turned(self.history, joint, began))

    def keep(self, step: str, since: float) -> str:
        """Record what was heard since then, and what stood by then; return the file's name."""
        if self._folder is None:
            return ''
        name = f'{step}.mcap'
        place = new_piece(self._folder, name)
        place.with_name(place.name + UNFINISHED).unlink(missing_ok=True)  # of one that was killed
        file = RecordingFile(place)
        nodes = (self._machine.mux, *self._machine.bridges)
        try:
            file.add_parameters(
                {each.full: {n: json.dumps(v) for n, v in each.values.items()} for each in nodes}
            )
            file.add_reason(f'commissioning: {step}')
            file.write(self._ring.messages(since))
            file.finish(place)
        finally:
            file.close()
        return name
