# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

import json
import math
from typing import Any

from builtin_interfaces.msg import Time
import pytest
from sensor_msgs.msg import JointState

from esi_drive_bridge.axes import axes_of, Axis
from esi_drive_bridge.convert import command_values, joint_state
from esi_drive_bridge.parameters import PARAMETERS
from esi_drive_bridge.protocol import AxisStatus, Mode, Status
from stage.rig import ROOT

VECTORS = json.loads((ROOT / 'test' / 'vectors' / 'esi.json').read_text())
MODES = {'current': Mode.TORQUE, 'velocity': Mode.VELOCITY, 'position': Mode.POSITION}
LEFT = Axis('left', Mode.VELOCITY, 1.0)
RIGHT = Axis('right', Mode.VELOCITY, 1.0, gear_ratio=10.0, inverted=True)
DEFAULTS = {parameter.name: parameter.default for parameter in PARAMETERS}
RPM = 2 * math.pi / 60


@pytest.mark.parametrize('entry', VECTORS['command'], ids=lambda entry: entry['hex'])
def test_scales_of_the_manual(entry: dict[str, Any]) -> None:
    mode = MODES[entry['mode'][0]]
    assert DEFAULTS[f'command_{entry["mode"][0]}_scale'] == [entry['scale']]
    axis = Axis('j', mode, entry['scale'])
    unit = RPM if mode is Mode.VELOCITY else 1.0
    for count, value in zip(entry['command'], entry['value'], strict=True):
        assert count * axis.si_per_count == pytest.approx(value * unit, rel=1e-6)


@pytest.mark.parametrize(
    ('axis', 'expected', 'unit'),
    [
        (Axis('j', Mode.VELOCITY, 2.0, gear_ratio=10.0), 0.2 * RPM, 'rad/s'),
        (Axis('j', Mode.POSITION, 0.5, gear_ratio=10.0), 0.05, 'rad'),
        (Axis('j', Mode.POSITION, 0.5, inverted=True), -0.5, 'rad'),
        (Axis('j', Mode.TORQUE, 0.01, gear_ratio=10.0), 0.01, 'A'),
        (Axis('j', Mode.TORQUE, 0.01, 10.0, 0.2, inverted=True), -0.02, 'N·m'),
    ],
)
def test_gear_torque_constant_and_direction(axis: Axis, expected: float, unit: str) -> None:
    assert axis.si_per_count == pytest.approx(expected)
    assert axis.unit == unit


@pytest.mark.parametrize(
    ('changes', 'text'),
    [
        ({'joint': ''}, 'name'),
        ({'command_scale': 0.0}, 'command_scale must be above 0'),
        ({'command_scale': math.nan}, 'command_scale'),
        ({'gear_ratio': -1.0}, 'gear_ratio must be above 0'),
        ({'gear_ratio': math.inf}, 'gear_ratio'),
        ({'torque_constant': -0.1}, 'torque_constant must be 0 or above'),
        ({'torque_constant': math.inf}, 'torque_constant'),
        ({'slew_limit': 0.0}, 'slew_limit must be above 0'),
        ({'slew_limit': math.nan}, 'slew_limit'),
        ({'command_scale': 1e-300, 'gear_ratio': 1e300}, 'give 0.0 a count'),
        ({'command_scale': 1e300, 'gear_ratio': 1e-300}, 'give inf a count'),
    ],
)
def test_bad_axes_are_refused(changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Axis(**{'joint': 'j', 'mode': Mode.VELOCITY, 'command_scale': 1.0, **changes})


@pytest.mark.parametrize('joints', [[], ['a', 'b', 'c'], ['a', 'a']])
def test_one_or_two_different_joints_are_needed(joints: list[str]) -> None:
    with pytest.raises(ValueError, match='one or two different names are needed'):
        axes_of({**DEFAULTS, 'joint_names': joints})


def test_one_element_is_for_all_axes_and_two_are_one_an_axis() -> None:
    values = {'mode': ['torque', 'velocity'], 'inverted': [False, True], 'slew_limit': [3.0]}
    assert axes_of({**DEFAULTS, **values}) == (
        Axis('left', Mode.TORQUE, 0.001, slew_limit=3.0),
        Axis('right', Mode.VELOCITY, 1.0, inverted=True, slew_limit=3.0),
    )
    (only,) = axes_of({**DEFAULTS, 'joint_names': ['tilt'], 'mode': ['position']})
    assert only == Axis('tilt', Mode.POSITION, 0.000191753, slew_limit=20.0)


@pytest.mark.parametrize(
    ('given', 'text'),
    [
        ({'mode': ['torque'] * 3}, 'mode = .*: 1 or 2 elements are needed'),
        ({'command_current_scale': [0.1] * 3}, 'command_current_scale = .*: 1 or 2 elements are'),
        ({'joint_names': ['j'], 'gear_ratio': [1.0] * 2}, 'gear_ratio = .*: 1 element is needed'),
        ({'joint_names': ['j'], 'command_position_scale': []}, 'position_scale = .*: 1 element'),
    ],
)
def test_list_that_does_not_fit_the_axes_is_refused_in_any_mode(
    given: dict[str, Any], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        axes_of({**DEFAULTS, **given})


# Commands.


def test_each_axis_reads_the_field_of_its_mode() -> None:
    axes = (LEFT, Axis('tilt', Mode.POSITION, 0.001))
    message = JointState(
        name=['left', 'tilt'], velocity=[3.0, math.nan], position=[math.nan, 0.5], effort=[1.0]
    )
    assert command_values(message, axes) == (3.0, 0.5)


@pytest.mark.parametrize(
    ('message', 'text'),
    [
        (JointState(name=['left'], velocity=[1.0]), "this drive has \\['left', 'right'\\]"),
        (JointState(name=['left', 'rihgt'], velocity=[1.0, 1.0]), 'rihgt'),
        (JointState(name=['left', 'left'], velocity=[1.0, 1.0]), "this drive has"),
        (JointState(name=['left', 'right', 'x', 'x'], velocity=[1.0] * 4), "'x', 'x'"),
        (JointState(name=['x', 'y'], velocity=[1.0] * 2), "'x', 'y'"),
        (JointState(name=['left', 'right'], velocity=[1.0]), '1 entries in velocity for 2 joints'),
        (JointState(name=['left', 'right'], position=[1.0, 1.0]), 'command left in velocity'),
        (JointState(velocity=[1.0, 2.0, 3.0]), '3 entries'),
        (JointState(), '0 entries'),
        (JointState(velocity=[1.0, math.nan]), 'velocity of right is nan'),
        (JointState(velocity=[-math.inf, 1.0]), 'velocity of left is -inf'),
        (JointState(name=[f'{n:0300}' for n in range(5000)]), 'name each of'),
    ],
)  # fmt: skip
def test_wrong_commands_are_refused_with_the_reason(message: JointState, text: str) -> None:
    with pytest.raises(ValueError, match=text) as refusal:
        command_values(message, (LEFT, RIGHT))
    assert len(str(refusal.value)) < 500


# Feedback.


def test_only_what_is_measured_is_filled() -> None:
    status = Status((AxisStatus(feedback=60), AxisStatus(feedback=600)))
    message = joint_state(status, (LEFT, RIGHT), Time(sec=7), 'base')
    assert list(message.name) == ['left', 'right']
    assert list(message.velocity) == pytest.approx([2 * math.pi, -2 * math.pi])
    assert list(message.position) == list(message.effort) == []
    assert message.header.stamp.sec == 7
    assert message.header.frame_id == 'base'


def test_every_field_is_filled_on_request_with_nan_for_what_is_not_measured() -> None:
    status = Status((AxisStatus(feedback=60), AxisStatus(feedback=0)))
    message = joint_state(status, (LEFT, RIGHT), every_field=True)
    assert list(message.velocity) == list(joint_state(status, (LEFT, RIGHT)).velocity)
    for values in (message.position, message.effort):
        assert len(values) == 2
        assert all(map(math.isnan, values))
