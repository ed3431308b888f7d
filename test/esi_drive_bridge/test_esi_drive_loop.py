# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session with the simulated drive, in simulated time."""

from itertools import pairwise

import pytest

from esi_drive_bridge.protocol import Layout, Mode
from esi_drive_bridge.session import Phase
from stage.esi_drive_loop import Loop
from stage.esi_drive_rig import axes as both, TICK


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


@pytest.mark.parametrize('latched', [False, True])
def test_rs422_bit_latched_or_not(latched: bool) -> None:
    loop = Loop()
    loop.drive.apply(f'latch {"on" if latched else "off"}')
    loop.run(0.1)
    loop.drive.apply('deaf on')
    loop.run(0.3)
    assert 'RS422' in loop.session.stop_reasons(loop.now)[0]
    loop.drive.apply('deaf off')
    loop.run(0.3)
    assert loop.session.estop == latched
    loop.session.clear_errors(loop.now)
    loop.run(0.3)
    assert not loop.session.estop


def test_a_few_lost_or_corrupt_packets_do_not_stop_anything() -> None:
    loop = Loop()
    loop.drive_at(500.0)
    loop.line.corrupt_next = 5
    loop.run(0.2)
    loop.line.drop_next = 5
    loop.run(0.2)
    assert loop.rpm == pytest.approx(500.0, rel=0.01)
    assert loop.session.counters.discarded_bytes >= 5 * Layout.DUAL.status_size


@pytest.mark.parametrize('mode', [Mode.VELOCITY, Mode.TORQUE])
@pytest.mark.parametrize('delay', [0.02, 0.1, 0.5, 0.99])
def test_a_slow_drive_is_told_to_start_from_rest_and_never_to_step(
    delay: float, mode: Mode
) -> None:
    loop = Loop(enable_delay=delay, axes=both(mode, slew_limit=2000.0))
    for goal in (800.0, -800.0):  # the second enabling begins like the first
        loop.enable = False
        loop.run(0.1)
        loop.heard.clear()
        loop.drive_at(goal)
        loop.run(1.0)
        assert loop.heard[0] == 0
        steps = [abs(after - before) for before, after in pairwise(loop.heard)]
        assert max(steps) <= 2000.0 * TICK + 1
        assert loop.heard[-1] == goal
        assert loop.session.enabled
