# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Freshness: in doubt, not fresh."""

import math

from hypothesis import given, strategies as st
import pytest

from bridge_core.watchdog import FreezeWatch, RateWatch, Watchdog

MOMENTS = st.floats(0.0, 1e9)
TIMEOUTS = st.floats(1e-3, 1e3)


@pytest.mark.parametrize('timeout', [0.0, -0.0, -1.0, math.nan, math.inf, -math.inf])
def test_timeout_that_never_or_always_expires_is_refused(timeout: float) -> None:
    with pytest.raises(ValueError, match='above 0 s and finite'):
        Watchdog(timeout)


def test_never_heard_is_expired_near_time_zero_too() -> None:
    watchdog = Watchdog(0.25)
    for now in (0.0, 0.1, 1e9):
        assert watchdog.expired(now)
    assert not watchdog.heard
    assert watchdog.age(0.0) == math.inf
    assert watchdog.deadline == math.inf


def test_fresh_up_to_the_deadline_and_not_at_it() -> None:
    watchdog = Watchdog(0.25)
    watchdog.feed(10.0)
    assert watchdog.heard
    assert not watchdog.expired(10.0)
    assert not watchdog.expired(10.2499)
    assert watchdog.expired(10.25)
    assert watchdog.expired(11.0)


@given(MOMENTS, TIMEOUTS)
def test_whoever_wakes_at_the_deadline_finds_it_expired(last: float, timeout: float) -> None:
    watchdog = Watchdog(timeout)
    watchdog.feed(last)
    assert watchdog.expired(watchdog.deadline)
    assert not watchdog.expired(math.nextafter(watchdog.deadline, -math.inf))


def test_clock_that_ran_backwards_is_not_fresh() -> None:
    watchdog = Watchdog(0.25)
    watchdog.feed(10.0)
    assert watchdog.expired(9.999)


def test_nan_is_not_fresh() -> None:
    watchdog = Watchdog(0.25)
    watchdog.feed(10.0)
    assert watchdog.expired(math.nan)
    watchdog.feed(math.nan)
    assert watchdog.expired(10.0)


def test_reset_forgets() -> None:
    watchdog = Watchdog(0.25)
    watchdog.feed(10.0)
    watchdog.reset()
    assert watchdog.expired(10.0)
    assert watchdog.deadline == math.inf


def test_recovers_when_heard_again() -> None:
    watchdog = Watchdog(0.25)
    watchdog.feed(10.0)
    assert watchdog.expired(11.0)
    watchdog.feed(11.0)
    assert not watchdog.expired(11.1)
    assert watchdog.deadline == 11.25


def test_age_is_told_in_words() -> None:
    watchdog = Watchdog(0.25)
    assert watchdog.describe(1.0) == 'never heard, limit 250 ms'
    watchdog.feed(1.0)
    assert watchdog.describe(1.312) == 'last heard 312 ms ago, limit 250 ms'


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
    watchdog.feed(100.0)
    assert watchdog.describe(100.0 + seconds) == f'last heard {text} ago, limit 250 ms'


def test_freeze_is_noticed_by_whoever_looks_first_and_settles_after_a_while() -> None:
    watch = FreezeWatch(0.25, 0.5)
    assert not watch.settling(100.0)  # the first look, whenever that is
    watch.look(100.25)
    assert not watch.settling(100.25)  # exactly the limit
    assert watch.settling(101.0)
    watch.look(101.25)
    assert watch.settling(101.4375)
    assert not watch.settling(101.5)


def test_freeze_amid_the_settling_begins_it_anew() -> None:
    watch = FreezeWatch(0.25, 0.5)
    for now in (0.0, 1.0, 1.375, 1.625):
        watch.look(now)
    assert watch.settling(1.8125)
    assert not watch.settling(1.875)


@pytest.mark.parametrize(('parts', 'exceeds'), [(15, False), (16, True)])
def test_rate_that_is_half_as_high_again_is_told_for_three_seconds(
    parts: int, exceeds: bool
) -> None:
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
