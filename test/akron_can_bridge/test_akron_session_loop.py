# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron session on one bus with simulated units, joysticks and a VSC: no clock, no port."""

from __future__ import annotations

import pytest

from akron_can_bridge.simulator import JoystickSimulator
from fort_vsc_bridge.simulator import CanSimulator
from stage.akron_loop_rig import Bench
from stage.akron_session_rig import MOVE

WATCHDOG = 0.2  # the unit's own, Appendix B


@pytest.mark.parametrize('kind', [1032, 1040, 1042, 1052])
def test_every_controller_moves_and_stops(kind: int) -> None:
    bench = Bench(unit={'device_type': kind}, device_type=kind).move()
    assert bench.moved(0.5) > 0.5
    bench.ours.stop = True
    bench.wait(lambda: not bench.unit.motion.moving, 1.0)
    assert abs(bench.moved(1.0)) < 0.01


def test_frozen_host_is_stopped_by_the_units_own_watchdog() -> None:
    bench = Bench().move()
    bench.ours.frozen = True
    took = bench.wait(lambda: bench.unit.describe()['cleared']['38'])
    assert took <= WATCHDOG + 0.01
    bench.wait(lambda: not bench.unit.motion.moving, 1.0)
    # Thawed, it does not go on with what it wanted.
    bench.ours.frozen = False
    assert abs(bench.moved(1.0)) < 0.01


def test_the_trap_between_two_manuals_is_sprung_and_told() -> None:
    vsc = CanSimulator()
    bench = Bench(vsc)
    vsc.apply('mode operational')
    vsc.apply('stick left_x 1')
    # The remote turns the unit past the mux, whatever we send ...
    assert bench.moved(1.0) > 1.0
    # ... and whoever asks the mux is told.
    assert bench.session.estop
    (reason,) = bench.reasons
    assert '0CFDD633' in reason or '0CFDD733' in reason
    assert "a FORT VSC's left joystick" in reason
    bench.ours.command = MOVE
    bench.run(0.2)
    assert not bench.session.drive.moving


def test_changed_identifiers_are_a_way_out() -> None:
    changed = {'left_basic': 0x0CFDD601, 'left_extended': 0x0CFDD701}
    vsc = CanSimulator(changed)
    bench = Bench(vsc)
    vsc.apply('mode operational')
    vsc.apply('stick left_x 1')
    assert bench.moved(1.0) == 0.0
    assert bench.reasons == []


def test_soe_permission_stops_an_allowed_joystick_with_us() -> None:
    stick = JoystickSimulator(0x33)
    bench = Bench(stick, allowed_joysticks=frozenset({0x33}), soe_permissive=True)
    bench.unit.apply('soe on')
    stick.apply('stick x -1')
    bench.run(0.5)
    assert bench.moved(0.5) < -0.5
    bench.ours.stop = True
    bench.wait(lambda: not bench.unit.motion.moving, 1.0)
    assert abs(bench.moved(1.0)) < 0.01
    assert bench.reasons == []  # a missing permission never counts


def test_unit_in_soe_mode_without_permission_stays_and_is_no_stop() -> None:
    bench = Bench()
    bench.unit.apply('soe on')
    bench.ours.command = MOVE
    assert bench.moved(1.0) == 0.0
    assert bench.reasons == []


def test_neighbour_that_takes_the_units_address_moves_it_and_we_follow() -> None:
    # 0.35 s without a frame: with a longer timeout that is no stop.
    bench = Bench(link_timeout=0.5).move()
    bench.say('18EEFF80', '0000000000000000')  # the NAME that wins against all
    start = bench.now
    for _ in range(100):
        bench.run(0.01)
        assert not bench.session.estop
    assert bench.session.finder.address == bench.unit.address == 0x81
    assert bench.moved(0.5) > 0.0
    assert bench.now - start < 2.0
