"""
``python -m test.patience MODULE``: run a node that lets a busy machine hold its wire up.

A wire of which nothing is heard for 85 ms hangs, and an input that took 30 ms does not count: on a
machine that is busy with something else that happens to healthy processes, and stops them. Tests
of these limits measure how long the machine held them up; tests of all else use this.
"""

import runpy
import sys

from bridge_core.transports import link
from bridge_core.transports import process
from bridge_core.transports import wire
from test.rig import TIMEOUT_FACTOR

vars(process).update(SILENCE_LIMIT=TIMEOUT_FACTOR, _KILL_TIME=2.0 * TIMEOUT_FACTOR)
vars(link).update(INPUT_LIMIT=1.0, REQUEST_LIMIT=TIMEOUT_FACTOR)
vars(wire).update(_FROZEN_TIME=1.0)

if __name__ == '__main__':
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)
