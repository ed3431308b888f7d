# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Standard output, standard error and the log file, none of which ever blocks.

A terminal that was stopped with Ctrl-S, a pipe that nobody reads or a disk that hangs blocks
whoever writes. That may be C code of ROS that holds the interpreter's lock meanwhile, and then no
thread of the process runs. So descriptors 1 and 2 become pipes that refuse what they have no room
for, and a process of its own (drain.py) empties them. It writes the log file, too, in the place of
ROS, which would do it in whatever thread logs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import contextlib
import fcntl
import io
import os
from pathlib import Path
import stat
import subprocess
import sys
import time

_PIPE_SIZE = 1 << 20  # bytes, as much as anybody may have
_LAST_TIME = 0.3  # s, for what was said last
_DRAIN = Path(__file__).with_name('drain.py')
_COLOURS = 'RCUTILS_COLORIZED_OUTPUT'
_NO_FILE = '--disable-external-lib-logs'  # the words of ROS
NO_SHOW = '--disable-stdout-logs'  # on standard error
_FILE_NAME = '--log-file-name'
_MAINS = ('node.py', '__main__.py', 'main.py')  # named for their package


def log_file(argv: Sequence[str]) -> str:
    """Return the log file of a process, where ROS would have it; empty: there is to be none."""
    if _NO_FILE in argv:
        return ''
    home = os.environ.get('ROS_HOME') or '~/.ros'
    folder = os.path.expanduser(os.environ.get('ROS_LOG_DIR') or f'{home}/log')
    program = Path(argv[0])
    name = program.parent.name if program.name in _MAINS else program.stem
    if _FILE_NAME in argv[:-1]:
        name = argv[argv.index(_FILE_NAME) + 1]
    return str(Path(folder).absolute() / f'{name}_{os.getpid()}_{time.time_ns() // 1000000}.log')


def without_ros_log_file(argv: Sequence[str]) -> list[str]:
    """Return the command line with which ROS writes no log file itself."""
    return [*(word for word in argv if word != NO_SHOW), '--ros-args', _NO_FILE, '--']


@contextlib.contextmanager
def unblocked_output(log: str = '', *, shown: bool = True) -> Iterator[None]:
    """
    Have whatever is written to descriptors 1 and 2 not wait, where it could.

    :param log: the file that gets what is written to 2 as well; empty: none.
    :param shown: what is written to 2 goes there, too.
    """
    drains: dict[tuple[int, int], tuple[subprocess.Popen[bytes], int]] = {}  # by file
    wanted = [number for number in (2, 1) if _may_block(number) or (log and number == 2)]
    kept = {number: os.dup(number) for number in wanted}
    streams = sys.stdout, sys.stderr
    if 2 in kept and os.isatty(2):
        os.environ.setdefault(_COLOURS, '1')  # ROS would not see that it is a terminal
    for number, real in kept.items():
        status = os.fstat(real)
        file = status.st_dev, status.st_ino
        target = real
        if number == 2 and not shown:
            file, target = (0, 0), subprocess.DEVNULL
        if file not in drains:
            drains[file] = _start_drain(target, log if number == 2 else '')
        os.dup2(drains[file][1], number)
    for _, pipe in drains.values():
        os.close(pipe)
    if 1 in kept:
        sys.stdout = _stream(1)
    if 2 in kept:
        sys.stderr = _stream(2)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = streams
        for number, real in kept.items():
            os.dup2(real, number)
            os.close(real)
        for drain, _ in drains.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                drain.wait(_LAST_TIME)


def escape_what_is_no_text() -> None:
    """Have standard output and error escape what they cannot encode, such as a file's name."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')


def _may_block(number: int) -> bool:
    """Tell whether a descriptor is more than /dev/null or the like: a file's disk may hang."""
    try:
        return not stat.S_ISCHR(os.fstat(number).st_mode) or os.isatty(number)
    except OSError:  # closed
        return False


def _start_drain(real: int, log: str) -> tuple[subprocess.Popen[bytes], int]:
    """Start the process that writes to ``real`` and ``log``; return it and the pipe to it."""
    read, write = os.pipe()
    with contextlib.suppress(OSError):  # the user has too many
        fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
    os.set_blocking(write, False)
    # In a session of its own: Ctrl-C is for the node, whose last words are still to be shown.
    drain = subprocess.Popen(
        [sys.executable, '-I', '-S', str(_DRAIN), *([log] if log else [])],
        stdin=read,
        stdout=real,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    os.close(read)
    return drain, write


def _stream(number: int) -> io.TextIOWrapper:
    return io.TextIOWrapper(
        _Lossy(number),
        encoding='utf-8',
        errors='backslashreplace',
        write_through=True,
    )


class _Lossy(io.RawIOBase):
    """Writes what there is room for, and raises nothing: print is not made to fail."""

    def __init__(self, number: int) -> None:
        self._number = number
        self.name = f'<descriptor {number}>'

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._number

    def write(self, data: bytes) -> int:  # type: ignore[override]
        with contextlib.suppress(OSError):
            os.write(self._number, data)
        return len(data)
