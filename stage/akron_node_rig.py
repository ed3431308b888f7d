# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What tests of the Akron node share: it as a process, with simulated units on a real CAN bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import contextlib
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from rugged_teleop.canbuses import CanBusDevice, frames
from stage.can_rig import CanBus
from stage.rig import latched, NodeProcess, Observer, Record
from stage.talkers import values_of

NAME = 'akron_can_bridge'
START_LIMIT = 60.0  # a process may take long to start
NEUTRAL = bytes.fromhex('0100010000000000')
MOVE = Joy(axes=[-0.5, 0.0])  # 50 % right
RIGHT = bytes.fromhex('107D010000000000')  # by hand from the manual's example


class Place:
    """A place on the bus, where a device can be exchanged: all others take it for that device."""

    def __init__(self, simulator: Any) -> None:
        self.simulator = simulator

    def __getattr__(self, name: str) -> Any:
        return getattr(self.simulator, name)


class Station(CanBusDevice):
    """A simulator on the bus."""

    def __init__(self, simulator: Any, bus: CanBus) -> None:
        self._place: Any = Place(simulator)
        super().__init__(self._place, bus.channel, interface=bus.interface)

    def exchange(self, simulator: Any) -> None:
        """Put another device into its place, with nothing on record."""
        self.call(lambda device, now: setattr(self._place, 'simulator', simulator))
        self.since = time.monotonic()

    def steer(self, *lines: str) -> float:
        """Steer the simulator; return the moment."""
        return [self.apply(line) for line in lines][-1]

    def look(self, key: str) -> Any:
        """Return something of what can be seen of it."""
        return self.describe()[key]

    since = 0.0

    def joystick_frames(self, source: int) -> list[bytes]:
        """Return the data of what it heard of a joystick."""
        identifier = 0x0CFDD600 | source
        return [f.data for f in frames(self.received(self.since)) if f.identifier == identifier]


class Bench:
    """A node and what it publishes; ``drive`` keeps its inputs coming."""

    def __init__(self, observer: Observer, node: NodeProcess, namespace: str = '') -> None:
        self.observer, self.node = observer, node
        self.prefix = f'{namespace}/{NAME}'
        self.estop = self._record(Bool, 'estop', latched())
        self.joint_states = self._record(JointState, 'joint_states')
        self.joy = self._record(Joy, 'joy')
        self.limits = self._record(DiagnosticStatus, 'limits', latched())
        self.outputs = self._record(DiagnosticStatus, 'outputs', latched())
        self.device = self._record(DiagnosticStatus, 'device', latched())
        self.diagnostics = observer.record(DiagnosticArray, '/diagnostics')
        self._cmd_joy: Any = None
        self._estop_in: Any = None
        self.commanding = True
        self._at = 0.0
        self.asked = Joy(axes=[0.0, 0.0])
        self.stop = False

    def _record(self, kind: Any, name: str, qos: Any = 10) -> Record:
        return self.observer.record(kind, f'{self.prefix}/{name}', qos)

    def connect(self) -> Bench:
        """Wait for topics and unit, with the stick at rest."""
        if self._estop_in is None:
            self._estop_in = self._publisher(Bool, 'estop_in')
            self._cmd_joy = self._publisher(Joy, 'cmd_joy')
        self.commanding, self.stop = True, False
        self.asked = Joy(axes=[0.0, 0.0])
        self.joint_states.clear()
        self.diagnostics.clear()
        self.wait(lambda: self.joint_states.last is not None, 'positions')
        self.wait_stop(False)
        for record in (self.limits, self.outputs):
            self.wait(lambda record=record: record.last is not None, record.topic)  # type: ignore[misc]
        return self

    def _publisher(self, kind: Any, name: str) -> Any:
        publisher = self.observer.node.create_publisher(kind, f'{self.prefix}/{name}', 10)
        self.wait(publisher.get_subscription_count, 'a subscriber', START_LIMIT)
        return publisher

    def wait(self, condition: Callable[[], Any], what: str = 'it', limit: float = 20.0) -> None:
        """Wait, and let command and e-stop input come at 50 Hz meanwhile."""

        def check() -> Any:
            self._feed()
            return condition()

        self.observer.wait_for(check, limit, lambda: f'{what}\n{self.node.output}')

    def wait_stop(self, stop: bool) -> None:
        self.wait(lambda: self.estop.last == Bool(data=stop), f'estop {stop}')

    def drive(
        self,
        station: Station,
        joy: Joy = MOVE,
        until: Callable[[], Any] = lambda: True,
    ) -> None:
        """Move, after neutral; anew if a busy machine let the command go stale meanwhile."""

        def moving() -> Any:
            is_free = self.value('neutral because') == 'commands go out'
            self.asked = joy if is_free else Joy(axes=[0.0, 0.0])
            return is_free and station.look('moving') and until()  # it may still be from before

        self.wait(moving, 'motion')

    def stand(self) -> None:
        """Wait until the unit has reported the same position for 0.6 s."""
        self.joint_states.clear()

        def stands() -> bool:
            found = [list(message.position) for message in self.joint_states.messages[-7:]]
            return len(found) == 7 and all(position == found[0] for position in found)

        self.wait(stands, 'rest')

    def status(self, part: str = 'device') -> Any:
        """Return the newest diagnostic of ours."""
        name = f'{self.prefix.lstrip("/")}: {part}'
        for array in reversed(self.diagnostics.messages):
            for status in array.status:
                if status.name == name:
                    return status
        return DiagnosticStatus()

    def value(self, key: str, part: str = 'device') -> str:
        return values_of(self.status(part)).get(key, '')

    def call(self, service: str) -> Any:
        return self.observer.call(Trigger, f'{self.prefix}/{service}', timeout=20.0)

    def _feed(self) -> None:
        now = time.monotonic()
        if self._cmd_joy is not None and now - self._at >= 0.02:
            self._at = now
            self._estop_in.publish(Bool(data=self.stop))
            if self.commanding:
                self._cmd_joy.publish(self.asked)


@contextlib.contextmanager
def bench_of(
    observer: Observer,
    bus: CanBus,
    parameters: Mapping[str, Any] | None = None,
    *,
    namespace: str = '',
) -> Iterator[Bench]:
    """Start a node with long timeouts, as machines are busy; the session's tests have them."""
    given = {
        'interface': bus.interface,
        'channel': bus.channel,
        'command_timeout': 2.0,
        'estop_in_timeout': 2.0,
        'link_timeout': 3.0,
        'answer_timeout': 3.0,
        **(parameters or {}),
    }
    with NodeProcess('akron_can_bridge.node', given, namespace=namespace, patient=True) as node:
        yield Bench(observer, node, namespace)
