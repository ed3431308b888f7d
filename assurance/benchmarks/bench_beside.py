# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What recorder and status page cost beside the nodes that decide, and what a stop takes then.

``python -m assurance.benchmarks.bench_beside [--turns N --trials M --rest SECONDS]``. With
``--turns``: a stop with recorder and ledger, with a recorder that has none, and with neither, in
turns on the same nodes; and what each recorder costs at rest.
"""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Iterator
import contextlib
from itertools import pairwise
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
from stage.devices import MUX
from stage.page_rig import watch
from stage.rig import NodeProcess

BROWSERS = 20
# From the most to the least; by name, the module that runs.
RECORDERS = {
    'recorder and ledger': 'rugged_teleop.recorder.node',
    'recorder alone': 'assurance.benchmarks.bare_recorder',
    'neither': '',
}
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


def turns(count: int, stops: int, rest: float) -> dict[str, Figures]:
    """
    Return the reactions (s) beside each recorder and none, their ratios, and per cent of a core.

    :param stops: of each turn. :param rest: s for which all is at rest, once beside each.
    """
    times: dict[str, list[float]] = {each: [] for each in RECORDERS}
    lost = dict.fromkeys(RECORDERS, 0)
    shares: dict[str, Figures] = {}
    with tempfile.TemporaryDirectory() as name, chain_of('three', Path(name)) as chain:
        assert isinstance(chain, Nodes)
        for number in range(count):
            order = [*RECORDERS]
            for kind in order[number % 3 :] + order[: number % 3]:
                with _recorder(chain, Path(name), RECORDERS[kind]) as recorder:
                    chain.pause(_SETTLE)
                    took, missed = trials(chain, 'estop', stops)
                    times[kind] += took
                    lost[kind] += missed
                    if recorder is not None and kind not in shares:
                        chain.rest(_SETTLE)
                        cost = Cost({'recorder': recorder.process.pid})
                        chain.rest(rest)
                        shares[kind] = {**cost.shares(), 'ledger': cost.thread('ledger')}
    found = {kind: figures(took) for kind, took in times.items()}
    return {
        **{f'three estop, {kind}': {**found[kind], 'lost': lost[kind]} for kind in found},
        **{
            f'{kind} / {other}': {
                key: found[kind][key] / found[other][key] for key in ('p50', 'p90', 'p99')
            }
            for kind, other in pairwise(found)
        },
        **{f'at rest, {kind}, % of a core': each for kind, each in shares.items()},
    }


@contextlib.contextmanager
def _recorder(chain: Nodes, folder: Path, module: str) -> Iterator[NodeProcess | None]:
    """Run one that hears the mux; none if there is no module."""
    if not module:
        yield None
        return
    with NodeProcess(module, {'folder': folder / 'recordings'}) as recorder:

        def hears() -> bool:
            found = chain.observer.node.get_subscriptions_info_by_topic(f'/{MUX}/status')
            return any(each.node_name == 'recorder' for each in found)

        chain.wait(hears, 'the recorder')
        yield recorder


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='python -m assurance.benchmarks.bench_beside', description=__doc__
    )
    parser.add_argument('--turns', type=int, default=0)
    parser.add_argument('--trials', type=int, default=50)
    parser.add_argument('--rest', type=float, default=60.0, metavar='SECONDS')
    given = parser.parse_args()
    use_own_domain()
    found = turns(given.turns, given.trials, given.rest) if given.turns else measure()
    for name, each in found.items():
        print(name, {key: float(f'{value:.3g}') for key, value in each.items()})


if __name__ == '__main__':
    main()
