# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What recorder and status page cost beside the nodes that decide, and what a stop takes then.

``python -m assurance.benchmarks.bench_beside [--pairs N --trials M --rest SECONDS]``. With
``--pairs``: a stop with the recorder and its ledger, and without, in turns on the same nodes; and
what recorder and ledger cost at rest.
"""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Iterator
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
from stage.devices import MUX
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


def pairs(count: int, stops: int, rest: float) -> dict[str, Figures]:
    """
    Return the reactions (s) with the recorder and without, their ratios, and per cent of a core.

    :param stops: of each half of a pair. :param rest: s for which all is at rest.
    """
    times: dict[bool, list[float]] = {True: [], False: []}
    lost = dict.fromkeys(times, 0)
    ratios = []
    with tempfile.TemporaryDirectory() as name, chain_of('three', Path(name)) as chain:
        assert isinstance(chain, Nodes)

        def half(recorded: bool) -> float:
            with _recorder(chain, Path(name)) if recorded else contextlib.nullcontext():
                chain.pause(_SETTLE)
                took, missed = trials(chain, 'estop', stops)
            times[recorded] += took
            lost[recorded] += missed
            return figures(took)['p50']

        for number in range(count):
            first = bool(number % 2)
            halves = {first: half(first), not first: half(not first)}
            ratios.append(halves[True] / halves[False])
        with _recorder(chain, Path(name)) as recorder:
            chain.rest(_SETTLE)
            cost = Cost({'recorder': recorder.process.pid})
            chain.rest(rest)
            shares = {**cost.shares(), 'ledger': cost.thread('ledger')}
    with_it, without = (figures(times[each]) for each in (True, False))
    return {
        'three estop, with recorder': {**with_it, 'lost': lost[True]},
        'three estop, without': {**without, 'lost': lost[False]},
        'ratio': {key: with_it[key] / without[key] for key in ('p50', 'p90')},
        'ratio of p50, pair by pair': figures(ratios),
        'at rest, % of a core': shares,
    }


@contextlib.contextmanager
def _recorder(chain: Nodes, folder: Path) -> Iterator[NodeProcess]:
    """Run one that hears the mux."""
    with NodeProcess('rugged_teleop.recorder.node', {'folder': folder / 'recordings'}) as recorder:

        def hears() -> bool:
            found = chain.observer.node.get_subscriptions_info_by_topic(f'/{MUX}/status')
            return any(each.node_name == 'recorder' for each in found)

        chain.wait(hears, 'the recorder')
        yield recorder


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='python -m assurance.benchmarks.bench_beside', description=__doc__
    )
    parser.add_argument('--pairs', type=int, default=0)
    parser.add_argument('--trials', type=int, default=50)
    parser.add_argument('--rest', type=float, default=60.0, metavar='SECONDS')
    given = parser.parse_args()
    use_own_domain()
    found = pairs(given.pairs, given.trials, given.rest) if given.pairs else measure()
    for name, each in found.items():
        print(name, {key: float(f'{value:.3g}') for key, value in each.items()})


if __name__ == '__main__':
    main()
