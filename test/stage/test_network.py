# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A way through a network: when each of many messages arrives, and which never do."""

from __future__ import annotations

from itertools import pairwise
import math

import pytest

from stage.network import Network, Way

PERIOD = 0.01  # s between two messages
COUNT = 10_000
INF = math.inf


def through(network: Network) -> list[tuple[float, float]]:
    """Return when each was sent and arrived, in the order of arrival, sent each PERIOD."""
    way, found = Way(), []
    way.set(network, 0.0)
    for number in range(COUNT):
        way.send(number * PERIOD, 100, number * PERIOD)
    while (now := way.next_arrival()) < math.inf:
        found += [(sent, now) for sent in way.arrived(now)]
    return found


@pytest.mark.parametrize(
    ('network', 'least', 'most', 'arrive', 'in_order'),
    [
        (Network(), (0.0, 0.0), (0.0, 0.0), 1.0, True),
        (Network(delay=0.5), (0.5, 0.5), (0.5, 0.5), 1.0, True),
        (Network(creep=0.1, most=2.0), (0.0, 0.0), (2.0, 2.0), 1.0, True),
        (Network(jitter=0.1), (0.0, 0.1), (0.09, 0.11), 1.0, True),
        (Network(jitter=0.1, reorders=True), (0.0, 0.1), (0.09, 0.11), 1.0, False),
        *((Network(loss=n), (0.0, 0.0), (0.0, 0.0), 1.0 - n, True) for n in (0.01, 0.1)),
        (Network(loss=0.1, burst=0.15), (0.0, 0.0), (0.0, 0.0), 0.9, True),
        (Network(twice=0.5), (0.0, 0.0), (0.0, INF), 1.5, False),
        (Network(rate=4e6, queue=1_000_000, other=4.5e6), (0.0, 0.1), (1.9, 2.01), None, True),
        (Network(rate=4e6, other=3e6), (0.0, 0.01), (0.0, 0.01), 1.0, True),
    ],
    ids=lambda each: str(each) if isinstance(each, Network) else '',
)
def test_messages_arrive_as_late_and_as_many_as_the_network_says(
    network: Network,
    least: tuple[float, float],
    most: tuple[float, float],
    arrive: float | None,
    in_order: bool,
) -> None:
    found = through(network)
    delays = [at - sent for sent, at in found]
    for delay, (low, high) in ((min(delays), least), (max(delays), most)):
        assert low - 1e-6 <= delay <= high + 1e-6
    assert arrive is None or len(found) / COUNT == pytest.approx(arrive, abs=0.03)
    assert all(before < after for (before, _), (after, _) in pairwise(found)) is in_order


def test_stall_keeps_its_backlog_and_what_loses_all_nothing() -> None:
    way = Way()
    way.set(Network(stalls=True), 0.0)
    way.send('a', 100, 1.0)
    assert way.next_arrival() == math.inf
    assert way.arrived(5.0) == []
    way.set(Network(), 5.0)
    assert way.arrived(5.0) == ['a']
    assert through(Network(loss=1.0)) == []
