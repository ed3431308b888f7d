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

"""What the tests start does not outlive them."""

import os
import subprocess
import sys

import pytest

from test.rig import ending_with
from test.rig import ROOT
from test.rig import wait_for
from test.toy_rig import is_running

_STARTS = """
from test.rig import NodeProcess

with NodeProcess(source='import signal; print("up"); signal.pause()') as node:
    node.wait_output('up')
    print(node.process.pid, flush=True)
    node.wait(600.0)
"""


def test_node_ends_with_tests_that_are_killed() -> None:
    with subprocess.Popen(
        [sys.executable, '-c', _STARTS], stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as tests:
        assert tests.stdout is not None
        node = int(tests.stdout.readline())
        assert is_running(node)
        tests.kill()
    wait_for(lambda: not is_running(node), 5.0, 'the end of the node')


@pytest.mark.parametrize('ours', [True, False])
def test_command_whose_parent_is_another_already_never_begins(ours: bool) -> None:
    command = [*ending_with(os.getpid() if ours else 0), 'printf', 'here']
    ended = subprocess.run(command, stdout=subprocess.PIPE, timeout=60.0, check=False)
    assert ended.stdout == (b'here' if ours else b'')
    assert (ended.returncode == 0) is ours
