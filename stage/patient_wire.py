# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The process of a patient node's wire, see patience.py; used like bridge_core's own.

It imports no more than that, so it starts as quickly.
"""

import runpy

from bridge_core.transports import active, wire

FROZEN_TIME = 1.0  # s; what is held up for as long has still heard everything
for module in (active, wire):
    vars(module).update(FROZEN_TIME=FROZEN_TIME)

if __name__ == '__main__':
    runpy.run_module('bridge_core.start_wire', run_name='__main__', alter_sys=True)
