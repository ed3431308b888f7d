# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What tests of the Akron node share: it as a process, with simulated units on a real CAN bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import contextlib
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from rugged_teleop.canbuses import CanBusDevice, frames
from stage.can_rig import CanBus
from stage.devices import Exchangeable
from stage.node_bench import BridgeBench
from stage.rig import latched, NodeProcess, Observer

NAME = 'akron_can_bridge'
START_LIMIT = 60.0  # a process may take long to start
NEUTRAL = bytes.fromhex('0100010000000000')
MOVE = Joy(axes=[-0.5, 0.0])  # 50 % right
RIGHT = bytes.fromhex('107D010000000000')  # by hand from the manual's example


class Station(Exchangeable, CanBusDevice):
    """A simulator on the bus, which all others take for the one that it was exchanged for."""

    def __init__(self, simulator: Any, bus: CanBus) -> None:
        super().__init__(simulator, bus.channel, interface=bus.interface)

    def look(self, key: str) -> Any:
        """Return something of what can be seen of it."""
        return self.describe()[key]

    def joystick_frames(self, source: int) -> list[bytes]:
        """Return the data of what it heard of a joystick."""
        identifier = 0x0CFDD600 | source
        return [f.data for f in frames(self.received()) if f.identifier == identifier]


class Bench(BridgeBench):
    """A node and what it publishes; ``drive`` keeps its inputs coming."""

    def __init__(self, observer: Observer, node: NodeProcess, namespace: str = '') -> None:
        super().__init__(observer, node, f'{namespace}/{NAME}')
        self.joint_states = self.record(JointState, 'joint_states')
        self.joy = self.record(Joy, 'joy')
        self.limits = self.record(DiagnosticStatus, 'limits', latched())
        self.outputs = self.record(DiagnosticStatus, 'outputs', latched())
        self.device = self.record(DiagnosticStatus, 'device', latched())
        self._cmd_joy: Any = None
        self._estop_in: Any = None
        self.commanding = True
        self._at = 0.0
        self.asked = Joy(axes=[0.0, 0.0])
        self.stop = False

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
            self.wait(lambda record=record: record.last is not None, record.topic)
        return self

    def _publisher(self, kind: Any, name: str) -> Any:
        publisher = self.observer.node.create_publisher(kind, f'{self.name}/{name}', 10)
        self.wait(publisher.get_subscription_count, 'a subscriber', START_LIMIT)
        return publisher

    def wait(self, condition: Any, what: str = 'it', timeout: float = 20.0) -> Any:
        """Wait, and let command and e-stop input come at 50 Hz meanwhile."""

        def check() -> Any:
            self._feed()
            return condition()

        return super().wait(check, what, timeout)

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

    def call(self, service: str) -> Any:
        return self.observer.call(Trigger, f'{self.name}/{service}', timeout=20.0)

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
