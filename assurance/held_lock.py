# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
An actuator's node, which holds its interpreter's lock when asked to. For the campaign only.

``python -m assurance.held_lock --ros-args ... -- NODE`` is the node. At SIGUSR1 a callback of its
executor sleeps in C for 4 s without releasing the lock; at SIGUSR2 it publishes to whoever listens
on TOPIC until the middleware has blocked for so long. ``... reader`` listens.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import HistoryPolicy, QoSProfile
from std_msgs.msg import Bool

from bridge_core.managed_node import ManagedNode
from bridge_core.runner import run
from rugged_teleop.stack import node_factory

TOPIC = '/held_lock'
BLOCKED = 'publishing blocked for'
HELD = 4.0  # s
_BLOCKED, _LONGEST = 0.05, 8.0  # s: a publish that takes so long has blocked; the whole trial
_SIGNALS = (signal.SIGUSR1, signal.SIGUSR2)
_QOS = QoSProfile(history=HistoryPolicy.KEEP_ALL)


class HeldLock(ManagedNode):
    """Goes before the class of a node."""

    def __init__(self, *words: Any, **options: Any) -> None:
        super().__init__(*words, **options)
        self._held = self.create_publisher(Bool, TOPIC, _QOS)
        acts = (self._sleep, self._publish)
        self._asked = {
            number: self.create_guard_condition(act)
            for number, act in zip(_SIGNALS, acts, strict=True)
        }
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        while True:  # not a handler: the runner takes any for the end
            self._asked[signal.Signals(signal.sigwait(_SIGNALS))].trigger()

    def _sleep(self) -> None:
        ctypes.PyDLL(None).sleep(int(HELD))

    def _publish(self) -> None:
        begin, blocked = time.monotonic(), 0.0
        while blocked < HELD and time.monotonic() < begin + _LONGEST:
            before = time.monotonic()
            with contextlib.suppress(RuntimeError):  # "cannot publish data", after it has blocked
                self._held.publish(Bool())
            took = time.monotonic() - before
            blocked += took if took > _BLOCKED else 0.0
        print(f'{BLOCKED} {blocked:.1f} s', file=sys.stderr, flush=True)


def read() -> None:
    """Listen on TOPIC."""
    rclpy.init()
    node: Any = rclpy.create_node('held_lock_reader')
    node.create_subscription(Bool, TOPIC, lambda message: None, _QOS)
    with contextlib.suppress(ExternalShutdownException):
        rclpy.spin(node)


def main() -> None:
    if sys.argv[1:] == ['reader']:
        read()
    else:
        if not signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS):
            # Anew, for an import has started threads that do not block them.
            os.execv(sys.executable, [sys.executable, '-m', 'assurance.held_lock', *sys.argv[1:]])
        name = sys.argv[-1]
        node: Any = node_factory(name)
        raise SystemExit(run([type(name, (HeldLock, node), {})], names=[name]))


if __name__ == '__main__':
    main()
