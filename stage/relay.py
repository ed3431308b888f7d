# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node that republishes another one's topics as a network would: late, or not at all."""

from __future__ import annotations

from functools import partial
import math
import sys
import threading
import time
from typing import Any

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, UInt8MultiArray

from bridge_core.managed_node import latched_qos
from bridge_core.proof_topics import PROOF_QOS
from stage.devices import DRIVE, MUX
from stage.network import NetworkProcess, obey, Way

_STOP, _PROOF = (Bool, latched_qos()), (UInt8MultiArray, PROOF_QOS)
_BRIDGE = {'estop': _STOP, 'own_estop': _STOP, 'joy': (Joy, 10), 'proof': _PROOF}
_MUX = {'estop': _STOP, 'enable': (Bool, 10), 'command': (JointState, 10), 'proof': _PROOF}
_DRIVE = {
    'estop': _STOP,
    'own_estop': _STOP,
    'enabled': _STOP,
    'joint_states': (JointState, 10),
    'proof': _PROOF,
}
BACK: dict[str, tuple[Any, Any]] = {'challenge': _PROOF}
RAW = '/raw'


def forth(node: str) -> dict[str, tuple[Any, Any]]:
    """Return what a node says: kind and QoS by topic."""
    return {MUX: _MUX, DRIVE: _DRIVE}.get(node, _BRIDGE)


def remapped(node: str) -> list[str]:
    """Return the ROS arguments by which a node speaks to the relay alone."""
    return [
        word
        for topic in (*forth(node), *BACK)
        for word in ('-r', f'/{node}/{topic}:={RAW}/{node}/{topic}')
    ]


class Relay(NetworkProcess):
    """
    The network between a node and who listens to it.

    It carries what a remote's bridge, a mux or a drive says, and challenges back to it.
    """

    def __init__(self, node: str) -> None:
        super().__init__('stage.relay', node)


class _Node(Node):
    """The node in that process."""

    def __init__(self, node: str) -> None:
        options: dict[str, Any] = {'start_parameter_services': False, 'enable_rosout': False}
        super().__init__(f'relay_{node}', **options)
        self._ways = [Way(0), Way(1)]
        self._changed = threading.Condition()
        for way, topics in zip(self._ways, (forth(node), BACK), strict=True):
            for topic, (kind, qos) in topics.items():
                names = [f'{RAW}/{node}/{topic}', f'/{node}/{topic}']
                source, target = reversed(names) if topics is BACK else names
                hear = partial(self._hear, way, self.create_publisher(kind, target, qos))
                self.create_subscription(kind, source, hear, qos, raw=True)
        for work in (self._obey, self._carry):
            threading.Thread(target=work, daemon=True).start()

    def _obey(self) -> None:
        """Take lines: a list of two networks, there and back."""
        for line in sys.stdin:
            with self._changed:
                obey(line, self._ways)
                self._changed.notify()

    def _hear(self, way: Way, publisher: Any, message: bytes) -> None:
        with self._changed:
            way.send((publisher, message), len(message), time.monotonic())
            self._changed.notify()

    def _carry(self) -> None:
        """Publish what arrives."""
        while True:
            with self._changed:
                now = time.monotonic()
                due = min(way.next_arrival() for way in self._ways)
                if due > now:
                    self._changed.wait(None if due == math.inf else due - now)
                found = [each for way in self._ways for each in way.arrived(time.monotonic())]
            for publisher, message in found:
                publisher.publish(message)


def main() -> None:
    """Relay until killed."""
    rclpy.init()
    rclpy.spin(_Node(sys.argv[1]))


if __name__ == '__main__':
    main()
