# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Drive on a small computer: does anything stop unasked, and how long does a stop take?

``python -m assurance.small_computer [--minutes 20] [--share 0.25] [--json FILE]``, as root: the
six nodes of config/demo.yaml in one process get this share of one core, in slices of 10 ms, by a
cgroup that is removed at the end. The devices are outside of it; VSC and drive are played in C.
Meanwhile the remote's e-stop is pressed as by ``assurance.lossy``. Run it at an ordinary priority,
as real time has no quota.

Exit status 1: a stop was missed or undid itself, or one came that nobody asked for.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
import contextlib
import json
import os
from pathlib import Path
import signal
import sys
import tempfile
import time
from typing import Any, Final

from akron_can_bridge.simulator import Simulator as MonitorSimulator
from assurance.benchmarks.bench_memory import TRANSMITTER
from assurance.benchmarks.chain import MUX, Nodes
from assurance.benchmarks.rig import Cost, family, figures, Rig, UnavailableError, use_own_domain
from assurance.lossy import drive, HEAD, Run
from assurance.pauses import Pauses
from rugged_teleop.canbuses import CanBusDevice, free_channel
from rugged_teleop.multicasts import free_port, MulticastDevice
from ssc_bridge.simulator import Simulator as SscSimulator
from stage.devices import Device, MONITOR, SSC, UNIT
from stage.rig import Observer
from vm110_bridge.simulator import Simulator as UnitSimulator

ROOTS: Final = (Path('/sys/fs/cgroup/cpu'), Path('/sys/fs/cgroup'))  # version 1, version 2
_PERIOD = 10_000  # us
_SETTLE = 3.0  # s, in which each wire gets its spare
# Nobody measures motion here, or watches a zone.
_MUX: Final[dict[str, Any]] = {'feedback.topic': '', 'speed_limits': []}


class Quota:
    """
    A cgroup whose processes get a share of one core; a context manager.

    :raises UnavailableError: there can be none, and why.
    """

    def __init__(self, share: float, roots: Iterable[Path] = ROOTS) -> None:
        root = next((each for each in roots if (each / 'cgroup.procs').exists()), None)
        if root is None:
            raise UnavailableError('no cgroup of processors is mounted below /sys/fs/cgroup')
        self._folder = root / f'rugged_teleop_{os.getpid()}'
        quota = round(share * _PERIOD)
        try:
            self._folder.mkdir()
            if (self._folder / 'cpu.cfs_quota_us').exists():
                (self._folder / 'cpu.cfs_period_us').write_text(f'{_PERIOD}')
                (self._folder / 'cpu.cfs_quota_us').write_text(f'{quota}')
            else:
                (self._folder / 'cpu.max').write_text(f'{quota} {_PERIOD}')
        except OSError as error:
            self.__exit__()
            raise UnavailableError(f'{error}: be root, and let {root} share processors') from error
        self._procs = self._folder / 'cgroup.procs'

    def take(self, pids: Iterable[int]) -> None:
        """Have processes be in it; what they start later is, too."""
        for pid in pids:
            self._procs.write_text(f'{pid}')

    def throttled(self) -> float:
        """Return for how many seconds they have waited for the next slice."""
        words = (self._folder / 'cpu.stat').read_text().split()
        found = dict(zip(words[::2], map(int, words[1::2]), strict=True))
        return found.get('throttled_time', 0) / 1e9 or found.get('throttled_usec', 0) / 1e6

    def __enter__(self) -> Quota:
        return self

    def __exit__(self, *error: object) -> None:
        with contextlib.suppress(OSError):  # it is not there, or something in it does not end
            self._folder.rmdir()


@contextlib.contextmanager
def running(share: float) -> Iterator[tuple[Run, Quota]]:
    """Have the six drive with this share."""
    with contextlib.ExitStack() as exits:
        quota = exits.enter_context(Quota(share))
        folder = Path(exits.enter_context(tempfile.TemporaryDirectory()))
        unit = MulticastDevice(UnitSimulator(), free_port())
        monitor = CanBusDevice(MonitorSimulator(), free_channel())
        servo = Device(folder / 'ssc', SscSimulator())
        for device in (unit, monitor, servo):
            exits.callback(device.close)
        servo.apply(*TRANSMITTER)
        rig = exits.enter_context(Rig(folder))
        observer = exits.enter_context(Observer('small_computer'))
        pauses = exits.enter_context(Pauses())
        further: dict[str, dict[str, Any]] = {
            UNIT: {'input_port': unit.port},
            MONITOR: {'channel': monitor.channel},
            SSC: {'port': servo.path},
            MUX: _MUX,
        }
        chain = Nodes(rig, observer, exits, stack=True, further=further)
        chain.neutral_time += 0.2  # as the file has it
        run = Run(chain, pauses)
        run.move()
        chain.pause(_SETTLE)
        quota.take(family(chain.pids['stack']))
        yield run, quota


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; return the exit status."""
    parser = argparse.ArgumentParser(prog='assurance.small_computer', description=__doc__)
    parser.add_argument('--minutes', type=float, default=20.0, help='of motion (20)')
    parser.add_argument('--share', type=float, default=0.25, help='of one core (0.25)')
    parser.add_argument('--pulses', type=int, default=200, help='stops of 5 ms (200)')
    parser.add_argument('--json', type=Path, help='write all figures to this file')
    given = parser.parse_args(arguments)
    use_own_domain(profile=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # and leave no node behind
    try:
        with running(given.share) as (run, quota):
            begin, cost = time.monotonic(), Cost(run.chain.pids)
            drive(run, given.minutes, given.pulses)
            found = {
                **figures(run.result.reactions),
                **cost.figures(),
                'throttled': 100.0 * quota.throttled() / (time.monotonic() - begin),
            }
    except UnavailableError as error:
        print(f'small_computer: ended, {error}', file=sys.stderr)
        return 2
    print(f'{HEAD}\n| {given.share:g} of a core | 0 | {run.result.row()} |')
    print(run.result.words())
    print({name: float(f'{value:.3g}') for name, value in found.items()})
    if given.json:
        text = json.dumps(vars(given) | vars(run.result) | found, default=str, indent=1)
        given.json.write_text(text + '\n', encoding='utf-8')
    return int(bool(run.result.missed or run.result.false))


if __name__ == '__main__':
    sys.exit(main())
