# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What recorder and status page cost beside the nodes that decide, and what a stop takes then."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path
import re
import tempfile
import threading
import time
from typing import Any

import aiohttp

from assurance.benchmarks.chain import chain_of, Nodes
from assurance.benchmarks.reaction import react, trials
from assurance.benchmarks.rig import Cost, Figures, figures, Size, use_own_domain, USUAL
from stage.page_rig import watch
from stage.rig import NodeProcess

BROWSERS = 20
_SETTLE = 3.0  # s


class Browsers(threading.Thread):
    """They take every snapshot of a page; ``taken`` counts them, browser by browser."""

    def __init__(self, address: str) -> None:
        super().__init__(daemon=True)
        self.taken = [0] * BROWSERS
        self._address = address
        self.start()

    def run(self) -> None:
        with contextlib.suppress(AssertionError, aiohttp.ClientError):  # the page has ended
            asyncio.run(self._look())

    async def _look(self) -> None:
        async with aiohttp.ClientSession() as session:
            await asyncio.gather(*(self._watch(session, n) for n in range(BROWSERS)))

    async def _watch(self, session: aiohttp.ClientSession, number: int) -> None:
        def take(snapshot: dict[str, Any]) -> bool:
            del snapshot
            self.taken[number] += 1
            return False

        await watch(session, self._address, take, timeout=3600.0)


def measure(size: Size = USUAL) -> dict[str, Figures]:
    """Return per cent of a core in motion, and the reactions (s) beside both and alone."""
    count, seconds = size.fewer, size.seconds
    with contextlib.ExitStack() as exits:
        folder = Path(exits.enter_context(tempfile.TemporaryDirectory()))
        chain = exits.enter_context(chain_of('three', folder))
        assert isinstance(chain, Nodes)
        recorder = exits.enter_context(
            NodeProcess('rugged_teleop.recorder.node', {'folder': folder / 'recordings'})
        )
        page = exits.enter_context(NodeProcess('rugged_teleop.status_page.node', {'port': 0}))
        page.wait_output('http://127.0.0.1:')
        pids = {'recorder': recorder.process.pid, 'page': page.process.pid}

        def shares() -> Figures:
            chain.move()
            chain.pause(_SETTLE)
            cost = Cost(pids)
            chain.pause(seconds)
            return cost.shares()

        alone = shares()
        found = {'recorder': {'cpu': alone['recorder']}, 'page': {'cpu': alone['page']}}
        browsers = Browsers(re.findall(r'http://127\.0\.0\.1:\d+', page.output)[0])
        chain.wait(lambda: all(browsers.taken), 'a snapshot for each browser')
        before, begin = sum(browsers.taken), time.monotonic()
        found['page, browsers'] = {'cpu': shares()['page'], 'n': BROWSERS}
        rate = (sum(browsers.taken) - before) / (time.monotonic() - begin)
        found['page, browsers']['snapshots/s'] = rate / BROWSERS
        times, lost = trials(chain, 'estop', count)
        found['three estop, beside both'] = {**figures(times), 'lost': lost}
    found['three estop, beside neither'] = react('three', count).figures()
    return found


def main() -> None:
    use_own_domain()
    for name, found in measure().items():
        print(name, {key: float(f'{value:.3g}') for key, value in found.items()})


if __name__ == '__main__':
    main()
