# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The suite, again and again while other work keeps all cores busy.

``python -m assurance.saturated [TIMES]`` runs ``make test`` TIMES times (ten), beside a loop
at nice 0 on each core. A run that failed is not repeated: it counts. With ``--json FILE``, which
has a line for each run, it goes on where it was, and keeps beside it what a run that failed said.
Exit status: 0 if all passed, 1 if one did not.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import contextlib
import json
from pathlib import Path
import re
import subprocess
import sys
import time
from typing import Any, Final

from assurance.benchmarks.rig import busy_cores

ROOT = Path(__file__).resolve().parents[1]
TIMES: Final = 10
_SUITE: Final = ('make', 'test')
_FAILED = re.compile('^(?:FAILED|ERROR) .*', re.MULTILINE)


def run(command: Sequence[str], log: Path | None) -> dict[str, Any]:
    """Run the suite once; return what became of it. :param log: for what a failed one said."""
    begin = time.monotonic()
    ended = subprocess.run(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    lines = ended.stdout.splitlines() or ['']
    if ended.returncode and log is not None:
        log.write_text(ended.stdout, encoding='utf-8')
    return {
        'status': ended.returncode,
        'seconds': round(time.monotonic() - begin),
        'ended': time.strftime('%Y-%m-%d %H:%M'),
        'failed': _FAILED.findall(ended.stdout),
        'words': next((line for line in reversed(lines) if ' passed' in line), lines[-1]),
    }


def main(arguments: Sequence[str] | None = None, command: Sequence[str] = _SUITE) -> int:
    """Run it as often; return the exit status."""
    parser = argparse.ArgumentParser(
        prog='assurance.saturated', description=(__doc__ or '').strip()
    )
    parser.add_argument('times', nargs='?', type=int, default=TIMES, help=f'({TIMES})')
    parser.add_argument('--json', type=Path, help='keep every run in this file, and go on there')
    parser.add_argument('--idle', action='store_true', help='without other work')
    given = parser.parse_args(arguments)
    runs: list[dict[str, Any]] = []
    if given.json and given.json.exists():
        runs = [json.loads(line) for line in given.json.read_text(encoding='utf-8').splitlines()]
    with contextlib.nullcontext() if given.idle else busy_cores():
        while len(runs) < given.times:
            log = given.json and given.json.with_suffix(f'.{len(runs) + 1}.log')
            runs.append(run(command, log))
            print(f'{len(runs):3}', *runs[-1].values(), flush=True)
            if given.json:
                with given.json.open('a', encoding='utf-8') as file:
                    file.write(json.dumps(runs[-1]) + '\n')
    passed = sum(not run['status'] for run in runs)
    print(f'{passed} of {len(runs)} passed')
    return int(passed < len(runs))


if __name__ == '__main__':
    sys.exit(main())
