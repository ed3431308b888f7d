# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What each e-stop source and operator costs a running mux.

``python -m assurance.benchmarks.bench_mux [N]``. All sources talk at 20 Hz and all sticks at
50 Hz, each by a publisher of its own, so that each message wakes the mux by itself.
"""

from __future__ import annotations

import contextlib
import itertools
import sys
import time

from assurance.benchmarks.rig import Cost, Figures, running, Size, use_own_domain, USUAL
from stage.rig import NodeProcess

SIZES = (1, 4, 16)
_ESTOP, _STICKS = 0.05, 0.02  # s
_SETTLE = 3.0  # s


def talk(count: int) -> None:
    """Publish stops that are clear and sticks that are neutral, until it is ended."""
    import rclpy
    from sensor_msgs.msg import Joy
    from std_msgs.msg import Bool

    rclpy.init()
    node = rclpy.create_node('talkers')
    said = []  # period, publisher, message
    for n in range(count):
        said.append((_ESTOP, node.create_publisher(Bool, f'estop{n}', 1), Bool()))
        joy = Joy(axes=[0.0] * 6, buttons=[0] * 8)
        said.append((_STICKS, node.create_publisher(Joy, f'joy{n}', 1), joy))
    begin = time.monotonic()
    due = [begin + period * n / len(said) for n, (period, *_) in enumerate(said)]
    while rclpy.ok():
        n = due.index(min(due))
        time.sleep(max(0.0, due[n] - time.monotonic()))
        period, publisher, message = said[n]
        publisher.publish(message)
        due[n] += period


def parameters(count: int) -> dict[str, object]:
    """Return those of a mux with so many sources and operators."""
    names = [f'each{n}' for n in range(count)]
    found: dict[str, object] = {
        'estop_sources': names,
        'operators': names,
        'drive_enabled_topic': '',
    }
    for n, name in enumerate(names):
        found |= {
            f'estop.{name}.topic': f'estop{n}',
            f'operator.{name}.topic': f'joy{n}',
            f'operator.{name}.priority': n,
            f'operator.{name}.axis': [1, 0],
            f'operator.{name}.mixing': 'arcade',
            f'operator.{name}.deadman_buttons': [0],
        }
    return found


def cost(count: int, seconds: float) -> Figures:
    """Return what a mux with so many of both costs."""
    with (
        NodeProcess('safety_mux.node', parameters(count)) as mux,
        running('-m', 'assurance.benchmarks.bench_mux', 'talk', str(count)),
    ):
        mux.wait_output('STOPPED')
        time.sleep(_SETTLE)
        spent = Cost({'mux': mux.process.pid})
        time.sleep(seconds)
        return spent.figures()


def measure(size: Size = USUAL) -> dict[str, Figures]:
    """Return the cost of each size, and of each further source and operator between two."""
    found = {count: cost(count, size.seconds) for count in SIZES}
    rows = {f'mux, {count}': figures for count, figures in found.items()}
    for few, many in itertools.pairwise(SIZES):
        each = (found[many]['cpu'] - found[few]['cpu']) / (many - few)
        rows[f'mux, each from {few} to {many}'] = {'cpu': each}
    return rows


def main() -> None:
    use_own_domain()
    for size in [int(word) for word in sys.argv[1:]] or SIZES:
        print(size, {name: float(f'{value:.3g}') for name, value in cost(size, 10.0).items()})


if __name__ == '__main__':
    if sys.argv[1:2] == ['talk']:
        with contextlib.suppress(RuntimeError, KeyboardInterrupt):  # ended between two of them
            talk(int(sys.argv[2]))
    else:
        main()
