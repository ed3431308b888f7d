# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two live publishers on one topic are distinguished from one restarted or killed."""

from collections.abc import Iterator
from signal import SIGKILL
import time

import pytest
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool

from bridge_core.publishers import PublisherWatch
from stage.mux_talkers import MuxBench, SILENCE_STOPS_WITHIN, sticks
from stage.rig import NodeProcess, Observer
from stage.talkers import Talker

pytestmark = pytest.mark.waits(60)
PERIOD = 0.05  # s between messages


def heard(*numbers: int | None, watch: PublisherWatch | None = None, start: float = 100.0) -> bool:
    """Hear one number each PERIOD; tell whether the last looks like one of two publishers."""
    watch = watch or PublisherWatch()
    now = start
    for number in numbers:
        now += PERIOD
        watch.heard(number, now)
    return watch.doubled(now)


def test_messages_that_never_arrived_are_counted() -> None:
    watch = PublisherWatch()
    numbers = [7, 8, 12, 13, 1, 2, None, 4]  # a restart, and a middleware that says nothing
    assert [watch.heard(number, 1.0) for number in numbers] == [0, 0, 3, 0, 0, 0, 0, 1]


def test_one_publisher_is_one() -> None:
    assert not heard(*range(1, 100))


def test_gaps_of_lost_messages_are_no_second_publisher() -> None:
    assert not heard(1, 2, 5, 6, 40, 41, 1000)


def test_restart_sets_the_numbers_back_once() -> None:
    assert not heard(500, 501, 502, 1, 2, 3, 4, 5)


def test_two_restarts_in_one_second_are_not_told_from_two_publishers() -> None:
    assert heard(500, 501, 1, 2, 1, 2)  # on the safe side


def test_two_restarts_far_apart_are_restarts() -> None:
    watch = PublisherWatch()
    assert not heard(500, 1, 2, watch=watch)
    assert not heard(3, 1, 2, watch=watch, start=110.0)


@pytest.mark.parametrize('offset', [0, 1, 7, 1000])
def test_two_that_talk_in_turns_are_found_by_the_third_pair(offset: int) -> None:
    pairs = [number for n in range(1, 4) for number in (n + offset, n)]
    assert heard(*pairs)


def test_slow_second_publisher_is_found() -> None:
    numbers = [n if n % 8 else n // 8 for n in range(100, 140)]
    assert heard(*numbers)


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
    assert heard(100, 7, 101, watch=watch, start=0.0)
    watch.counted(2)
    assert watch.doubled(3600.0)
    watch.counted(1)
    assert not watch.doubled(3600.0)
    watch.counted(2)
    assert not watch.doubled(3600.0)


def test_discovery_alone_finds_no_second_publisher() -> None:
    watch = PublisherWatch()
    watch.counted(2)  # such as a dead one, and its successor
    assert not heard(500, 501, 502, 1, 2, 3, 4, 5, watch=watch)


def test_one_that_left_is_forgotten_without_discovery_too() -> None:
    watch = PublisherWatch()
    assert heard(100, 1, 101, 2, 102, watch=watch, start=0.0)
    assert watch.doubled(3.2)
    assert not watch.doubled(3.3)


def test_restart_that_loses_messages_is_no_second_publisher() -> None:
    assert not heard(500, 501, 1, 2, 40, 41, 42)
    watch = PublisherWatch()
    assert not heard(*range(400, 500), 1, 2, watch=watch, start=0.0)
    assert not heard(*range(3, 499), 501, 502, watch=watch, start=0.1 + 102 * PERIOD)


@pytest.mark.parametrize(
    ('number', 'lost', 'two'), [(501, 0, True), (511, 10, True), (512, 510, False)]
)
def test_publisher_that_is_heard_again_may_have_lost_ten(
    number: int, lost: int, two: bool
) -> None:
    watch = PublisherWatch()
    for each in (500, 1):
        watch.heard(each, 100.0)
    assert watch.heard(number, 100.0) == lost
    assert watch.doubled(100.0) == two


@pytest.mark.parametrize(('moment', 'two'), [(103.0, True), (103.125, False)])
def test_publisher_is_alive_for_three_seconds(moment: float, two: bool) -> None:
    watch = PublisherWatch()
    watch.heard(500, 100.0)
    watch.heard(1, 101.0)
    watch.heard(501, moment)
    assert watch.doubled(moment) == two
    if two:
        assert watch.doubled(moment + 3.0)
        assert not watch.doubled(moment + 3.125)


@pytest.mark.parametrize(('moment', 'two'), [(101.5, True), (101.625, False)])
def test_two_steps_back_within_a_second_are_two_publishers(moment: float, two: bool) -> None:
    watch = PublisherWatch()
    watch.heard(10, 100.0)
    watch.heard(4, 100.5)
    watch.heard(3, moment)
    assert watch.doubled(moment) == two
    assert watch.settled(moment) is False


def test_number_that_comes_again_is_a_step_back() -> None:
    assert heard(5, 5, 5)


@pytest.mark.parametrize(
    ('numbers', 'two'),
    [
        ((100, 1, 2, 101), True),  # the first goes on after two of the second
        ((3, 5, 5), True),  # the first has lost one, and says as much as the second
        ((1, 3, 5), False),  # one that loses every other message
        ((5, 5, 7), False),  # it was restarted, and lost one
        ((5, 1, 5), False),  # it was restarted, and lost three
    ],
)
def test_numbers_that_go_on_where_others_came_between_are_of_two(
    numbers: tuple[int, ...], two: bool
) -> None:
    assert heard(*numbers) == two


def test_the_last_two_steps_back_count_however_many_there_were() -> None:
    watch = PublisherWatch()
    for number, now in ((40, 100.0), (30, 110.0), (20, 120.0), (10, 121.0)):
        watch.heard(number, now)
    assert watch.doubled(121.0)


def test_two_publishers_of_whom_nothing_was_heard_yet_are_not_told_apart() -> None:
    watch = PublisherWatch()
    watch.counted(2)
    assert not watch.doubled(100.0)


def test_restarted_publisher_counts_again_once_it_is_known_to_be_alone() -> None:
    watch = PublisherWatch()
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
    assert not heard(*[number] * 20, watch=watch)
    assert watch.settled(100.0)
    watch.counted(2)
    assert watch.doubled(100.0)
    assert not watch.settled(100.0)
    watch.counted(1)
    assert not watch.doubled(100.0)


def test_discovery_alone_makes_no_second_publisher_where_numbers_are_told() -> None:
    watch = PublisherWatch()
    assert not heard(*range(1, 20), watch=watch)
    watch.counted(2)
    assert not watch.doubled(100.0)


# Over real topics.


@pytest.fixture
def mux(observer: Observer) -> Iterator[MuxBench]:
    result = MuxBench(observer)
    yield result
    result.close()


@pytest.mark.parametrize(
    ('topic', 'rate'), [('fort_vsc_bridge/estop', 50.0), ('fort_vsc_bridge/joy', 0.5)]
)
def test_second_live_publisher_stops_until_it_is_gone(
    mux: MuxBench, topic: str, rate: float
) -> None:
    mux.active()
    cause = time.monotonic()
    kind, message = (Joy, sticks(0.5, deadman=True)) if 'joy' in topic else (Bool, Bool())
    second = Talker(mux.observer, kind, f'{mux.space}/{topic}', message, rate=rate)
    mux.stopped_since(cause, 1.0 / rate + 3.0)  # the first message comes after a period
    mux.joy.message = sticks()
    doubled = f'two live publishers on {mux.space}/{topic}'
    mux.wait(lambda: mux.explains(doubled), 'why')
    mux.observer.holds_for(lambda: doubled in mux.why(), 3.5)
    assert not mux.reset().success
    second.leave()
    mux.wait(lambda: mux.is_past('two live publishers'), 'only one again')
    mux.active()


def test_second_publisher_that_says_stop_among_clear_ones_latches(mux: MuxBench) -> None:
    mux.active()
    second = mux.observer.publisher(Bool, f'{mux.space}/esi_drive_bridge/estop')
    cause = time.monotonic()
    second.publish(Bool(data=True))
    mux.stopped_since(cause, 3.0)


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


_SOURCE = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import Bool
rclpy.init()
node = Node('source')
publisher = node.create_publisher(Bool, '{topic}', 10)
node.create_timer(0.02, lambda: publisher.publish(Bool()))
rclpy.spin(node)
"""


def test_killed_source_does_not_keep_its_successor_out(mux: MuxBench) -> None:
    mux.drive_estop.pause()
    source = _SOURCE.format(topic=f'{mux.space}/esi_drive_bridge/estop')
    with NodeProcess(source=source) as first:
        mux.active()
        cause = time.monotonic()
        assert first.end(SIGKILL) == -SIGKILL
        mux.stopped_since(cause, SILENCE_STOPS_WITHIN)
    mux.joy.message = sticks()
    with NodeProcess(source=source):
        # Discovery still counts the dead one.
        mux.active()
        assert not any('two live' in status.message for status in mux.status.messages)
