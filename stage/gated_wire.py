# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The process of a wire that loads when the test lets it; used like bridge_core's own.

It waits until somebody has opened the named pipe ``WIRE_GATE`` to write.
"""

import contextlib
import os
from pathlib import Path
import runpy


def opens(gate: Path) -> bool:
    """Open the gate, where somebody waits for that."""
    with contextlib.suppress(OSError):  # ENXIO
        os.close(os.open(gate, os.O_WRONLY | os.O_NONBLOCK))
        return True
    return False


if __name__ == '__main__':
    Path(os.environ['WIRE_GATE']).open().close()
    runpy.run_module('bridge_core.start_wire', run_name='__main__', alter_sys=True)
