# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
All the evidence: ``make proof``, or ``python -m assurance.proof [STEP]...``; takes a day.

Each step is a command. One that has passed is not done again until the sources change; one that
was interrupted goes on where it was, if it keeps that. ``build/proof.json`` has what each gave.
Exit status: 0 if all steps passed, 1 if one did not.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Mapping, Sequence
import hashlib
import json
from pathlib import Path
import subprocess
import sys
import time
from typing import Any, Final

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / 'build' / 'proof.json'
_SOURCES: Final = ('py', 'yaml', 'xml', 'c', 'json.gz')
_WORDS = 60  # lines of each step's end that are kept
# FILE is one for the step's figures, its own for each state of the sources.
STEPS: Final = {
    'states': '-m pytest -q -m proof',
    'campaign': '-m assurance.campaign --json FILE',
    'random': '-m assurance.campaign random -n 1000 --json FILE',
    'random-stack': '-m assurance.campaign random -n 1000 --stack --json FILE',
    'random-two-hosts': '-m assurance.campaign random -n 1000 --two-hosts --json FILE',
    'black-channel': '-m assurance.black_channel',
    'lossy': '-m assurance.lossy --json FILE',
    'ledger': '-m assurance.ledger_kills',
    'lossy-bursts': '-m assurance.lossy --bursts --link remote --json FILE',
    'soak': '-m assurance.soak 1 --json FILE',
    'soak-busy': '-m assurance.soak 1 --busy --json FILE',
    'suite': '-m assurance.saturated 10 --json FILE',
    'fuzz': '-m assurance.fuzz',
    'mutants': '-m assurance.mutants',
}


def digest_of_sources() -> str:
    """Return what changes with any file of the package, and of its tests, that a step reads."""
    files = sorted(path for kind in _SOURCES for path in ROOT.glob(f'[a-z]*/**/*.{kind}'))
    return hashlib.sha1(b''.join(path.read_bytes() for path in files)).hexdigest()[:12]


def run(step: str, results: Path, sources: str) -> dict[str, Any]:
    """Do a step, and show what it says; return the result. An interrupt is none."""
    file = results.parent / 'proof' / sources / f'{step}.json'
    file.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, *STEPS[step].replace('FILE', str(file)).split()]
    words: deque[str] = deque(maxlen=_WORDS)
    begin = time.monotonic()
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end='', flush=True)
            words.append(line.rstrip())
    return {
        'sources': sources,
        'command': STEPS[step],
        'status': process.returncode,
        'seconds': round(time.monotonic() - begin),
        'ended': time.strftime('%Y-%m-%d %H:%M'),
        'words': list(words),
    }


def main(arguments: Sequence[str] | None = None, results: Path = RESULTS) -> int:
    """Do the steps; return the exit status."""
    parser = argparse.ArgumentParser(prog='assurance.proof', description=(__doc__ or '').strip())
    parser.add_argument('steps', nargs='*', metavar='STEP', choices=[*STEPS, []])
    steps = parser.parse_args(arguments).steps or list(STEPS)
    known = json.loads(results.read_text(encoding='utf-8')) if results.exists() else {}
    sources = digest_of_sources()
    for step in steps:
        print(f'\n== {step}', flush=True)
        if not _has_passed(known.get(step), sources):
            known[step] = run(step, results, sources)
            scratch = results.with_suffix('.new')
            scratch.write_text(json.dumps(known, indent=1) + '\n', encoding='utf-8')
            scratch.replace(results)
    print()
    for step in steps:
        result = known[step]
        outcome = 'passed' if not result['status'] else f'failed, status {result["status"]}'
        print(f'{step:20} {outcome:20} {result["seconds"]:6} s  {result["ended"]}')
    return int(any(known[step]['status'] for step in steps))


def _has_passed(result: Mapping[str, Any] | None, sources: str) -> bool:
    return result is not None and result['sources'] == sources and not result['status']


if __name__ == '__main__':
    sys.exit(main())
