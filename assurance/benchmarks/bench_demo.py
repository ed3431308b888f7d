# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How often the scripted demo holds, without a second try; argument: how often it is tried."""

from __future__ import annotations

import re
import subprocess
import sys

from assurance.benchmarks.rig import Figures, figures
from stage.rig import ROOT

_TIME = 300.0  # s
# Of the motors: what a monitor and a servo do has ", to ..." behind the cause.
_REACTION = re.compile(r'^ *([\d.]+) ms  (?!.*, to ).*e-stop', re.MULTILINE)


def measure(quick: bool = False, count: int = 10) -> dict[str, Figures]:
    """Return how many runs failed, and the motors' reactions (s) to e-stops."""
    held, reactions = 0, []
    count = 3 if quick else count
    for _ in range(count):
        run = subprocess.run(
            [sys.executable, '-m', 'demo', '--once'],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_TIME,
            check=False,
        )
        held += run.returncode == 0
        reactions += [float(text) / 1e3 for text in _REACTION.findall(run.stdout)]
        if run.returncode:
            print(next((line for line in run.stdout.splitlines() if 'FAILED' in line), run.stderr))
    return {'demo': {'failed': count - held, 'n': count}, 'demo e-stop': figures(reactions)}


def main() -> None:
    print(measure(count=int((sys.argv[1:] or ['10'])[0])))


if __name__ == '__main__':
    main()
