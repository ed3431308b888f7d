# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the tests start does not outlive them."""

from collections.abc import Iterator
import os
from signal import SIGKILL
import subprocess
import sys
import tempfile

import pytest

from stage.forks import ForkedProcess
from stage.rig import ending_with, forks, ROOT, TIMEOUT_FACTOR, wait_for
from stage.toy_rig import is_running

WAIT = 10.0 * TIMEOUT_FACTOR

_STARTS = """
from stage.rig import NodeProcess

NodeProcess.forked = {}
with NodeProcess({}) as node:
    print(node.process.pid, flush=True)
    node.wait(600.0)
"""


@pytest.mark.parametrize('forked', [True, False])
@pytest.mark.parametrize('node', ["'safety_mux.node'", "source='import signal; signal.pause()'"])
def test_node_ends_with_tests_that_are_killed(node: str, forked: bool) -> None:
    with subprocess.Popen(
        [sys.executable, '-c', _STARTS.format(forked, node)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as tests:
        assert tests.stdout is not None
        pid = int(tests.stdout.readline())
        assert is_running(pid)
        tests.kill()
    wait_for(lambda: not is_running(pid), 5.0, 'the end of the node')


@pytest.mark.parametrize('ours', [True, False])
def test_command_whose_parent_is_another_already_never_begins(ours: bool) -> None:
    command = [*ending_with(os.getpid() if ours else 0), 'printf', 'here']
    ended = subprocess.run(command, stdout=subprocess.PIPE, timeout=60.0, check=False)
    assert ended.stdout == (b'here' if ours else b'')
    assert (ended.returncode == 0) is ours


@pytest.fixture
def output() -> Iterator[int]:
    with tempfile.TemporaryFile() as file:
        yield file.fileno()


def run(statement: str, output: int) -> ForkedProcess:
    return ForkedProcess(forks(), ['-c', statement, 'argument'], output)


def test_fork_has_the_environment_and_session_of_its_start(
    monkeypatch: pytest.MonkeyPatch, output: int
) -> None:
    run('pass', output).wait(WAIT)
    monkeypatch.setenv('MARK', 'set since')
    process = run('import os, sys; print(os.environ["MARK"], os.getsid(0), sys.argv)', output)
    assert process.wait(WAIT) == process.poll() == 0
    expected = f"set since {process.pid} ['-c', 'argument']\n"
    assert os.pread(output, 1000, 0).decode() == expected


def test_end_of_a_fork_is_told_as_that_of_a_child(output: int) -> None:
    raising = run('1 / 0', output)
    assert raising.wait(WAIT) == 1
    assert b'ZeroDivisionError' in os.pread(output, 10_000, 0)
    waiting = run('import signal; signal.pause()', output)
    with pytest.raises(subprocess.TimeoutExpired):
        waiting.wait(0.0)
    assert waiting.poll() is None
    waiting.kill()
    assert waiting.wait(WAIT) == waiting.returncode == -SIGKILL
    waiting.terminate()  # as nothing is there


def test_path_that_a_test_sets_is_no_forks(monkeypatch: pytest.MonkeyPatch) -> None:
    assert forks().serves()
    monkeypatch.setenv('PYTHONPATH', '/elsewhere')
    assert not forks().serves()
