# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The trial of one joint: its course, and the command with the node on a simulated drive."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
from dataclasses import replace
from functools import partial
from pathlib import Path
from signal import SIGINT, SIGKILL
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rclpy.task import Future
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, UInt16MultiArray

from bridge_core import clock
from esi_drive_bridge.simulator import Simulator
from rugged_teleop.bench import course
from rugged_teleop.bench.commander import Commander, follow
from rugged_teleop.bench.course import Course, Facts, Order, Phase
from rugged_teleop.bench.main import main
from rugged_teleop.bench.targets import TARGETS
from rugged_teleop.ptys import PtyDevice
from ssc_bridge.simulator import Simulator as Ssc
from stage.devices import Drive
from stage.rig import latched, NodeProcess, Observer, ROOT, TIMEOUT_FACTOR, wait_for

READY = Facts(
    listens=True, estop=False, enabled=False, measured=0.0, speed=0.0, reason='as it says'
)
ENABLED = replace(READY, enabled=True)
STOP = Order(estop=True)
TICK = 0.02


class Trial:
    """A course in simulated time."""

    def __init__(self, *, is_measured: bool = True) -> None:
        self.now = 50.0
        self.course = Course(2.0, 3.0, self.now, is_measured=is_measured)

    def run(self, facts: Facts, seconds: float = TICK) -> Order | None:
        end, order = self.now + seconds - TICK / 2, None
        while self.now < end:
            self.now += TICK
            order = self.course.step(facts, self.now)
        return order

    def enabling(self) -> Trial:
        self.run(READY, course.ALONE_TIME + course.NEUTRAL_TIME + 0.1)
        assert self.course.phase is Phase.ENABLING
        return self

    def moving(self) -> Trial:
        self.enabling().run(ENABLED)
        assert self.course.phase is Phase.MOVING
        return self


# The course.


def test_nothing_is_published_until_nobody_else_was_seen_for_a_while() -> None:
    trial = Trial()
    assert trial.run(READY, course.ALONE_TIME - 2 * TICK) is None
    assert trial.run(READY, 4 * TICK) == Order()


def test_whole_course_is_neutral_enabled_moving_at_rest_disabled() -> None:
    trial = Trial()
    trial.run(READY, course.ALONE_TIME + 2 * TICK)
    assert trial.run(READY, course.NEUTRAL_TIME - 4 * TICK) == Order()
    assert trial.run(READY, 8 * TICK) == Order(enable=True)
    assert trial.run(replace(ENABLED, measured=1.9), 2.9) == Order(2.0, enable=True)
    assert trial.run(replace(ENABLED, measured=1.9, speed=1.9), 0.2) == Order(enable=True)
    assert trial.run(ENABLED) == STOP
    assert trial.run(READY, course.DISABLE_TIME + 2 * TICK) == STOP
    assert trial.course.phase is Phase.WATCHING
    assert trial.run(replace(READY, speed=-0.1), course.WATCH_TIME + 2 * TICK) is None
    assert (trial.course.phase, trial.course.problem) == (Phase.DONE, '')
    assert trial.course.end == 'disabled; stands: at most 0.1 rad/s in 1 s'
    assert trial.course.peak == 1.9


@pytest.mark.parametrize(
    ('facts', 'ends', 'problem'),
    [
        (replace(READY, speed=-5.03), '', 'disabled and still turns at 5.03 rad/s 5 s later'),
        (replace(READY, measured=9.0, speed=None), 'its speed is not measured', ''),
        (replace(READY, measured=None, speed=None), '', 'nothing is heard of the drive'),
        (ENABLED, '', 'the drive does not say that it is disabled'),
    ],
    ids=['turns', 'current alone', 'silent', 'enabled'],
)
def test_end_says_what_was_measured_and_never_judges_by_current(
    facts: Facts, ends: str, problem: str
) -> None:
    trial = Trial().moving()
    trial.run(replace(ENABLED, speed=2.0), 3.0 + course.REST_LIMIT + 2 * TICK)
    trial.run(facts, course.DISABLE_LIMIT + course.WATCH_LIMIT)
    assert trial.course.phase is Phase.DONE
    assert ends in trial.course.end
    assert bool(ends) == bool(trial.course.end)
    assert problem in trial.course.problem
    assert bool(problem) == bool(trial.course.problem)


def test_what_is_not_measured_ends_with_no_word_of_rest() -> None:
    trial = Trial(is_measured=False)
    silent = replace(READY, measured=None, speed=None)
    trial.run(silent, course.ALONE_TIME + course.NEUTRAL_TIME + 0.1)
    trial.run(replace(silent, enabled=True), 3.0 + course.DISABLE_TIME + 10 * TICK)
    assert (trial.course.phase, trial.course.end) == (Phase.DONE, '')


def test_other_publisher_is_refused_before_anything_is_published() -> None:
    trial = Trial()
    trial.run(READY, 0.5)
    assert trial.run(replace(READY, others=('/x/enable',))) is None
    assert trial.course.phase is Phase.DONE
    assert 'somebody else publishes /x/enable' in trial.course.problem


@pytest.mark.parametrize(
    ('facts', 'says'),
    [
        (replace(ENABLED, others=('/x/enable',)), 'somebody else'),
        (replace(ENABLED, estop=True), 'demands a stop: as it says'),
        (READY, 'not enabled any more: as it says'),
        (replace(READY, reason=''), 'not enabled any more: see /diagnostics'),
    ],
    ids=['other', 'e-stop', 'disabled', 'disabled a moment ago'],
)
def test_whatever_goes_wrong_amid_is_a_stop(facts: Facts, says: str) -> None:
    trial = Trial().moving()
    assert trial.run(facts) == STOP
    assert trial.run(ENABLED, 1.0) == STOP  # and stays one
    assert says in trial.course.problem


def test_other_publisher_that_stays_does_not_keep_the_trial_from_its_end() -> None:
    trial = Trial().moving()
    other = replace(READY, others=('/x/enable',))
    trial.run(replace(other, enabled=True), 0.5)
    assert trial.run(other, course.DISABLE_TIME + course.WATCH_TIME + 4 * TICK) is None
    assert trial.course.phase is Phase.DONE
    assert 'somebody else' in trial.course.problem


def test_stop_amid_enabling_is_one() -> None:
    """It may have gone by the next step, and nobody would know of it."""
    trial = Trial().enabling()
    assert trial.run(replace(READY, estop=True)) == STOP
    assert trial.run(ENABLED, 1.0) == STOP


def test_what_was_decided_before_a_halt_is_not_published_after_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    halted: list[float] = []

    class HaltedCourse(Course):
        def step(self, facts: Facts, now: float) -> Order | None:
            order = super().step(facts, now)
            if self.phase is Phase.MOVING and not halted:
                halted.append(time.now)
                time.now += 10.0  # SIGSTOP and SIGCONT, say
            return order

    class Told:
        refusal = ''

        def __init__(self) -> None:
            self.orders: list[Order] = []

        def facts(self) -> Facts:
            return replace(READY, enabled=bool(self.orders) and self.orders[-1].enable)

        def publish(self, order: Order) -> None:
            self.orders.append(order)

        def spin(self) -> None:
            time.now += TICK

    time, told = Trial(), Told()
    monkeypatch.setattr(clock, 'now', lambda: time.now)
    trial = HaltedCourse(2.0, 3.0, time.now, is_measured=True)
    follow(trial, told, lambda: None)
    assert not any(order.value for order in told.orders)
    assert told.orders[-1] == STOP
    assert 'held up for 10.0 s' in trial.problem


def test_trial_that_was_held_up_ends_and_one_that_waits_goes_on() -> None:
    """What it heard before is no news: a stop may have come and gone."""
    trial = Trial().moving()
    trial.now += 0.2
    assert trial.run(ENABLED) == STOP
    assert trial.course.problem == 'this trial was held up for 0.2 s'
    trial = Trial()
    trial.now += 0.5
    assert trial.run(READY) is None
    assert not trial.course.problem


@pytest.mark.parametrize(
    ('facts', 'limit', 'says'),
    [
        (Facts(), course.FIND_LIMIT, 'no node listens'),
        (Facts(listens=True), course.FIND_LIMIT, 'no node reports'),
        (replace(READY, estop=True), course.HEALTHY_LIMIT, 'its e-stop is not ready: as it says'),
        (READY, course.ENABLE_LIMIT, 'enabling for 12 s'),
    ],
)
def test_what_does_not_come_is_named(facts: Facts, limit: float, says: str) -> None:
    trial = Trial()
    trial.run(facts, limit + course.ALONE_TIME + course.NEUTRAL_TIME + 0.2)
    assert says in trial.course.problem
    assert trial.run(READY, course.DISABLE_LIMIT + 0.1) is None


def test_interruption_is_a_stop_until_the_drive_is_disabled() -> None:
    trial = Trial().moving()
    trial.course.interrupt('interrupted', trial.now)
    assert trial.run(ENABLED, 2.0) == STOP
    trial.run(READY, course.WATCH_TIME + 4 * TICK)
    assert trial.course.phase is Phase.DONE


# The command.


@pytest.fixture
def drive(tmp_path: Path) -> Iterator[Drive]:
    result = Drive(tmp_path / 'drive', Simulator(command_timeout=1.0))
    yield result
    result.close()


@pytest.fixture
def node(drive: Drive, observer: Observer) -> Iterator[str]:
    """Run the node; busy machines get longer than the defaults. Return its name."""
    name = '/trial/esi_drive_bridge'
    values = {'port': drive.path, 'link_timeout': 2.0, 'command_timeout': 2.0}
    with NodeProcess('esi_drive_bridge.node', values, namespace='/trial', patient=True):
        estop = observer.record(Bool, f'{name}/estop', latched())
        observer.wait_for(lambda: estop.last is not None and not estop.last.data, 20.0, 'no stop')
        yield name


@contextlib.contextmanager
def bench(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    child = subprocess.Popen(
        [sys.executable, '-m', 'stage.patience', 'rugged_teleop', 'bench', *arguments],
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


def moves(drive: Drive) -> bool:
    rpm: Any = drive.rpm
    return bool(drive.enabled and rpm > 5.0)


def wait_while_it_runs(
    child: subprocess.Popen[str], condition: Callable[[], bool], what: str | Callable[[], str]
) -> None:
    """Wait for the condition. :raises AssertionError: the trial ended before; with its words."""

    def met() -> bool:
        assert child.poll() is None, child.communicate()[0]
        return condition()

    wait_for(met, 30.0, what)


def test_diagnostic_that_is_ok_is_no_reason_for_a_stop(observer: Observer) -> None:
    """A stop may come before the diagnostic that tells of it."""
    device, said = DiagnosticStatus(name='a/drive: device'), DiagnosticArray()
    said.status.append(device)
    with Commander('speed', '/a/drive', 'left', 50.0) as commander:
        listener = observer.node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        for level, words, reason in (
            (DiagnosticStatus.OK, 'all well', 'see /diagnostics'),
            (DiagnosticStatus.WARN, 'too hot', 'too hot'),
        ):
            device.level, device.message = level, words

            def heard(words: str = words) -> bool:
                listener.publish(said)
                commander.spin()
                return bool(commander.summary == words)

            wait_for(heard, 10.0, words)
            assert commander.facts().reason == reason
        observer.node.destroy_publisher(listener)


def test_stop_that_came_and_went_and_silence_count_as_a_stop(
    observer: Observer, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit = 10.0 * TIMEOUT_FACTOR
    monkeypatch.setattr('rugged_teleop.bench.commander.SILENCE_LIMIT', limit)
    with Commander('position', '/a/ssc', 'pan', 50.0) as commander:
        estop = observer.node.create_publisher(Bool, '/a/ssc/estop', latched())

        def hears(*values: bool) -> bool:
            """Say it anew; the trial is held up meanwhile."""
            if estop.get_subscription_count():
                for value in values:
                    estop.publish(Bool(data=value))
            end = clock.now() + 0.3
            while clock.now() < end:
                commander.spin()
            return commander._estop is values[-1]

        wait_for(lambda: hears(False), 10.0, 'no stop')
        commander.facts()
        assert commander.facts().estop is False
        # At 200 Hz, while a hold-up is short enough to be none.
        wait_for(lambda: hears(True, *[False] * 40), 10.0, 'a stop, and none')
        assert [commander.facts().estop for _ in range(2)] == [True, False]
        monkeypatch.setattr(commander, '_estop_at', clock.now() - limit)
        assert commander.facts().estop
        assert commander.facts().reason == 'its e-stop fell silent'
        observer.node.destroy_publisher(estop)


def test_whoever_sends_pulses_to_the_servos_is_noticed(observer: Observer) -> None:
    with Commander('position', '/a/ssc', 'pan', 50.0) as commander:
        assert commander.facts().others == ()
        other = observer.node.create_publisher(UInt16MultiArray, '/a/ssc/pulse_command', 10)
        wait_for(lambda: commander.facts().others, 10.0, 'the other publisher')
        assert commander.facts().others == ('/a/ssc/pulse_command',)
        observer.node.destroy_publisher(other)


def test_node_whose_first_response_is_lost_is_asked_for_its_parameters_once_more(
    node: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    with Commander('speed', node, 'left', 50.0) as commander:
        ask = commander._parameters.call_async

        def lose_the_first(request: Any) -> Any:
            asked.append(request)
            return ask(request) if len(asked) > 1 else Future()

        def listens() -> bool:
            commander.spin()
            return commander.facts().listens

        monkeypatch.setattr(commander._parameters, 'call_async', lose_the_first)
        wait_for(listens, 10.0, 'a node that listens and is known')
        monkeypatch.undo()
    assert len(asked) > 1


def test_joint_turns_for_its_time_and_ends_at_rest_and_disabled(drive: Drive, node: str) -> None:
    with bench('--node', node, '--joint', 'left', '--speed', '1.0', '--seconds', '1') as child:
        wait_while_it_runs(child, lambda: moves(drive), 'motion')
        text, _ = child.communicate(timeout=30.0 * TIMEOUT_FACTOR)
    assert (child.returncode, 'disabled; stands: at most 0 rad/s' in text) == (0, True), text
    assert not drive.enabled
    assert drive.rpm < 1.0


@pytest.mark.parametrize(
    ('number', 'status'),
    [pytest.param(SIGINT, 130, marks=pytest.mark.proof), (SIGKILL, -SIGKILL)],
)
def test_whatever_ends_it_the_drive_is_disabled(
    number: int, status: int, drive: Drive, node: str
) -> None:
    with bench('--node', node, '--joint', 'left', '--speed', '1', '--seconds', '60') as child:
        wait_while_it_runs(child, lambda: moves(drive), 'motion')
        child.send_signal(number)
        assert child.wait(15.0 * TIMEOUT_FACTOR) == status
        wait_for(lambda: not drive.enabled, 10.0, 'a disabled drive')


def test_what_the_drive_cannot_do_and_other_commanders_are_refused(
    drive: Drive, node: str, observer: Observer
) -> None:
    for joint, option, says in (
        ('middle', '--speed', "no joint 'middle'"),
        ('left', '--position', 'is for a node with servos, command_timeout'),
    ):
        with bench('--node', node, '--joint', joint, option, '1') as child:
            text, _ = child.communicate(timeout=30.0 * TIMEOUT_FACTOR)
        assert (child.returncode, says in text) == (1, True), text
    observer.publisher(Bool, f'{node}/enable')
    with bench('--node', node, '--joint', 'left', '--speed', '1') as child:
        text, _ = child.communicate(timeout=30.0 * TIMEOUT_FACTOR)
    assert (child.returncode, f'publishes {node}/enable' in text) == (1, True), text
    assert not any(packet.enables for packet in drive.packets())


# What is no drive.


@pytest.mark.parametrize(
    ('option', 'joints', 'joint', 'at_rest', 'moving'),
    [
        ('position', ['pan', 'tilt'], 'tilt', None, JointState(name=['tilt'], position=[0.5])),
        ('stick', ['rotation', 'elevation'], 'elevation', [0.0, 0.0], Joy(axes=[0.0, -0.5])),
        ('speed', ['a', 'b'], 'a', [0.0, 0.0], JointState(name=['a', 'b'], velocity=[0.5, 0.0])),
    ],
)
def test_each_kind_is_commanded_in_its_own_words(
    option: str, joints: list[str], joint: str, at_rest: list[float] | None, moving: Any
) -> None:
    target = TARGETS[option]
    rest = target.message(Order(), joints, joint)
    assert (rest if rest is None else list(getattr(rest, target.trial.field))) == at_rest
    assert target.message(Order(0.5, enable=True), joints, joint) == moving
    assert target.message(STOP, joints, joint) == rest


def test_status_is_that_of_the_trial_though_nobody_reads_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def run(trial: Course, *_: Any) -> None:
        trial.problem = 'no node listens to its inputs'

    def gone(_: str) -> None:
        raise BrokenPipeError

    commander = contextlib.nullcontext(SimpleNamespace(summary=''))
    monkeypatch.setattr(f'{Commander.__module__}.Commander', lambda *_: commander)
    monkeypatch.setattr(f'{follow.__module__}.follow', run)
    monkeypatch.setattr(sys, 'stderr', SimpleNamespace(write=gone))
    with pytest.raises(SystemExit) as ended:
        main(['--speed', '1', '--joint', 'left'])
    assert ended.value.code == 1


def test_servo_goes_where_it_is_told_and_then_to_its_failsafe(tmp_path: Path) -> None:
    name, path = '/trial/ssc_bridge', tmp_path / 'ssc'
    values = {'port': path, 'link_timeout': 2.0, 'command_timeout': 2.0, 'servos': ['pan']}
    values |= {'servo.pan.channel': 1, 'estop_states': [''], 'lost_link_is_stop': False}
    seen: list[int] = []

    def goes(port: PtyDevice) -> bool:
        seen.append(port.describe()['serial_us'][0])
        return seen[-1] == 1750

    def goes_or_ends(port: PtyDevice, child: subprocess.Popen[str]) -> bool:
        return goes(port) or child.poll() is not None

    with (
        PtyDevice(Ssc(), path) as port,
        NodeProcess('ssc_bridge.node', values, namespace='/trial', patient=True) as node,
    ):
        words = ('--node', name, '--joint', 'pan', '--position', '0.5', '--seconds', '1')
        while 1750 not in seen:  # anew only where the machine held one of the two up
            before = len(node.output)
            with bench(*words) as child:
                wait_for(partial(goes_or_ends, port, child), 60.0, 'the pulse, or its end')
                text, _ = child.communicate(timeout=30.0 * TIMEOUT_FACTOR)
            assert 1750 in seen or 'held up' in text + node.output[before:], (seen[-5:], text)
        assert (child.returncode, 'whether it stands is not measured' in text) == (0, True), text
        wait_for(lambda: port.describe()['serial_us'][0] != 1750, 10.0, 'its failsafe')
