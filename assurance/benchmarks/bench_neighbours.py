# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How long a publish takes while neighbours on its topics are killed; argument: seconds (60)."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time

from assurance.benchmarks.rig import Figures, use_own_domain
from bridge_core.share import shared

_SLOW = 0.03  # s
_LIFE = 2.0  # s of a subscriber
_NAMES = (
    'ROS_AUTOMATIC_DISCOVERY_RANGE',
    'FASTDDS_BUILTIN_TRANSPORTS',
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTRTPS_DEFAULT_PROFILES_FILE',
)
_PROFILE = str(shared('config/fastdds_loopback.xml'))
SETTINGS = {
    'LOCALHOST, shared memory': {_NAMES[0]: 'LOCALHOST'},
    'fastdds_loopback.xml': {
        _NAMES[0]: 'SYSTEM_DEFAULT',
        _NAMES[2]: _PROFILE,
        _NAMES[3]: _PROFILE,
    },
}
_QOS = 'QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)'
_COMMON = f"""
import sys, time, rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool
rclpy.init()
node = rclpy.create_node('bench')
qos = {_QOS}
"""
PUBLISHER = f"""{_COMMON}
publishers = [node.create_publisher(Bool, f'bench{{i}}', qos) for i in range(3)]
end, longest, slow, count = time.monotonic() + float(sys.argv[1]), 0.0, 0, 0
while time.monotonic() < end:
    start = time.monotonic()
    for publisher in publishers:
        publisher.publish(Bool(data=True))
    took = time.monotonic() - start
    longest, slow, count = max(longest, took), slow + (took > {_SLOW}), count + 1
    time.sleep(0.0005)
print(slow, longest, count)
"""
SUBSCRIBER = f"""{_COMMON}
for i in range(3):
    node.create_subscription(Bool, f'bench{{i}}', lambda message: None, qos)
rclpy.spin(node)
"""


def start(source: str, environment: dict[str, str], *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, '-c', source, *arguments],
        env=environment,
        stdout=subprocess.PIPE if arguments else subprocess.DEVNULL,
        text=True,
    )


def watch(setting: dict[str, str], seconds: float) -> Figures:
    """Return the slow publishes and the longest (s), and how many subscribers were killed."""
    others = {name: value for name, value in os.environ.items() if name not in _NAMES}
    environment = {**others, **setting}
    publisher = start(PUBLISHER, environment, str(seconds))
    subscribers: list[subprocess.Popen[str]] = []
    kills = 0
    while publisher.poll() is None:
        if len(subscribers) < 3:
            subscribers.append(start(SUBSCRIBER, environment))
        time.sleep(random.uniform(0.5, 1.0) * _LIFE / 3)
        if len(subscribers) == 3:
            end(subscribers.pop(0))
            kills += 1
    for subscriber in subscribers:
        end(subscriber)
    assert publisher.stdout is not None
    slow, longest, count = map(float, publisher.stdout.read().split())
    return {'slow': slow, 'max': longest, 'n': count, 'killed': kills}


def measure(quick: bool = False, seconds: float = 60.0) -> dict[str, Figures]:
    """Return what is watched, with each setting."""
    seconds = 10.0 if quick else seconds
    rows: dict[str, Figures] = {}
    for name, setting in SETTINGS.items():
        found = watch(setting, seconds)
        rest = {key: found.pop(key) for key in ('slow', 'killed')}
        rows |= {f'publish, {name}': found, f'publishes over 30 ms, {name}': rest}
    return rows


def end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    use_own_domain()
    for name, setting in SETTINGS.items():
        found = watch(setting, seconds)
        print(
            f'{name}: {found["slow"]:.0f} of {found["n"]:.0f} over {_SLOW * 1e3:.0f} ms, longest '
            f'{found["max"] * 1e3:.0f} ms, {found["killed"]:.0f} neighbours killed'
        )


if __name__ == '__main__':
    main()
