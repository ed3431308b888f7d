# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From the start of a process to its first message, at a subscriber that is up already."""

from __future__ import annotations

import time

from std_msgs.msg import Bool

from assurance.benchmarks.rig import Figures, figures, Size, use_own_domain, USUAL
from stage.rig import latched, NodeProcess, Observer

NODE = 'fort_vsc_bridge'
BARE = """
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool
rclpy.init()
node = rclpy.create_node('bare')
qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_publisher(Bool, '~/estop', qos).publish(Bool(data=True))
rclpy.spin(node)
"""


def first_message(observer: Observer, name: str, space: str) -> float:
    """Return the seconds from the start of a node of this name to its first ``~/estop``."""
    topic = f'{space}/{name}/estop'
    heard = observer.record(Bool, topic, latched())
    begin = time.monotonic()
    if name == 'bare':
        process = NodeProcess(source=BARE, namespace=space)
    else:  # without a device: what is measured does not wait for one
        process = NodeProcess(f'{name}.node', {'port': '/dev/null/none'}, namespace=space)
    with process:
        observer.wait_for(lambda: heard.times, 30.0, topic)
    return heard.times[0] - begin


def measure(size: Size = USUAL) -> dict[str, Figures]:
    """Return the seconds of a node of ours, and of a bare rclpy publisher."""
    times: dict[str, list[float]] = {'bare': [], NODE: []}
    with Observer('start') as observer:
        for number in range(size.starts):
            for name, found in times.items():
                found.append(first_message(observer, name, f'/start{number}'))
    return {f'start {name}': figures(found) for name, found in times.items()}


def main() -> None:
    use_own_domain()
    for name, found in measure().items():
        print(f'{name}: median {found["p50"]:.3f} s, max {found["max"]:.3f} s, n {found["n"]}')


if __name__ == '__main__':
    main()
