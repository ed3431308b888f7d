# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How old words become on a link, by simulated time."""

from __future__ import annotations

import pytest

from assurance import ages
from bridge_core.proof import PERIOD
from stage.network import Network

HOURS = 0.02


@pytest.mark.parametrize(('delay', 'jitter'), [(0.0, 0.0), (0.05, 0.0), (0.02, 0.05)])
def test_words_become_as_old_as_a_round_trip_and_a_period_make_them(
    delay: float, jitter: float
) -> None:
    oldest = max(ages.ages(Network(delay, jitter=jitter), 72.0))
    assert PERIOD + 2 * delay <= oldest + 1e-9 <= PERIOD + 2 * (delay + jitter) + 2e-9


def test_more_loss_and_longer_bursts_make_more_stops() -> None:
    none, some, bursts = (
        ages.stops(Network(loss=loss, burst=burst), HOURS)[0]
        for loss, burst in ((0.0, 0.0), (0.1, 0.0), (0.1, 0.3))
    )
    assert none == 0.0
    assert 0.0 < some < bursts
