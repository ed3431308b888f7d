# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The way of a stop through a node, on rclpy's wait set and on its public executor."""

from collections.abc import Callable, Iterator
from concurrent.futures import wait
import threading
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool, Int32

from bridge_core import clock, lane as lane_module, rclpy_inner
from bridge_core.lane import Lane
from stage.rig import wait_for

PERIOD = 0.02


class Rig:
    """A node with a lane, and another node that publishes to it."""

    def __init__(self, context: Context) -> None:
        self.node = Node('listener', namespace='/lane', context=context)
        self.talker = Node('talker', namespace='/lane', context=context)
        self.lane = Lane(self.node, 'listener lane')
        self.heard: list[Any] = []

    def listen(self, topic: str = 'number') -> Callable[[int], None]:
        """Subscribe into ``heard``; return what publishes there, once both have met."""
        self.lane.subscribe(Int32, topic, self.hear, 10)
        return self.publisher(topic)

    def hear(self, message: Any, info: dict[str, Any]) -> None:
        del info
        self.heard.append(message.data)

    def publisher(self, topic: str, qos: Any = 10, kind: Any = Int32) -> Callable[[Any], None]:
        """Return what publishes there, once it is heard: a value, or a message as bytes."""
        publisher = self.talker.create_publisher(kind, topic, qos)
        wait_for(lambda: publisher.get_subscription_count(), what=topic)

        def publish(value: Any) -> None:
            publisher.publish(value if isinstance(value, bytes) else kind(data=value))

        return publish

    def wait_heard(self, *numbers: int) -> None:
        wait_for(lambda: self.heard == list(numbers), what=lambda: f'{numbers}: {self.heard[-9:]}')

    def close(self) -> None:
        self.lane.stop()
        self.node.destroy_node()
        self.talker.destroy_node()


@pytest.fixture(params=['wait set', 'executor'], autouse=True)
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run each test both ways."""
    if request.param == 'executor':
        monkeypatch.setattr(rclpy_inner, 'wait_set_works', lambda context: False)
    return str(request.param)


@pytest.fixture
def rig(context: Context) -> Iterator[Rig]:
    result = Rig(context)
    yield result
    result.close()


def test_lane_waits_by_the_wait_set_where_there_is_one(
    capfd: pytest.CaptureFixture[str], rig: Rig, way: str
) -> None:
    is_inner = way == 'wait set'
    assert isinstance(rig.lane._waiter, rclpy_inner._WaitSetWaiter) == is_inner
    assert ('by the executor of rclpy' not in capfd.readouterr().err) == is_inner


def test_messages_come_in_order_with_their_numbers(rig: Rig) -> None:
    numbers: list[int] = []

    def on_message(message: Any, info: dict[str, Any]) -> None:
        rig.hear(message, info)
        numbers.append(info['publication_sequence_number'])
        assert threading.current_thread().name == 'listener lane'

    rig.lane.subscribe(Int32, 'number', on_message, 100)
    rig.lane.start()
    say = rig.publisher('number', 100)
    for n in range(50):
        say(n)
    rig.wait_heard(*range(50))
    assert numbers == list(range(numbers[0], numbers[0] + 50))


def test_lane_tells_its_subscriptions_which_have_the_namespace_of_the_node(rig: Rig) -> None:
    first, second = (rig.lane.subscribe(Int32, f'~/{topic}', rig.hear, 10) for topic in 'ab')
    assert first.topic_name == '/lane/listener/a'
    assert not list(first.event_handlers)  # nobody would ever serve them
    assert rig.lane.subscriptions == [first, second]
    rig.lane.unsubscribe(first)
    assert rig.lane.subscriptions == [second]


def test_group_of_a_lane_lets_no_executor_begin() -> None:
    group = rclpy_inner.NotForExecutors()
    assert not group.can_execute(object())
    assert not group.beginning_execution(object())


def test_no_stop_among_a_thousand_messages_is_lost(rig: Rig) -> None:
    """All depth's worth that waits at once is read, with other topics and calls going on."""
    stops: list[bool] = []
    qos = QoSProfile(depth=1000)
    rig.lane.subscribe(Bool, 'estop', lambda message, info: stops.append(message.data), qos)
    other = rig.listen()
    say = rig.publisher('estop', qos, Bool)
    sent = [n % 97 == 0 for n in range(1000)]
    for n, stop in enumerate(sent):
        say(stop)
        if n % 50 == 0:
            other(n)
    rig.lane.start()
    wait_for(lambda: len(stops) == 1000, what=lambda: f'{len(stops)} came')
    assert stops == sent


def test_flood_of_one_topic_leaves_others_their_turn(rig: Rig, way: str) -> None:
    order: list[str] = []
    first = rig.lane.subscribe(Int32, 'first', lambda *_: order.append('first'), 500)
    rig.lane.subscribe(Int32, 'second', lambda *_: order.append('second'), 10)
    flood, single = rig.publisher('first', 500), rig.publisher('second')
    for n in range(500):
        flood(n)
    single(0)
    assert first is not None
    rig.lane.start()
    wait_for(lambda: len(order) == 501, what=lambda: f'{len(order)} came')
    assert order[0] == 'first'  # subscribed first
    assert order.index('second') <= 2 * rclpy_inner._BATCH


@pytest.mark.parametrize(
    ('received', 'waited'),
    [(0, 0.0), (1, 9.999999999), (7_500_000_000, 2.5), (10_000_000_009, 0.0)],
)
def test_message_waited_since_the_middleware_took_it_in(
    monkeypatch: pytest.MonkeyPatch, received: int, waited: float
) -> None:
    monkeypatch.setattr('bridge_core.lane.time.time_ns', lambda: 10_000_000_000)
    assert lane_module.waited({'received_timestamp': received}) == pytest.approx(waited)


def test_lane_that_has_nothing_to_do_sleeps(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    publish = rig.listen()
    waiter = rig.lane._waiter
    real, waits = waiter.wait, []

    def wait_counted(*arguments: Any, **options: Any) -> None:
        waits.append(arguments)
        real(*arguments, **options)

    monkeypatch.setattr(waiter, 'wait', wait_counted)
    rig.lane.start()
    for number in range(20):
        publish(number)
        wait_for(lambda: rig.heard[-1:] == [number])  # noqa: B023 - waited for here
    assert len(waits) < 100
    waits.clear()
    called = threading.Event()
    rig.lane.every(0.5, lambda now: called.set())
    for _ in range(2):
        assert called.wait(30.0)
        called.clear()
    assert len(waits) < 50


def test_set_is_made_anew_for_topics(rig: Rig, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if way != 'wait set':
        return
    real, made = rclpy_inner.make_wait_set, []

    def make_counted(*arguments: Any) -> Any:
        made.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(rclpy_inner, 'make_wait_set', make_counted)
    publish = rig.listen()
    rig.lane.start()
    for number in range(20):
        publish(number)
        wait_for(lambda: rig.heard[-1:] == [number])  # noqa: B023 - waited for here
    assert len(made) == 1


def test_subscription_that_others_destroy_takes_nothing_else_along(rig: Rig) -> None:
    lost = rig.lane.subscribe(Int32, 'lost', rig.hear, QoSProfile(depth=1))
    publish = rig.listen()
    lost.destroy()
    rig.lane.start()
    publish(1)
    rig.wait_heard(1)
    assert not rig.lane.fault.done()


def test_lane_that_has_ended_holds_no_subscription(rig: Rig) -> None:
    publish = rig.listen()
    rig.lane.start()
    publish(1)
    rig.wait_heard(1)
    [subscription] = rig.lane.subscriptions
    rig.lane.stop()
    subscription.destroy()
    with pytest.raises(InvalidHandle):
        subscription.handle.__enter__()
    wait_for(lambda: rig.talker.count_subscribers('number') == 0)


def test_subscriptions_are_added_and_removed_while_it_waits(rig: Rig) -> None:
    second = rig.lane.subscribe(Int32, 'second', lambda *_: rig.heard.append('removed'), 10)
    publisher = rig.talker.create_publisher(Int32, 'second', 10)
    wait_for(lambda: publisher.get_subscription_count(), what='second')
    rig.lane.start()
    say_first = rig.listen('first')  # added while it waits
    say_first(1)
    rig.wait_heard(1)
    rig.lane.unsubscribe(second)
    wait_for(lambda: not publisher.get_subscription_count(), what='it is gone')
    publisher.publish(Int32())
    say_first(2)
    rig.wait_heard(1, 2)


def test_nothing_comes_after_a_callback_has_unsubscribed(rig: Rig) -> None:
    def on_message(message: Any, info: dict[str, Any]) -> None:
        rig.hear(message, info)
        rig.lane.unsubscribe(subscription)

    subscription = rig.lane.subscribe(Int32, 'number', on_message, 10)
    say, last = rig.publisher('number'), rig.listen('last')
    for n in range(5):
        say(n)
    last(99)
    rig.lane.start()
    rig.wait_heard(0, 99)


def test_callback_that_raises_loses_no_other(rig: Rig, capfd: pytest.CaptureFixture[str]) -> None:
    def on_message(message: Any, info: dict[str, Any]) -> None:
        rig.hear(message, info)
        raise ZeroDivisionError

    rig.lane.subscribe(Int32, 'number', on_message, 10)
    rig.lane.start()
    say = rig.publisher('number')
    for n in range(5):
        say(n)
    rig.wait_heard(*range(5))
    output = ''

    def reported() -> bool:
        nonlocal output
        output += capfd.readouterr().err
        return 'ZeroDivisionError' in output

    wait_for(reported, what='the report')
    assert output.count('Traceback') == 1


def test_message_that_nobody_can_read_is_counted_and_loses_nothing_else(rig: Rig) -> None:
    stops: list[bool] = []
    rig.lane.subscribe(Bool, 'estop', lambda message, info: stops.append(message.data), 10)
    say = rig.publisher('estop', 10, Bool)
    rig.lane.start()
    for message in (True, b'\0\1\0\0', b'\0\1', True):
        say(message)
    wait_for(lambda: len(stops) == 2, what='what came behind them')
    assert stops == [True, True]
    assert rig.lane.malformed == 2


def test_executor_of_the_node_leaves_the_lane_its_messages(rig: Rig, context: Context) -> None:
    """Its own subscriptions it serves; so does the lane, in its thread."""
    threads: list[threading.Thread] = []
    rig.lane.subscribe(Int32, 'number', lambda *_: threads.append(threading.current_thread()), 10)
    ordinary: list[Any] = []
    rig.node.create_subscription(Int32, 'number', ordinary.append, 10)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(rig.node)
    rig.lane.start()
    say = rig.publisher('number')
    wait_for(lambda: rig.node.count_subscribers('number') == 2, what='both')
    for n in range(10):
        say(n)
    wait_for(
        lambda: len(threads) == len(ordinary) == 10,
        what=lambda: f'{len(threads)}, {len(ordinary)}',
        idle=lambda duration: executor.spin_once(timeout_sec=duration),
    )
    executor.shutdown()
    assert {thread.name for thread in threads} == {'listener lane'}


# Calls.


def test_posted_calls_come_in_order_also_those_of_before_the_start(rig: Rig) -> None:
    rig.lane.post(rig.heard.append, 0)
    rig.lane.start()
    for n in range(1, 100):
        rig.lane.post(rig.heard.append, n)
    rig.wait_heard(*range(100))


def test_call_returns_what_the_lane_returns_or_raises_and_is_direct_without_it(rig: Rig) -> None:
    assert rig.lane.call(threading.current_thread) is threading.current_thread()
    rig.lane.start()
    assert rig.lane.call(lambda n: (n, threading.current_thread().name), 3) == (3, 'listener lane')
    with pytest.raises(ZeroDivisionError):
        rig.lane.call(lambda: 1 / 0)
    assert rig.lane.call(rig.lane.call, max, 1, 2) == 2  # directly on the lane's own thread
    rig.lane.stop()
    assert rig.lane.call(threading.current_thread) is threading.current_thread()


def test_call_that_was_given_up_is_never_made(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    gate = threading.Event()
    rig.lane.start()
    rig.lane.post(gate.wait)
    with monkeypatch.context() as patch:
        patch.setattr(lane_module, '_CALL_LIMIT', 0.1)
        with pytest.raises(TimeoutError, match='nothing was done: listener lane'):
            rig.lane.call(rig.heard.append, 'late')
    gate.set()
    rig.lane.call(rig.heard.append, 'next')
    assert rig.heard == ['next']


@pytest.mark.parametrize('waits', [1, 2])
def test_call_that_has_begun_is_never_said_not_to_be_made(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, waits: int
) -> None:
    """It is given up after the second wait; an answer during that is worth it."""
    gate, begun = threading.Event(), threading.Event()
    over: list[bool] = []  # waits that were

    def answer() -> bool:
        begun.set()
        return gate.wait(20.0)

    def wait_in_vain(futures: Any, timeout: float) -> Any:
        assert begun.wait(20.0)
        over.append(True)
        if len(over) > waits:
            gate.set()
        return wait(futures, 20.0 if gate.is_set() else 0.0)

    monkeypatch.setattr(lane_module, 'wait', wait_in_vain)
    rig.lane.start()
    if waits == 1:
        assert rig.lane.call(answer) is True
    else:
        with pytest.raises(TimeoutError, match='may still be done'):
            rig.lane.call(answer)
        gate.set()


def test_nothing_that_was_posted_is_lost_behind_calls_that_were_given_up(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lane_module, '_CALL_LIMIT', 0.0)
    monkeypatch.setattr(lane_module, '_CAPACITY', 19)
    rig.lane.stop()
    rig.lane = Lane(rig.node, 'listener lane')
    gate = threading.Event()
    rig.lane.start()
    rig.lane.post(gate.wait)
    wait_for(lambda: not rig.lane._calls, 20.0, 'hanging')
    for number in range(30):
        rig.lane.post(rig.heard.append, number)
        with pytest.raises(TimeoutError, match='nothing was done: listener lane'):
            rig.lane.call(rig.heard.append, 'late')
    assert len(rig.lane._calls) == 39, 'calls that are given up pile up'
    gate.set()
    rig.wait_heard(*range(30))


def test_call_that_the_lane_posts_itself_needs_no_wake(rig: Rig) -> None:
    assert rig.lane._timeout() is None
    rig.lane.post(int)
    assert rig.lane._timeout() == 0.0
    rig.lane.post(rig.lane.post, rig.heard.append, 1)
    rig.lane.start()
    rig.wait_heard(1)


# Timers.


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Have a lane that was not started take its time from here: ``time.now()``, ``time.at``."""
    result = SimpleNamespace(at=0.0)
    result.now = lambda: result.at
    monkeypatch.setattr(lane_module, 'clock', result)
    return result


Plan = dict[float, bool]  # at which moments it is looked at, and whether the lane rests then


@pytest.mark.parametrize(
    ('added', 'rest', 'plan', 'called'),
    [
        (
            *(0.0, None),
            dict.fromkeys((0.9, 1.0, 1.25, 1.9, 2.2, 2.9, 3.0, 5.0, 5.5, 5.9, 6.0), False),
            [1.0, 2.2, 3.0, 5.0, 6.0],  # late, they keep their phase and are not made up for
        ),
        (0.0, 2.0, {1.0: False, 2.0: True, 3.0: True, 4.0: False, 5.0: False}, [1, 2, 4, 5]),
        # Those that are due within 1 ms come together.
        (0.0005, None, dict.fromkeys((1.0, 2.0, 2.0005, 3.25, 4.0), False), [1, 2, 3.25, 4]),
    ],
    ids=['once each period', 'another period while it rests', 'together'],
)
def test_timer_is_called_when_it_is_due(
    rig: Rig, time: Any, added: float, rest: float | None, plan: Plan, called: list[float]
) -> None:
    time.at = added
    rig.lane.every(1.0, rig.heard.append, rest=rest)
    for time.at, rig.lane.rests in plan.items():
        rig.lane._call_timers()
    assert rig.heard == called


def test_what_is_not_urgent_wakes_no_resting_lane(rig: Rig, way: str) -> None:
    rig.lane.subscribe(Int32, 'sticks', rig.hear, 10, urgent=False)
    say_sticks, say_stop = rig.publisher('sticks'), rig.listen('stop')
    rig.lane.rests = True
    rig.lane.start()
    say_stop(0)
    rig.wait_heard(0)  # it waits now, and nothing wakes it that came before
    say_sticks(1)
    if way == 'wait set':  # the executor waits for all
        time_out = clock.now() + 0.3
        while clock.now() < time_out:
            assert rig.heard == [0]
    say_stop(2)
    rig.wait_heard(0, 1, 2)
    rig.lane.post(lambda: setattr(rig.lane, 'rests', False))
    for n in range(3, 6):  # the first one may come in the wake-up by ``post``
        say_sticks(n)
        rig.wait_heard(*range(n + 1))


def test_wait_is_as_long_as_to_the_next_timer(rig: Rig, time: Any) -> None:
    rig.lane.every(9.0, rig.heard.append)
    rig.lane.every(1.0, rig.heard.append)
    assert rig.lane._timeout() == 1.0
    time.at = 1.5
    assert rig.lane._timeout() == 0.0


def test_faults_are_told_each_second(
    rig: Rig, time: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    for at in (0.0, 0.9, 1.0, 1.9, 2.0):
        time.at = at
        rig.lane._guarded(lambda: 1 / 0)
    assert capfd.readouterr().err.count('ZeroDivisionError') == 3


def test_timer_added_while_it_waits_for_ever_comes(rig: Rig) -> None:
    rig.lane.start()
    rig.lane.call(int)  # it has begun to wait
    rig.lane.every(PERIOD, rig.heard.append)
    wait_for(lambda: rig.heard, what='a call')


# Ends.


def thread_of(lane: Lane) -> threading.Thread:
    assert lane.thread is not None
    return lane.thread


def assert_gives_back(lane: Lane) -> None:
    """What wakes it is rclpy's no more."""
    waiter: Any = lane._waiter
    guard: GuardCondition = waiter._guard
    with pytest.raises(InvalidHandle):
        guard.trigger()


def destroy_and_wake(rig: Rig, _: Context) -> None:
    rig.node.destroy_node()
    rig.lane.post(int)


ENDS: dict[str, Callable[[Rig, Context], object]] = {
    'it is stopped': lambda rig, context: rig.lane.stop(),
    'it stops itself': lambda rig, context: rig.lane.post(rig.lane.stop),
    'its context is shut down': lambda rig, context: context.shutdown(),
    'its node is destroyed, and it wakes': destroy_and_wake,
}


@pytest.mark.parametrize('end', ENDS)
def test_thread_ends_and_that_is_no_fault(context: Context, end: str) -> None:
    own = Context()
    rclpy.init(context=own)
    rig = Rig(own)
    rig.listen()
    rig.lane.start()
    rig.lane.call(int)  # it waits
    ENDS[end](rig, own)
    thread = thread_of(rig.lane)
    wait_for(lambda: not thread.is_alive(), what='its end')
    assert_gives_back(rig.lane)
    assert not rig.lane.fault.done()
    rig.lane.stop()  # may be repeated
    rig.close()
    own.try_shutdown()
    assert context.ok()


def test_stop_without_a_start(rig: Rig) -> None:
    rig.listen()
    rig.lane.stop()
    assert_gives_back(rig.lane)
    rig.lane.post(int)


def test_what_the_last_call_posts_is_called(rig: Rig) -> None:
    def end() -> None:
        rig.lane.stop()
        rig.lane.post(rig.heard.append, 1)

    rig.lane.start()
    rig.lane.post(end)
    rig.wait_heard(1)


@pytest.mark.parametrize('fault', [ZeroDivisionError, SystemExit])
def test_timer_that_raises_ends_the_thread_which_is_told(
    rig: Rig, fault: type[BaseException], capfd: pytest.CaptureFixture[str]
) -> None:
    def act(now: float) -> None:
        raise fault

    told: list[Any] = []
    rig.lane.fault.add_done_callback(told.append)
    rig.lane.every(PERIOD, act)
    rig.lane.start()
    wait_for(lambda: told, what='the fault')
    assert isinstance(rig.lane.fault.exception(0.0), fault)
    assert 'listener lane ends: Traceback' in capfd.readouterr().err
    assert rig.lane.call(threading.current_thread) is threading.current_thread()


def test_lane_that_hangs_is_alone(
    rig: Rig, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lane_module, '_CALL_LIMIT', 0.1)
    other = Rig(context)
    gate = threading.Event()
    try:
        for each in (rig, other):
            each.lane.every(PERIOD, each.heard.append)
            each.lane.start()
        wait_for(lambda: rig.heard and other.heard, what='both')
        rig.lane.post(gate.wait)
        wait_for(lambda: rig.lane._calls or not gate.is_set(), what='it hangs')
        with pytest.raises(TimeoutError):
            rig.lane.call(int)
        silent, count = len(rig.heard), len(other.heard)
        wait_for(lambda: len(other.heard) > count + 10, what='the other goes on')
        assert len(rig.heard) == silent
        rig.lane.stop()  # gives up
        assert thread_of(rig.lane).is_alive()
        assert thread_of(rig.lane).daemon  # it holds no process
    finally:
        gate.set()
        other.close()


@pytest.mark.parametrize(
    ('name', 'owner'),
    [('_safety_mux_lane', 'safety_mux'), ('safety_mux', 'safety_mux'), ('fast_lane', 'fast_lane')],
)
def test_owner_of_the_small_node_of_a_lane_is_named(name: str, owner: str) -> None:
    assert lane_module.owner_of(name) == owner
