# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The anchors: what the rig measures without any logic of ours.

usage: bare.py floor|in|mid|out|pace VSC DRIVE [PRIORITY]

``in``, ``mid`` and ``out`` are three rclpy nodes, a topic between each; ``floor`` is the first and
the last in one thread, without a topic; ``pace`` sends a packet a millisecond. With PRIORITY all
threads are SCHED_FIFO.
"""

import binascii
from collections.abc import Callable
import contextlib
import os
import sys
import threading
import time
import tty
from typing import Any

_HEARTBEAT, _OVERHEAD, _PERIOD = 0x20, 6, 0.001
_ON = b'\x01\x10\x00\x01\x10\x00'


def packet(body: bytes) -> bytes:
    return b'\xf0\xf0' + body + binascii.crc_hqx(body, 0xFFFF).to_bytes(2, 'little')


DISABLE, ENABLE = packet(bytes(6)), packet(_ON)


def opened(path: str) -> int:
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)
    return port


def read(vsc: str, on_stop: Callable[[bool], object]) -> None:
    """Tell for ever what each heartbeat says."""
    port, data = opened(vsc), b''
    while True:
        data += os.read(port, 4096)
        while len(data) >= _OVERHEAD:
            if data[:2] != b'\x10\x01':
                data = data[1:]
                continue
            size = data[3] + _OVERHEAD
            if len(data) < size:
                break
            frame, data = data[:size], data[size:]
            if frame[2] == _HEARTBEAT:
                on_stop(any(frame[6:10]))


def writer(drive: str) -> Callable[[bool], object]:
    port = opened(drive)
    return lambda stop: os.write(port, DISABLE if stop else ENABLE)


def pace(drive: str) -> None:
    """Send a packet at each millisecond, for ever."""
    write, due = writer(drive), time.monotonic()
    while True:
        due += _PERIOD
        time.sleep(max(0.0, due - time.monotonic()))
        write(False)


def spin(role: str, vsc: str, drive: str) -> None:
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from std_msgs.msg import Bool

    rclpy.init()
    node: Any = rclpy.create_node(f'bare_{role}')
    if role == 'in':
        heard = node.create_publisher(Bool, 'a', 10)

        def tell() -> None:
            with contextlib.suppress(RuntimeError):  # the node has left
                read(vsc, lambda stop: heard.publish(Bool(data=stop)))

        threading.Thread(target=tell, daemon=True).start()
    elif role == 'mid':
        passed = node.create_publisher(Bool, 'b', 10)
        node.create_subscription(Bool, 'a', passed.publish, 10)
    else:
        write = writer(drive)
        node.create_subscription(Bool, 'b', lambda message: write(message.data), 10)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with contextlib.suppress(ExternalShutdownException):
        executor.spin()


def main(role: str, vsc: str, drive: str, priority: str = '0') -> None:
    if int(priority):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(priority)))
    if role == 'floor':
        read(vsc, writer(drive))
    elif role == 'pace':
        pace(drive)
    else:
        spin(role, vsc, drive)


if __name__ == '__main__':
    main(*sys.argv[1:])
