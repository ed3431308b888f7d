# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Freshness: in doubt, not fresh."""

from collections.abc import Sequence
import math

from hypothesis import given, strategies as st
import pytest

from bridge_core.watchdog import FreezeWatch, RateWatch, Watchdog


@pytest.mark.parametrize('timeout', [0.0, -0.0, -1.0, math.nan, math.inf, -math.inf])
def test_timeout_that_never_or_always_expires_is_refused(timeout: float) -> None:
    with pytest.raises(ValueError, match='above 0 s and finite'):
        Watchdog(timeout)


@pytest.mark.parametrize(
    ('fed', 'now', 'expired'),
    [
        ([], 0.0, True),  # near time zero, too
        ([], 1e9, True),
        ([10.0], 10.0, False),
        ([10.0], 10.2499, False),
        ([10.0], 10.25, True),
        ([10.0], 9.999, True),  # a clock that ran backwards
        ([10.0], math.nan, True),
        ([10.0, math.nan], 10.0, True),
        ([10.0, 'reset'], 10.0, True),
        ([10.0, 11.0], 11.1, False),
    ],
)
def test_fresh_until_its_deadline(fed: Sequence[float | str], now: float, expired: bool) -> None:
    watchdog = Watchdog(0.25)
    for each in fed:
        watchdog.reset() if isinstance(each, str) else watchdog.feed(each)
    assert watchdog.expired(now) is expired
    assert watchdog.heard is (bool(fed) and fed[-1] != 'reset')
    if not watchdog.heard:
        assert (watchdog.age(now), watchdog.deadline) == (math.inf, math.inf)


@given(st.floats(0.0, 1e9), st.floats(1e-3, 1e3))
def test_whoever_wakes_at_the_deadline_finds_it_expired(last: float, timeout: float) -> None:
    watchdog = Watchdog(timeout)
    watchdog.feed(last)
    assert watchdog.expired(watchdog.deadline)
    assert not watchdog.expired(math.nextafter(watchdog.deadline, -math.inf))


@pytest.mark.parametrize(
    ('seconds', 'text'),
    [
        (0.312, '312 ms'),
        (9.9, '9900 ms'),
        (10.0, '10 s'),
        (599.0, '599 s'),
        (600.0, '10 min'),
        (3600.0, '60 min'),
    ],
)
def test_ages_are_said_in_a_unit_that_is_read_at_a_glance(seconds: float, text: str) -> None:
    watchdog = Watchdog(0.25)
    assert watchdog.describe(1.0) == 'never heard, limit 250 ms'
    watchdog.feed(100.0)
    assert watchdog.describe(100.0 + seconds) == f'last heard {text} ago, limit 250 ms'


@pytest.mark.parametrize(
    ('looks', 'now', 'settling'),
    [
        ([], 100.0, False),  # the first look, whenever that is
        ([100.0, 100.25], 100.25, False),  # exactly the limit
        ([100.0, 100.25], 101.0, True),  # noticed by whoever looks first
        ([100.0, 100.25, 101.0, 101.25], 101.4375, True),
        ([100.0, 100.25, 101.0, 101.25], 101.5, False),
        ([0.0, 1.0, 1.375, 1.625], 1.8125, True),  # the second one begins it anew
        ([0.0, 1.0, 1.375, 1.625], 1.875, False),
    ],
)
def test_freeze_settles_after_a_while(looks: Sequence[float], now: float, settling: bool) -> None:
    watch = FreezeWatch(0.25, 0.5)
    for each in looks:
        watch.look(each)
    assert watch.settling(now) is settling


@pytest.mark.parametrize(('parts', 'exceeds'), [(15, False), (16, True)])
def test_rate_half_as_high_again_is_told_for_three_seconds(parts: int, exceeds: bool) -> None:
    """Sixteen in less than a second, where ten are due; in just a second they are not too many."""
    watch = RateWatch(10.0)
    for n in range(15):
        watch.feed(96.0 + n / parts)
    assert not watch.exceeded(96.0 + 15 / parts)
    last = 96.0 + 15 / parts
    watch.feed(last)
    assert watch.exceeded(last) is exceeds
    assert watch.exceeded(last + 2.9375) is exceeds
    assert not watch.exceeded(last + 3.0)
