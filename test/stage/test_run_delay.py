# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
