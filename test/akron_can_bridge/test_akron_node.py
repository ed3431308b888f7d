# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron bridge as a process, with a simulated unit on a real CAN bus."""

from __future__ import annotations

from collections.abc import Iterator
import time

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


def test_estop_input_stops_it_and_a_held_stick_does_not_start_it_again(
    bench: Bench, unit: Station
) -> None:
    bench.drive(unit)
    bench.stop = True
    bench.wait(lambda: not unit.look('moving'), 'rest')
    bench.wait(lambda: 'e-stop input is true' in bench.value('neutral because'), 'the reason')
    bench.stop = False
    bench.wait(lambda: 'must be neutral once' in bench.value('neutral because'), 'the reason')
    assert not unit.look('moving')
    bench.wait(lambda: bench.estop.last == Bool(data=False), 'estop false')
    bench.drive(unit)


def test_silent_command_stops_it_with_neutral_and_never_silence(
    bench: Bench, unit: Station
) -> None:
    bench.drive(unit)
    delay = RunDelay([bench.node.process.pid])
    bench.commanding = False
    bench.wait(lambda: not unit.look('moving'), 'rest')
    # Not by the unit's own watchdog, of 0.2 s; unless the machine let it expire.
    assert unit.look('cleared')['38'] == 0 or delay.exceeds(0.15)
    bench.wait(lambda: unit.joystick_frames(0x38)[-1] == NEUTRAL, 'neutral')


def test_malformed_command_is_refused_and_stops(bench: Bench, unit: Station) -> None:
    bench.drive(unit)
    bench.asked = Joy(axes=[float('nan'), 0.0])
    bench.wait(lambda: not unit.look('moving'), 'rest')
    bench.wait(lambda: 'axis 0 is nan' in bench.value('last refusal', 'link'), 'the refusal')
    bench.wait(lambda: 'command refused' in bench.value('neutral because'), 'the reason')


def test_deactivated_node_goes_on_saying_neutral(bench: Bench, unit: Station) -> None:
    bench.drive(unit)
    assert bench.observer.change_state(bench.prefix, 'deactivate')
    bench.wait(lambda: not unit.look('moving'), 'rest')
    assert unit.joystick_frames(0x38)[-3:] == [NEUTRAL] * 3
    bench.wait_stop(True)
    unit.since = time.monotonic()
    bench.wait(lambda: len(unit.joystick_frames(0x38)) > 20, 'frames')
    assert set(unit.joystick_frames(0x38)) == {NEUTRAL}
    bench.joint_states.clear()
    bench.wait(lambda: 'not active' in bench.status('link').message, 'the diagnostic')
    assert not bench.joint_states.messages  # it does not listen
    assert bench.observer.change_state(bench.prefix, 'activate')
    bench.wait_stop(False)
    bench.drive(unit)


def test_unconfigured_node_is_silent_and_a_configured_one_says_neutral(
    bench: Bench, unit: Station
) -> None:
    assert bench.observer.change_state(bench.prefix, 'deactivate')
    assert bench.observer.change_state(bench.prefix, 'cleanup')

    def is_silent() -> bool:
        unit.since = time.monotonic() - 0.3
        return not unit.joystick_frames(0x38)

    bench.wait(is_silent, 'silence')  # the last frames may still be on their way
    assert bench.observer.change_state(bench.prefix, 'configure')
    bench.wait(lambda: len(unit.joystick_frames(0x38)) > 10, 'frames')
    assert set(unit.joystick_frames(0x38)) == {NEUTRAL}
    bench.wait_stop(True)
    assert bench.observer.change_state(bench.prefix, 'activate')
    bench.wait_stop(False)
    bench.drive(unit)


def test_enable_input_and_motor_fault_are_stops_in_words(bench: Bench, unit: Station) -> None:
    unit.steer('enable off')
    bench.wait_stop(True)
    bench.wait(lambda: 'enable input is not asserted' in bench.status().message, 'the reason')
    unit.steer('enable on', 'fault axis_2 on')
    bench.wait(lambda: 'motor axis 2 fault' in bench.status().message, 'the fault')
    answer = bench.call('poll_faults')
    assert answer.success
    assert 'motor axis 2' in answer.message
    unit.steer('fault axis_2 off')
    bench.wait_stop(False)


def test_limits_and_outputs_are_told(bench: Bench, unit: Station) -> None:
    unit.steer('limit left -30', 'limit right 45', 'position 5 1', 'output aux_agent on')

    def value(record: Record, key: str) -> str:
        return next((v.value for v in record.last.values if v.key == key), '')

    bench.wait(lambda: value(bench.limits, 'left soft limit (deg)') == '-30', 'the limit')
    bench.wait(lambda: value(bench.limits, 'axis 5 + (open) hard stop') == 'true', 'the stop')
    assert bench.limits.last.level == DiagnosticStatus.WARN
    assert value(bench.limits, 'calibrated') == 'true'
    bench.wait(lambda: value(bench.outputs, 'aux agent dispense') == 'true', 'the output')
    assert value(bench.outputs, 'enable') == 'true'


def test_services_answer(bench: Bench, unit: Station) -> None:
    unit.steer('position 1 20')
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
    unit.steer('setup off')
    answer = bench.call('reset_controller')
    assert answer.success
    assert 'is back' in answer.message


def test_readdressed_in_motion_it_goes_on(bench: Bench, unit: Station) -> None:
    bench.wait(lambda: bench.value('moves to another address'), 'a diagnostic')
    moves = int(bench.value('moves to another address'))
    bench.drive(unit)
    unit.steer('address 9A')
    bench.wait(lambda: bench.value('address') == '9A', 'the new address')
    bench.wait(lambda: bench.device.last.message == '1032AE100801035 at 9A', 'who it is')
    named = {pair.key: pair.value for pair in bench.device.last.values}
    assert named['manufacturer'] == '326 (Akron Brass)'
    count = len(bench.device.messages)
    bench.wait(lambda: len(bench.device.messages) > count + 2, 'it again')
    assert int(bench.value('moves to another address')) == moves + 1
    if not unit.look('moving'):  # a busy machine held its frames up: neutral comes first then
        bench.drive(unit)
    bench.joint_states.clear()
    bench.wait(lambda: bench.joint_states.last is not None, 'positions from there')
