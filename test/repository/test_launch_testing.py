# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
ROS's plugins for pytest, which an installed ROS brings into every run of these tests.

Stand-ins have their entry points and hooks. launch_testing's hook has an argument that pytest 9
has no more, and imports the modules that it is asked about; launch_ros has a hook that only
launch_testing declares.
"""

import os
from pathlib import Path
import subprocess
import sys

import pytest

from conftest import collect_ignore_glob
from stage.rig import ROOT

IMPORTS = """
import pytest
from _pytest.pathlib import import_path

def pytest_pycollect_makemodule(module_path, parent):
    import_path(module_path, root=parent.config.rootpath, consider_namespace_packages=False)
    return pytest.Module.from_parent(parent, path=module_path)
"""
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


@pytest.mark.parametrize('names', [[], ['launch_testing'], ['launch_ros'], [*PLUGINS]], ids=str)
def test_plugins_of_ros_are_left_out(tmp_path: Path, names: list[str]) -> None:
    found = collect(
        tmp_path, {name: PLUGINS[name] for name in names}, 'test/bridge_core/test_checksums.py'
    )
    assert 'test_checksums.py::' in found


@pytest.mark.computes(20)
def test_plugin_that_imports_modules_leaves_every_test_in(tmp_path: Path) -> None:
    """It is called otherwise, so that it is there: a module that skips itself would skip all."""
    found = collect(tmp_path, {'other': IMPORTS})
    names = {path.name for path in (ROOT / 'test').rglob('test_*.py')}
    names -= {Path(pattern).name for pattern in collect_ignore_glob}
    assert {name for name in names if f'{name}::' not in found} == set()
