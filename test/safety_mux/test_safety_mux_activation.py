# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""An activation with other parameters undoes nothing that only standstill or a person ends."""

from collections.abc import Iterator
from typing import Any

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Float64

from bridge_core import clock
from bridge_core.proof import Writer
from safety_mux.outputs import GatedJoy
from safety_mux.protocol import State
from stage.fed_mux import StepMux, SteppedMux
from stage.mux_talkers import sticks

STOP_TIME = 0.5
RUNS_ON = 1.8  # rad/s; faster than standstill, and no overspeed


class WatchedMux(SteppedMux):
    """A mux with feedback. :ivar speed: of the left joint; None: silence."""

    def __init__(self, context: Any, monkeypatch: pytest.MonkeyPatch, **parameters: Any) -> None:
        self.speed: float | None = 0.0
        parameters |= {'feedback.topic': 'joints', 'estop.fort.own_topic': ''}
        super().__init__(context, monkeypatch, stop_time=STOP_TIME, **parameters)

    def _feed(self, now: float) -> None:
        super()._feed(now)
        for each in self.mux._intake.topics():
            if each.parameter == 'feedback.topic' and self.speed is not None:
                names = list(self.mux.values['joints'])
                speeds = [self.speed] + [0.0] * (len(names) - 1)
                each.take(JointState(name=names, velocity=speeds), now)

    def moving(self) -> None:
        """Drive, and have the joints run on when the operator lets go."""
        assert self.reset().ok
        self.run(1.5)
        self.joy = sticks(0.5, deadman=True)
        self.run(0.1)
        self.speed = RUNS_ON
        assert self.run(0.3) is State.ACTIVE
        self.joy = sticks()

    def change(self, **parameters: Any) -> bool:
        """Deactivate, set parameters, activate at once; tell whether that is accepted."""
        self.mux.trigger_deactivate()
        changes = [Parameter(name, value=value) for name, value in parameters.items()]
        assert all(result.successful for result in self.mux.set_parameters(changes))
        accepted = bool(self.mux.trigger_activate() == TransitionCallbackReturn.SUCCESS)
        self.mux._hold(clock.now())  # as its thread does
        return accepted

    def all_stop(self) -> bool:
        """Tell whether every device is asked to stop."""
        return all(demand._value for demand in self.mux._stop_demands.values())


@pytest.fixture
def mux(context: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[WatchedMux]:
    result = WatchedMux(context, monkeypatch)
    yield result
    result.mux.destroy_node()


@pytest.mark.parametrize('fault', [True, False], ids=['fault', 'awaited'])
def test_motion_that_nobody_asked_for_outlasts_other_parameters(
    mux: WatchedMux, fault: bool
) -> None:
    mux.moving()
    if fault:
        mux.run(STOP_TIME + 0.2)
        assert mux.all_stop()
    assert mux.change(hold_time=0.6)
    mux.run(2.0)
    assert mux.all_stop()
    assert 'the joints do not stand' in mux.message()
    assert not mux.reset().ok
    mux.speed = 0.0
    mux.run(2.0)
    assert not mux.all_stop(), 'it ends when the joints stand'
    assert mux.reset().ok


def test_standstill_that_is_seen_in_time_is_no_fault_with_other_parameters(
    mux: WatchedMux,
) -> None:
    mux.moving()
    assert mux.change(hold_time=0.6)
    mux.run(STOP_TIME / 2)
    mux.speed = 0.0
    mux.run(2.0)
    assert not mux.all_stop()
    assert mux.reset().ok


@pytest.mark.parametrize('fault', [True, False], ids=['fault', 'awaited'])
def test_joints_that_have_to_stand_are_not_put_out_of_sight(mux: WatchedMux, fault: bool) -> None:
    mux.moving()
    mux.run(STOP_TIME + 0.2 if fault else 0.1)
    assert not mux.change(**{'feedback.topic': ''})
    assert 'let the joints stand, or restart the node' in str(mux.mux._failure)
    assert ('waiting for standstill' in str(mux.mux._failure)) is not fault
    mux.run(2.0)
    assert mux.all_stop()
    mux.speed = 0.0
    mux.run(0.1)
    assert not mux.all_stop()
    assert mux.mux.trigger_activate() == TransitionCallbackReturn.SUCCESS


def test_feedback_may_come_and_go_while_the_joints_stand(mux: WatchedMux) -> None:
    for topic in ('', 'joints', 'others'):
        assert mux.change(**{'feedback.topic': topic})
        mux.run(2.0)
        assert mux.reset().ok
        assert mux.run(0.1) is State.READY


def test_parameters_count_from_the_activation_on(mux: WatchedMux) -> None:
    parameters = {
        'operator.fort.scale': [2.0],
        'joint.left.max': 2.0,
        'joint.right.max': 2.0,
        'estop.fort.topic': 'button',
    }
    assert mux.change(**parameters)
    topics = [name.rpartition('/')[2] for name in mux.mux._inputs._watches]
    assert 'button' in topics
    mux.run(2.0)
    assert mux.reset().ok
    mux.run(1.5)
    mux.joy = sticks(1.0, deadman=True)
    assert mux.run(1.5) is State.ACTIVE
    assert mux.arbiter.limiter.output == (2.0, 2.0)


def test_stop_of_a_deactivation_is_not_undone_by_an_activation_before_it(
    monkeypatch: pytest.MonkeyPatch, step_mux: StepMux
) -> None:
    """The mux's thread is held up for longer than a transition waits, and not for a stall."""
    mux = step_mux(stall_limit=1.0, neutral_time=1.0)
    assert mux.reset().ok
    mux.run(1.5)
    mux.joy = sticks(0.5, deadman=True)
    assert mux.run(0.3) is State.ACTIVE
    late: list[Any] = []

    def held_up(what: Any) -> None:
        raise TimeoutError('the lane hangs')

    monkeypatch.setattr(mux.mux.lane, 'call', held_up)
    monkeypatch.setattr(mux.mux.lane, 'post', late.append)
    assert mux.mux.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    assert mux.mux.trigger_activate() == TransitionCallbackReturn.SUCCESS
    mux.now += 0.45
    for each in late:
        each()
    assert mux.mux._last_state is State.STOPPED
    assert mux.run(0.1) is State.STOPPED


def test_gated_joy_is_neutral_after_an_activation_with_other_parameters(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mux = WatchedMux(context, monkeypatch, **{'operator.fort.gated_joy': True})
    mux.moving()
    mux.joy = None
    said: list[Any] = []

    def passed(_: GatedJoy, joy: Joy) -> Joy:
        said.append(joy)
        return Joy()

    monkeypatch.setattr(GatedJoy, '_passed', passed)
    for parameters in ({}, {'hold_time': 0.6}):
        assert mux.change(**parameters)
        said.clear()
        mux.run(1.0)
        assert len(said) == pytest.approx(20, abs=1)
        assert [len(joy.axes) for joy in said] == [len(sticks().axes)] * len(said)
    mux.mux.destroy_node()


class Limited(WatchedMux):
    """A mux with a speed limit and a drive that says whether it is enabled; None: silence."""

    def __init__(
        self, context: Any, monkeypatch: pytest.MonkeyPatch, *, enabled: bool | None = True
    ) -> None:
        self.zone: float | None = 0.1
        self.enabled = enabled
        parameters = {
            'speed_limits': ['zone'],
            'speed_limit.zone.topic': 'zone',
            'speed_limit.zone.lowest': 0.5,
            'feedback.overspeed_tolerance': 1000.0,
        }
        super().__init__(context, monkeypatch, **parameters)

    def _feed(self, now: float) -> None:
        super()._feed(now)
        messages = {'drive': (Bool, self.enabled), 'speed limit': (Float64, self.zone)}
        for each in self.mux._intake.topics():
            message, value = messages.get(each.kind, (None, None))
            if message is not None and value is not None:
                each.take(message(data=value), now)

    def fastest(self) -> float:
        """Return how fast a full stick moves the joints."""
        self.run(2.0)
        assert self.reset().ok
        self.run(1.5)
        self.joy = sticks(1.0, deadman=True)
        assert self.run(1.5) is State.ACTIVE
        return float(max(map(abs, self.arbiter.limiter.output)))


@pytest.mark.parametrize('parameters', [{}, {'hold_time': 0.6}], ids=['as it was', 'changed'])
@pytest.mark.parametrize(
    ('silent', 'speed'), [('zone', 1.0), ('enabled', 0.0)], ids=['speed limit', 'drive']
)
def test_silence_makes_nothing_faster_by_an_activation(
    context: Any,
    monkeypatch: pytest.MonkeyPatch,
    silent: str,
    speed: float,
    parameters: dict[str, Any],
) -> None:
    mux = Limited(context, monkeypatch)
    mux.run(0.5)
    setattr(mux, silent, None)
    mux.run(1.0)
    assert mux.change(**parameters)
    assert mux.fastest() == pytest.approx(speed)
    mux.mux.destroy_node()


def test_drive_that_was_never_heard_keeps_nothing_still(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mux = Limited(context, monkeypatch, enabled=None)
    mux.zone = 1.0
    assert mux.fastest() == pytest.approx(10.0)
    monkeypatch.setattr(mux.mux._command, 'get_subscription_count', lambda: 1, raising=False)
    mux.run(2.0)
    assert mux.message() == 'fort has control'
    mux.mux.destroy_node()


@pytest.mark.parametrize('parameters', [{}, {'hold_time': 0.6}], ids=['as it was', 'changed'])
def test_two_publishers_outlast_other_parameters(
    mux: WatchedMux, monkeypatch: pytest.MonkeyPatch, parameters: dict[str, Any]
) -> None:
    watches = mux.mux._inputs._watches
    (topic,) = (name for name in watches if name.endswith('fort_vsc_bridge/estop'))
    monkeypatch.setattr(mux.mux, 'count_publishers', lambda name: 1 + (name == topic))
    for number in (100, 1, 101, 2):
        watches[topic][2].heard(number, clock.now())
    mux.look_around()
    mux.run(0.1)
    assert 'two live publishers' in mux.message()
    assert mux.change(**parameters)
    mux.look_around()
    mux.run(4.0)
    assert 'two live publishers' in mux.message()


@pytest.mark.parametrize(
    ('changes', 'needed'),
    [
        ({}, True),
        ({'hold_time': 0.6}, True),
        ({'estop.fort.proof': 'none', 'operator.fort.proof': 'none'}, False),
    ],
)
def test_node_that_proved_its_words_has_to_prove_them_after_an_activation(
    mux: WatchedMux, changes: dict[str, Any], needed: bool
) -> None:
    inputs = mux.mux._inputs
    (node,) = (each for each, _ in inputs._proven if each.name.endswith('fort_vsc_bridge'))
    node.hear(Writer(7).proof(mux.now), mux.now)
    for _ in range(2):
        assert mux.change(**changes)
        changes = {name: value + 0.1 for name, value in changes.items() if name == 'hold_time'}
    mux.run(2.0)
    assert mux.reset().ok is not needed
    assert ('its node proves no age' in mux.message()) is needed


def test_trip_outlasts_other_parameters(mux: WatchedMux) -> None:
    mux.arbiter.trip(clock.now())
    assert mux.change(hold_time=0.6)
    mux.run(2.0)
    assert mux.all_stop()
    assert mux.reset().ok
    mux.run(0.1)
    assert not mux.all_stop()


def test_no_motion_is_left_while_the_joints_stand(mux: WatchedMux) -> None:
    assert mux.arbiter.motion_left(clock.now()) == ''


@pytest.mark.parametrize('changes', [{}, {'hold_time': 0.6}], ids=['as it was', 'changed'])
def test_script_that_resets_for_ever_resets_nothing_after_an_activation(
    mux: WatchedMux, changes: dict[str, float]
) -> None:
    assert mux.reset().ok
    for _ in range(3):
        mux.run(1.0)
        assert 'nothing to reset' in mux.reset().message
    assert mux.change(**changes)
    for _ in range(4):
        mux.run(1.0)
        assert 'none counts until there was none' in mux.reset().message
    mux.run(mux.mux.values['reset_silence'] + 0.1)
    assert mux.reset().ok
