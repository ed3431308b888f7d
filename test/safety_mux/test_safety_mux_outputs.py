# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What goes out besides e-stop and enable: who may move what, and what is said when he may not."""

from __future__ import annotations

from itertools import pairwise
import time
from types import SimpleNamespace
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Twist, Vector3
import pytest
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.time import Time as Clock
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Header

from bridge_core.cdr import bool_message
from bridge_core.lane import owner_of
from safety_mux.mapping import JoyMapping, Stick
from safety_mux.node import SafetyMux
from safety_mux.outputs import command_of, GatedButton, GatedJoy, Repeated
from safety_mux.protocol import State
from safety_mux.report import unheard
from stage.fed_mux import LIMIT, StepMux, TICK
from stage.mux_talkers import NewMux, sticks
from stage.rig import Observer
from stage.talkers import namespace, values_of

DEADBAND = 0.05
DEADMAN = 0
STAMPED = Header(frame_id='remote', stamp=Time(sec=7))


def joy(*axes: float, buttons: tuple[int, ...] = (1, 0)) -> Joy:
    """Return what an operator sends who holds his deadman."""
    return Joy(header=Header(frame_id='remote'), axes=axes, buttons=buttons)


class Gate:
    """A gate and what it has published, as (axes, buttons)."""

    def __init__(self) -> None:
        self.messages: list[Any] = []
        self.gate = GatedJoy(self, lambda: Time(sec=7), deadband=DEADBAND, deadman=[DEADMAN])
        self.now = 0.0

    def publish(self, message: Any) -> None:
        self.messages.append(message)

    def hear(self, *axes: float, buttons: tuple[int, ...] = (1, 0)) -> None:
        self.gate.hear_joy(joy(*axes, buttons=buttons))

    def tick(self, has_control: bool, dt: float = 0.0) -> list[tuple[list[float], list[int]]]:
        """Return what goes out in a tick ``dt`` s after the last."""
        before = len(self.messages)
        self.now += dt
        self.gate.decide(has_control, self.now)
        self.gate.say(self.now)
        return [(list(m.axes), list(m.buttons)) for m in self.messages[before:]]

    def in_control(self) -> Gate:
        self.hear(0.0, 0.0)
        assert self.tick(True) == [([0.0, 0.0], [1, 0])]
        return self


# Axes that count with a button alone.


@pytest.mark.parametrize(
    ('axis', 'axis_buttons', 'held'),
    [
        ([0, 1], [-1, 5], {(): (0.5, 0.0), (5,): (0.5, 0.8), (6,): (0.5, 0.0)}),
        ([0, 1], [5, 6], {(): (0.0, 0.0), (5,): (0.5, 0.0), (5, 6): (0.5, 0.8)}),
        # An axis of two joints is passed on while one of them takes it.
        ([0, 0], [5, 6], {(): (0.0, 0.8), (6,): (0.5, 0.8)}),
        ([0, 0], [5, -1], {(): (0.5, 0.8)}),
        ([0, 1], [-1, -1], {(): (0.5, 0.8)}),
    ],
)
@pytest.mark.parametrize('pressed_at', [1, 3])
def test_axis_without_its_own_button_is_0_for_others_as_it_is_for_the_joints(
    axis: list[int], axis_buttons: list[int], held: Any, pressed_at: int
) -> None:
    sticks = tuple(Stick(each) for each in axis)
    mapping = JoyMapping(sticks, (0,), pressed_at=pressed_at, axis_buttons=tuple(axis_buttons))
    for pressed, axes in held.items():
        said: list[Any] = []
        gate = GatedJoy(
            SimpleNamespace(publish=said.append),
            Time,
            deadman=mapping.deadman,
            axis_buttons=mapping.buttons_of_axes(),
            pressed_at=mapping.pressed_at,
        )
        gate.hear_joy(Joy(axes=[0.0, 0.0], buttons=[pressed_at] + [0] * 6))
        gate.decide(True, 0.0)
        values = [pressed_at - (n not in (0, *pressed)) for n in range(7)]  # one less is not held
        gate.hear_joy(Joy(axes=[0.5, 0.8], buttons=values))
        gate.say(0.0)
        assert tuple(said[-1].axes) == pytest.approx(axes)
        demand = mapping.sample([0.5, 0.8], values).demand
        for index, each in zip(axis, demand, strict=True):
            assert not each or axes[index], 'it moves a joint'
        gate.hear_joy(Joy(axes=[0.5, 0.8], buttons=[pressed_at] * 7))
        gate.say(0.1)
        assert tuple(said[-1].axes) == pytest.approx((0.5, 0.8))


# A topic that is repeated.


class Said:
    """A repeated topic, once a second, and what it has published, with the time."""

    def __init__(self, lazy: bool = False) -> None:
        self.messages: list[tuple[float, bool]] = []
        self.topic = Repeated(self, Bool, 1.0, lazy=lazy)
        self.now = 0.0
        self.listeners = 0

    def publish(self, message: Any) -> None:
        self.messages.append((self.now, message == bool_message(True)))

    def get_subscription_count(self) -> int:
        return self.listeners

    def say(self, *story: tuple[float, bool]) -> list[tuple[float, bool]]:
        for self.now, value in story:
            self.topic.say(value, self.now)
        return self.messages


# What is said at which times, as 0 or 1; behind | what nobody hears.
REPEATED = {
    'at once and then once in a period': '0: 5 6 7.2 8 | 5.5 6.9',
    'a change at once, and topics of one period together': '0: 0; 1: .4 1 | .9; 0: 1.5 2.1',
    'at the same moments whenever it began': '1: .8 1 | .9',
    'what was due while nobody asked once': '1: 0 9 10 12 13 | 9 9.9 12 12.9',
}


@pytest.mark.parametrize('name', REPEATED)
def test_topic_is_said(name: str) -> None:
    said = Said()
    expected: list[tuple[float, bool]] = []
    for part in REPEATED[name].split('; '):
        value, _, times = part.partition(': ')
        told, quiet = ([*map(float, each.split())] for each in f'{times} |'.split('|')[:2])
        story = [(at, value == '1') for at in sorted([*told, *quiet])]
        expected += [(at, value == '1') for at in told]
        said.say(*story)
    assert said.messages == expected


def test_command_is_repeated_with_enable_at_rest_and_at_rate_else(
    monkeypatch: pytest.MonkeyPatch, step_mux: StepMux
) -> None:
    stepped, said = step_mux(), []
    for where, what, name in (
        (stepped.mux, '_command', 'command'),
        (stepped.mux._enable, 'publisher', 'enable'),
    ):
        publisher = SimpleNamespace(publish=lambda _, name=name: said.append(name))
        monkeypatch.setattr(where, what, publisher)

    def in_a_second() -> tuple[int, int]:
        said.clear()
        stepped.run(1.0)
        return said.count('command'), said.count('enable')

    assert in_a_second() == (33, 33)
    assert stepped.reset().ok
    stepped.run(LIMIT + 0.1)
    assert in_a_second() == (33, 33)
    stepped.joy = sticks(1.0, deadman=True)
    assert stepped.run(0.2) is State.ACTIVE
    assert in_a_second() == (100, 33)
    stepped.stop = True
    said.clear()
    stepped.run(TICK)
    assert said == ['enable', 'command'], 'the first zero goes out at once'


def test_takeover_is_logged_and_told_at_once(
    monkeypatch: pytest.MonkeyPatch, step_mux: StepMux
) -> None:
    low = {'topic': 'low/joy', 'priority': 5, 'axis': [1, 0]}
    named = {f'operator.low.{name}': value for name, value in low.items()}
    stepped = step_mux(operators=['fort', 'low'], **named)
    mux, stick = stepped.mux, sticks()
    said: list[str] = []
    feed = stepped._feed

    def feed_both(now: float) -> None:
        feed(now)
        stepped.topic('operator.low.topic').take(stick, now)

    monkeypatch.setattr(stepped, '_feed', feed_both)
    monkeypatch.setattr(mux, 'get_logger', lambda: SimpleNamespace(info=said.append))
    publish = SimpleNamespace(publish=lambda status: said.append(values_of(status)['owner']))
    stepped.run(2.0)
    assert stepped.reset().ok
    stepped.run(2.0)
    stick = sticks(0.5, deadman=True)
    assert stepped.run(2.0) is State.ACTIVE
    monkeypatch.setattr(mux, '_status', publish)
    said.clear()
    stepped.joy = sticks(0.5, deadman=True)
    assert stepped.run(0.3) is State.ACTIVE
    assert said == ["ACTIVE: operator 'fort' took over", 'fort']


def test_stop_that_follows_a_stop_is_logged_once(
    monkeypatch: pytest.MonkeyPatch, step_mux: StepMux
) -> None:
    stepped = step_mux()
    said: list[str] = []
    assert stepped.reset().ok
    assert stepped.run(0.3) is State.READY
    monkeypatch.setattr(stepped.mux, 'get_logger', lambda: SimpleNamespace(info=said.append))
    stepped.stop = True
    assert stepped.run(0.3) is State.STOPPED
    for _ in range(2):
        stepped.topic('estop.drive.topic').take(Bool(data=True), stepped.now)
        stepped.mux._tick(stepped.now)
    demands = [f"STOPPED: e-stop source '{name}' demands a stop" for name in ('fort', 'drive')]
    assert [text[: len(words)] for text, words in zip(said, demands, strict=True)] == demands


def test_lazy_topic_is_said_to_nobody_on_change_and_repeated_to_who_listens() -> None:
    said = Said(lazy=True)
    alone = ((0.0, True), (1.0, True), (2.5, True), (2.6, False), (4.0, False))
    assert said.say(*alone) == [(0.0, True), (2.6, False)]
    said.listeners = 1
    assert said.say((4.5, False), (5.0, False), (5.5, False))[2:] == [(5.0, False)]


# One operator's gate; assurance/explorations has what goes out of it in every state.

# Steps 'hear AXES/BUTTONS', 'open' or 'closed' with the seconds since the last one and what goes
# out then, if anything does, and 'held' with what is left out, in order.
CONTROL = 'hear 0 0/1 0; open: 0 0/1 0;'
GATES = {
    'nothing goes out before the first message': 'closed .1; open .1; held; closed .1',
    'each message goes out once and unchanged': f"""{CONTROL} hear .5 -1/1 1; open .01: .5 -1/1 1;
        open .01; hear .25 0/1 1; open .01: .25 0/1 1; open .01""",
    'what was held before control is 0 until let go of': """hear 0 .6/1 1; open: 0 0/1 0;
        held axis 1, button 1; hear .3 .7/1 1; open .01: .3 0/1 0; hear .3 -.025/1 0;
        open .01: .3 -.025/1 0; held; hear .3 .5/1 1; open .01: .3 .5/1 1""",
    'nothing is held back while it is closed': """open; closed; hear 0 .6/1 0; closed .05: 0 0/0 0;
        held""",
    'a message may become longer or shorter': f"""{CONTROL} hear .5 .5 .5/1 0;
        open: .5 .5 0/1 0; hear .5/; open: .5/; closed: 0/""",
}


def axes_and_buttons(text: str) -> tuple[list[float], list[int]]:
    axes, _, buttons = text.partition('/')
    return [float(each) for each in axes.split()], [int(each) for each in buttons.split()]


@pytest.mark.parametrize('name', GATES)
def test_gate_lets_through(name: str) -> None:
    gate = Gate()
    for step in GATES[name].split(';'):
        (what, *words), _, sent = (part.split() for part in step.partition(':'))
        if what == 'hear':
            axes, buttons = axes_and_buttons(' '.join(words))
            gate.hear(*axes, buttons=tuple(buttons))
        elif what == 'held':
            assert ', '.join(gate.gate.held) == ' '.join(words), step
        else:
            went: list[Any] = gate.tick(what == 'open', *map(float, words))
            expected = [axes_and_buttons(' '.join(sent))] if sent else []
            assert went == [(pytest.approx(axes), buttons) for axes, buttons in expected], step
            assert not went or gate.messages[-1].header == STAMPED


@pytest.mark.parametrize('tick', [0.007, 0.01, 0.011])
def test_neutral_is_repeated_at_20_hz_with_the_lengths_and_the_frame_of_the_last(
    tick: float,
) -> None:
    gate = Gate()
    gate.hear(0.5, -1.0, 0.2, buttons=(1,))
    sent = [gate.tick(False, tick) for _ in range(round(10.0 / tick))]
    assert 199 <= sum(map(len, sent)) <= 201
    assert [each for each in sent if each][-1] == [([0.0, 0.0, 0.0], [0])]
    assert gate.messages[-1].header == STAMPED


@pytest.mark.parametrize(
    ('deadbands', 'held'),
    [
        ({'deadband': 0.5}, []),
        ({}, ['axis 0', 'axis 1']),
        ({'deadbands': {0: 0.5}, 'deadband': 0.05}, ['axis 1']),
    ],
)
def test_axis_is_let_go_of_at_its_own_deadband_or_else_that_of_all(
    deadbands: Any, held: list[str]
) -> None:
    gate = GatedJoy(Said(), Time, **deadbands)
    gate.hear_joy(joy(0.5, 0.5, 0.0, buttons=()))
    gate.decide(True, 0.0)
    assert gate.held == held


def test_what_is_left_out_is_named_in_part() -> None:
    gate = Gate()
    gate.hear(*[0.5] * 4, buttons=(1,) * 1000)
    gate.tick(True)
    assert gate.gate.held[::3] == ['axis 0', 'axis 3', 'button 3', 'button 6']
    assert len(gate.gate.held) == 10


@pytest.mark.parametrize(('held', 'pressed_at'), [(-1, 1), (1, 2)])
def test_named_button_may_be_pressed_from_any_value_that_is_not_held(
    held: int, pressed_at: int
) -> None:
    """As of a switch with three positions: -1, 0, 1."""
    gate = GatedJoy(None, Time, deadman=[DEADMAN], pressed_at=pressed_at)
    gate.hear_joy(joy(buttons=(pressed_at, held)))
    gate.decide(True, 0.0)
    assert (gate.holds(DEADMAN), gate.holds(1)) == (True, False)
    gate.hear_joy(joy(buttons=(pressed_at, pressed_at)))
    assert gate.holds(1)
    assert gate.held == [], 'nobody hears his Joy'
    said = Said()
    named = GatedButton(said.topic)
    for each in (gate, GatedJoy(None, Time)):
        named.add(each, 1)
    named.say(0.0)
    assert said.messages == [(0.0, True)]
    gate.decide(False, 1.0)
    assert not gate.holds(1)


def test_end_of_control_is_neutral_with_the_decision() -> None:
    gate = Gate().in_control()
    gate.gate.decide(False, 0.0)
    assert list(gate.messages[-1].buttons) == [0, 0]


# Commands.


STAMP = Time(sec=3, nanosec=4)


def values(output: str) -> dict[str, Any]:
    joints = ['left', 'right', 'mast'] if output == 'joints' else ['linear', 'angular']
    return {'output': output, 'joints': joints, 'interface': 'effort', 'frame_id': 'base'}


def test_command_of_joints_has_their_names_the_field_of_the_interface_and_the_stamp() -> None:
    command = command_of(values('joints'))
    assert command.topic == '~/command'
    command.message((9.0, 9.0, 9.0), Time())
    message = deserialize_message(command.message((1.0, -2.0, 0.5), STAMP), JointState)
    assert list(message.name) == ['left', 'right', 'mast']
    assert list(message.effort) == [1.0, -2.0, 0.5]
    assert not message.velocity
    assert not message.position
    assert message.header.stamp == STAMP


@pytest.mark.parametrize('output', ['twist', 'twist_stamped'])
def test_twist_is_forward_and_turn_and_nothing_else(output: str) -> None:
    command = command_of(values(output))
    assert command.topic == '~/cmd_vel'
    command.message((9.0, 9.0), Time())
    message = command.message((0.5, -0.25), STAMP)
    if output == 'twist_stamped':
        assert message.header == Header(frame_id='base', stamp=STAMP)
        message = message.twist
    assert message == Twist(linear=Vector3(x=0.5), angular=Vector3(z=-0.25))


def test_twist_of_three_joints_goes_sideways_too() -> None:
    command = command_of(values('twist') | {'joints': ['linear', 'lateral', 'angular']})
    message = command.message((0.5, 0.125, -0.25), STAMP)
    assert message == Twist(linear=Vector3(x=0.5, y=0.125), angular=Vector3(z=-0.25))


# The node.


def parameters(values: dict[str, Any]) -> list[Any]:
    from rclpy.parameter import Parameter

    return [Parameter(name, value=value) for name, value in values.items()]


def test_axis_of_two_joints_is_let_go_of_at_the_lesser_of_their_deadbands(context: Any) -> None:
    for deadbands in ([0.05, 0.6], [0.6, 0.05]):
        values = {'gated_joy': True, 'mixing': 'none', 'axis': [1, 1], 'deadband': deadbands}
        overrides = parameters({f'operator.fort.{name}': value for name, value in values.items()})
        mux = SafetyMux(context=context, namespace=namespace(), parameter_overrides=overrides)
        gate = mux._gated_joys['fort']
        said: list[Any] = []
        gate.publisher = SimpleNamespace(publish=said.append)
        gate.hear_joy(sticks(0.5, deadman=True))
        gate.decide(True, 1.0)
        gate.say(1.0)
        mux.destroy_node()
        assert said[-1].axes[1] == 0.0, 'held as control began'


QUIET = 'mode is Menu: leave the menu'


@pytest.mark.parametrize(
    ('level', 'message', 'words'),
    [
        (DiagnosticStatus.OK, f'ok; {QUIET}', f'; its device says: {QUIET}'),
        (DiagnosticStatus.WARN, QUIET, f'; its device says: {QUIET}'),
        (DiagnosticStatus.OK, 'ok', ''),
    ],
    ids=['in order', 'a warning', 'nothing to say'],
)
def test_operator_without_a_deadman_is_told_what_his_device_says(
    step_mux: StepMux, level: Any, message: str, words: str
) -> None:
    stepped = step_mux()
    assert stepped.reset().ok
    assert stepped.run(LIMIT + 0.1) is State.READY
    stepped.says('fort_vsc_bridge', level, message)
    advice = f"press the deadman of 'fort' to take control{words}"
    assert advice in stepped.values().values()
    stepped.run(2.9)
    assert advice in stepped.values().values()
    stepped.run(0.2)
    stepped.look_around()  # its node says nothing any more
    assert "press the deadman of 'fort' to take control" in stepped.values().values()
    stepped.says('fort_vsc_bridge', level, message)
    stepped.joy = None  # a device that sends no sticks in such a mode
    stepped.run(LIMIT + 0.1)
    assert f'limit 1000 ms{words or ": start its node"}' in stepped.message()


def test_buttons_that_are_pressed_instead_of_the_deadman_are_named(step_mux: StepMux) -> None:
    stepped = step_mux(**{'operator.fort.deadman_buttons': [0, 2], 'operator.fort.pressed_at': 2})
    assert stepped.reset().ok
    assert stepped.run(LIMIT + 0.1) is State.READY
    for value, said in ((1, ''), (2, "operator 'fort': buttons pressed: 0; its deadman: 0 and 2")):
        stepped.joy.buttons[0] = value
        assert stepped.run(0.1) is State.READY
        assert said in stepped.message()
        assert ('buttons pressed' in stepped.message()) == bool(said)


@pytest.mark.parametrize(
    ('listeners', 'said'),
    [
        ([], '~/command'),
        (['status_page', 'recorder'], '~/command, but for recorder, status_page'),
        (
            ['_ros2cli_12', 'rosbag2_recorder', 'rqt_gui_py_node_9'],
            '~/command, but for _ros2cli',
        ),
        (['status_page', 'esi_drive_bridge'], ''),
        (['diff_drive_controller'], ''),
        ([owner_of('_esi_drive_bridge_lane')], ''),
        ([owner_of('_status_page_lane')], '~/command, but for status_page'),
    ],
)
def test_who_only_looks_at_commands_is_nobody_who_obeys(listeners: list[str], said: str) -> None:
    found = unheard('~/command', listeners)
    assert found.startswith(said)
    assert bool(found) == bool(said)


def test_drive_that_does_not_enable_says_why_in_the_status_of_the_mux(step_mux: StepMux) -> None:
    stepped = step_mux()
    mux = stepped.mux
    enabled = stepped.topic('drive_enabled_topic')
    enabled.take(Bool(data=False), stepped.now)
    assert stepped.reset().ok
    stepped.run(LIMIT + 0.1)
    stepped.says('esi_drive_bridge', DiagnosticStatus.OK, 'ok; disabled: enable is false')
    stepped.joy = sticks(0.5, deadman=True)
    assert stepped.run(0.1) is State.ACTIVE
    enabled.take(Bool(data=False), stepped.now)
    assert 'enable is false' not in stepped.message()  # which it said before it was asked
    why = 'ok; disabled: the drive did not become enabled within 1000 ms; try ~/clear_errors'
    stepped.says('esi_drive_bridge', DiagnosticStatus.OK, why)
    expected = why.removeprefix('ok; ').replace('~', f'{mux.get_namespace()}/esi_drive_bridge')
    said = stepped.values()['inhibit 1']
    assert said.startswith("operator 'fort' waits for the drive to be enabled: ")
    assert said.endswith(f'; its device says: {expected}')


def test_joy_and_button_of_the_owner_go_through_from_control_on_to_release_or_stop(
    step_mux: StepMux,
) -> None:
    given = {'gated_joy': True, 'buttons': ['horn=2'], 'mixing': 'none', 'axis': [1, 0]}
    given |= {'axis_buttons': [-1, 5]}
    stepped = step_mux(**{f'operator.fort.{name}': value for name, value in given.items()})
    joys: list[Any] = []
    horns: list[bool] = []
    stepped.gate('fort').publisher = SimpleNamespace(publish=joys.append)
    stepped.mux._buttons['horn'].topic.publisher = SimpleNamespace(
        publish=lambda message: horns.append(message == bool_message(True)),
        get_subscription_count=lambda: 1,
    )

    def run(deadman: bool, pushed: bool, own_button: bool = False) -> State:
        """Have him hold his deadman, and push two other sticks and the horn besides."""
        stepped.joy = sticks(deadman=deadman)
        if pushed:
            stepped.joy.axes[0] = stepped.joy.axes[4] = 0.5
            stepped.joy.buttons[2] = 1
        stepped.joy.buttons[5] = int(own_button)
        joys.clear()
        horns.clear()
        return stepped.run(LIMIT + 0.1)

    def is_neutral() -> bool:
        return bool(joys and horns) and not any([*joys[-1].axes, *joys[-1].buttons, horns[-1]])

    assert stepped.reset().ok
    for end in ('release', 'stop'):
        assert run(deadman=False, pushed=False) is State.READY
        assert is_neutral()
        assert (len(joys[-1].axes), len(joys[-1].buttons)) == (6, 8)
        assert run(deadman=True, pushed=True, own_button=True) is State.ACTIVE
        assert not any(any(joy.axes) for joy in joys), 'what was held before control'
        assert not any(horns)
        assert joys[-1].buttons[0] == 1
        assert 'leaves out what was held before: let go of axis 0, axis 4' in stepped.message()
        assert run(deadman=True, pushed=False) is State.ACTIVE
        assert run(deadman=True, pushed=True) is State.ACTIVE
        assert list(joys[-1].axes) == [0.0, 0.0, 0.0, 0.0, 0.5, 0.0], 'without its own button'
        assert list(joys[-1].buttons) == list(stepped.joy.buttons)
        assert horns[-1]
        assert run(deadman=True, pushed=True, own_button=True) is State.ACTIVE
        assert list(joys[-1].axes) == list(stepped.joy.axes)
        stepped.stop = end == 'stop'
        state = run(deadman=stepped.stop, pushed=True, own_button=True)
        assert state is (State.STOPPED if stepped.stop else State.READY)
        assert is_neutral()


# A base controller instead of drives.

BASE: dict[str, Any] = {
    'joints': ['linear', 'angular'],
    'joint.linear.max': 1.0,
    'joint.linear.acceleration': 2.0,
    'joint.linear.deceleration': 4.0,
    'joint.angular.max': 2.0,
    'joint.angular.acceleration': 20.0,
    'joint.angular.deceleration': 40.0,
    'operator.fort.mixing': 'none',
    'operator.fort.axis': [1, 0],
    'operator.fort.scale': [1.0, 2.0],
    'drive_enabled_topic': '',
}


def test_operator_drives_a_base_by_forward_and_turn(observer: Observer, new_mux: NewMux) -> None:
    mux = new_mux(output='twist_stamped', **BASE)
    mux.wait(lambda: len(mux.command.messages) > 10 and mux.is_stopped(), 'zero at the start')
    mux.active()
    mux.joy.message = sticks(1.0, deadman=True)
    mux.joy.message.axes[0] = 0.525  # half of the way behind the dead band
    mux.wait(lambda: mux.demand == pytest.approx((1.0, 1.0), abs=1e-3), 'forward and turn')
    stamped = [(Clock.from_msg(m.header.stamp), m.twist.linear.x) for m in mux.command.messages]
    for (before, slower), (after, faster) in pairwise(stamped):
        assert before < after
        assert faster - slower <= 2.0 * (after - before).nanoseconds / 1e9 + 0.5, 'a step'
    assert mux.command.last.header.frame_id == 'base_link'
    assert f'{mux.name}/command' not in dict(observer.node.get_topic_names_and_types())
    (endpoint,) = observer.node.get_publishers_info_by_topic(f'{mux.name}/cmd_vel')
    assert endpoint.qos_profile.durability == DurabilityPolicy.VOLATILE
    cause = time.monotonic()
    mux.fort_estop.publisher.publish(Bool(data=True))
    mux.stopped_since(cause)


@pytest.mark.parametrize('category', [0, 1])
def test_stop_of_a_base_goes_out_before_the_next_decision(
    monkeypatch: pytest.MonkeyPatch, step_mux: StepMux, category: int
) -> None:
    parameters = {'output': 'twist', **BASE, 'estop.drive.stop_category': category}
    stepped = step_mux(**parameters)
    mux, said = stepped.mux, []
    assert stepped.reset().ok
    assert stepped.run(LIMIT + 0.1) is State.READY
    stepped.joy = sticks(1.0, deadman=True)
    assert stepped.run(1.0) is State.ACTIVE
    command = SimpleNamespace(publish=lambda message: said.append(message.linear.x))
    monkeypatch.setattr(mux, '_command', command)
    stepped.now += TICK / 4
    drive = stepped.topic('estop.drive.topic')
    assert drive.take(Bool(data=True), stepped.now)
    stepped.decide()
    monkeypatch.undo()
    assert len(said) == 1
    assert said[0] == 0.0 if category == 0 else 0.9 < said[0] < 1.0
