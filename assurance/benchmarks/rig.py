# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the benchmarks share: the devices in C, what processes cost, and quantiles."""

from __future__ import annotations

import atexit
from collections.abc import Iterable, Iterator, Sequence
import contextlib
import functools
import itertools
import os
from pathlib import Path
import select
import shutil
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

from stage.rig import own_domain

SOURCE = Path(__file__).with_name('rig.c')
_COMPILERS = ('cc', 'gcc', 'clang')
_ANSWER_TIME = 5.0  # s
_TICKS = os.sysconf('SC_CLK_TCK')
_PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')

Figures = dict[str, float]


class UnavailableError(Exception):
    """What a benchmark needs is not there: it is skipped, and says so."""


def use_own_domain(*, profile: bool = False) -> None:
    """
    Use a ROS domain that nobody else does, on this machine only.

    :param profile: config/fastdds_loopback.xml; without it Fast DDS uses shared memory.
    """
    own_domain()
    if profile:
        return
    for name in _PROFILES:
        os.environ.pop(name, None)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'


def figures(values: Iterable[float]) -> Figures:
    """Return p50, p90, p99, max and n; n alone where there are no values."""
    ordered = sorted(values)
    if not ordered:
        return {'n': 0}
    last = len(ordered) - 1
    result = {f'p{p}': ordered[min(last, int(len(ordered) * p / 100))] for p in (50, 90, 99)}
    return {**result, 'max': ordered[last], 'n': len(ordered)}


# The devices.


class Packet(NamedTuple):
    """A command packet at the drive: when its last byte was read (s, monotonic), and axis A."""

    at: float
    enables: bool
    command: int


@functools.cache
def build() -> Path:
    """Return the devices' program. :raises UnavailableError: there is no C compiler."""
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise UnavailableError(f'no C compiler for {SOURCE.name}: {", ".join(_COMPILERS)}')
    folder = tempfile.mkdtemp(prefix='rugged_teleop_rig_')
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    subprocess.run([compiler, '-O2', '-o', f'{folder}/rig', str(SOURCE)], check=True)
    return Path(folder) / 'rig'


class Rig:
    """
    A VSC and a drive on two ptys; see rig.c for what they obey. A context manager.

    :param environment: as rig.c has it. :param priority: SCHED_FIFO; 0: none.
    """

    def __init__(
        self, folder: Path, environment: dict[str, str] | None = None, priority: int = 0
    ) -> None:
        self.vsc, self.drive = folder / 'vsc', folder / 'drive'
        self._process = subprocess.Popen(
            [str(build()), str(self.vsc), str(self.drive)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **(environment or {})},
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._input, self._output = self._process.stdin, self._process.stdout
        self._text = b''
        if self._line(_ANSWER_TIME) != ['ready']:
            raise UnavailableError('the rig does not start')
        if priority:
            os.sched_setscheduler(self._process.pid, os.SCHED_FIFO, os.sched_param(priority))

    def say(self, *commands: str) -> None:
        """Have the devices obey."""
        self._input.write(''.join(f'{command}\n' for command in commands).encode())
        self._input.flush()

    def fire(self, what: str, timeout: float = 3.0) -> float | None:
        """Return the seconds from this stop to the first disable packet; None: none came."""
        self.say(f'fire {what}')
        while (line := self._line(timeout)) and line[0] != 't':
            pass
        return int(line[1]) / 1e9 if line else None

    def moves(self) -> bool:
        """Tell whether the newest packet enables, and asks for motion."""
        _, enable, command, *_ = self._ask('stat', 's')
        return enable == '1' and command != '0'

    def enabled(self) -> bool:
        """Tell whether the newest packet enables."""
        return self._ask('stat', 's')[1] == '1'

    def packets(self, since: float) -> list[Packet]:
        """Return the packets after a moment (s, monotonic), of at most the last 262144."""
        self.say(f'packets {round(since * 1e9)}')
        found = []
        while (line := self._line(_ANSWER_TIME)) != ['end']:
            if not line:
                raise UnavailableError('the rig does not answer')
            if line[0] == 'k':
                found.append(Packet(int(line[1]) / 1e9, line[2] == '1', int(line[3])))
        return found

    def _ask(self, command: str, tag: str) -> list[str]:
        self.say(command)
        while (line := self._line(_ANSWER_TIME)) and line[0] != tag:
            pass
        if not line:
            raise UnavailableError('the rig does not answer')
        return line

    def _line(self, timeout: float) -> list[str]:
        """Return the words of the next line; none: it did not come in time."""
        end = time.monotonic() + timeout
        while b'\n' not in self._text:
            left = end - time.monotonic()
            if left <= 0.0 or not select.select([self._output], [], [], left)[0]:
                return []
            data = os.read(self._output.fileno(), 65536)
            if not data:
                return []
            self._text += data
        line, _, self._text = self._text.partition(b'\n')
        return line.decode().split()

    def close(self) -> None:
        """Take the devices away."""
        self._input.close()
        self._process.terminate()
        self._process.wait(5.0)
        self._output.close()
        for link in (self.vsc, self.drive):
            link.unlink(missing_ok=True)

    def __enter__(self) -> Rig:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def gaps(packets: Sequence[Packet]) -> list[float]:
    """Return the seconds between packets."""
    return [after.at - before.at for before, after in itertools.pairwise(packets)]


# Processes.


def title(pid: int) -> str:
    """Return the command line; empty where it is gone."""
    with contextlib.suppress(OSError):
        return Path(f'/proc/{pid}/cmdline').read_text().replace('\0', ' ').strip()
    return ''


def children(pid: int) -> list[int]:
    """Return the children of all threads of a process."""
    found = []
    with contextlib.suppress(OSError):
        for task in Path(f'/proc/{pid}/task').iterdir():
            found += [int(word) for word in (task / 'children').read_text().split()]
    return found


def family(pid: int) -> list[int]:
    """Return a process and its descendants."""
    return [pid, *(member for child in children(pid) for member in family(child))]


def wires_of(pid: int) -> list[int]:
    """Return the processes of a node, or of several, that run a wire; a spare does not."""
    return [member for member in family(pid)[1:] if is_wire(member)]


def is_wire(pid: int) -> bool:
    """Tell whether a process runs a wire."""
    with contextlib.suppress(OSError):
        return Path(f'/proc/{pid}/comm').read_text() == 'wire\n'
    return False


def processor_time(pid: int) -> float:
    """Return the seconds of processor time spent; 0 where it is gone."""
    with contextlib.suppress(OSError):
        fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICKS
    return 0.0


def resident(pid: int) -> float:
    """Return the resident memory, in MB (2**20 bytes); 0 where it is gone."""
    with contextlib.suppress(OSError):
        for line in Path(f'/proc/{pid}/status').read_text().splitlines():
            if line.startswith('VmRSS:'):
                return int(line.split()[1]) / 1024
    return 0.0


class Cost:
    """Samples what processes and their descendants cost; by name. :param pids: by name."""

    def __init__(self, pids: dict[str, int]) -> None:
        self._pids = {name: family(pid) for name, pid in pids.items()}
        self._wires = {name: wires_of(pid) for name, pid in pids.items()}
        self._begin, self._spent = time.monotonic(), self._times()

    def _times(self) -> dict[str, float]:
        return {n: sum(map(processor_time, pids)) for n, pids in self._pids.items()}

    def shares(self) -> dict[str, float]:
        """Return the per cent of a core since the start, by name."""
        elapsed = time.monotonic() - self._begin
        spent = self._times()
        return {n: 100.0 * (spent[n] - before) / elapsed for n, before in self._spent.items()}

    def memory(self) -> dict[str, float]:
        """Return the MB of each node, and of its largest wire process as ``NAME: wire``."""
        found = {name: resident(pids[0]) for name, pids in self._pids.items()}
        for name, wires in self._wires.items():
            if wires:
                found[f'{name}: wire'] = max(map(resident, wires))
        return found


@contextlib.contextmanager
def running(
    *command: str, priority: int = 0, apart: bool = False
) -> Iterator[subprocess.Popen[bytes]]:
    """
    Run this Python with these arguments meanwhile.

    :param priority: SCHED_FIFO; 0: none. :param apart: as a program of another terminal or
        service, with a share of the processors of its own (sched(7): autogroup).
    """
    process = subprocess.Popen(
        [sys.executable, *command],
        cwd=Path(__file__).resolve().parents[2],
        stdin=subprocess.DEVNULL,
        start_new_session=apart,
    )
    if priority:
        os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(priority))
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def busy_cores(*, apart: bool = False) -> Iterator[None]:
    """Have every core busy with other work, at nice 0. :param apart: as in running()."""
    with contextlib.ExitStack() as stack:
        for _ in range(os.cpu_count() or 1):
            stack.enter_context(running('-S', '-c', 'while True: pass', apart=apart))
        yield
