"""
The CAN tests once more, on a real SocketCAN interface inside user-mode-linux.

That is a Linux kernel which runs as an ordinary process; it needs no privileges. Where it cannot
run, the reason is told and the tests are skipped, or fail if RUGGED_TELEOP_REQUIRE_UML is 1, as CI
sets it.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
from pathlib import Path
import re
import shlex
import shutil
import signal
import subprocess
import sys
from typing import NoReturn
from xml.etree import ElementTree

import pytest

from test.can_rig import VARIABLE
from test.rig import ROOT

_KERNEL = 'linux.uml'
_MODULES = Path('/usr/lib/uml/modules')
_INSTALL = 'apt install user-mode-linux iproute2'
_MEMORY = 1024  # MiB
_LONGEST = 900.0  # seconds a file; a single test in there hangs after 300
_ARGUMENTS = ('-m', 'can_bus', '-o', 'faulthandler_timeout=300')


def files_with_can_tests() -> list[str]:
    """Return the test files that take the fixture can_bus."""
    files = sorted(Path(__file__).parent.glob('test_*.py'))
    others = (file for file in files if file != Path(__file__))
    return [file.name for file in others if re.search(r'\bcan_bus\b', file.read_text('utf-8'))]


def missing() -> str:
    """Return what has to be installed before anything can run; empty: nothing."""
    needed = [
        name for name in (_KERNEL, 'ip', 'tc', 'mount') if shutil.which(name, path=_path()) is None
    ]
    if not needed and not _MODULES.is_dir():
        needed = [str(_MODULES)]
    return f'{", ".join(needed)} not found; {_INSTALL}' if needed else ''


def cannot_run(reason: str) -> NoReturn:
    text = f'nothing was tested on a real CAN interface: {reason}'
    if os.environ.get('RUGGED_TELEOP_REQUIRE_UML') == '1':
        pytest.fail(text)
    pytest.skip(text)


@pytest.mark.skipif(VARIABLE in os.environ, reason='we are inside already')
@pytest.mark.parametrize('file', files_with_can_tests())
def test_can_tests_pass_on_a_real_interface(file: str, tmp_path: Path) -> None:
    if reason := missing():
        cannot_run(reason)
    faulthandler.cancel_dump_traceback_later()  # this takes as long as all the tests in there
    console = run_inside(tmp_path, [f'test/{file}', *_ARGUMENTS])
    if not (tmp_path / 'booted').exists():
        cannot_run(f'{_KERNEL} does not start: {console[-500:]}')
    output = (tmp_path / 'output.txt').read_text(encoding='utf-8', errors='replace')
    assert (tmp_path / 'exit').exists(), f'no end within {_LONGEST:g} s\n{console}\n{output}'
    assert (tmp_path / 'exit').read_text(encoding='ascii') == '0', output
    assert sum(passed_in(report) for report in tmp_path.glob('junit*.xml')) > 0, output


def run_inside(directory: Path, arguments: list[str]) -> str:
    """Run pytest inside, at most for _LONGEST; return what the kernel printed."""
    request = {
        'directory': str(ROOT),
        'arguments': arguments,
        'environment': dict(os.environ),
    }
    (directory / 'request.json').write_text(json.dumps(request), encoding='utf-8')
    process = subprocess.Popen(
        kernel_command(directory),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        env={**os.environ, **memory_file(directory), 'PATH': _path()},
    )
    try:
        console = process.communicate(timeout=_LONGEST)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        console = process.communicate()[0]
    return console.decode(errors='replace')


def kernel_command(directory: Path) -> list[str]:
    """Return how the kernel is started; its process 1 is a script that starts uml_guest.py."""
    script = directory / 'init'
    guest = [sys.executable, '-m', 'test.uml_guest', str(directory)]
    script.write_text(
        f'#!/bin/sh\nexport PATH={shlex.quote(_path())}\ncd {shlex.quote(str(ROOT))}\n'
        f'export PYTHONDONTWRITEBYTECODE=1\nexec {shlex.join(guest)}\n',
        encoding='utf-8',
    )
    script.chmod(0o755)
    return [
        *(_KERNEL, f'mem={_MEMORY}M', f'uml_dir={directory}/', 'quiet'),
        *('root=/dev/root', 'rootfstype=hostfs', 'rootflags=/', 'ro', f'init={script}'),
        *('con=null', 'con0=null,fd:1'),
    ]


def memory_file(directory: Path) -> dict[str, str]:
    """Return what has the kernel put its memory on disk where /dev/shm is too small for it."""
    with contextlib.suppress(OSError):
        if shutil.disk_usage('/dev/shm').free > _MEMORY << 20:
            return {}
    return {'TMPDIR': str(directory)}


def passed_in(report: Path) -> int:
    suite = ElementTree.parse(report).getroot()[0]
    return sum(len(case) == 0 for case in suite.iter('testcase'))


def _path() -> str:
    """Return where programs are, those for root included."""
    return f'{os.environ.get("PATH", "/usr/bin:/bin")}:/usr/sbin:/sbin'
