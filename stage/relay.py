# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node that republishes another one's topics, late or not at all: a network, to who listens."""

from __future__ import annotations

from collections import deque
from functools import partial
import os
import random
import subprocess
import sys
import threading
import time
from typing import Any

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool, UInt8MultiArray

from bridge_core.managed_node import latched_qos
from bridge_core.proof_topics import PROOF_QOS
from stage.rig import ending_with, ROOT

_STEP = 0.002  # s
FORWARD: dict[str, tuple[Any, Any]] = {
    'estop': (Bool, latched_qos()),
    'own_estop': (Bool, latched_qos()),
    'joy': (Joy, 10),
    'proof': (UInt8MultiArray, PROOF_QOS),
}
RAW = '/raw'


def remapped(node: str) -> list[str]:
    """Return the ROS arguments by which a node speaks to the relay alone."""
    topics = [*FORWARD, 'challenge']
    return [word for each in topics for word in ('-r', f'/{node}/{each}:={RAW}/{node}/{each}')]


class Relay:
    """
    A relay of one bridge's topics, and of challenges to it: a process of its own.

    Use it as a context manager. What was said first arrives first.
    """

    def __init__(self, node: str) -> None:
        self._process = subprocess.Popen(
            [*ending_with(os.getpid()), sys.executable, '-m', 'stage.relay', node],
            stdin=subprocess.PIPE,
            cwd=ROOT,
            text=True,
            bufsize=1,
            start_new_session=True,
        )

    def set(self, *, delay: float = 0.0, loss: float = 0.0) -> None:
        """Set what holds for all that comes from now on, each way: s, and a share from 0 to 1."""
        assert self._process.stdin is not None
        self._process.stdin.write(f'{delay} {loss}\n')

    def __enter__(self) -> Relay:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.communicate()


class _Node(Node):
    """The node in that process."""

    def __init__(self, node: str) -> None:
        options: dict[str, Any] = {'start_parameter_services': False, 'enable_rosout': False}
        super().__init__(f'relay_{node}', **options)
        self._delay = self._loss = 0.0
        self._chance = random.Random(0)
        self._ways: list[tuple[Any, deque[tuple[float, bytes]]]] = []
        for topic, (kind, qos) in FORWARD.items():
            self._join(kind, f'{RAW}/{node}/{topic}', f'/{node}/{topic}', qos)
        challenge = f'{node}/challenge'
        self._join(UInt8MultiArray, f'/{challenge}', f'{RAW}/{challenge}', PROOF_QOS)
        self.create_timer(_STEP, self._carry)

    def obey(self) -> None:
        """Take lines of two numbers, delay and loss."""
        for line in sys.stdin:
            self._delay, self._loss = map(float, line.split())

    def _join(self, kind: Any, source: str, target: str, qos: Any) -> None:
        way: deque[tuple[float, bytes]] = deque()
        self._ways.append((self.create_publisher(kind, target, qos), way))
        self.create_subscription(kind, source, partial(self._hear, way), qos, raw=True)

    def _hear(self, way: deque[tuple[float, bytes]], message: bytes) -> None:
        if self._chance.random() >= self._loss:
            way.append((time.monotonic() + self._delay, message))
            self._carry()

    def _carry(self) -> None:
        now = time.monotonic()
        for publisher, way in self._ways:
            while way and way[0][0] <= now:
                publisher.publish(way.popleft()[1])


def main() -> None:
    """Relay until killed."""
    rclpy.init()
    node = _Node(sys.argv[1])
    threading.Thread(target=node.obey, daemon=True).start()
    rclpy.spin(node)


if __name__ == '__main__':
    main()
