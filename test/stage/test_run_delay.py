# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the machine's share in a reaction is measured by."""

import os
import signal
import subprocess
import sys

from stage.run_delay import RunDelay

_PARENT = """
import subprocess, sys
child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60.0)'])
print(child.pid, flush=True)
child.wait()
"""


def test_child_counts_on_when_its_parent_is_dead() -> None:
    with subprocess.Popen([sys.executable, '-c', _PARENT], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        try:
            delay = RunDelay([parent.pid])
            parent.kill()
            parent.wait()
            assert any(each.startswith(f'/proc/{child}/') for each in delay._waited())
        finally:
            os.kill(child, signal.SIGKILL)
