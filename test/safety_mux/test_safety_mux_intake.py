# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What of a message reaches the arbiter, and which messages are to be decided on at once."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

from geometry_msgs.msg import Twist, TwistStamped, Vector3
import pytest
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Float64

from bridge_core.parameters import MANAGED_PARAMETERS, ParameterError, resolve
from safety_mux.configuration import joint_limits, rest_period
from safety_mux.intake import Intake
from safety_mux.parameters import parameter_table
from safety_mux.protocol import OperatorSample, State
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


def test_one_drive_and_several_are_not_both_there() -> None:
    with pytest.raises(ParameterError, match="drive_enabled_topic must be ''"):
        Fed({}, estop__drive__enabled_topic='/drive/enabled')


def test_what_is_not_configured_is_not_listened_to() -> None:
    kinds = {each.kind for each in Fed({}).topics.values()}
    assert kinds == {'e-stop source', 'drive', 'operator'}


def twist(speed: float, turn: float) -> Twist:
    return Twist(linear=Vector3(x=speed), angular=Vector3(z=turn))


def joints(**fields: list[float]) -> JointState:
    return JointState(name=['right', 'other', 'left'], **fields)


BOTH = JointState(name=['left', 'right'], velocity=[1.0, 2.0], effort=[3.0, 4.0])
NAMED = {'autonomy__type': 'JointState'}
EFFORT = {**NAMED, 'interface': 'effort', 'feedback__topic': '', **numbers('left', 'right')}
TWIST = {'output': 'twist', 'joints': ['linear', 'angular'], 'feedback__topic': ''}
TWIST |= numbers('linear', 'angular')
OMNI = TWIST | {'joints': ['linear', 'lateral', 'angular'], **numbers('lateral')}
OMNI |= {'operator__fort__mixing': 'none', 'operator.fort.axis': [1, 0, 3]}
SIDEWAYS = Twist(linear=Vector3(x=1.0, y=3.0), angular=Vector3(z=2.0))
ENDS = {f'joint.left.{name}': 5.0 for name in ('position_max', 'slow_zone')}
PLACED = joints(velocity=[2.0, 9.0, 1.0], position=[8.0, 9.0, 4.0])
DRIVES = {'drive_enabled_topic': '', 'estop__drive__enabled_topic': '/drive/enabled'}
JOY = sticks(0.5, deadman=True)
HELD = OperatorSample(False, True, ((0.5 - 0.05) / (1.0 - 0.05) * 10.0,) * 2)
NO_STAMP = ('set_invalid', 'operator', 'fort', 'stamps', None)


@pytest.mark.parametrize(
    ('topic', 'message', 'told', 'given'),
    [
        ('estop.fort.own_topic', Bool(data=True), ('own_estop_message', 'fort', True), {}),
        ('estop.fort.topic', Bool(data=False), ('estop_message', 'fort', False), {}),
        ('drive_enabled_topic', Bool(data=True), ('drive_enabled', '', True), {}),
        ('estop.drive.enabled_topic', Bool(), ('drive_enabled', 'drive', False), DRIVES),
        ('speed_limit.zone.topic', Float64(data=0.25), ('speed_limit', 'zone', 0.25), {}),
        ('feedback.topic', joints(velocity=[2.0, 9.0, 1.0]), ('measured', (1.0, 2.0)), {}),
        ('feedback.topic', joints(velocity=[2.0]), ('malformed', 'feedback', 'feedback'), {}),
        ('operator.fort.topic', JOY, ('operator_sample', 'fort', HELD), {}),
        ('operator.fort.topic', Joy(axes=[0.0]), ('malformed', 'operator', 'fort'), {}),
        ('autonomy.topic', twist(1.0, 0.0), ('autonomy_command', (10.0, 10.0)), {}),
        ('autonomy.topic', twist(0.0, 1.0), ('autonomy_command', (-2.5, 2.5)), {}),
        ('autonomy.topic', twist(math.nan, 0.0), ('malformed', 'autonomy', 'autonomy'), {}),
        ('autonomy.topic', twist(1.0, 0.5), ('autonomy_command', (1.0, 0.5)), TWIST),
        ('autonomy.topic', SIDEWAYS, ('autonomy_command', (1.0, 3.0, 2.0)), OMNI),
        ('feedback.topic', joints(velocity=[2.0, 9.0, 1.0]), ('malformed', 'feedback'), ENDS),
        ('feedback.topic', PLACED, ('measured', (1.0, 2.0)), ENDS),
        (
            'autonomy.topic',
            TwistStamped(twist=twist(1.0, 0.0)),
            ('autonomy_command', (10.0, 10.0)),
            {'autonomy__type': 'TwistStamped'},
        ),
        ('autonomy.topic', BOTH, ('autonomy_command', (1.0, 2.0)), NAMED),
        ('autonomy.topic', BOTH, ('autonomy_command', (3.0, 4.0)), EFFORT),
        ('autonomy.topic', joints(), ('malformed', 'autonomy', 'autonomy'), NAMED),
    ],
)
def test_message_is_told_with_its_time(
    topic: str, message: Any, told: tuple[Any, ...], given: dict[str, Any]
) -> None:
    fed = Fed(**given)
    _, found = fed.take(topic, message)
    found = [each for each in found if each != NO_STAMP]
    assert len(found) == 1
    name, *arguments = found[0]
    assert (name, arguments[-1]) == (told[0], 3.0)
    expected = [pytest.approx(each) if isinstance(each, tuple) else each for each in told[1:]]
    assert arguments[: len(expected)] == expected
    stamped = {'operator_sample': ('operator', 'fort'), 'measured': ('feedback', 'feedback')}
    assert fed.heard == ([(*stamped[told[0]], message)] if told[0] in stamped else [])


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


def test_stamp_that_stands_still_makes_an_operator_invalid_where_it_must_move() -> None:
    fed = Fed(operator__fort__require_moving_stamps=True)
    joy = sticks()
    joy.header.stamp.sec, joy.header.stamp.nanosec = 7, 5
    faults = [fed.take('operator.fort.topic', joy, now)[1][0][-1] for now in (3.0, 3.2, 60.0)]
    assert faults[0] is None
    assert 'the same' in faults[-1]
    assert (faults[-1].code, faults[-1].fields) == (
        'mux.operator.same_stamp',
        {'operator': 'fort'},
    )
    joy.header.stamp.nanosec = 6
    assert fed.take('operator.fort.topic', joy, 60.1)[1][0][-1] is None


def test_reset_trusts_the_positions_and_no_other_change_does() -> None:
    fed = Fed()
    trusted: list[None] = []
    fed.intake.ends.trust = lambda: trusted.append(None)  # type: ignore[method-assign]
    for state, times in (
        *((State.READY, 0), (State.ACTIVE, 0), (State.READY, 0), (State.STOPPED, 0)),
        *((State.STOPPED, 0), (State.READY, 1), (State.STOPPED, 1)),
    ):
        fed.decided(state)
        assert len(trusted) == times


@pytest.mark.parametrize(
    ('rate', 'heartbeat_rate', 'period'),
    [(100.0, 33.0, 0.02), (50.0, 20.0, 0.03), (50.0, 50.0, 0.02), (20.0, 33.0, 0.05)],
)
def test_decisions_are_rarer_at_rest_and_no_rarer_than_heartbeats(
    rate: float, heartbeat_rate: float, period: float
) -> None:
    values = {'rate': rate, 'heartbeat_rate': heartbeat_rate}
    assert rest_period(values) == pytest.approx(period)


@pytest.mark.parametrize(('interface', 'together'), [('velocity', True), ('effort', False)])
def test_velocities_grow_together_and_torques_do_not(interface: str, together: bool) -> None:
    given = {'interface': interface, **numbers('left', 'right')}
    limits = joint_limits(resolve((*MANAGED_PARAMETERS, *parameter_table(given)), given))
    assert [limit.together for limit in limits] == [together, together]


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


def test_deadman_counts_as_refused_unless_its_operator_has_control_by_the_next_decision() -> None:
    fed = Fed()
    for owner, count in (('fort', 0), (None, 1), ('senior', 2)):
        for deadman in (True, False):
            fed.take('operator.fort.topic', sticks(0.0, deadman=deadman))
        fed.arbiter.decision.owner = owner
        fed.intake.decide(3.0)
        assert fed.intake.presses['fort'].refused == count
