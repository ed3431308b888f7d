# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recipes as the doctor sees them; what the sticks of machines of our own nodes ask of what."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from sensor_msgs.msg import Joy

from akron_can_bridge.convert import command
from fort_vsc_bridge.protocol import AXIS_NAMES
from rugged_teleop.bringup import processes
from rugged_teleop.doctor.configuration import configured, wiring
from rugged_teleop.doctor.findings import Level
from safety_mux.configuration import joy_mapping
from stage.rig import ROOT

RECIPES = ROOT / 'config' / 'recipes'
NAMES = sorted(path.stem for path in RECIPES.glob('*.yaml'))
REMOTES = {
    'fort': AXIS_NAMES,
    'vm110': ('joystick_1', 'joystick_2', 'joystick_3', 'joystick_4'),
    'ssc': ('turn', 'forward'),
}
MACHINES = {
    'tracked_vehicle': ['/esi_drive_bridge', '/fort_vsc_bridge', '/safety_mux'],
    'four_wheels': [
        '/fort_vsc_bridge',
        '/front/esi_drive_bridge',
        '/rear/esi_drive_bridge',
        '/safety_mux',
    ],
    'fire_truck': ['/akron_can_bridge', '/esi_drive_bridge', '/fort_vsc_bridge', '/safety_mux'],
    'three_remotes': [
        '/esi_drive_bridge',
        '/fort_vsc_bridge',
        '/safety_mux',
        '/ssc_bridge',
        '/vm110_bridge',
    ],
}


def mux_of(recipe: str) -> Mapping[str, Any]:
    """Return the mux's parameters, defaults included."""
    nodes, _ = configured([RECIPES / f'{recipe}.yaml'])
    (values,) = (node.values for node in nodes if node.name == 'safety_mux')
    return values


@pytest.mark.parametrize('recipe', NAMES)
def test_doctor_has_nothing_to_correct_in_a_recipe(recipe: str) -> None:
    nodes, findings = configured([RECIPES / f'{recipe}.yaml'])
    assert nodes
    found = [*findings, *wiring(nodes)]
    assert [each.text for each in found if each.level is Level.DO] == []


@pytest.mark.parametrize('recipe', MACHINES)
def test_bring_up_starts_the_nodes_of_a_recipe(recipe: str, tmp_path: Path) -> None:
    found = processes(RECIPES / f'{recipe}.yaml', tmp_path, simulated=True, recorder=False)
    assert sorted(each.name for each in found if each.respawn) == MACHINES[recipe]


@pytest.mark.parametrize(
    ('recipe', 'operator', 'stick', 'demand'),
    [
        ('tracked_vehicle', 'fort', 'left_y', (12.0, 0.0)),
        ('tracked_vehicle', 'fort', 'right_y', (0.0, 12.0)),
        ('four_wheels', 'fort', 'left_y', (10.0, 0.0, 10.0, 0.0)),
        ('four_wheels', 'fort', 'right_y', (0.0, 10.0, 0.0, 10.0)),
        ('fire_truck', 'fort', 'right_y', (8.0, 8.0)),
        ('fire_truck', 'fort', 'right_x', (-8.0, 8.0)),
        ('fire_truck', 'fort', 'left_x', (0.0, 0.0)),
        ('three_remotes', 'fort', 'left_y', (10.0, 10.0)),
        ('three_remotes', 'vm110', 'joystick_2', (5.0, 5.0)),
        ('three_remotes', 'vm110', 'joystick_1', (-5.0, 5.0)),
        ('three_remotes', 'ssc', 'forward', (10.0, 10.0)),
    ],
)
def test_stick_that_is_pushed_forward_or_left_asks_for_this(
    recipe: str, operator: str, stick: str, demand: tuple[float, ...]
) -> None:
    axes = [float(each == stick) for each in REMOTES[operator]]
    sample = joy_mapping(mux_of(recipe), operator).sample(axes, [1] * 9)
    assert sample.deadman
    assert sample.demand == pytest.approx(demand)


@pytest.mark.parametrize(
    ('stick', 'rotates', 'elevates'),
    [('left_x', True, False), ('left_y', False, True), ('right_y', False, False)],
)
def test_stick_of_the_fire_truck_moves_the_monitor_or_the_wheels(
    stick: str, rotates: bool, elevates: bool
) -> None:
    nodes, _ = configured([RECIPES / 'fire_truck.yaml'])
    values = {node.name: node.values for node in nodes}
    assert values['safety_mux']['operator.fort.gated_joy']
    joy = Joy(axes=[float(each == stick) for each in AXIS_NAMES], buttons=[1] * 8)
    basic, _ = command(joy, values['akron_can_bridge']['button_switches'])
    assert (basic.x.magnitude > 0, basic.y.magnitude > 0) == (rotates, elevates)
    drives = any(joy_mapping(values['safety_mux'], 'fort').sample(joy.axes, [1]).demand)
    assert drives is not (rotates or elevates)
