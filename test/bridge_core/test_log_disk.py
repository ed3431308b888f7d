# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The disk of the log files hangs: no node waits for it."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
from pathlib import Path
import subprocess
import time

import pytest
from std_msgs.msg import Bool

from stage.mux_talkers import MuxBench
from stage.rig import NodeProcess, Observer, wait_for


def run(*words: str | Path) -> None:
    subprocess.run(words, check=True, capture_output=True)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """Give a disk of its own, which ``fsfreeze`` has hang."""
    image, folder = tmp_path / 'image', tmp_path / 'disk'
    folder.mkdir()
    image.write_bytes(b'')
    os.truncate(image, 1 << 24)
    try:
        run('mkfs.ext4', '-q', image)
        run('mount', '-o', 'loop', image, folder)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip('this user may not mount a disk')
    yield folder
    with contextlib.suppress(subprocess.CalledProcessError):  # it does not hang
        run('fsfreeze', '-u', folder)
    wait_for(lambda: subprocess.run(['umount', folder], check=False).returncode == 0, 10.0, 'rest')


@pytest.fixture
def mux(observer: Observer, disk: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[MuxBench]:
    monkeypatch.setattr(NodeProcess, 'forked', False)  # with this environment
    monkeypatch.setenv('ROS_LOG_DIR', str(disk / 'log'))
    with contextlib.closing(MuxBench(observer)) as mux:
        mux.wait(lambda: mux.says('STOPPED'), 'STOPPED')
        wait_for(lambda: [*disk.glob('log/*.log')], 5.0, 'a log file')
        yield mux


def test_mux_whose_log_disk_hangs_decides_and_publishes_on(mux: MuxBench, disk: Path) -> None:
    mux.ready()
    run('fsfreeze', '-f', disk)
    frozen = time.monotonic()
    mux.fort_estop.message = Bool(data=True)  # which it logs
    mux.wait(lambda: mux.says('STOPPED'), 'the stop')
    for _ in range(80):  # more than a buffer of the file takes
        assert mux.trip().success  # which it logs, too
    before = len(mux.estop.times)
    mux.wait(lambda: len(mux.estop.times) > before + 20, '~/estop')
    gaps = [b - a for a, b in zip(mux.estop.times, mux.estop.times[1:], strict=False)]
    assert time.monotonic() - frozen > 0.1
    assert max(gaps[-20:]) < 1.0
    run('fsfreeze', '-u', disk)
    [log] = disk.glob('log/*.log')
    wait_for(lambda: 'trip' in log.read_text(), 10.0, 'what was logged meanwhile')
