# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Output that never blocks: the process that writes it, and who writes to it."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
import re
import signal
import subprocess
import sys

import pytest

from bridge_core import drain
from stage.rig import ROOT, run_python, TIMEOUT_FACTOR, wait_for

LINE = b'0123456789abcdef' * 64 + b'\n'


class Drained:
    """The process between two pipes, of which this side reads or does not."""

    def __init__(self) -> None:
        self.output, real = os.pipe()
        os.set_blocking(self.output, False)
        self.process = subprocess.Popen(
            [sys.executable, '-I', '-S', str(Path(drain.__file__))],
            stdin=subprocess.PIPE,
            stdout=real,
        )
        os.close(real)
        assert self.process.stdin is not None
        self.input = self.process.stdin
        self.shown = b''

    def read(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            self.shown += os.read(self.output, 1 << 20)
        return self.shown

    def __enter__(self) -> Drained:
        return self

    def __exit__(self, *error: object) -> None:
        self.input.close()
        self.process.kill()
        self.process.wait()
        os.close(self.output)


def test_drain_copies_in_order_and_ends_with_its_input() -> None:
    with Drained() as drained:
        drained.input.write(b'one\n')
        drained.input.flush()
        wait_for(lambda: drained.read() == b'one\n', 5.0, 'a line')
        drained.input.write(b'two')
        drained.input.close()
        assert drained.process.wait(5.0 * TIMEOUT_FACTOR) == 0
        assert drained.read() == b'one\ntwo'


def test_drain_of_a_blocked_output_takes_everything_and_counts_what_it_drops() -> None:
    lines = 2000  # 2 MB, of which pipe and drain keep some 300 kB
    with Drained() as drained:
        for _ in range(lines):
            drained.input.write(LINE)  # blocks for ever, if the drain does
        drained.input.flush()

        def counts() -> tuple[int, int]:
            """Return the lines that came through, and those that are said to be missing."""
            notes = re.findall(rb'\[(\d+) lines are missing', drained.read())
            return drained.shown.count(b'\n') - len(notes), sum(map(int, notes))

        wait_for(lambda: sum(counts()) == lines, 10.0, lambda: f'every line: {counts()}')
        assert counts()[1] > lines / 2


def test_drain_of_an_output_that_stays_blocked_ends_all_the_same() -> None:
    with Drained() as drained:
        drained.input.write(LINE * 200)
        drained.input.close()
        assert drained.process.wait(5.0 * TIMEOUT_FACTOR) == 0


def test_interrupt_of_the_terminal_is_left_to_the_node() -> None:
    source = (
        'import signal, sys\n'
        'from bridge_core.output import unblocked_output\n'
        'with unblocked_output():\n'
        '    print("up")\n'
        '    signal.sigwait({signal.SIGINT})\n'
        '    print("last words", file=sys.stderr)\n'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', 'import signal; signal.pthread_sigmask(0, {2})\n' + source],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        cwd=ROOT,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.read(3) == b'up\n'
    os.killpg(process.pid, signal.SIGINT)
    assert process.stdout.read() == b'last words\n'
    assert process.wait(5.0 * TIMEOUT_FACTOR) == 0


def test_what_goes_to_a_file_waits_for_no_disk_and_comes_whole(tmp_path: Path) -> None:
    source = (
        'import os, stat\n'
        'from bridge_core.output import unblocked_output\n'
        'with unblocked_output():\n'
        '    assert stat.S_ISFIFO(os.fstat(1).st_mode)\n'
        '    print("done")\n'
    )
    file = tmp_path / 'log'
    with file.open('wb') as output:
        run_python('-c', source, stdout=output, check=True)
    wait_for(lambda: file.read_text() == 'done\n', 5.0, 'the line')


@pytest.mark.parametrize(
    ('words', 'files', 'shown'),
    [
        ([], 'node_*.log', True),
        (['--log-file-name', 'other'], 'other_*.log', True),
        (['--disable-stdout-logs'], 'node_*.log', False),
        (['--disable-external-lib-logs'], 'none', True),
    ],
)
def test_log_file_is_written_as_the_words_of_ros_say(
    tmp_path: Path, words: list[str], files: str, shown: bool
) -> None:
    source = (
        'import sys\n'
        'from bridge_core.output import log_file, NO_SHOW, unblocked_output\n'
        'log = log_file(["node", *sys.argv[1:]])\n'
        'with unblocked_output(log, shown=NO_SHOW not in sys.argv):\n'
        '    print("\\x1b[33mwords\\x1b[0m", file=sys.stderr)\n'
    )
    folder = tmp_path / 'new' / 'folder'
    environment = {**os.environ, 'ROS_LOG_DIR': str(folder)}
    ended = run_python('-c', source, *words, env=environment, check=True)
    assert ended.stderr == '\x1b[33mwords\x1b[0m\n' * shown
    found = [*folder.glob('*')]
    assert found == [*folder.glob(files)][:1]
    assert [file.read_text() for file in found] == ['words\n'] * (files != 'none')


def test_log_file_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / 'file').touch()
    source = (
        'import sys\n'
        'from bridge_core.output import unblocked_output\n'
        'with unblocked_output(sys.argv[1]):\n'
        '    print("words", file=sys.stderr)\n'
    )
    log = tmp_path / 'file' / 'x.log'
    ended = run_python('-c', source, str(log), check=True)
    assert sorted(ended.stderr.splitlines()) == [f'[no log file: {log}: File exists]', 'words']


def test_print_into_a_pipe_that_takes_nothing_raises_nothing() -> None:
    source = (
        'import os, sys\n'
        'from bridge_core import output\n'
        'read, write = os.pipe()\n'
        'os.set_blocking(write, False)\n'
        'os.dup2(write, 1)\n'
        'sys.stdout = output._stream(1)\n'
        'for _ in range(1000):\n'
        '    print("x" * 1000)\n'
        'os.close(read)\n'
        'print("nobody hears it")\n'
    )
    run_python('-c', source, check=True)


_CLOSED = ['sh', '-c', 'exec "$@" <&- >&- 2>&-', 'sh', sys.executable]
_PIPE = """
import os, sys
from bridge_core.descriptors import fill_standard_descriptors
fill_standard_descriptors()
sys.exit(min(os.pipe()) < 3 or not all(map(os.get_inheritable, range(3))))
"""


def test_what_is_opened_first_is_no_standard_descriptor() -> None:
    assert subprocess.run([*_CLOSED, '-c', _PIPE], cwd=ROOT).returncode == 0


def test_node_that_is_started_without_descriptors_runs() -> None:
    """With a pipe or the log file of ROS as standard output it would end by itself."""
    process = subprocess.Popen([*_CLOSED, '-m', 'safety_mux.node'], cwd=ROOT)
    own = Path(f'/proc/{process.pid}')

    def runs() -> bool:
        assert process.poll() is None
        names = {path.read_text() for path in own.glob('task/*/comm')}
        return any(name.startswith('dds.udp') for name in names)

    try:
        wait_for(runs, 20.0, 'a running node')
        found = [os.readlink(own / f'fd/{number}').split(':')[0] for number in range(3)]
        assert found == ['/dev/null', '/dev/null', 'pipe']  # the last one to the log file
        process.terminate()
        assert process.wait(10.0 * TIMEOUT_FACTOR) == 0
    finally:
        process.kill()
        process.wait()
