# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stops are measured in use, and a brake that wears is found before its limit."""

from __future__ import annotations

from collections.abc import Callable
import math
import random
from typing import Any

import pytest

from rugged_teleop.ledger.stopping import curves_of, Drive, is_of, Stopped, Trend

CURVE = {'left': [(2.0, 0.1), (10.0, 0.41)]}
SCATTER = 0.05  # of the times of a sound brake: load, floor, samples of 20 ms


def stop(
    brake: float,
    *,
    speed: float = 10.0,
    places: Callable[[float], bool] = lambda t: True,
    disabled: float = 0.01,
) -> list[Stopped]:
    """
    Have a wheel run and brake (rad/s²), heard each 20 ms; return what was measured.

    :param places: tells when its place is measured.
    """
    drive = Drive()
    drive.hear_enabled(True, 0.0)
    found: list[Stopped] = []
    for tick in range(800):
        t = tick * 0.02 - 0.5
        since = max(0.0, t - disabled)
        now = max(0.0, speed - brake * since)
        place = 100.0 + speed * min(t, disabled) + (speed**2 - now**2) / (2.0 * brake)
        if tick == 25:
            drive.stop(0.0)
        if t >= disabled:
            drive.hear_enabled(False, disabled)
        found += drive.hear_joints(['a'], [now], [place if places(t) else math.nan], t)
    return found


@pytest.mark.parametrize(
    'places',
    [lambda t: True, lambda t: False, lambda t: t < -0.01, lambda t: t > 0.01, lambda t: t < 0.2],
    ids=['always', 'never', 'until the stop', 'since the stop', 'until amid the stop'],
)
def test_time_and_angle_to_standstill_are_measured(places: Callable[[float], bool]) -> None:
    (found,) = stop(25.0, places=places)
    assert (found.joint, found.speed, found.disabled) == ('a', 10.0, 0.01)
    assert found.time == pytest.approx(0.40, abs=0.03)
    assert found.angle == pytest.approx(2.1, abs=0.15)


def test_joint_that_does_not_stand_has_no_time() -> None:
    (found,) = stop(0.5, disabled=0.0)
    assert found.time is None
    assert found.angle > 70.0


def test_joint_that_swings_stands_when_it_stays() -> None:
    drive = Drive()
    drive.hear_joints(['a'], [5.0], [0.0], 0.0)
    found: list[Stopped] = [*drive.hear_joints(['a'], [5.0], [0.0], 0.0)]
    drive.stop(0.0)
    for tick in range(1, 60):
        swing = 5.0 * math.cos(tick / 4.0) * (tick < 40)
        found += drive.hear_joints(['a'], [swing], [math.nan], tick * 0.02)
    assert [each.time for each in found] == [0.8]


def test_each_joint_has_its_own_time_and_creeping_is_not_standing() -> None:
    drive = Drive()
    names = ['a', 'b', 'unmeasured', 'stands']
    tuple(drive.hear_joints(names, [5.0, -5.0, math.nan, 0.0], [0.0, 0.0, 0.0, 0.0, 9.9], 0.0))
    drive.stop(0.0)
    found: list[Stopped] = []
    course = [(0.1, 0.1, 4.0), (0.15, 0.1, 3.0), (0.2, 1.0, 2.0), (0.3, 0.1, 1.0), (0.5, 0.0, 0.2)]
    for at, a, b in [*course, (0.55, 0.0, 0.0), (0.61, 0.0, 0.0)]:
        assert found == []
        found += drive.hear_joints(names, [a, -b, math.nan, 1.0], [math.nan, -at, 0.0, 0.0], at)
    assert [(each.joint, each.speed, each.time) for each in found] == [
        ('a', 5.0, 0.3),
        ('b', 5.0, pytest.approx(0.38)),
    ]
    assert found[1].angle == pytest.approx(0.5)


def test_what_is_not_measured_neither_stands_nor_moves() -> None:
    drive = Drive()
    tuple(drive.hear_joints(['a'], [5.0, 5.0], [], 0.0))  # the second has no name
    drive.stop(0.0)
    found: list[Stopped] = []
    for at, speed in ((0.1, math.nan), (0.2, math.nan), (0.3, 2.0), (0.4, 0.0), (0.6, 0.0)):
        found += drive.hear_joints(['a'], [speed, speed], [], at)
    ((joint, *_, time, _, unheard),) = found
    assert (joint, round(time or 0.0, 6), round(unheard, 6)) == ('a', 0.4, 0.1)


@pytest.mark.parametrize(
    ('before', 'after', 'disabled'),
    [
        ([True], [(0.02, False), (0.03, False)], 0.02),
        ([True, False], [(0.02, False)], 0.0),
        ([], [(0.02, True)], None),
        ([True], [(0.02, True)], None),
    ],
    ids=['enabled', 'disabled before', 'unknown', 'does not obey'],
)
def test_time_until_disabled(
    before: list[bool], after: list[tuple[float, bool]], disabled: float | None
) -> None:
    drive = Drive()
    for enabled in before:
        drive.hear_enabled(enabled, -0.1)
    tuple(drive.hear_joints(['a'], [5.0], [], 0.0))
    drive.stop(0.0)
    for at, enabled in after:
        drive.hear_enabled(enabled, at)
    tuple(drive.hear_joints(['a'], [0.0], [], 0.1))
    (found,) = drive.hear_joints(['a'], [0.0], [], 0.2)
    assert found.disabled == disabled


def test_silent_drive_is_given_up() -> None:
    drive = Drive()
    tuple(drive.hear_joints(['a'], [5.0], [], 100.0))
    drive.stop(100.0)
    assert [*drive.look(109.0)] == []
    assert [each[-3:] for each in drive.look(110.0)] == [(None, 0.0, 10.0)]
    assert not drive.is_stopping
    trend = Trend({'a': [(5.0, 0.4)]}, 0.25)
    assert trend.judge('a', 5.0, None, 10.0) == '', 'its power may be cut, with good brakes'
    assert trend.judge('a', 5.0, None, 0.1) != ''
    assert trend.judge('a', 5.0, 3.0, 0.6) != ''


@pytest.mark.parametrize(
    ('heard', 'speed'),
    [(-1.0, 5.0), (0.0, 0.1), (0.0, math.nan)],
    ids=['silent since', 'stands', 'not measured'],
)
def test_stop_of_what_does_not_move_is_not_measured(heard: float, speed: float) -> None:
    drive = Drive()
    tuple(drive.hear_joints(['a'], [speed], [], heard))
    drive.stop(0.0)
    assert not drive.is_stopping


@pytest.mark.parametrize(
    ('drive', 'mux', 'own'),
    [
        ('/drive', '/mux', True),
        ('/front/drive', '/mux', False),
        ('/front/drive', '/front/mux', True),
        ('/drive', '/front/mux', False),
    ],
)
def test_drive_belongs_to_the_nearest_mux_above(drive: str, mux: str, own: bool) -> None:
    assert is_of(drive, mux, ['/mux', '/front/mux']) is own
    assert not is_of(drive, mux, ['/elsewhere/mux'])


def braked(
    chance: random.Random, speed: float, time: float, period: float, gaps: float
) -> Stopped:
    """Have a wheel brake within about this time, heard each ``period`` but for some ``gaps``."""
    drive, at, stop = Drive(), chance.uniform(-period, 0.0) - 0.2, chance.uniform(0.0, 0.01)
    while True:
        now = speed * min(1.0, max(0.0, 1.0 - (at - 0.01) / time)) + chance.gauss(0.0, 0.02)
        if at > stop:
            drive.stop(stop)
        if at < 0.0 or chance.random() >= gaps:
            for found in drive.hear_joints(['a'], [now], [], at + chance.uniform(0.0, 0.004)):
                return found
        at += period


def trend_of(chance: random.Random, brake: float, period: float) -> Trend:
    """Commission a machine with such a brake (rad/s²)."""
    speeds = [speed for speed in (1.0, 2.0, 5.0, 10.0) for _ in range(3)]
    stops = [braked(chance, speed, speed / brake, period, 0.0) for speed in speeds]
    points = [{'speed': each.speed, 'time': each.time, 'angle': 1.0} for each in stops]
    return Trend(curves_of({'stopping': {'a': points}}), 0.25)


def judged(trend: Trend, stopped: Stopped) -> str:
    return trend.judge('a', stopped.speed, stopped.time, stopped.unheard)


ROWS = [
    *((speed, 25.0, 0.02, 0.05) for speed in (1.0, -2.0, 5.0, 10.0, -10.0)),
    *((10.0, 25.0, 0.1, 0.05), (2.0, 10.0, 0.05, 0.2), (10.0, 100.0, 0.005, 0.0)),
]


@pytest.mark.parametrize(('speed', 'brake', 'period', 'gaps'), ROWS)
def test_sound_brake_is_warned_of_in_none_of_500_stops(
    speed: float, brake: float, period: float, gaps: float
) -> None:
    chance = random.Random(1)
    trend = trend_of(chance, brake, period)
    for _ in range(500):
        driven = speed * chance.uniform(0.95, 1.05)
        time = abs(driven) / brake * chance.gauss(1.0, SCATTER)
        assert judged(trend, braked(chance, driven, time, period, gaps)) == ''


@pytest.mark.parametrize('used', [0, 1, 50])
@pytest.mark.parametrize(
    ('speed', 'period'), [(10.0, 0.02), (-10.0, 0.05), (10.0, 0.005), (5.0, 0.02)]
)
def test_brake_that_wears_is_warned_of_before_the_limit(
    speed: float, period: float, used: int
) -> None:
    chance = random.Random(used)
    trend, time = trend_of(chance, 25.0, period), abs(speed) / 25.0
    for _ in range(used):
        judged(trend, braked(chance, speed, time * chance.gauss(1.0, SCATTER), period, 0.0))
    slower = 1.0
    while not judged(
        trend, braked(chance, speed, time * slower * chance.gauss(1.0, SCATTER), period, 0.0)
    ):
        slower *= 1.02
        assert slower <= 1.25, trend


@pytest.mark.parametrize(
    ('speed', 'time', 'text'),
    [
        (10.0, 0.62, 'left: 0.62 s from 10.0 rad/s, commissioned 0.41'),
        (6.0, 0.3, ''),
        (6.0, 0.4, 'left: 0.40 s from 6.0 rad/s, commissioned 0.26'),
        (10.0, None, 'left: did not stand from 10.0 rad/s'),
        (11.0, 0.55, ''),
        (11.0, 0.59, 'left: 0.59 s from 11.0 rad/s, commissioned 0.45'),
        (1.8, 0.11, ''),
        (1.8, 0.14, 'left: 0.14 s from 1.8 rad/s, commissioned 0.09'),
        (1.0, 5.0, ''),
        (20.0, 5.0, ''),
    ],
)
def test_slow_stop_is_told_with_numbers(speed: float, time: float | None, text: str) -> None:
    trend = Trend(CURVE, 0.25)
    assert trend.judge('left', speed, time) == text
    assert trend.judge('right', speed, time) == ''
    trend.judge('left', 10.0, 0.41)
    assert trend.judge('left', 10.0, 0.41) == ''
    assert trend.warnings == {}


def test_stops_from_about_the_same_speed_are_averaged() -> None:
    points = [(10.2, 0.5), (2.0, 0.1), (10.0, 0.4), (9.8, 0.3), (5.0, 0.2)]
    stops = [{'speed': speed, 'time': time, 'angle': 1.0} for speed, time in points]
    (curve,) = curves_of({'stopping': {'a': stops}}).values()
    assert curve == [(2.0, 0.1), (5.0, 0.2), (pytest.approx(10.0), pytest.approx(0.4))]


@pytest.mark.parametrize(
    'report',
    [
        *({}, [], {'stopping': {'a': [{'speed': 1}]}}),
        *({'stopping': {'a': [{'speed': s, 'time': t}]}} for s, t in ((0, 1), (1, math.inf))),
    ],
)
def test_report_without_stops_is_refused(report: Any) -> None:
    with pytest.raises(ValueError, match='stop'):
        curves_of(report)
