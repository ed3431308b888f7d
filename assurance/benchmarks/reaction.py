# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Wire to wire: from a stop in at the VSC's port to the first disable packet out at the drive's.

Or from the stick that is let go to the first packet with a lesser command.

``python -m assurance.benchmarks.reaction KIND TRIALS [WHAT] [--rt PRIORITY] [--load]``.
KIND: floor (one
thread, no topic), bare (three rclpy processes without logic), three (our nodes, a process each),
stack (our nodes in one process). WHAT: estop, deadman, silence; stick with three and stack.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import contextlib
from functools import partial
import math
from pathlib import Path
import sys
import tempfile
from typing import NamedTuple

from assurance.benchmarks.chain import Bare, chain_of, Nodes
from assurance.benchmarks.rig import (
    busy_cores,
    Cost,
    Figures,
    figures,
    Size,
    UnavailableError,
    use_own_domain,
    USUAL,
)

KINDS = ('floor', 'bare', 'three', 'stack')
STOPS = ('estop', 'deadman', 'silence')
STICK = 'stick'
RT_PRIORITY = 50  # SCHED_FIFO
_MOST_LOST = 10  # of what does not even move


class Result(NamedTuple):
    """The reactions (s), how many trials gave none, and what all and each cost at rest."""

    times: list[float]
    lost: int
    rest: Figures  # see Cost.figures; with the per cent of each process, by its name

    def figures(self) -> Figures:
        """Return quantiles and the lost trials."""
        return {**figures(self.times), 'lost': self.lost}


def trials(chain: Bare | Nodes, what: str, count: int) -> tuple[list[float], int]:
    """
    Return the reactions (s) and how many trials gave none.

    :raises UnavailableError: so many were lost that it is no measurement.
    """
    times: list[float] = []
    for done in range(1, count + 1):
        try:
            chain.move()
        except AssertionError as error:
            if done - len(times) > _MOST_LOST:
                raise UnavailableError(f'{done - len(times)} trials lost: {error}') from error
            continue
        took = chain.rig.fire(what)
        if took is not None:
            times.append(took)
    return times, count - len(times)


def react(
    kind: str,
    count: int,
    what: str = 'estop',
    *,
    rt_priority: int = 0,
    load: bool = False,
    rest: float = 0.0,
) -> Result:
    """
    Measure one kind of chain. :param rest: s for which it is watched at rest; 0: it is not.

    :raises UnavailableError: it cannot be measured.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        chain_of(kind, Path(folder), rt_priority) as chain,
        busy_cores() if load else contextlib.nullcontext(),
    ):
        times, lost = trials(chain, what, count)
        at_rest = cost_at_rest(chain, rest) if rest else {}
    return Result(times, lost, at_rest)


def cost_at_rest(chain: Bare | Nodes, seconds: float) -> Figures:
    """Return what a chain costs at rest, together and by process."""
    chain.rest(0.5)
    cost = Cost(chain.pids)
    chain.rest(seconds)
    print(cost.threads(), flush=True)
    return {**cost.figures(), **cost.shares()}


def hold(seconds: float, rt_priority: int) -> Figures:
    """Return how often our three nodes stop by themselves in motion, with all cores busy."""
    with (
        tempfile.TemporaryDirectory() as folder,
        chain_of('three', Path(folder), rt_priority) as chain,
    ):
        chain.move()
        assert isinstance(chain, Nodes)
        stops = 0
        with busy_cores():
            left = seconds
            while left > 0.0:
                chain.pause(min(left, 1.0))
                left -= 1.0
                if not chain.rig.moves():
                    stops += 1
                    print(f'stopped by itself after {seconds - left:.0f} s:')
                    for node in chain.nodes.values():
                        print(*node.output.splitlines()[-2:], sep='\n')
                    with contextlib.suppress(AssertionError):  # not yet: it counts once more
                        chain.move()
    return {'stops': stops, 'n': round(seconds)}


def measure(size: Size = USUAL) -> dict[str, Figures]:
    """Return each kind's reactions (s), the bare chain between all others, and their cost."""
    count, fewer, rest = size.stops, size.fewer, size.seconds
    third = math.ceil(count / 3)
    found = {'floor estop': react('floor', fewer).figures()}
    bare = [react('bare', third, rest=rest)]
    for kind in ('three', 'stack'):
        result = react(kind, count, rest=rest)
        bare.append(react('bare', third))
        found[f'{kind} estop'] = result.figures()
        found[f'{kind} rest'] = result.rest
    for what in STOPS[1:]:
        found[f'three {what}'] = react('three', fewer, what).figures()
        bare.append(react('bare', fewer))
    found['three stick'] = react('three', fewer, STICK).figures()
    found['bare rest'] = bare[0].rest
    found['bare estop'] = together(bare).figures()
    return found


def measure_load(size: Size = USUAL) -> dict[str, Figures]:
    """
    Return the same with all cores busy, without and with a real-time priority.

    What the rights, or the nodes, do not allow is left out.
    """
    found: dict[str, Figures] = {}
    for rt_priority, words in ((0, 'load'), (RT_PRIORITY, 'load, rt')):
        under_load = partial(react, rt_priority=rt_priority, load=True)
        try:
            bare = [under_load('bare', size.fewer)]
            found[f'three estop, {words}'] = under_load('three', size.fewer).figures()
            bare.append(under_load('bare', size.fewer))
            found[f'bare estop, {words}'] = together(bare).figures()
            if rt_priority:
                found['three in motion, load, rt'] = hold(size.hold, rt_priority)
        except (UnavailableError, PermissionError) as error:
            print(f'{words}: skipped, {error}', file=sys.stderr)
    return found


def together(results: Sequence[Result]) -> Result:
    """Return the trials of several runs as of one."""
    times = [time for result in results for time in result.times]
    return Result(times, sum(result.lost for result in results), {})


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='python -m assurance.benchmarks.reaction', description=__doc__
    )
    parser.add_argument('kind', choices=KINDS)
    parser.add_argument('trials', type=int)
    parser.add_argument('what', choices=(*STOPS, STICK), nargs='?', default='estop')
    parser.add_argument('--rt', type=int, default=0, metavar='PRIORITY', help='SCHED_FIFO, 1-97')
    parser.add_argument('--load', action='store_true', help='with all cores busy')
    parser.add_argument('--rest', type=float, default=10.0, help='s for which it is at rest')
    given = parser.parse_args()
    if given.what == STICK and given.kind not in ('three', 'stack'):
        parser.error(f'{given.kind} knows no {STICK}')
    use_own_domain()
    try:
        result = react(
            given.kind,
            given.trials,
            given.what,
            rt_priority=given.rt,
            load=given.load,
            rest=given.rest,
        )
    except UnavailableError as error:
        raise SystemExit(f'reaction: skipped, {error}') from error
    print('  at rest:', {name: float(f'{value:.3g}') for name, value in result.rest.items()})
    values = result.figures()
    counts = {name: f'{int(values.pop(name))}' for name in ('n', 'lost')}
    texts = {**counts, **{name: f'{1e3 * value:.2f}' for name, value in values.items()}}
    words = ' '.join(f'{name} {text}' for name, text in texts.items())
    print(f'{given.kind} {given.what}: {words} (ms)')


if __name__ == '__main__':
    main()
