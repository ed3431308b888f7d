# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What runs as process 1 inside user-mode-linux: readies the kernel for CAN, runs tests, halts.

The host's files are the root, read-only. Everything written goes to memory, except what is for
the host, in the directory that the first argument names:

=============  =============================================================
file           what
=============  =============================================================
request.json   from the host: environment, directory, arguments for pytest
booted         the kernel and its CAN modules work
output.txt     what pytest printed
junit.xml      what it ran
exit           its exit code
=============  =============================================================
"""

from __future__ import annotations

import ctypes
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

_MODULES = (  # each after those that it needs
    *('kernel/net/can/can', 'kernel/net/can/can-raw', 'kernel/drivers/net/can/dev/can-dev'),
    *('kernel/drivers/net/can/vcan', 'kernel/drivers/net/can/slcan/slcan'),
    'kernel/net/sched/sch_plug',
)
_FINIT_MODULE = 313  # asm/unistd_64.h
_POWER_OFF = 0x4321FEDC  # linux/reboot.h
_MEMORY = Path('/dev/shm')
_HOST = _MEMORY / 'host'
_SCRATCH = _MEMORY / 'scratch'
_libc = ctypes.CDLL(None, use_errno=True)


def main(host_directory: str) -> None:
    mount_all(host_directory)
    load_modules()
    run('ip', 'link', 'set', 'lo', 'up')
    (_HOST / 'booted').touch()
    request = json.loads((_HOST / 'request.json').read_text(encoding='utf-8'))
    code = run_tests(request, '--junitxml', f'{_HOST}/junit.xml')
    (_HOST / 'exit').write_text(str(code), encoding='ascii')


def run_tests(request: dict[str, Any], *options: str) -> int:
    """Run pytest as the host asks; return its exit code."""
    with (_HOST / 'output.txt').open('ab') as output:
        return subprocess.run(
            [sys.executable, '-m', 'pytest', *request['arguments'], *options],
            cwd=request['directory'],
            env={**request['environment'], **own_environment()},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            check=False,
        ).returncode


def mount_all(host_directory: str) -> None:
    """Mount what is not the host's. /dev is of this kernel already, and in memory."""
    for kind, place in (('proc', '/proc'), ('sysfs', '/sys'), ('tmpfs', _MEMORY)):
        mount(kind, Path(place))
    mount('devpts', Path('/dev/pts'))
    mount('hostfs', _HOST, '-o', host_directory)
    _SCRATCH.mkdir()


def mount(kind: str, place: Path, *options: str) -> None:
    if not place.is_dir():
        place.mkdir()
    run('mount', '-t', kind, 'none', str(place), *options)


def load_modules() -> None:
    """Load without kmod, which need not be there. :raises OSError: a module does not load."""
    for module in _MODULES:
        path = f'/usr/lib/uml/modules/{os.uname().release}/{module}.ko'
        descriptor = os.open(path, os.O_RDONLY)
        if _libc.syscall(_FINIT_MODULE, descriptor, b'', 0):
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), path)
        os.close(descriptor)


def own_environment() -> dict[str, str]:
    return {
        'RUGGED_TELEOP_CAN': 'socketcan',
        'RUGGED_TELEOP_PATIENCE': '4',
        'HOME': str(_SCRATCH),
        'TMPDIR': str(_SCRATCH),
        'HYPOTHESIS_STORAGE_DIRECTORY': str(_SCRATCH / 'hypothesis'),
        'PYTHONDONTWRITEBYTECODE': '1',
        'PYTEST_ADDOPTS': f'-o cache_dir={_SCRATCH}/cache',
    }


def run(*command: str) -> None:
    subprocess.run(command, check=True, timeout=30.0)


if __name__ == '__main__':
    try:
        main(sys.argv[1])
    finally:
        os.sync()
        _libc.reboot(_POWER_OFF)
