# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What of a message reaches the arbiter, and which messages are to be decided on at once."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

from geometry_msgs.msg import Twist, TwistStamped
import pytest
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Float64

from bridge_core.parameters import MANAGED_PARAMETERS, ParameterError, resolve
from safety_mux.configuration import joint_limits
from safety_mux.intake import Intake
from safety_mux.parameters import parameter_table
from safety_mux.protocol import State
from stage.mux_talkers import sticks

EVERYTHING = {
    'joints': ['left', 'right'],
    'estop.fort.own_topic': 'fort_vsc_bridge/own_estop',
    'feedback.topic': 'esi_drive_bridge/joint_states',
    'speed_limits': ['zone'],
    'speed_limit.zone.topic': 'zone',
    'autonomy.topic': 'cmd_vel',
    'autonomy.wheel_separation': 0.5,
    'autonomy.wheel_radius': 0.1,
}


def numbers(*joints: str) -> dict[str, Any]:
    """Return what has no default where no wheels are driven by speed."""
    limits = ('max', 'acceleration', 'deceleration')
    named = {f'joint.{joint}.{limit}': 10.0 for joint in joints for limit in limits}
    return {**named, 'operator.fort.scale': [10.0]}


class Arbiter:
    """Notes what it is told."""

    def __init__(self) -> None:
        self.told: list[tuple[Any, ...]] = []
        self.decision = SimpleNamespace(state=State.READY, owner=None)

    def tick(self, now: float) -> Any:
        return self.decision

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments: self.told.append((name, *arguments))


class Fed:
    """An intake in front of that arbiter. :param given: parameters beside ``base``."""

    def __init__(self, base: dict[str, Any] = EVERYTHING, **given: Any) -> None:
        values = base | {name.replace('__', '.'): value for name, value in given.items()}
        self.heard: list[Any] = []
        table = (*MANAGED_PARAMETERS, *parameter_table(values))
        self.intake = Intake(resolve(table, values), 0.0, lambda *heard: self.heard.append(heard))
        self.real = self.intake.arbiter
        self.arbiter = cast('Any', Arbiter())
        self.intake.arbiter = self.arbiter
        self.topics = {each.parameter: each for each in self.intake.topics()}

    def take(self, parameter: str, message: Any, now: float = 3.0) -> tuple[bool, list[Any]]:
        """Return whether to decide at once, and what the arbiter was told of it."""
        self.arbiter.told.clear()
        return self.topics[parameter].take(message, now), list(self.arbiter.told)

    def decided(self, state: State, owner: str | None = None) -> None:
        self.arbiter.decision = SimpleNamespace(state=state, owner=owner)
        assert self.intake.decide(1.0) is self.arbiter.decision


def test_all_that_is_configured_is_listened_to_and_own_stops_first() -> None:
    told = [(each.parameter, each.kind, each.name, each.type) for each in Fed().intake.topics()]
    assert told == [
        ('estop.fort.own_topic', 'e-stop source', 'fort', 'Bool'),
        ('estop.fort.topic', 'e-stop source', 'fort', 'Bool'),
        ('estop.drive.topic', 'e-stop source', 'drive', 'Bool'),
        ('drive_enabled_topic', 'drive', '', 'Bool'),
        ('speed_limit.zone.topic', 'speed limit', 'zone', 'Float64'),
        ('feedback.topic', 'feedback', 'feedback', 'JointState'),
        ('operator.fort.topic', 'operator', 'fort', 'Joy'),
        ('autonomy.topic', 'autonomy', 'autonomy', 'Twist'),
    ]


def test_each_of_several_drives_is_listened_to() -> None:
    fed = Fed({}, drive_enabled_topic='', estop__drive__enabled_topic='/drive/enabled')
    (drive,) = (each for each in fed.intake.topics() if each.kind == 'drive')
    assert (drive.parameter, drive.name) == ('estop.drive.enabled_topic', 'drive')
    message = Bool(data=True)
    assert fed.take(drive.parameter, message) == (False, [('drive_enabled', 'drive', True, 3.0)])


def test_one_drive_and_several_are_not_both_there() -> None:
    with pytest.raises(ParameterError, match="drive_enabled_topic must be ''"):
        Fed({}, estop__drive__enabled_topic='/drive/enabled')


def test_what_is_not_configured_is_not_listened_to() -> None:
    kinds = {each.kind for each in Fed({}).topics.values()}
    assert kinds == {'e-stop source', 'drive', 'operator'}


def test_operator_of_the_arbiter_is_the_one_of_the_parameters() -> None:
    fed = Fed()
    assert [operator.name for operator in fed.intake.config.operators] == ['fort']
    assert fed.real.config is fed.intake.config


@pytest.mark.parametrize('value', [True, False])
def test_message_of_one_value_is_told_with_its_time(value: bool) -> None:
    fed = Fed()
    fed.decided(State.ACTIVE)
    message = Bool(data=value)
    assert fed.take('estop.fort.topic', message)[1] == [('estop_message', 'fort', value, 3.0)]
    own = [('own_estop_message', 'fort', value, 3.0)]
    assert fed.take('estop.fort.own_topic', message) == (False, own)
    assert fed.take('drive_enabled_topic', message) == (False, [('drive_enabled', '', value, 3.0)])
    limit = [('speed_limit', 'zone', 0.25, 3.0)]
    assert fed.take('speed_limit.zone.topic', Float64(data=0.25)) == (False, limit)


@pytest.mark.parametrize('state', State)
def test_stop_is_decided_on_at_once_unless_it_is_stopped(state: State) -> None:
    fed = Fed()
    assert fed.take('estop.fort.topic', Bool(data=True))[0]  # nothing is decided yet
    fed.decided(state)
    assert fed.take('estop.fort.topic', Bool(data=True))[0] is (state is not State.STOPPED)
    assert fed.take('estop.fort.topic', Bool(data=False))[0] is False


def test_deadman_that_its_owner_releases_is_decided_on_at_once() -> None:
    fed = Fed()
    released, held = sticks(), sticks(deadman=True)
    assert fed.take('operator.fort.topic', released)[0] is False
    for owner in (None, 'senior', 'fort'):
        fed.decided(State.ACTIVE, owner)
        assert fed.take('operator.fort.topic', released)[0] is (owner == 'fort')
        assert fed.take('operator.fort.topic', held)[0] is False


def test_joy_is_told_as_a_sample_and_heard() -> None:
    fed = Fed()
    joy = sticks(0.5, deadman=True)
    _, told = fed.take('operator.fort.topic', joy)
    assert told == [
        ('set_invalid', 'operator', 'fort', 'stamps', None),
        (
            'operator_sample',
            'fort',
            fed.intake.mappings['fort'].sample(joy.axes, joy.buttons),
            3.0,
        ),
    ]
    assert fed.heard == [('fort', joy)]


def test_malformed_joy_is_told_as_such_and_heard_by_nobody() -> None:
    fed = Fed()
    fed.decided(State.ACTIVE, 'fort')
    at_once, told = fed.take('operator.fort.topic', Joy(axes=[0.0], buttons=[0]))
    ((_, *stamps), (name, kind, operator, why, now)) = told
    assert (name, kind, operator, now) == ('malformed', 'operator', 'fort', 3.0)
    assert 'axes' in why
    assert stamps[-1] is None
    assert at_once is False
    assert not fed.heard


def test_stamp_that_stands_still_makes_an_operator_invalid_where_it_must_move() -> None:
    fed = Fed(operator__fort__require_moving_stamps=True)
    joy = sticks()
    joy.header.stamp.sec, joy.header.stamp.nanosec = 7, 5
    faults = [fed.take('operator.fort.topic', joy, now)[1][0][-1] for now in (3.0, 3.2, 60.0)]
    assert faults[0] is None
    assert 'the same' in faults[-1]
    joy.header.stamp.nanosec = 6
    assert fed.take('operator.fort.topic', joy, 60.1)[1][0][-1] is None


def test_feedback_is_told_by_joint() -> None:
    fed = Fed()
    message = JointState(name=['right', 'other', 'left'], velocity=[2.0, 9.0, 1.0])
    assert fed.take('feedback.topic', message) == (False, [('measured', (1.0, 2.0), 3.0)])
    message.name[0] = 'wrong'
    at_once, ((name, kind, _, why, now),) = fed.take('feedback.topic', message)
    assert (at_once, name, kind, now) == (False, 'malformed', 'feedback', 3.0)
    assert 'right' in why


def twist(speed: float, turn: float) -> Twist:
    result = Twist()
    result.linear.x, result.angular.z = speed, turn
    return result


def test_twist_turns_the_joints_of_a_differential_drive() -> None:
    assert Fed().take('autonomy.topic', twist(1.0, 0.0)) == (
        False,
        [('autonomy_command', (pytest.approx(10.0), pytest.approx(10.0)), 3.0)],
    )
    _, ((_, (left, right), _),) = Fed().take('autonomy.topic', twist(0.0, 1.0))
    assert -left == right == pytest.approx(2.5)


def test_twist_as_output_stays_speed_and_turn() -> None:
    base = {**EVERYTHING, **numbers('linear', 'angular')}
    fed = Fed(base, output='twist', joints=['linear', 'angular'], feedback__topic='')
    _, told = fed.take('autonomy.topic', twist(1.0, 0.5))
    assert told == [('autonomy_command', (1.0, 0.5), 3.0)]


def test_stamped_twist_is_read_within() -> None:
    fed = Fed(autonomy__type='TwistStamped')
    assert fed.topics['autonomy.topic'].type == 'TwistStamped'
    _, told = fed.take('autonomy.topic', TwistStamped(twist=twist(1.0, 0.0)))
    assert told[0][1] == (pytest.approx(10.0), pytest.approx(10.0))


@pytest.mark.parametrize('interface', ['velocity', 'effort'])
def test_joint_state_is_read_where_the_interface_says(interface: str) -> None:
    base = {**EVERYTHING, **numbers('left', 'right')}
    fed = Fed(base, autonomy__type='JointState', interface=interface, feedback__topic='')
    values = {'velocity': [1.0, 2.0], 'effort': [3.0, 4.0]}
    message = JointState(name=['left', 'right'], **values)
    _, told = fed.take('autonomy.topic', message)
    assert told == [('autonomy_command', tuple(values[interface]), 3.0)]


@pytest.mark.parametrize(('interface', 'together'), [('velocity', True), ('effort', False)])
def test_velocities_grow_together_and_torques_do_not(interface: str, together: bool) -> None:
    given = {'interface': interface, **numbers('left', 'right')}
    limits = joint_limits(resolve((*MANAGED_PARAMETERS, *parameter_table(given)), given))
    assert [limit.together for limit in limits] == [together, together]


def test_malformed_autonomy_is_told_as_such() -> None:
    fed = Fed(autonomy__type='JointState')
    at_once, ((name, kind, _, why, now),) = fed.take('autonomy.topic', JointState(name=['left']))
    assert (at_once, name, kind, now) == (False, 'malformed', 'autonomy', 3.0)
    assert why
    endless = twist(math.nan, 0.0)
    assert Fed().take('autonomy.topic', endless)[1][0][:2] == ('malformed', 'autonomy')


@pytest.mark.parametrize(
    ('given', 'heard'),
    [
        ({}, 'fort_vsc_bridge/own_estop'),
        ({'estop.fort.topic': 'fort_vsc_bridge/estop'}, 'fort_vsc_bridge/own_estop'),
        ({'estop.fort.topic': '/fort_vsc_bridge/estop'}, 'fort_vsc_bridge/own_estop'),
        ({'estop.fort.topic': 'near/estop'}, ''),
        ({'estop.fort.topic': 'near/estop', 'estop.fort.own_topic': 'near/own'}, 'near/own'),
    ],
)
def test_own_estop_is_that_of_the_default_node_only_with_its_estop(
    given: dict[str, Any], heard: str
) -> None:
    assert resolve(parameter_table(given), given)['estop.fort.own_topic'] == heard
