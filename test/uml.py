"""The host's side of user-mode-linux: kernels that run test files, one after another."""

from __future__ import annotations

from collections.abc import Sequence
import concurrent.futures
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
import tempfile
from types import TracebackType
from xml.etree import ElementTree

from test.rig import ROOT

KERNEL = 'linux.uml'
LONGEST = 900.0  # seconds a file; a single test in there hangs after 300
_MODULES = Path('/usr/lib/uml/modules')
_INSTALL = 'apt install user-mode-linux iproute2'
_MEMORY = 1024  # MiB
_ARGUMENTS = ('-m', 'can_bus', '-o', 'faulthandler_timeout=300')


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
        return '' if any(map(passed_in, self.directory.glob('junit*.xml'))) else 'no test ran'


class Kernels:
    """Runs test files in the background. Use it as a context manager."""

    def __init__(self, directory: Path, files: Sequence[str]) -> None:
        self._directory = directory
        self._environment = dict(os.environ)
        self._running: set[subprocess.Popen[bytes]] = set()
        self._pool = concurrent.futures.ThreadPoolExecutor(1)
        self._results = {file: self._pool.submit(self._run, file) for file in files}

    def result(self, file: str) -> Result:
        """
        Return what came of it; wait for it.

        What failed beside others is run once more when these are done; that counts.
        """
        result = self._results[file].result()
        if result.booted and result.fault:
            concurrent.futures.wait(self._results.values())
            print(f'once more, alone: {result.fault}\n{result.output}')
            result = self._run(file)
        return result

    def __enter__(self) -> Kernels:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in list(self._running):
            end(process)
        self._pool.shutdown()

    def _run(self, file: str) -> Result:
        """Run the tests of a file, at most for LONGEST."""
        directory = Path(tempfile.mkdtemp(dir=self._directory))
        request = {
            'directory': str(ROOT),
            'arguments': [f'test/{file}', *_ARGUMENTS],
            'environment': self._environment,
        }
        (directory / 'request.json').write_text(json.dumps(request), encoding='utf-8')
        process = subprocess.Popen(
            kernel_command(directory),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**self._environment, **memory_file(directory), 'PATH': path()},
        )
        self._running.add(process)
        try:
            console = process.communicate(timeout=LONGEST)[0]
        except subprocess.TimeoutExpired:
            end(process)
            console = process.communicate()[0]
        self._running.discard(process)
        return Result(console.decode(errors='replace'), directory)


def end(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


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
    guest = [sys.executable, '-m', 'test.uml_guest', str(directory)]
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
