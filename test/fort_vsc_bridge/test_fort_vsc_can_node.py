# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VSC's node does on a CAN bus alone: identifiers, parts of messages, a second VSC."""

from __future__ import annotations

from collections.abc import Iterator

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from sensor_msgs.msg import JoyFeedback
from std_msgs.msg import String

from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.simulator import CanSimulator
from stage.can_rig import CanBus, make_bus
from stage.fort_vsc_nodes import can_bench, NodeBench, Station
from stage.node_bench import DEVICE
from stage.rig import Observer

HEARTBEAT, RIGHT_EXTENDED = 0x0CFDE801, 0x0CFDD934
VALUE, STRING = 0x0CFDE900, 0x0CFDEA00


@pytest.fixture(scope='module')
def bus() -> Iterator[CanBus]:
    result = make_bus()
    yield result
    result.close()


@pytest.fixture(scope='module')
def shared(bus: CanBus) -> Iterator[NodeBench]:
    with Observer() as observer:
        result = can_bench(bus, observer)
        yield result
        result.close()


@pytest.fixture
def bench(shared: NodeBench) -> NodeBench:
    shared.start_anew()
    return shared


def test_missing_joystick_frame_makes_joy_neutral_and_is_named(bench: NodeBench) -> None:
    bench.wait_deflected()
    bench.vsc.mute(RIGHT_EXTENDED)
    bench.wait_neutral()
    named = 'right_z unavailable'
    bench.wait(lambda: bench.diagnostics.value(DEVICE, 'faulty controls') == named, 'its name')
    assert bench.level(DEVICE) == DiagnosticStatus.ERROR
    bench.wait_says(bench.estop, False)
    bench.vsc.mute()
    bench.wait(lambda: bench.axes()[1] == 1.0, 'the stick back')


def test_bus_left_and_joined_again_is_a_stop_until_the_vsc_is_heard(bench: NodeBench) -> None:
    bench.wait_deflected()
    assert bench.observer.change_state(bench.name, 'deactivate')
    bench.wait_says(bench.estop, True)
    bench.wait_neutral()
    bench.vsc.mute(HEARTBEAT)
    assert bench.observer.change_state(bench.name, 'activate')
    bench.wait(lambda: bench.count('frames') > 0, 'frames')
    assert bench.says(bench.estop, True)
    bench.vsc.mute()
    bench.wait_says(bench.estop, False)


def test_values_names_and_rumble_reach_the_vsc_at_its_pace(bench: NodeBench) -> None:
    rumble = JoyFeedback(type=JoyFeedback.TYPE_RUMBLE, id=1, intensity=1.0)
    bench.ask(KeyValue, 'set_user_value', KeyValue(key='3', value='-123456'))
    bench.ask(KeyValue, 'set_user_name', KeyValue(key='2', value='BOOM ANGLE, DEGREE'))
    bench.ask(JoyFeedback, 'set_feedback', rumble)
    bench.ask(String, 'display_text', String(data='one\ntwo'))
    text = {2: 'BOOM ANGLE, DEGREE', 90: 'one', 91: 'two', 92: '', 93: ''}
    bench.wait(lambda: bench.vsc.look(lambda vsc: dict(vsc.names)) == text, 'all text')
    bench.wait(lambda: bench.vsc.look(lambda vsc: dict(vsc.values)) == {3: -123456, 99: 1}, 'all')
    assert [side for _, side in bench.vsc.look(lambda vsc: list(vsc.rumbles))] == ['right']
    assert bench.vsc.look(lambda vsc: vsc.broken_strings) == 0
    heard = bench.vsc.heard
    assert CanFrame(VALUE, bytes.fromhex('03C01DFEFF')) in heard
    assert CanFrame(STRING, b'\x02\x01NGLE, ') in heard
    assert {sent.identifier for sent in heard} == {VALUE, STRING}


def test_second_vsc_with_the_same_identifiers_is_a_stop(bench: NodeBench, bus: CanBus) -> None:
    second = Station(bus, CanSimulator())
    try:
        second.apply('mode operational', 'stick left_y 1')
        bench.wait(lambda: 'one of two VSCs' in bench.told(DEVICE), 'why')
        bench.estop.clear()
        bench.observer.holds_for(lambda: all(bench.estop.data), 1.0, 'one stop without a gap')
    finally:
        second.close()
    bench.wait_says(bench.estop, False)


def test_vsc_with_other_identifiers_is_heard_and_one_as_delivered_is_not(
    can_bus: CanBus, shared: NodeBench, observer: Observer
) -> None:
    shared.vsc.apply('unplug')  # a real interface is the same one for every test
    changed = {'heartbeat': 0x18FF0001, 'left_basic': 0x18FF0002, 'feedback_value': 0x18FF0003}
    stranger = Station(can_bus, CanSimulator())
    stranger.apply('mode operational', 'stick left_y 1')
    bench = can_bench(can_bus, observer, **{f'can.{name}': each for name, each in changed.items()})
    try:
        bench.node.wait_output('opened')
        observer.holds_for(lambda: not bench.says(bench.estop, False), 0.5, 'a stop')
        stranger.close()
        bench.vsc.exchange(CanSimulator(changed))
        bench.vsc.apply('mode operational', 'stick left_y -1')
        bench.wait_says(bench.estop, False)
        bench.wait(lambda: bench.axes()[1:2] == [-1.0], 'its stick')
        bench.ask(KeyValue, 'set_user_value', KeyValue(key='1', value='5'))
        bench.wait(lambda: bench.vsc.look(lambda vsc: vsc.values.get(1)) == 5, 'the value')
    finally:
        stranger.close()
        bench.close()
