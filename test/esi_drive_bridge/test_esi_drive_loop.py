# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session with the simulated drive, in simulated time."""

import pytest

from esi_drive_bridge.protocol import Layout, Mode
from esi_drive_bridge.session import Phase
from stage.esi_drive_loop import Loop
from stage.esi_drive_rig import axes as both


@pytest.mark.parametrize(
    ('layout', 'compact'),
    [(Layout.DUAL, False), (Layout.PADDED, False), (Layout.COMPACT, True)],
)
def test_motor_turns_and_stops(layout: Layout, compact: bool) -> None:
    axes = layout.axes
    loop = Loop(compact=compact, layout=layout, axes=both(Mode.VELOCITY)[:axes])
    loop.drive_at(800.0)
    assert loop.rpm == pytest.approx(800.0, rel=0.01)
    assert loop.session.enabled
    assert loop.session.status is not None
    assert loop.session.status.axes[0].feedback == pytest.approx(800, abs=8)
    loop.session.set_estop(True, loop.now)
    loop.estop = True
    loop.run(0.02)
    assert not loop.motor_enabled
    loop.run(1.0)
    assert abs(loop.rpm) < 1.0
    loop.estop = False
    loop.run(1.0)
    assert abs(loop.rpm) < 1.0
    assert loop.drive.describe()['crc_errors'] == 0


@pytest.mark.parametrize(
    'line',
    ['mute on', 'reboot', 'hang 0.3', 'trip a', 'refuse b on', 'deaf on', 'fault b brake on'],
)
def test_whatever_happens_to_the_drive_needs_a_new_edge(line: str) -> None:
    loop = Loop()
    loop.drive_at(800.0)
    loop.drive.apply(line)
    loop.run(0.6)
    assert loop.session.phase is Phase.DISABLED
    for undo in ('mute off', 'deaf off', 'refuse * off', 'fault * brake off'):
        loop.drive.apply(undo)
    loop.run(0.5)
    loop.session.clear_errors(loop.now)
    loop.run(1.0)
    assert not loop.motor_enabled
    assert abs(loop.rpm) < 1.0
    loop.drive_at(300.0)
    assert loop.rpm == pytest.approx(300.0, rel=0.01)
