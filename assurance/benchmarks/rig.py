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
import re
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
_PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')

Figures = dict[str, float]


class Size(NamedTuple):
    """How much is measured: stops, further ones, starts; seconds of watching and of holding."""

    stops: int
    fewer: int
    starts: int
    seconds: float
    hold: float


USUAL = Size(300, 60, 20, 15.0, 600.0)
QUICK = Size(20, 8, 5, 5.0, 20.0)
ONCE = Size(1, 1, 1, 0.3, 1.0)  # whether it works at all


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


def resident(pid: int) -> float:
    """Return the resident memory, in MB (2**20 bytes); 0 where it is gone."""
    with contextlib.suppress(OSError):
        for line in Path(f'/proc/{pid}/status').read_text().splitlines():
            if line.startswith('VmRSS:'):
                return int(line.split()[1]) / 1024
    return 0.0


class Spent(NamedTuple):
    """What processes have spent: seconds of a processor, and how often a thread has waited."""

    time: float
    waits: int


def spent_by(pid: int) -> Spent:
    """Return what the threads of a process have spent; none where it is gone."""
    return _sum(_threads(pid).values())


def _threads(pid: int) -> dict[str, Spent]:
    """Return the same by the names that the kernel shows for threads."""
    found: dict[str, list[Spent]] = {}
    for task in Path(f'/proc/{pid}/task').glob('*'):
        with contextlib.suppress(OSError):  # it has ended
            spent = int((task / 'schedstat').read_text().split()[0]) / 1e9
            status = (task / 'status').read_text()
            waits = int(re.findall(r'^voluntary_ctxt_switches:\s+(\d+)', status, re.M)[0])
            found.setdefault((task / 'comm').read_text().strip(), []).append(Spent(spent, waits))
    return {name: _sum(each) for name, each in found.items()}


def _sum(spent: Iterable[Spent]) -> Spent:
    return Spent(*map(sum, zip(Spent(0.0, 0), *spent, strict=True)))


def _packets() -> int:
    """Return how many UDP packets this machine has sent."""
    lines = Path('/proc/net/snmp').read_text(encoding='ascii').splitlines()
    names, values = (line.split() for line in lines if line.startswith('Udp: '))
    return int(values[names.index('OutDatagrams')])


def _idle() -> tuple[int, int]:
    """Return the ticks in which all processors were idle, and all ticks."""
    head = Path('/proc/stat').read_text(encoding='ascii').splitlines()[0]
    ticks = [int(word) for word in head.split()[1:9]]  # those of guests are among them
    return ticks[3] + ticks[4], sum(ticks)


def proportional(pid: int) -> float:
    """Return the memory in MB, of what is shared its part (PSS); 0 where it is gone."""
    with contextlib.suppress(OSError):
        text = Path(f'/proc/{pid}/smaps_rollup').read_text(encoding='ascii')
        return int(re.findall(r'^Pss:\s+(\d+)', text, re.M)[0]) / 1024
    return 0.0


class Cost:
    """Samples what processes and their descendants cost; by name. :param pids: by name."""

    def __init__(self, pids: dict[str, int]) -> None:
        self._pids = {name: family(pid) for name, pid in pids.items()}
        self._begin, self._spent = time.monotonic(), self._now()
        self._packets, self._idle = _packets(), _idle()

    def _now(self) -> dict[str, dict[str, Spent]]:
        return {
            name: {
                # A wire's own title begins with its node.
                f'{pid} {title(pid).partition(":")[0] if n else name} {thread}': spent
                for n, pid in enumerate(pids)
                for thread, spent in _threads(pid).items()
            }
            for name, pids in self._pids.items()
        }

    def _since(self) -> dict[str, dict[str, tuple[float, float]]]:
        """Return per cent of a core and wake-ups a second, by name and thread."""
        elapsed, now = time.monotonic() - self._begin, self._now()

        def each(spent: Spent, before: Spent) -> tuple[float, float]:
            return (
                100.0 * (spent.time - before.time) / elapsed,
                (spent.waits - before.waits) / elapsed,
            )

        return {
            name: {n: each(now[name].get(n, was), was) for n, was in threads.items()}
            for name, threads in self._spent.items()
        }

    def shares(self) -> dict[str, float]:
        """Return the per cent of a core since the start, by name."""
        return {
            name: sum(share for share, _ in threads.values())
            for name, threads in self._since().items()
        }

    def thread(self, name: str) -> float:
        """Return the per cent of a core since the start of all threads with this name."""
        found = (each.items() for each in self._since().values())
        return sum(share for threads in found for n, (share, _) in threads if n.endswith(name))

    def threads(self) -> str:
        """Return a table of the threads that cost most, for people."""
        rows = [
            (share, waits, thread.partition(' ')[2])
            for threads in self._since().values()
            for thread, (share, waits) in threads.items()
            if waits >= 1.0
        ]
        return '% of a core  wake-ups/s  us each  thread\n' + ''.join(
            f'{share:11.2f} {waits:11.0f} {share / waits * 1e4:8.0f}  {thread}\n'
            for share, waits, thread in sorted(rows, reverse=True)
        )

    def figures(self) -> Figures:
        """
        Return per cent of a core, and what tells it from other runs, of all together.

        Packets and the idle share of all processors are the machine's.
        """
        elapsed = time.monotonic() - self._begin
        since = [each for threads in self._since().values() for each in threads.values()]
        idle, ticks = (after - was for after, was in zip(_idle(), self._idle, strict=True))
        return {
            'cpu': sum(share for share, _ in since),
            'wake-ups/s': sum(waits for _, waits in since),
            'packets/s': (_packets() - self._packets) / elapsed,
            'PSS': sum(proportional(pid) for pids in self._pids.values() for pid in pids),
            'idle': 100.0 * idle / max(1, ticks),
        }


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
