# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How old what comes over a serial server may be: by a question that the VSC answers."""

from collections import deque
from collections.abc import Callable
from functools import partial
import math
import random

import pytest

from bridge_core.session import Level
from fort_vsc_bridge.protocol.wires import CanWire, HidWire, SerialWire
from fort_vsc_bridge.session import Session, Settings, UserValue
from fort_vsc_bridge.session.line_age import AGE_KEY, LineAge
from fort_vsc_bridge.simulator import build_frame, Simulator
from stage.fort_vsc_rig import Bench, heartbeat, opened

NETWORK = SerialWire(network=True)
LIMIT = 0.5
QUESTION = build_frame(0x32, bytes((AGE_KEY,)))
ANSWER = build_frame(0x30, bytes((AGE_KEY, 0, 0, 0, 0)))
STEP = 0.005

Delay = Callable[[float], float]


def after(start: float, delay: float) -> Delay:
    return lambda at: delay if at >= start else 0.01


def creeping(start: float, rate: float, most: float) -> Delay:
    return lambda at: 0.01 + min(max(at - start, 0.0) * rate, most)


class Far:
    """A simulated VSC behind a network, which delays each way and keeps the order."""

    def __init__(self, there: Delay = lambda at: 0.01, back: Delay = lambda at: 0.01) -> None:
        self.bench = opened(wire=NETWORK)
        self.device = Simulator()
        self.device.apply('mode operational')
        self.delays = (there, back)
        self.lose: Callable[[bytes], bool] = lambda frame: False  # of what the VSC says
        self.began = self.bench.now
        self.oracle = True  # what the session says of the age is compared with the truth
        self.stopped: list[tuple[float, bool, str]] = []  # since when, whether, and why
        self.ages: list[float] = []  # true ages of what came, and what the session says of it
        self._ways: tuple[deque[tuple[float, bytes, float]], ...] = (deque(), deque())
        self._seen = 0

    def run(self, seconds: float) -> None:
        bench, end = self.bench, self.bench.now + seconds
        while bench.now < end:
            bench.now += STEP
            now = bench.now
            self._put(1, [f for f in self.device.poll(now) if not self.lose(f)])
            bench.hear(*self._taken(1))
            self._put(0, [frame for _, frame in bench.sent[self._seen :]])
            self._seen = len(bench.sent)
            for frame in self._taken(0):
                self.device.receive(frame, now)
            self._note()

    def _put(self, way: int, frames: list[bytes]) -> None:
        now = self.bench.now
        for frame in frames:
            last = self._ways[way][-1][0] if self._ways[way] else 0.0
            at = max(now + self.delays[way](now - self.began), last)
            self._ways[way].append((at, frame, now))

    def _taken(self, way: int) -> list[bytes]:
        frames = []
        while self._ways[way] and self._ways[way][0][0] <= self.bench.now:
            _, frame, said_at = self._ways[way].popleft()
            frames.append(frame)
            if way and frame[2] == 0x20:
                self.said_at = said_at
        return frames

    def _note(self) -> None:
        session, now = self.bench.session, self.bench.now
        if session.link_up and self.oracle:
            assert session.as_of(now) <= self.said_at + 1e-6, 'it was said sooner'
        if not self.stopped or self.stopped[-1][1] is not session.estop:
            why = '; '.join(session.stop_reasons(now))
            self.stopped.append((now - self.began, session.estop, why))

    @property
    def stops(self) -> list[tuple[float, str]]:
        """Return when it stopped since the link came up first, and why."""
        return [(at, why) for at, stop, why in self.stopped[2:] if stop]

    def warnings(self) -> list[str]:
        problems = self.bench.session.problems(self.bench.now)
        return [text for level, text in problems if level is Level.WARN]


@pytest.mark.parametrize(
    ('each_way', 'warned'), [(0.0, False), (0.02, False), (0.1, False), (0.15, True), (0.19, True)]
)
def test_line_that_is_young_enough_is_no_stop(each_way: float, warned: bool) -> None:
    far = Far(after(0.0, each_way), after(0.0, each_way))
    far.run(20.0)
    assert far.stops == []
    assert bool(far.warnings()) is warned
    age = far.bench.now - far.bench.session.as_of(far.bench.now)
    assert 2 * each_way < age < 2 * each_way + 0.25
    questions = len(far.bench.frames(0x32))
    assert questions < (30 if each_way < 0.1 else 90)
    assert far.device.too_fast[0x32] == 0
    assert UserValue(AGE_KEY, 0) not in far.bench.events


@pytest.mark.parametrize('there', [0.01, 0.4, 2.0])
@pytest.mark.parametrize('back', [0.3, 0.46, 2.0, 7.5])
def test_line_late_from_the_start_stops_once_that_is_known(there: float, back: float) -> None:
    far = Far(after(0.0, there), after(0.0, back))
    far.run(30.0)
    if there + back < 0.4:  # and two heartbeats
        assert far.stops == []
        return
    at, why = far.stops[0]
    assert at <= there + back + 0.2
    assert 'look at the network to the serial server' in why
    assert len(far.stops) == 1
    assert far.bench.session.estop


@pytest.mark.parametrize(
    ('rate', 'most'),
    [(0.3, 2.0), (0.5, 2.0), (1.0, 2.0), (0.12, 2.0), (0.05, 0.6)],
)
def test_delay_that_creeps_stops_soon_after_it_has_passed_the_limit(
    rate: float, most: float
) -> None:
    """As it does where other traffic fills the queue of a radio: no gap tells it."""
    far = Far(back=creeping(5.0, rate, most))
    far.run(5.0 + most / rate + 5.0)
    ((at, why),) = far.stops
    said = 5.0 + LIMIT / rate
    assert at < said + LIMIT + 0.05
    assert 'line_age_limit is 500 ms' in why
    assert far.bench.session.estop
    far.delays = (far.delays[0], after(0.0, 0.01))
    far.run(10.0)
    assert not far.bench.session.estop


@pytest.mark.parametrize('late', [1.5, 3.05, 8.0])
def test_stall_that_keeps_its_backlog_is_late_until_it_is_young_again(late: float) -> None:
    end = 5.0 + late
    far = Far(back=lambda at: 0.01 if at < 5.0 else max(end - at, 0.01) if at < end else late)
    far.run(end + late + 4.0)
    assert len(far.stops) == 1
    assert far.bench.session.estop
    assert 'up to' in far.bench.session.stop_reasons(far.bench.now)[0]


@pytest.mark.parametrize(('lost', 'interval'), [(LineAge.PATIENCE + 0.5, 0.05), (0.0, 0.1)])
def test_lost_answers_or_fewer_heartbeats_are_no_stop(lost: float, interval: float) -> None:
    far = Far()
    far.device.messages[0x20] = (True, interval)
    far.run(3.0)
    far.lose = lambda frame: frame[2] == 0x30
    far.run(lost)
    assert far.bench.session.estop is False
    far.lose = lambda frame: False
    far.run(7.0)
    assert far.stops == []
    assert far.warnings() == []
    if not lost:  # it is asked more often
        assert 20 < len(far.bench.frames(0x32)) < 60


def test_vsc_that_sends_its_heartbeats_faster_hides_no_delay() -> None:
    far = Far(back=creeping(5.0, 0.02, 2.0))
    far.device.messages[0x20] = (True, 0.02)
    far.run(5.0)
    assert far.bench.now - far.bench.session.as_of(far.bench.now) < 0.15
    far.oracle = False  # for a second they may hide what one question after the other tells
    far.run(50.0)
    ((at, _),) = far.stops
    assert at < 5.0 + LIMIT / 0.02 + LIMIT + 1.0


def test_vsc_that_answers_no_question_is_a_warning_and_no_stop() -> None:
    far = Far()
    far.lose = lambda frame: frame[2] == 0x30
    far.run(LineAge.FIRST_PATIENCE - 0.5)
    assert far.warnings() == []
    far.run(1.0)
    (text,) = far.warnings()
    assert 'nobody knows how old what comes over this network is' in text
    assert far.bench.session.as_of(far.bench.now) == -math.inf
    far.run(20.0)
    assert far.stops == []
    assert len(far.bench.frames(0x32)) == 4
    far.lose = lambda frame: False
    far.run(LineAge.FIRST_PATIENCE)
    assert far.warnings() == []
    assert far.bench.session.as_of(far.bench.now) > far.bench.now - 0.2


@pytest.mark.parametrize('before', [0.0, 0.01, 0.3])
def test_question_of_somebody_else_makes_nothing_younger(before: float) -> None:
    """Its answer may come first, and is that to the older question."""
    far = Far(back=after(0.0, 0.2))
    far.run(6.0)
    for _ in range(20):
        far.run(before + 0.13)
        far.bench.session.get_feedback(AGE_KEY, far.bench.now)
    far.run(2.0)
    assert UserValue(AGE_KEY, 0) in far.bench.events
    assert far.stops == []


def test_question_waits_behind_none_of_somebody_else() -> None:
    far = Far()
    far.run(3.0)
    for _ in range(20):
        for key in range(1, 10):
            far.bench.session.get_feedback(key, far.bench.now)
        far.run(0.2)
        assert far.bench.now - far.bench.session.as_of(far.bench.now) < 0.3
    assert far.stops == []
    assert far.device.too_fast[0x32] == 0


def test_node_that_was_held_up_asks_again() -> None:
    """Meanwhile the line may have grown late: it saw no heartbeat that tells."""
    far = Far()
    far.run(3.0)
    far.bench.now += 2.0
    far.bench.session.interrupted('held up', far.bench.now)
    far.run(0.1)
    assert far.bench.session.estop
    far.run(1.5)
    assert not far.bench.session.estop
    assert len(far.stops) == 1


def test_new_line_is_of_unknown_age() -> None:
    assert Session(Settings(wire=NETWORK)).as_of(0.0) == -math.inf
    far = Far()
    far.run(3.0)
    far.bench.close()
    far.bench.open()
    assert far.bench.session.as_of(far.bench.now) == -math.inf
    far.run(0.2)
    assert far.bench.session.as_of(far.bench.now) > far.bench.now - 0.2


@pytest.mark.parametrize('opened_at', [6.0, 6.2, 6.4, 6.6, 6.8, 7.0, 7.2])
@pytest.mark.parametrize('back', [1.05, 1.2, 2.1])
def test_answer_of_before_the_line_makes_an_old_one_young_for_a_moment_alone(
    opened_at: float, back: float
) -> None:
    """It was on its way when the port was opened anew."""
    far = Far(back=after(0.0, back))
    far.oracle = False
    far.run(opened_at)
    assert far.bench.session.estop
    far.bench.close()
    far.bench.open()
    far.run(LineAge.PATIENCE)
    far.oracle = True
    for _ in range(40):
        far.run(0.25)
        assert far.bench.session.estop


@pytest.mark.parametrize('wire', [SerialWire(), CanWire(), HidWire()])
def test_line_that_holds_nothing_back_is_asked_nothing(wire: SerialWire | CanWire) -> None:
    session = Session(Settings(wire=wire))
    session.opened(0.0)
    assert session.as_of(0.0) == -math.inf
    if wire == SerialWire():
        bench = opened()
        bench.run(2.0, heartbeat())
        assert bench.session.as_of(bench.now) == pytest.approx(bench.now - 0.02)
        assert bench.frames(0x32) == []
        assert not any('age of the line' in name for name in bench.session.values(bench.now))


def test_network_whose_age_is_not_asked_for_is_a_warning() -> None:
    bench = Bench(wire=NETWORK, line_age_limit=0.0)
    bench.open()
    bench.run(2.0, heartbeat())
    assert bench.frames(0x32) == []
    assert bench.session.problems(bench.now)[-1][1].startswith('set line_age_limit')
    assert bench.session.as_of(bench.now) == -math.inf


def test_answer_on_a_line_that_loops_tells_nothing() -> None:
    bench = opened(wire=NETWORK)
    assert [frame for _, frame in bench.sent if frame[2] == 0x32] == [QUESTION]
    bench.hear(heartbeat(), QUESTION, ANSWER)
    assert bench.session.as_of(bench.now) == -math.inf


def _loses(rng: random.Random, share: float, frame: bytes) -> bool:
    return frame[2] == 0x30 and rng.random() < share


@pytest.mark.parametrize('seed', range(20))
def test_nothing_is_ever_older_than_the_session_says(seed: int) -> None:
    """Delays that come and go both ways, lost answers, and others who ask: see Far._note."""
    rng = random.Random(seed)
    far = Far()
    for _ in range(40):
        there, back = (rng.choice([0.0, 0.02, 0.1, 0.3, 1.0]) for _ in range(2))
        far.delays = (after(0.0, there), after(0.0, back))
        share = rng.choice([0.0, 0.0, 0.0, 0.3])
        far.lose = partial(_loses, rng, share)
        far.run(rng.choice([0.1, 0.5, 2.0]))
        if rng.random() < 0.2:
            far.bench.session.get_feedback(AGE_KEY, far.bench.now)


def line(*trips: tuple[float, float]) -> LineAge:
    """Return a line that began at 0, after questions and their answers at these moments."""
    result = LineAge(5.0, 1.0)
    result.begin(0.0)
    for asked, answered in trips:
        result.asked(asked)
        result.answered(answered)
    return result


@pytest.mark.parametrize(
    ('trips', 'asks_at'),
    [
        ([], 0.0),
        ([(0.0, 0.25)], 3.0),  # an answer to a question of before the line may come until then
        ([(2.75, 3.0)], 3.0),
        ([(3.0, 3.25)], 4.0),  # each second
        ([(2.0, 6.5)], 3.0),  # too long for another answer
    ],
)
def test_line_is_asked_at_these_moments(trips: list[tuple[float, float]], asks_at: float) -> None:
    assert line(*trips).ask_at == asks_at


@pytest.mark.parametrize(
    ('limit', 'trip', 'asks_at'),
    [(2.5, 0.25, 2.25), (2.5, 2.25, 3.0), (2.5, 2.5, 3.0), (0.1, 0.05, 0.1)],
)
def test_new_line_is_asked_before_the_limit_where_an_answer_can_come_in_time(
    limit: float, trip: float, asks_at: float
) -> None:
    age = LineAge(limit, 1.0)
    age.begin(0.0)
    age.asked(0.0)
    age.answered(trip)
    assert age.ask_at == asks_at


@pytest.mark.parametrize(
    ('trip', 'heartbeats', 'patience'), [(0.25, 3, 3.0), (1.0, 3, 10.0), (5.25, 3, 10.0)]
)
def test_question_is_given_up_after_this_time(
    trip: float, heartbeats: int, patience: float
) -> None:
    age = line((4.0, 4.0 + trip))
    asked = 4.0 + trip + heartbeats
    for each in range(heartbeats):
        age.heard(4.0 + trip + each)
    age.asked(asked)
    assert age.ask_at == asked + patience
    assert not age.is_silent
    age.asked(asked + patience)
    assert age.is_silent


def test_line_is_late_from_its_limit_on_and_for_a_second_after() -> None:
    age = line((4.0, 4.5))
    assert (age.is_late(8.75), age.is_late(9.0)) == (False, True)
    age.asked(8.0)
    age.answered(9.0)  # just late: for a second
    assert [age.is_late(at) for at in (9.75, 10.0)] == [True, False]
    assert [age.changes_at(at) for at in (9.0, 10.0, 13.0)] == [10.0, 13.0, math.inf]


def test_heartbeat_at_the_limit_is_late() -> None:
    age = line((4.0, 4.5))
    age.heard(4.5)
    age.heard(9.0)
    assert age.limit_at == 10.0
    assert age.is_late(9.5)


def test_line_of_which_nothing_came_is_as_old_as_it_may_be() -> None:
    age = line()
    assert (age.as_of, age.limit_at, age.changes_at(0.0)) == (-math.inf, math.inf, math.inf)
    assert not age.is_late(0.0)
