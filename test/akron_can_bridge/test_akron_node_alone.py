# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron bridge in processes of their own: ended, with other parameters, with neighbours."""

from __future__ import annotations

from collections.abc import Iterator
import os
import signal

import pytest
from std_msgs.msg import Bool

from akron_can_bridge.simulator import JoystickSimulator, Simulator
from stage.akron_node_rig import bench_of, NEUTRAL, START_LIMIT, Station
from stage.can_rig import CanBus
from stage.endings import first_of
from stage.rig import ENDING, Observer
from stage.toy_rig import is_running, name_of, spares_of, wires_of

pytestmark = pytest.mark.waits(55)


@pytest.fixture
def own_unit(can_bus: CanBus) -> Iterator[Station]:
    """Give a unit to a node of the test's own."""
    with Station(Simulator(), can_bus) as station:
        yield station


@pytest.mark.parametrize('number', [*first_of(*ENDING), signal.SIGKILL, signal.SIGSEGV])
def test_node_that_ends_or_dies_leaves_neutral_frames(
    observer: Observer, can_bus: CanBus, own_unit: Station, number: int
) -> None:
    with bench_of(observer, can_bus) as bench:
        bench.connect().drive(own_unit)
        wire = wires_of(bench.node.process.pid)[0]
        assert (bench.node.end(number) == 0) is (number in ENDING)
        bench.wait(lambda: not is_running(wire), 'the end of the wire')
        # What it said last may still be on its way to the unit.
        bench.wait(lambda: own_unit.joystick_frames(0x38)[-3:] == [NEUTRAL] * 3, 'neutral frames')
        bench.wait(lambda: not own_unit.look('moving'), 'rest')


def test_setup_mode_outlives_wire_and_activation(
    observer: Observer, can_bus: CanBus, own_unit: Station
) -> None:
    with bench_of(observer, can_bus) as bench:
        pid = bench.connect().node.process.pid
        bench.wait(lambda: 'spare wire' in map(name_of, spares_of(pid)), 'who takes over')
        assert bench.call('enter_setup').success

        def is_told() -> bool:
            return 'the unit is in setup mode' in bench.value('neutral because')

        bench.wait(is_told, 'setup mode')
        os.kill(wires_of(pid)[0], signal.SIGKILL)
        bench.wait(lambda: 'SIGKILL' in bench.value('last wire', 'link'), 'its end')
        bench.wait_stop(False)
        bench.diagnostics.clear()
        bench.wait(is_told, 'setup mode of the next wire')
        assert bench.observer.change_state(bench.name, 'deactivate')
        assert bench.observer.change_state(bench.name, 'activate')
        bench.wait_stop(False)
        bench.diagnostics.clear()
        bench.wait(is_told, 'setup mode of the next activation')
        bench.wait(lambda: bench.call('reset_controller').success, 'the reset')
        bench.drive(own_unit)


def test_foreign_joystick_is_a_stop_and_an_allowed_one_an_operator(
    observer: Observer, can_bus: CanBus, own_unit: Station
) -> None:
    with Station(JoystickSimulator(0x33), can_bus) as stick:
        with bench_of(observer, can_bus) as bench:
            bench.wait(lambda: '0CFDD633' in bench.told(), 'the trap', START_LIMIT)
            assert 'allowed_joysticks' in bench.told()
            bench.wait(lambda: bench.estop.last == Bool(data=True), 'estop true')
        given = {'joy_source': 0x33, 'allowed_joysticks': [0x33]}
        with bench_of(observer, can_bus, given) as bench:
            bench.connect()
            stick.apply('stick x 1', 'switch 2 on')
            bench.wait(lambda: bench.joy.last and bench.joy.last.axes[0] == -1.0, 'the stick')
            bench.wait(lambda: list(bench.joy.last.buttons[:3]) == [0, 1, 0], 'the button')
            bench.wait(lambda: bench.value('joysticks heard') == '33 allowed', 'the diagnostic')
            stick.apply('mute on')
            bench.wait(lambda: not any(bench.joy.last.axes), 'neutral')
