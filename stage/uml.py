# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The host's side of user-mode-linux: a kernel that runs tests."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
import json
import os
from pathlib import Path
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from xml.etree import ElementTree

from stage.rig import ROOT

KERNEL = 'linux.uml'
LONGEST = 580.0  # seconds; pytest takes a test that lasts 600 for one that hangs
_MODULES = Path('/usr/lib/uml/modules')
_INSTALL = 'apt install user-mode-linux iproute2'
_MEMORY = 1024  # MiB
# The kernel has processes of its own, which outlive a signal to the first; and whoever sends us
# SIGKILL gives us no time to end anything. So a shell waits for the end of a pipe from us, and
# then ends the whole session.
_ENDS_WITH_US = (
    *('/bin/sh', '-c'),
    'exec 3<&0 </dev/null; (read -r _ <&3; kill -KILL 0) >/dev/null 2>&1 & exec "$@" 3<&-',
    'sh',
)


@dataclass(frozen=True)
class Result:
    """What a kernel left: what it printed, and its directory; see uml_guest.py."""

    console: str
    directory: Path

    @property
    def booted(self) -> bool:
        return (self.directory / 'booted').exists()

    @property
    def output(self) -> str:
        """What pytest printed in there."""
        file = self.directory / 'output.txt'
        return file.read_text(encoding='utf-8', errors='replace') if file.exists() else ''

    @property
    def fault(self) -> str:
        """What went wrong; empty: all passed."""
        exit_code = self.directory / 'exit'
        if not exit_code.exists():
            return f'no end within {LONGEST:g} s'
        if exit_code.read_text(encoding='ascii') != '0':
            return 'tests failed'
        return '' if passed_in(self.directory / 'junit.xml') else 'no test ran'


def run_in_kernel(directory: Path, mark: str) -> Result:
    """
    Run the tests with this mark in a kernel of their own, at most for LONGEST.

    :param directory: what passes between us and the kernel; see uml_guest.py.
    """
    request = {'directory': str(ROOT), 'arguments': arguments(mark), 'environment': {**os.environ}}
    (directory / 'request.json').write_text(json.dumps(request), encoding='utf-8')
    with subprocess.Popen(
        [*_ENDS_WITH_US, *kernel_command(directory)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        env={**os.environ, **memory_file(directory), 'PATH': path()},
    ) as process:
        assert process.stdout is not None
        killer = threading.Timer(LONGEST, os.killpg, (process.pid, signal.SIGKILL))
        killer.start()
        try:
            console = process.stdout.read()
        finally:
            killer.cancel()
    return Result(console.decode(errors='replace'), directory)


def arguments(mark: str) -> list[str]:
    """Return what makes pytest run all that has this mark, and import nothing else."""
    files = sorted((ROOT / 'test').rglob('test_*.py'))
    text = f'pytest.mark.{mark}'
    return ['-m', mark, *(str(file) for file in files if text in file.read_text('utf-8'))]


def missing() -> str:
    """Return what has to be installed before anything can run; empty: nothing."""
    needed = [
        name for name in (KERNEL, 'ip', 'tc', 'mount') if shutil.which(name, path=path()) is None
    ]
    if not needed and not _MODULES.is_dir():
        needed = [str(_MODULES)]
    return f'{", ".join(needed)} not found; {_INSTALL}' if needed else ''


def kernel_command(directory: Path) -> list[str]:
    """Return how the kernel is started; its process 1 is a script that starts uml_guest.py."""
    script = directory / 'init'
    guest = [sys.executable, '-m', 'stage.uml_guest', str(directory)]
    script.write_text(
        f'#!/bin/sh\nexport PATH={shlex.quote(path())}\ncd {shlex.quote(str(ROOT))}\n'
        f'export PYTHONDONTWRITEBYTECODE=1\nexec {shlex.join(guest)}\n',
        encoding='utf-8',
    )
    script.chmod(0o755)
    return [
        *(KERNEL, f'mem={_MEMORY}M', f'uml_dir={directory}/', 'quiet'),
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


def path() -> str:
    """Return where programs are, those for root included."""
    return f'{os.environ.get("PATH", "/usr/bin:/bin")}:/usr/sbin:/sbin'
