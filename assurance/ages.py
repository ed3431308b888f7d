# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How often would a sound link be taken for an old one? To choose ``age_limit`` by.

``python -m assurance.ages [--hours 10] [--delay S] [--jitter S] [--loss SHARE] [--bursts S]``
carries challenges and proofs over such a link, in simulated time. The table has how many times an
hour what was heard last becomes older than each limit: each time would be a stop.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import math
import sys
from typing import Final

from bridge_core.proof import PERIOD, Reader, Writer
from stage.network import Network, Way

LIMITS: Final = (0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8)  # s
_BEGIN = 1000.0  # s; where the clock begins


def ages(network: Network, seconds: float) -> Iterator[float]:
    """Yield how old, in s, each thing that was heard became before it was followed by another."""
    there, back = Way(1), Way(2)
    for way in (there, back):
        way.set(network, _BEGIN)
    reader, writer = Reader(1, silence=math.inf), Writer(2, lately=math.inf)
    now = due = _BEGIN
    while now < _BEGIN + seconds:
        now = min(due, there.next_arrival(), back.next_arrival())
        if now == due:
            due += PERIOD
            challenge = reader.challenge(now)
            there.send(challenge, len(challenge), now)
        for challenge in there.arrived(now):
            if writer.hear(challenge, now):
                proof = writer.proof(now)
                back.send(proof, len(proof), now)
        for proof in back.arrived(now):
            before = reader.as_of
            reader.hear(proof, now)
            if reader.as_of > before > -math.inf:
                yield now - before


def stops(network: Network, hours: float) -> list[float]:
    """Return the stops an hour, by limit."""
    found = list(ages(network, 3600 * hours))
    return [sum(age > limit for age in found) / hours for limit in LIMITS]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m assurance.ages', allow_abbrev=False)
    parser.add_argument('--hours', type=float, default=10.0, help='of simulated time (10)')
    for name, words in (('delay', 's, each way'), ('jitter', 's on top, at most')):
        parser.add_argument(f'--{name}', type=float, default=0.0, help=f'{words} (0)')
    parser.add_argument('--loss', type=float, default=0.0, help='share that is lost, each way (0)')
    bursts = 's, at most, of the bursts that it is lost in (0: each by itself)'
    parser.add_argument('--bursts', type=float, default=0.0, help=bursts)
    given = parser.parse_args(arguments)
    network = Network(given.delay, jitter=given.jitter, loss=given.loss, burst=given.bursts)
    print('| link |' + ''.join(f' {limit:g} s |' for limit in LIMITS))
    print('|' + ' --- |' * (1 + len(LIMITS)))
    counts = ''.join(f' {count:.3g} |' for count in stops(network, given.hours))
    print(f'| {network} |{counts}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
