# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two live publishers on one topic are distinguished from one restarted or killed."""

from collections.abc import Iterator, Sequence
import time

import pytest
from sensor_msgs.msg import Joy

from bridge_core.publishers import PublisherWatch
from stage.mux_talkers import MuxBench, sticks
from stage.rig import NodeProcess, Observer
from stage.talkers import Talker

pytestmark = pytest.mark.waits(60)
PERIOD = 0.05  # s between messages


SLOW_SECOND = [n if n % 8 else n // 8 for n in range(100, 140)]


def hear(watch: PublisherWatch, *numbers: int | None, start: float = 100.0) -> float:
    """Hear one number each PERIOD; return when the last came."""
    for n, number in enumerate(numbers, 1):
        watch.heard(number, start + n * PERIOD)
    return start + len(numbers) * PERIOD


NUMBERS: dict[str, tuple[Sequence[int], bool]] = {
    'one': (range(1, 100), False),
    'one that loses messages': ((1, 2, 5, 6, 40, 41, 1000), False),
    'one that loses every other message': ((1, 3, 5), False),
    'a restart': ((500, 501, 502, 1, 2, 3, 4, 5), False),
    'a restart that loses messages': ((500, 501, 1, 2, 40, 41, 42), False),
    'a restart that loses one': ((5, 5, 7), False),
    'a restart that loses three': ((5, 1, 5), False),
    'two restarts in a second': ((500, 501, 1, 2, 1, 2), True),
    'a number that comes again is a step back': ((5, 5, 5), True),
    'the first goes on after two of the second': ((100, 1, 2, 101), True),
    'the first has lost one, and says as much': ((3, 5, 5), True),
    'a slow second': (SLOW_SECOND, True),
    **{
        f'{ahead} ahead': ([m for n in (1, 2, 3) for m in (n + ahead, n)], True)
        for ahead in (0, 1, 7, 1000)
    },
}


@pytest.mark.parametrize('name', NUMBERS)
def test_numbers_tell_two_publishers_from_one(name: str) -> None:
    watch, (numbers, two) = PublisherWatch(), NUMBERS[name]
    now = hear(watch, *numbers)
    assert watch.doubled(now) == two
    if not two:
        watch.counted(2)  # discovery alone, such as of a dead one, finds no second
        assert not watch.doubled(now)


MOMENTS: dict[str, tuple[Sequence[tuple[int, float]], dict[float, bool]]] = {
    'who was heard within three seconds may be alive': (
        [(500, 100.0), (1, 101.0), (501, 103.0)],
        {103.0: True, 106.0: True, 106.125: False},
    ),
    'and no longer': ([(500, 100.0), (1, 101.0), (501, 103.125)], {103.125: False}),
    'two steps in a second': ([(10, 100.0), (4, 100.5), (3, 101.5)], {101.5: True}),
    'and in more': ([(10, 100.0), (4, 100.5), (3, 101.625)], {101.625: False}),
    'the last two steps count': (
        [(40, 100.0), (30, 110.0), (20, 120.0), (10, 121.0)],
        {121.0: True},
    ),
    'restarts far apart': (
        [(500, 100.0), (1, 100.05), (2, 100.1), (3, 110.0), (1, 110.05), (2, 110.1)],
        {100.1: False, 110.1: False},
    ),
}


@pytest.mark.parametrize('name', MOMENTS)
def test_moments_tell_two_publishers_from_one(name: str) -> None:
    watch, (heard, doubled) = PublisherWatch(), MOMENTS[name]
    for number, now in heard:
        watch.heard(number, now)
    assert {now: watch.doubled(now) for now in doubled} == doubled
    if any(doubled.values()):
        assert watch.settled(heard[-1][1]) is False


def test_messages_that_never_arrived_are_counted() -> None:
    watch = PublisherWatch()
    numbers = [7, 8, 12, 13, 1, 2, None, 4]  # a restart, and a middleware that says nothing
    assert [watch.heard(number, 1.0) for number in numbers] == [0, 0, 3, 0, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ('number', 'lost', 'two'), [(501, 0, True), (511, 10, True), (512, 510, False)]
)
def test_publisher_heard_again_may_have_lost_ten(number: int, lost: int, two: bool) -> None:
    watch = PublisherWatch()
    for each in (500, 1):
        watch.heard(each, 100.0)
    assert watch.heard(number, 100.0) == lost
    assert watch.doubled(100.0) == two


def test_restart_after_which_all_goes_on_is_no_second_publisher() -> None:
    watch = PublisherWatch()
    assert not watch.doubled(hear(watch, *range(400, 500), 1, 2, start=0.0))
    assert not watch.doubled(hear(watch, *range(3, 499), 501, 502, start=0.1 + 102 * PERIOD))


@pytest.mark.parametrize('rate', [0.05, 0.5, 0.9, 1.0, 3.0])
@pytest.mark.parametrize('first', [1, 90, 300, 100_000])
def test_slow_second_publisher_is_found_by_its_first_message(rate: float, first: int) -> None:
    watch = PublisherWatch()
    second, due = first, 5.0
    for tick in range(2000):
        now = tick * PERIOD
        watch.heard(100 + tick, now)
        assert watch.doubled(now) == (second > first), now
        if now >= due:
            watch.heard(second, now)
            watch.counted(2)
            second, due = second + 1, due + 1.0 / rate


def test_second_publisher_that_discovery_knows_is_one_until_it_is_gone() -> None:
    watch = PublisherWatch()
    assert watch.doubled(hear(watch, 100, 7, 101, start=0.0))
    for count, two in ((2, True), (1, False), (2, False)):
        watch.counted(count)
        assert watch.doubled(3600.0) == two


def test_restarted_publisher_counts_again_once_it_is_known_to_be_alone() -> None:
    watch = PublisherWatch()
    watch.counted(2)
    assert not watch.doubled(99.0)  # nobody has heard two
    assert watch.settled(100.0)
    watch.heard(500, 100.0)
    watch.heard(1, 100.1)
    assert not watch.settled(100.35)
    assert watch.settled(100.36)
    watch.heard(501, 100.4)
    watch.heard(2, 100.5)
    assert not watch.settled(101.05)


@pytest.mark.parametrize('number', [None, 0, 0xFFFFFFFFFFFFFFFF])
def test_middleware_without_sequence_numbers_leaves_it_to_discovery(number: int | None) -> None:
    watch = PublisherWatch()
    assert not watch.doubled(hear(watch, *[number] * 20))
    for count, two in ((2, True), (1, False)):
        watch.counted(count)
        assert watch.doubled(100.0) == two
        assert watch.settled(100.0) != two


# Over real topics.


@pytest.fixture
def mux(observer: Observer) -> Iterator[MuxBench]:
    result = MuxBench(observer)
    yield result
    result.close()


def test_second_live_publisher_stops_until_it_is_gone(mux: MuxBench) -> None:
    mux.active()
    cause = time.monotonic()
    topic = f'{mux.space}/fort_vsc_bridge/joy'
    second = Talker(mux.observer, Joy, topic, sticks(0.5, deadman=True), rate=10.0)
    mux.stopped_since(cause, 3.1)  # the first message comes after a period
    mux.joy.message = sticks()
    doubled = f'two live publishers on {topic}'
    mux.wait(lambda: mux.explains(doubled), 'why')
    mux.observer.holds_for(lambda: doubled in mux.why(), 3.5)
    assert not mux.reset().success
    second.leave()
    mux.wait(lambda: mux.is_past('two live publishers'), 'only one again')
    mux.active()


def test_second_mux_is_noticed_by_the_first_and_both_stay_stopped(mux: MuxBench) -> None:
    mux.active()
    with NodeProcess('safety_mux.node', mux.given, namespace=mux.space):
        mux.wait(lambda: 'stop the other publisher' in mux.node.output, 'why')
        mux.joy.message = sticks()
        mux.wait(lambda: mux.state.data[-5:] == ['STOPPED'] * 5, 'what both say')
        mux.state.clear()
        mux.observer.holds_for(lambda: set(mux.state.data) <= {'STOPPED'}, 1.0)
        assert not mux.reset().success
    mux.state.clear()
    mux.wait(lambda: mux.is_past('stop the other publisher'), 'only one again')
    mux.active()
