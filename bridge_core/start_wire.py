# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Start the process of a wire, or say in one line why it cannot: see transports/wire_process.py.

usage: python -S -m bridge_core.start_wire RT_PRIORITY DESCRIPTOR [MODULE RECONNECT_PERIOD TAP
           IN_FORCE BEFORE]

RT_PRIORITY 0 is that of the process that starts it, -1 none. Without the rest it is the template
of such processes, see transports/template.py, and each of them goes on from here.
"""

import os
import sys

from bridge_core.descriptors import fill_standard_descriptors


def main() -> None:
    """Load all that a wire needs, and run it once it is its turn."""
    arguments = sys.argv[1:]
    _be_ordinary(arguments[0])
    fill_standard_descriptors()
    if len(arguments) == 2:
        from bridge_core.transports.template import serve  # late: what a wire does without

        arguments = serve(int(arguments[1]))
        _be_ordinary(arguments[0])
    rt_priority, descriptor, module, reconnect_period, tap, in_force, before = arguments
    try:
        from bridge_core.transports.wire_process import (
            InForce,  # late: it may fail
            load,
            run,
        )

        node, bridge, refusals = load(int(descriptor), module, int(rt_priority))
    except (ImportError, MemoryError, OSError) as error:
        sys.exit(f'the process of a wire cannot start: {module}: {error!r}')
    left = InForce(int(in_force)), int(before)
    run(node, bridge, refusals, float(reconnect_period), int(tap), *left)


def _be_ordinary(rt_priority: str) -> None:
    """Give up the priority of the node for as long as this loads: stops of others would wait."""
    if rt_priority != '0':
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


if __name__ == '__main__':
    main()
