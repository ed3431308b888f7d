# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Start the process of a wire, or say in one line why it cannot: see transports/wire_process.py.

usage: python -S -m bridge_core.start_wire DESCRIPTOR MODULE RECONNECT_PERIOD RT_PRIORITY TAP
           IN_FORCE BEFORE

RT_PRIORITY 0 is that of the process that starts it, -1 none.
"""

import os
import sys

from bridge_core.descriptors import fill_standard_descriptors


def main() -> None:
    """Load all that a wire needs, and run it once it is its turn."""
    descriptor, module, reconnect_period, rt_priority, tap, in_force, before = sys.argv[1:]
    if rt_priority != '0':  # not its node's for as long as it loads: stops of others would wait
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    fill_standard_descriptors()
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


if __name__ == '__main__':
    main()
