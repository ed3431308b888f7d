# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
ROS's plugins for pytest, which an installed ROS brings into every run of these tests.

Stand-ins have their entry points and hooks. launch_testing's hook has an argument that pytest 9
has no more; launch_ros has a hook that only launch_testing declares.
"""

import os
from pathlib import Path
import subprocess
import sys

import pytest

from stage.rig import ROOT

PLUGINS = {
    'launch_testing': 'def pytest_pycollect_makemodule(path, parent): ...',
    'launch_ros': 'def pytest_launch_collect_makemodule(path, parent, entrypoint): ...',
}


def collect(folder: Path, plugins: dict[str, str], *words: str) -> str:
    """Return what pytest lists where these plugins are installed. :raises AssertionError: none."""
    for name, text in plugins.items():
        (folder / f'{name}_hooks.py').write_text(text, encoding='utf-8')
        info = folder / f'{name}-1.dist-info'
        info.mkdir()
        (info / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1\n')
        (info / 'entry_points.txt').write_text(f'[pytest11]\n{name} = {name}_hooks\n')
    paths = [str(folder), *filter(None, [os.environ.get('PYTHONPATH')])]  # ROS's own, say
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '--collect-only', '-q', '-p', 'no:xdist', *words],
        capture_output=True,
        text=True,
        cwd=ROOT,
        # colcon gives its options to whatever runs pytest.
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(paths), 'PYTEST_ADDOPTS': ''},
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


@pytest.mark.proof  # it collects anew; what it guards is in pyproject.toml alone
def test_plugins_of_ros_are_left_out(tmp_path: Path) -> None:
    found = collect(tmp_path, PLUGINS, 'test/bridge_core/test_checksums.py')
    assert 'test_checksums.py::' in found
