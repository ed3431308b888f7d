# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The drive node at 1 kHz: commands, status and packets, beside a bare sleep loop on the same port.

How much of a core it takes, and by how much its packets are off the millisecond at the drive.
"""

from __future__ import annotations

import contextlib
import itertools
from pathlib import Path
import sys
import tempfile
import time

from assurance.benchmarks.rig import (
    Cost,
    Figures,
    figures,
    gaps,
    Rig,
    running,
    Size,
    UnavailableError,
    use_own_domain,
    USUAL,
)
from stage.rig import NodeProcess, wait_for

NODE = 'esi_drive_bridge'
PERIOD = 0.001  # s
_HEARTBEAT = 30  # commands between two of enable and e-stop: the mux's heartbeat_rate
_SETTLE = 0.7  # s of disable before enable
_PATIENCE = 2.0  # s until it is tried again
_RATES = {'command_rate': 1000.0, 'status_rate': 1000.0, 'baud': 1_000_000}


def talk() -> None:
    """Publish what a mux would, commands a thousand times a second, until it is ended."""
    import rclpy
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Bool

    rclpy.init()
    node = rclpy.create_node('talker')
    command = node.create_publisher(JointState, f'/{NODE}/command', 1)
    enable = node.create_publisher(Bool, f'/{NODE}/enable', 10)
    estop = node.create_publisher(Bool, f'/{NODE}/estop_in', 10)
    enabled = [False]
    node.create_subscription(
        Bool, f'/{NODE}/enabled', lambda heard: enabled.append(heard.data), 10
    )
    while not all(said.get_subscription_count() for said in (command, enable, estop)):
        time.sleep(0.01)
    message = JointState(name=['left', 'right'], velocity=[0.5, 0.5])
    due = begin = time.monotonic()
    for number in itertools.count():
        if not rclpy.ok():
            return
        command.publish(message)
        if number % _HEARTBEAT == 0:
            rclpy.spin_once(node, timeout_sec=0.0)
            if due - begin > _PATIENCE and not enabled[-1]:
                begin = due  # held up amid it, on a busy machine
            enable.publish(Bool(data=due - begin > _SETTLE))
            estop.publish(Bool(data=False))
        due += PERIOD
        time.sleep(max(0.0, due - time.monotonic()))


def deviations(rig: Rig, seconds: float) -> list[float]:
    """Return by how much (s) each gap between packets is off the period."""
    since = time.monotonic()
    time.sleep(seconds)
    return [abs(gap - PERIOD) for gap in gaps(rig.packets(since))]


def measure(size: Size = USUAL) -> dict[str, Figures]:
    """Return node and loop: per cent of a core, deviations (s)."""
    with contextlib.ExitStack() as exits:
        folder = Path(exits.enter_context(tempfile.TemporaryDirectory()))
        rig = exits.enter_context(Rig(folder, {'STATUS_NS': '1000000'}))
        exits.enter_context(running('-m', 'assurance.benchmarks.bench_esi', 'talk'))
        with running('-m', 'assurance.benchmarks.bare', 'pace', str(rig.vsc), str(rig.drive)):
            wait_for(rig.enabled, 10.0, 'packets of the loop')
            loop = figures(deviations(rig, size.seconds))
        with NodeProcess(f'{NODE}.node', {'port': rig.drive, **_RATES}) as node:
            # The loop has left the rig at enable.
            wait_for(lambda: not rig.enabled(), 10.0, 'packets of the node')
            try:
                wait_for(rig.enabled, 10.0, 'enable')
            except AssertionError as error:
                raise UnavailableError(f'{error}: {node.output}') from error
            cost = Cost({NODE: node.process.pid})
            ours = figures(deviations(rig, size.seconds))
            spent = cost.figures()
    # The target: a fifth of what a loop of sleeps is off, and 0.2 ms.
    allowed = {'p99': 0.2 * loop['p99'] + 0.0002}
    return {
        '1 kHz node': ours,
        '1 kHz cost': spent,
        '1 kHz loop': loop,
        '1 kHz allowed': allowed,
    }


def main() -> None:
    use_own_domain()
    for name, found in measure().items():
        print(name, {key: float(f'{value:.3g}') for key, value in found.items()})


if __name__ == '__main__':
    if sys.argv[1:] == ['talk']:
        with contextlib.suppress(RuntimeError):  # ended between two of them
            talk()
    else:
        main()
