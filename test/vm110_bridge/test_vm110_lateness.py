# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""VRPI that come later than their numbers say: a queue on the way, which shows no gap."""

from collections.abc import Callable
import random

import pytest

from bridge_core.session import Level
from stage.vm110_rig import armed, Bench, CENTRED, of, opened, vrci
from vm110_bridge.session import Command
from vm110_bridge.session.lateness import Lateness, PERIOD

LIMIT = 0.5
Delay = Callable[[float], float]


def heard(
    seconds: float,
    delay: Delay,
    *,
    period: float = PERIOD,
    lost: float = 0.0,
    lateness: Lateness | None = None,
) -> tuple[Lateness, list[tuple[float, float, bool]]]:
    """
    Have VRPI come in their order, and return how late they were found.

    :param delay: s, by when a VRPI is sent. :param lost: their share. The list has of each the
        moment at which it was sent, its lag, and whether it is late.
    """
    chance = random.Random(1)
    lateness = lateness or Lateness(LIMIT)
    found, arrival = [], 0.0
    for serial in range(round(seconds / period)):
        sent = serial * period
        arrival = max(arrival, sent + delay(sent))
        if chance.random() >= lost:
            lateness.heard(serial & 0xFFFF, 1000.0 + arrival)
            found.append((sent, lateness.lag, lateness.is_late))
    return lateness, found


def jitter(most: float) -> Delay:
    chance = random.Random(2)
    return lambda sent: chance.random() * most


@pytest.mark.parametrize('period', [0.124, 0.125, 0.125 * (1 + 2e-4), 0.125 * (1 - 2e-4), 0.126])
@pytest.mark.parametrize(('most', 'lost'), [(0.0, 0.0), (0.1, 0.0), (0.1, 0.05)])
@pytest.mark.parametrize('seconds', [7200.0, pytest.param(86400.0, marks=pytest.mark.proof)])
def test_clock_that_is_not_ours_is_never_late(
    period: float, most: float, lost: float, seconds: float
) -> None:
    """And whose first VRPI come at any time within the jitter."""
    _, found = heard(seconds, jitter(most), period=period, lost=lost)
    assert max(lag for _, lag, _ in found) < LIMIT / 2


@pytest.mark.parametrize('period', [0.124, 0.125, 0.126])
@pytest.mark.parametrize(
    ('hold', 'every'), [(0.2, 7200.0), (0.3, 7200.0), (2.0, 7200.0), (0.2, 60.0), (0.4, 300.0)]
)
def test_what_was_held_back_for_a_moment_is_forgotten(
    period: float, hold: float, every: float
) -> None:
    """The first VRPI, too: what was learned of the period with them kept it late for ever."""
    _, found = heard(7200.0, lambda sent: hold * (sent % every < 0.3), period=period)
    assert all(lag < LIMIT / 4 for sent, lag, _ in found if sent % every > 1.0)


@pytest.mark.parametrize('period', [0.124, 0.125, 0.126])
@pytest.mark.parametrize(('at', 'step'), [(5.0, 0.4), (20.0, 0.4), (60.0, 0.45)])
@pytest.mark.parametrize('rate', [0.005, 0.02, 0.3])
def test_delay_that_stays_teaches_no_period_that_hides_a_creep(
    period: float, at: float, step: float, rate: float
) -> None:
    shakes, start = jitter(0.05), at + 300.0

    def delay(sent: float) -> float:
        return step * (sent >= at) + min(max(sent - start, 0.0) * rate, 2.0) + shakes(sent)

    _, found = heard(start + 2.0 / rate, delay, period=period)
    first = next(sent for sent, _, late in found if late and sent > at + 60.0)
    assert 0.25 < (first - start) * rate < 1.5 * LIMIT + rate * PERIOD


@pytest.mark.parametrize('period', [0.124, 0.125, 0.126])
@pytest.mark.parametrize(
    ('start', 'rate'), [(100.0, 0.05), (10.0, 0.3), (10.0, 1.0), (600.0, 0.005)]
)
@pytest.mark.parametrize('most', [0.0, 0.05])
def test_delay_that_creeps_is_late_before_the_limit_is_passed_by_much(
    period: float, start: float, rate: float, most: float
) -> None:
    shakes = jitter(most)

    def delay(sent: float) -> float:
        return min(max(sent - start, 0.0) * rate, 2.0) + shakes(sent)

    _, found = heard(start + 2.0 / rate + 60.0, delay, period=period)
    first = next(sent for sent, _, late in found if late)
    assert LIMIT - 0.1 < (first - start) * rate < 1.5 * LIMIT + rate * PERIOD
    lasts = 10.0 if start == 10.0 else 60.0  # it knows the period less well then
    assert all(late for sent, _, late in found if first < sent < first + lasts)


@pytest.mark.parametrize('delay', [0.4, 0.6, 2.0])
def test_delay_that_came_in_a_stall_stays_late_for_as_long_as_it_stays(delay: float) -> None:
    lateness, found = heard(1800.0, lambda sent: delay if sent > 900.0 else 0.0)
    assert lateness.is_late is (delay > LIMIT)
    assert found[-1][1] == pytest.approx(delay, abs=0.2)
    _, found = heard(20.0, lambda sent: 0.0 if sent > 10.0 else 5.0 * (sent > 5.0))
    assert not found[-1][2]


@pytest.mark.parametrize('period', [0.124, 0.125, 0.126])
@pytest.mark.parametrize('at', [1.0, 5.0, 60.0, 900.0])
@pytest.mark.parametrize('step', [0.7, 3.0])
def test_delay_that_came_while_the_period_was_not_known_well_ends_with_its_queue_alone(
    period: float, at: float, step: float
) -> None:
    shakes = jitter(0.05)
    _, found = heard(
        7200.0, lambda sent: step * (at < sent < 7000.0) + shakes(sent), period=period
    )
    assert {late for sent, _, late in found if at + 1.0 < sent < 6990.0} == {True}
    assert not found[-1][2]


def test_late_ends_at_half_of_the_limit() -> None:
    delays = (0.0,) * 10 + (0.6, 0.4, 0.2)  # for 100 s each
    _, found = heard(1299.0, lambda sent: delays[int(sent / 100)])
    lates = [late for sent, _, late in found if sent % 100 == 50]
    assert lates[-4:] == [False, True, True, False]


def test_packets_that_are_no_vrpi_take_no_time() -> None:
    lateness = Lateness(LIMIT)
    serial = 65500
    for n in range(2000):
        lateness.heard(serial & 0xFFFF, n * PERIOD)
        serial += 1
        for _ in range(n % 3):
            lateness.passed()
            serial += 1
    assert lateness.lag < 0.1


def test_numbers_that_may_have_wrapped_begin_anew() -> None:
    lateness, _ = heard(100.0, lambda sent: 0.0)
    lateness.heard(4000, 1000.0 + 100.0 + 65536 * PERIOD)
    assert lateness.lag == 0.0


def late(bench: Bench, seconds: float, rate: float = 0.3) -> None:
    """Hear VRPI that come later and later."""
    for _ in range(round(seconds / PERIOD)):
        bench.hear()
        bench.wait(PERIOD * (1.0 + rate))


def test_late_base_unit_is_a_stop_of_its_own_with_numbers_and_half_of_it_a_warning() -> None:
    bench = armed()
    bench.run(10.0)
    late(bench, 1.25)
    ((level, text),) = bench.session.problems(bench.now)
    assert level is Level.WARN
    assert not bench.session.estop
    late(bench, 1.25)
    assert bench.session.own_estop
    (text,) = bench.session.stop_reasons(bench.now)
    assert text.startswith('look at the network to the base unit: what it says comes ')
    assert text.endswith(' ms later than before, line_age_limit is 500 ms')
    for _ in range(6):
        bench.hear()  # what was held back
    bench.run(1.0)
    assert not bench.session.estop
    late(bench, 1.25)
    bench.wait(1.0)
    ((level, text),) = bench.session.problems(bench.now)
    assert text.startswith("check the BU's power")  # whatever it was before


def test_late_command_is_dropped_though_one_of_an_unarmed_remote_would_be_taken() -> None:
    """The base unit has told its operator that it failed, 2 s after it was asked."""
    bench = armed(accept_unarmed_commands=True)
    bench.run(10.0)
    late(bench, 4.0)
    bench.hear(vrci(1), 'VRCI')
    assert not of(Command, bench.events)
    assert bench.session.dropped_commands == 1


@pytest.mark.parametrize('limit', [0.0, 5.0])
def test_limit_may_be_greater_or_none(limit: float) -> None:
    bench = armed(line_age_limit=limit)
    bench.run(10.0)
    late(bench, 10.0)
    assert not bench.session.estop
    assert bool(bench.session.problems(bench.now)) is (limit > 0.0)


@pytest.mark.parametrize('limit', [0.1, -1.0, 11.0])
def test_limit_that_makes_no_sense_is_refused(limit: float) -> None:
    with pytest.raises(ValueError, match='line_age_limit'):
        armed(line_age_limit=limit)


def test_commands_of_the_remote_make_nothing_late_nor_hide_it() -> None:
    bench = armed()
    bench.listeners = None  # so they are sent again and again
    for _ in range(100):
        bench.hear(vrci(1), 'VRCI')
        bench.hear()
        bench.wait(PERIOD)
    assert not bench.session.estop
    for _ in range(100):
        bench.hear(vrci(1), 'VRCI')
        bench.hear()
        bench.wait(1.1 * PERIOD)
    assert bench.session.estop


@pytest.mark.parametrize('first', [1000, 65500])
@pytest.mark.parametrize(('copies', 'kept'), [(0, True), (1, True), (16, True), (16, False)])
def test_slower_way_is_late_though_it_brings_what_is_no_newer_than_what_the_faster_has_brought(
    copies: int, first: int, kept: bool
) -> None:
    """The faster of two ways fails; copies, or what it has lost, come in the silence at first."""
    bench = opened()
    bench.serial = first
    packets = [bench.packet('VRPI', CENTRED) for _ in range(80)]
    for left, packet in zip(range(79, -1, -1), packets, strict=True):
        if kept or left % 16 == 0:
            bench.take(packet)
        bench.wait(PERIOD)
    bench.wait((16 - copies) * PERIOD)
    for packet in packets[len(packets) - copies :]:
        bench.take(packet)
        bench.wait(PERIOD)
    assert not bench.session.link_up
    for _ in range(80):
        bench.hear()
        assert bench.session.own_estop
        bench.wait(PERIOD)
    assert 'look at the network' in bench.session.stop_reasons(bench.now)[0]


def test_base_unit_that_restarts_is_not_late() -> None:
    bench = armed()
    bench.run(10.0)
    late(bench, 4.0)
    assert bench.session.estop
    bench.wait(1.0)
    bench.serial = -1
    bench.run(2.0)
    assert not bench.session.estop
