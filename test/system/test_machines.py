# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The machines of the recipes, driven by their remotes, and stopped by them on every wire."""

from __future__ import annotations

from pathlib import Path

import pytest

from stage.endings import first_of
from stage.rig import Observer
from test.system.machine_rig import Machine

# The sticks of FORT that move all there is, and whose stops are tried.
MACHINES = {
    'tracked_vehicle': (('left_y', 'right_y'), {'fort': ['silent']}),
    'four_wheels': (('left_y', 'right_y'), {'fort': ['e-stop']}),
    'fire_truck': (('right_y', 'left_x'), {'fort': ['e-stop', 'deadman', 'silent']}),
    'three_remotes': (
        ('left_y',),
        {'ssc': ['receiver lost'], 'vm110': ['e-stop'], 'fort': ['deadman']},
    ),
}


@pytest.mark.parametrize(
    'recipe',
    [
        *first_of('fire_truck', 'tracked_vehicle', 'four_wheels'),
        pytest.param('three_remotes', marks=pytest.mark.proof),
    ],
)
def test_remote_moves_the_machine_and_its_stop_ends_that_on_every_wire(
    recipe: str, tmp_path: Path, observer: Observer
) -> None:
    sticks, stops = MACHINES[recipe]
    cmd_joy = 'safety_mux/joy/fort' if recipe == 'fire_truck' else ''
    stack = recipe in ('tracked_vehicle', 'three_remotes')
    with Machine(tmp_path, observer, recipe, sticks, cmd_joy=cmd_joy, stack=stack) as machine:
        for operator, causes in stops.items():
            for cause in causes:
                machine.stop(operator, cause)
