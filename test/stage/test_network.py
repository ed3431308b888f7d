# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A way through a network: when each of many messages arrives, and which never do."""

from __future__ import annotations

from itertools import pairwise
import math

import pytest

from stage.network import Network, Way

PERIOD = 0.01  # s between two messages
SIZE = 100  # bytes


def through(network: Network, seconds: float = 100.0) -> list[tuple[float, float]]:
    """Return when each was sent and arrived, in the order of arrival, sent each PERIOD."""
    way, found = Way(), []
    way.set(network, 0.0)
    for number in range(round(seconds / PERIOD)):
        way.send(number * PERIOD, SIZE, number * PERIOD)
    while (now := way.next_arrival()) < math.inf:
        found += [(sent, now) for sent in way.arrived(now)]
    return found


def delays(network: Network) -> list[float]:
    return [at - sent for sent, at in through(network)]


def is_in_order(network: Network) -> bool:
    return all(before < after for (before, _), (after, _) in pairwise(through(network)))


def test_sound_network_changes_nothing() -> None:
    assert set(delays(Network())) == {0.0}


def test_delay_grows_up_to_its_most() -> None:
    assert delays(Network(delay=0.5)) == pytest.approx([0.5] * 10_000)
    found = delays(Network(creep=0.1, most=2.0))
    assert found[1000] == pytest.approx(1.0)
    assert found[-1] == pytest.approx(2.0)


def test_jitter_keeps_the_order_unless_it_is_to_reorder() -> None:
    for reorders in (False, True):
        network = Network(jitter=0.1, reorders=reorders)
        assert is_in_order(network) is not reorders
        assert 0.09 < max(delays(network)) <= 0.11
        assert len(delays(network)) == 10_000


@pytest.mark.parametrize('burst', [0.0, 0.15])
@pytest.mark.parametrize('loss', [0.01, 0.1, 1.0])
def test_that_share_is_lost_at_once_or_in_bursts(loss: float, burst: float) -> None:
    arrived = [sent for sent, _ in through(Network(loss=loss, burst=burst), 500.0)]
    assert len(arrived) / 50_000 == pytest.approx(1.0 - loss, abs=0.03)
    gap = max((after - before for before, after in pairwise(arrived)), default=0.0)
    assert not burst or gap < 0.4  # of two bursts, one after the other


def test_copies_arrive() -> None:
    assert len(delays(Network(twice=0.5))) == pytest.approx(15_000, abs=300)


def test_queue_fills_with_other_traffic_and_drops_at_its_end() -> None:
    network = Network(rate=4e6, queue=1_000_000, other=4.5e6)
    found = delays(network)
    assert found[1000] == pytest.approx(1.4, abs=0.2)
    assert max(found) == pytest.approx(2.0, abs=0.01)
    assert is_in_order(network)
    assert max(delays(Network(rate=4e6, other=3e6))) < 0.01


def test_stall_keeps_its_backlog() -> None:
    way = Way()
    way.set(Network(stalls=True), 0.0)
    way.send('a', SIZE, 1.0)
    assert way.next_arrival() == math.inf
    assert way.arrived(5.0) == []
    way.set(Network(), 5.0)
    assert way.arrived(5.0) == ['a']
