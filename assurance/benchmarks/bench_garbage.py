# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A VSC's port that delivers 1 MB/s of noise, half of it full of headers: what its node
takes, and whether others grow slower.

The flooded node is a second one, beside the three whose reaction is measured.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
import sys
import tempfile
import time
import tty

from assurance.benchmarks.chain import chain_of
from assurance.benchmarks.reaction import react, trials
from assurance.benchmarks.rig import Cost, Figures, figures, running, Size, use_own_domain, USUAL
from stage.rig import NodeProcess

RATE, PERIOD = 1_000_000, 0.005  # bytes/s, s
_HEADER = b'\x10\x01\x20\x06'  # of a heartbeat


def flood(path: str) -> None:
    """Make a pty, and write noise to it for ever."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.symlink(os.ttyname(slave), path)
    half = round(RATE * PERIOD / 2)
    headers = b''.join(_HEADER + os.urandom(4) for _ in range(half // 8))
    noise, due = os.urandom(half) + headers, time.monotonic()
    while True:
        left = memoryview(noise)
        while left:  # waits for the reader
            left = left[os.write(master, left) :]
        due = max(due + PERIOD, time.monotonic() - 10 * PERIOD)
        time.sleep(max(0.0, due - time.monotonic()))


def sent(pid: int) -> int:
    """Return how many bytes a process has written."""
    text = Path(f'/proc/{pid}/io').read_text(encoding='ascii')
    return int(next(line for line in text.splitlines() if line.startswith('wchar')).split()[1])


def measure(size: Size = USUAL) -> dict[str, Figures]:
    """Return the flooded node's per cent of a core, and the reactions (s) beside it and alone."""
    count, seconds = size.fewer, size.seconds
    with contextlib.ExitStack() as exits:
        folder = Path(exits.enter_context(tempfile.TemporaryDirectory()))
        port = folder / 'noise'
        chain = exits.enter_context(chain_of('three', folder))
        noise = exits.enter_context(running('-m', 'assurance.benchmarks.bench_garbage', str(port)))
        while not port.is_symlink():
            time.sleep(0.01)
        node = exits.enter_context(
            NodeProcess('fort_vsc_bridge.node', {'port': port}, namespace='/flooded')
        )
        chain.rest(1.0)
        cost, before, begin = (
            Cost({'flooded': node.process.pid}),
            sent(noise.pid),
            time.monotonic(),
        )
        chain.rest(seconds)
        rate = (sent(noise.pid) - before) / (time.monotonic() - begin)
        found = {'flooded node': {**cost.figures(), 'MB/s': rate / 1e6}}
        times, lost = trials(chain, 'estop', count)
        found['three estop, beside noise'] = {**figures(times), 'lost': lost}
    found['three estop, without noise'] = react('three', count).figures()
    return found


def main() -> None:
    use_own_domain()
    for name, found in measure().items():
        print(name, {key: float(f'{value:.3g}') for key, value in found.items()})


if __name__ == '__main__':
    if len(sys.argv) > 1:
        with contextlib.suppress(KeyboardInterrupt):
            flood(sys.argv[1])
    else:
        main()
