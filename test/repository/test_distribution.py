# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is built from the sources has all that belongs in it, and works without them."""

from collections.abc import Iterator
import os
from pathlib import Path
import shutil
import subprocess
import sys
import tarfile
import zipfile

import pytest

from stage.rig import NOT_INSTALLED, ROOT
from test.repository.test_package import entry_points

# What is made in a working copy, and is no source.
MADE = (
    '.git',
    '.venv*',
    '_build',
    '__pycache__',
    '*.egg-info',
    'build',
    'dist',
    'install',
    'log',
    '.*_cache',
)
BUILD = 'import sys, setuptools.build_meta as b; getattr(b, sys.argv[1])(sys.argv[2])'


def run(folder: Path, *command: str, **environment: str) -> str:
    """Run this Python in a folder. :raises AssertionError: with its output, if it fails."""
    done = subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob('*') if path.is_file()}


@pytest.fixture(scope='module')
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the sources alone."""
    folder = tmp_path_factory.mktemp('sources') / 'copy'
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*MADE, '.hypothesis'))
    return folder


@pytest.fixture(scope='module')
def unpacked(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the sdist's folder, unpacked."""
    before = files(sources)
    target = tmp_path_factory.mktemp('sdist')
    run(sources, '-c', BUILD, 'build_sdist', str(target))
    assert before <= files(sources)
    (archive,) = target.glob('*.tar.gz')
    with tarfile.open(archive) as opened:
        opened.extractall(target, filter='data')
    return target / archive.name.removesuffix('.tar.gz')


@pytest.fixture(scope='module')
def wheel(unpacked: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel that the sdist gives."""
    target = tmp_path_factory.mktemp('wheel')
    run(unpacked, '-c', BUILD, 'build_wheel', str(target))
    (found,) = target.glob('*.whl')
    return found


@pytest.fixture(scope='module')
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the wheel in it, as pip unpacks it."""
    target = tmp_path_factory.mktemp('installed')
    options = ('--quiet', '--no-index', '--no-deps', '--no-compile', '--target')
    run(target, '-m', 'pip', 'install', *options, str(target), str(wheel))
    return target


def test_sdist_has_every_source_file(sources: Path, unpacked: Path) -> None:
    kinds = {'', '.cfg', '.md', '.py', '.rst', '.toml', '.txt', '.xml'}  # others lie about there
    wanted = {name for name in files(sources) if '/' in name or Path(name).suffix in kinds}
    assert {name for name in wanted if '.egg-info/' not in name} - files(unpacked) == set()


def expected(sources: Path) -> Iterator[str]:
    """Yield what a wheel must have: the packages as they are, the rest in folders of ROS."""
    for init in sources.glob('*/__init__.py'):
        if init.parent.name not in NOT_INSTALLED:
            yield from (f'{init.parent.name}/{name}' for name in files(init.parent))
    for folder in ('config', 'container', 'dbc', 'docs', 'launch', 'systemd', 'udev'):
        yield from (f'share/rugged_teleop/{folder}/{name}' for name in files(sources / folder))
    yield from (f'lib/rugged_teleop/{name}' for name in files(sources / 'tools'))


def test_wheel_has_every_module_page_and_asset(sources: Path, wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as opened:
        data = f'{wheel.name[: wheel.name.index("-py3")]}.data/data/'
        names = {name.removeprefix(data) for name in opened.namelist()}
    wanted = set(expected(sources))
    assert len(wanted) > 200
    assert wanted <= names
    assert 'share/rugged_teleop/package.xml' in names
    assert not any(name.split('/')[0] in NOT_INSTALLED for name in names)


def test_wheel_works_without_its_sources(installed: Path, tmp_path: Path) -> None:
    check = f"""
import importlib, pathlib
for point in {sorted(entry_points().values())}:
    module, function = point.split(':')
    module = importlib.import_module(module)
    assert pathlib.Path(module.__file__).is_relative_to({str(installed)!r}), module
    assert callable(getattr(module, function))
from bridge_core.share import shared
print(shared('config/fastdds_loopback.xml'))
"""
    found = run(tmp_path, '-c', check, PYTHONPATH=str(installed))
    assert Path(found.strip()).is_relative_to(installed)
    command = (str(installed / 'bin' / 'rugged_teleop'), '--help')
    assert 'decode' in run(tmp_path, *command, PYTHONPATH=str(installed))
