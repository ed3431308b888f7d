# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``python -m assurance.benchmarks [--quick] [--check] [GROUP...]``: measure, write or compare.

Groups that are named are measured alone, and replace their rows only. ``--check`` measures again
and compares ratios with those of the results, writes nothing, and exits with status 1 if one got
worse by a quarter.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import datetime
from importlib import metadata
import os
from pathlib import Path
import platform
import sys
import time

from assurance.benchmarks import (
    bench_beside,
    bench_can,
    bench_esi,
    bench_garbage,
    bench_memory,
    bench_mux,
    bench_start,
    reaction,
    results,
)
from assurance.benchmarks.rig import Figures, QUICK, Size, UnavailableError, use_own_domain, USUAL

Measure = Callable[[Size], dict[str, Figures]]


SHORT: dict[str, Measure] = {
    'reaction': reaction.measure,
    'esi': bench_esi.measure,
    'start': bench_start.measure,
    'memory': bench_memory.measure,
    'mux': bench_mux.measure,
}
GROUPS = SHORT | {
    'load': reaction.measure_load,
    'garbage': bench_garbage.measure,
    'beside': bench_beside.measure,
    'can': bench_can.measure,
}


def machine() -> dict[str, str]:
    """Return what the figures depend on."""
    lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    models = (line.partition(':')[2].strip() for line in lines if line.startswith('model name'))
    return {
        'processor': next(models, platform.machine()),
        'cores': str(os.cpu_count()),
        'kernel': platform.release(),
        'Python': platform.python_version(),
        'rclpy': _version('ros-jazzy-rclpy', 'rclpy'),
        'date': datetime.date.today().isoformat(),
    }


def _version(*distributions: str) -> str:
    for name in distributions:
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return 'unknown'


def measure(names: list[str], size: Size) -> tuple[dict[str, Figures], list[str]]:
    """Return what was measured, and the groups that could not be."""
    measured: dict[str, Figures] = {}
    failed = []
    for name in names:
        begin = time.monotonic()
        try:
            measured |= GROUPS[name](size)
        except UnavailableError as error:
            print(f'{name}: skipped, {error}', file=sys.stderr)
        except Exception as error:  # of one group: the others are worth having
            print(f'{name}: failed, {type(error).__name__}: {error}', file=sys.stderr)
            failed.append(name)
        else:
            print(f'{name}: {time.monotonic() - begin:.0f} s', file=sys.stderr, flush=True)
    return measured, failed


def main() -> None:
    parser = argparse.ArgumentParser(prog='python -m assurance.benchmarks', description=__doc__)
    parser.add_argument('groups', nargs='*', metavar='GROUP', help=', '.join(GROUPS))
    parser.add_argument('--quick', action='store_true', help='about 5 minutes, less sure')
    parser.add_argument('--check', action='store_true', help='compare, and write nothing')
    given = parser.parse_intermixed_args()
    unknown = [name for name in given.groups if name not in GROUPS]
    if unknown:
        parser.error(f'no group {unknown[0]!r}; there are {", ".join(GROUPS)}')
    use_own_domain()
    measured, failed = measure(
        given.groups or list(SHORT if given.quick else GROUPS), QUICK if given.quick else USUAL
    )
    now, before = results.rows(measured), results.load()
    print(results.table(machine(), now))
    worse = results.worse(before['rows'], now) if given.check else []
    for text in worse:
        print(f'worse: {text}')
    if not given.check:
        # What failed keeps its rows.
        kept = before['rows'] if given.groups or failed else []
        results.write(machine(), results.merged(kept, now))
    raise SystemExit(1 if worse or failed else 0)


if __name__ == '__main__':
    main()
