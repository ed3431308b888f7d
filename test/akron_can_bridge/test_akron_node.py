# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron bridge as a process, with a simulated unit on a real CAN bus."""

from __future__ import annotations

from collections.abc import Iterator
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool

from akron_can_bridge.simulator import Simulator
from stage.akron_node_rig import Bench, bench_of, NEUTRAL, Station
from stage.can_rig import make_bus
from stage.rig import Observer, Record
from stage.run_delay import RunDelay


@pytest.fixture(scope='module')
def shared() -> Iterator[tuple[Bench, Station]]:
    """Give one node with its unit, as a process takes long to start."""
    bus = make_bus()
    with (
        Observer() as observer,
        Station(Simulator(), bus) as station,
        bench_of(observer, bus) as bench,
    ):
        yield bench, station


@pytest.fixture
def unit(shared: tuple[Bench, Station]) -> Station:
    """Give the unit as new."""
    shared[1].exchange(Simulator())
    return shared[1]


@pytest.fixture
def bench(shared: tuple[Bench, Station], unit: Station) -> Bench:
    """Give the node, which knows the unit."""
    del unit
    return shared[0].connect()


def test_stick_moves_the_unit_and_its_position_comes_back(bench: Bench, unit: Station) -> None:
    right, up = Joy(axes=[-1.0, 0.0]), Joy(axes=[0.0, -1.0])  # back: up
    bench.drive(unit, right, lambda: bench.joint_states.last.position[0] < -0.05)
    assert list(bench.joint_states.last.name) == ['rotation', 'elevation']
    assert bench.joint_states.last.position[1] == pytest.approx(0.0, abs=0.01)
    bench.drive(unit, up, lambda: bench.joint_states.last.position[1] > 0.05)


STOPS: list[tuple[dict[str, Any], str]] = [
    ({'stop': True}, 'e-stop input is true'),
    ({'asked': Joy(axes=[float('nan'), 0.0])}, 'command refused: axis 0 is nan'),
    ({'commanding': False}, 'command is stale'),
]


@pytest.mark.parametrize(('given', 'reason'), STOPS, ids=[reason for _, reason in STOPS])
def test_unit_stops_by_neutral_frames_and_starts_again_behind_a_neutral_command(
    bench: Bench, unit: Station, given: dict[str, Any], reason: str
) -> None:
    bench.drive(unit)
    delay = RunDelay([bench.node.process.pid])
    held = {name: getattr(bench, name) for name in given}
    vars(bench).update(given)
    bench.wait(lambda: not unit.look('moving'), 'rest')
    # Not by the unit's own watchdog, of 0.2 s; unless the machine let it expire.
    assert unit.look('cleared')['38'] == 0 or delay.exceeds(0.15)
    bench.wait(lambda: reason in bench.value('neutral because'), 'the reason')
    vars(bench).update(held)
    bench.wait(lambda: 'must be neutral once' in bench.value('neutral because'), 'the reason')
    assert not unit.look('moving')
    assert bench.estop.last == Bool(data=False)
    bench.drive(unit)


def test_node_says_neutral_while_it_is_configured_alone(bench: Bench, unit: Station) -> None:
    bench.drive(unit)
    assert bench.observer.change_state(bench.name, 'deactivate')
    bench.wait(lambda: not unit.look('moving'), 'rest')
    bench.wait_stop(True)
    unit.since = time.monotonic()
    bench.wait(lambda: len(unit.joystick_frames(0x38)) > 20, 'frames')
    assert set(unit.joystick_frames(0x38)) == {NEUTRAL}
    assert bench.observer.change_state(bench.name, 'cleanup')

    def is_silent() -> bool:
        unit.since = time.monotonic() - 0.3
        return not unit.joystick_frames(0x38)

    bench.wait(is_silent, 'silence')  # the last frames may still be on their way
    assert bench.observer.change_state(bench.name, 'configure')
    bench.wait(lambda: len(unit.joystick_frames(0x38)) > 10, 'frames')
    assert set(unit.joystick_frames(0x38)) == {NEUTRAL}
    assert bench.observer.change_state(bench.name, 'activate')
    bench.wait_stop(False)
    bench.drive(unit)


def test_limits_and_outputs_are_told(bench: Bench, unit: Station) -> None:
    unit.apply('limit left -30', 'limit right 45', 'position 5 1', 'output aux_agent on')

    def value(record: Record, key: str) -> str:
        return next((v.value for v in record.last.values if v.key == key), '')

    bench.wait(lambda: value(bench.limits, 'left soft limit (deg)') == '-30', 'the limit')
    bench.wait(lambda: value(bench.limits, 'axis 5 + (open) hard stop') == 'true', 'the stop')
    assert bench.limits.last.level == DiagnosticStatus.WARN
    assert value(bench.limits, 'calibrated') == 'true'
    bench.wait(lambda: value(bench.outputs, 'aux agent dispense') == 'true', 'the output')
    assert value(bench.outputs, 'enable') == 'true'


def test_services_answer_and_a_fault_that_one_polls_is_a_stop(bench: Bench, unit: Station) -> None:
    unit.apply('fault axis_2 on')
    bench.wait_stop(True)
    assert 'motor axis 2' in bench.call('poll_faults').message
    unit.apply('fault axis_2 off')
    bench.wait_stop(False)
    unit.apply('position 1 20')
    bench.wait(lambda: bench.joint_states.last.position[0] < -0.3, 'the position')
    bench.stand()
    assert bench.call('zero_positions').success
    bench.wait(lambda: abs(bench.joint_states.last.position[0]) < 0.01, 'zero')
    answer = bench.call('poll_versions')
    assert answer.success
    assert 'fixed boot' in answer.message
    bench.stand()
    assert bench.call('enter_setup').success
    assert unit.look('setup')
    unit.apply('setup off')
    answer = bench.call('reset_controller')
    assert answer.success
    assert 'is back' in answer.message
