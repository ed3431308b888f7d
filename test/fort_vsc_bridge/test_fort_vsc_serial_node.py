# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VSC's node does on a serial port alone: values, positions, the software e-stop."""

from __future__ import annotations

from collections.abc import Iterator
import json
from pathlib import Path
from signal import SIGCONT, SIGSTOP, SIGTERM
import time
from typing import Any

from diagnostic_msgs.msg import KeyValue
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import BatteryState, JoyFeedback
from std_msgs.msg import Bool, String, UInt8

from fort_vsc_bridge.simulator import build_frame, build_sentence
from stage.fort_vsc_nodes import NodeBench, serial_bench
from stage.node_bench import DEVICE
from stage.rig import Observer, ROOT
from stage.talkers import Talker

pytestmark = pytest.mark.waits(60)
CLEAR, STOP = build_frame(0x21, b'\0'), build_frame(0x21, b'\x01')
GIVEN: dict[str, Any] = {
    'frame_id': 'remote',
    'tolerate_faulty_axes': True,
    'axis_full_scale': 800,
    'deadband': 0.2,
}
OUTLASTS_GAPS = 2.0  # s; of a talker that a busy machine holds up
VECTORS = {
    entry['is']: bytes.fromhex(entry['hex'])
    for entry in json.loads((ROOT / 'test/vectors/fort_vsc.json').read_text())['serial']
}  # of several with one name the last


@pytest.fixture(scope='module')
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NodeBench]:
    with Observer() as observer:
        result = serial_bench(tmp_path_factory.mktemp('fort'), observer, **GIVEN)
        yield result
        result.close()


@pytest.fixture
def bench(shared: NodeBench) -> NodeBench:
    shared.start_anew()
    return shared


# From the VSC.


def test_nothing_is_known_of_a_vsc_that_was_never_heard(
    observer: Observer, tmp_path: Path
) -> None:
    bench = NodeBench(None, {'port': str(tmp_path / 'none')}, observer)
    try:
        records = (bench.mode, bench.autonomy, bench.strength)
        bench.wait(lambda: all(r.last for r in (*records, bench.battery)), 'all four')
        assert [record.last.data for record in records] == ['None', 'None', -1]
        assert not bench.battery.last.present
    finally:
        bench.close()


def test_remote_status_becomes_battery_only_while_a_remote_is_connected(bench: NodeBench) -> None:
    bench.wait_says(bench.autonomy, 'User control')
    bench.vsc.write(VECTORS['remote status'])
    bench.wait(lambda: bench.battery.last and bench.battery.last.present, 'a battery')
    battery = bench.battery.last
    assert battery.percentage == pytest.approx(0.70)
    assert battery.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_CHARGING
    bench.wait_says(bench.strength, VECTORS['remote status'][6])
    bench.vsc.apply('estop remote on')  # Local: no remote vouches for it any more
    bench.wait(lambda: not bench.battery.last.present, 'no battery')
    bench.wait_says(bench.strength, -1)


def write_sentences(bench: NodeBench, *sentences: str) -> float:
    bench.vsc.enable_message(0x12, False)
    frames = (build_frame(0x12, b'\0' + sentence.encode()) for sentence in sentences)
    return float(bench.vsc.write(b''.join(frames)))


def test_gps_sentence_becomes_fix_and_a_bad_one_is_counted(bench: NodeBench) -> None:
    before = bench.count('bad GPS sentences', DEVICE)
    # 48 deg 7.038 min north, 11 deg 31.000 min east, 545.4 m above a geoid of 46.9 m.
    sentence = '$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47'
    wrong = sentence.replace('4807', '1107')
    cause = write_sentences(bench, wrong, sentence + '\r\n')
    bench.wait(lambda: {sentence, wrong} <= set(bench.nmea.data), 'both sentences')

    def fixes() -> list[Any]:  # the simulated remote has one of its own
        found = (fix for _, fix in bench.fix.since(cause))
        return [fix for fix in found if fix.latitude == pytest.approx(48.1173)]

    (fix,) = bench.wait(fixes, 'the fix')
    assert (fix.longitude, fix.altitude) == pytest.approx((11.516667, 592.3))
    assert fix.header.frame_id == 'remote'
    bench.wait(lambda: bench.count('bad GPS sentences', DEVICE) == before + 1, 'the count')
    assert not any(round(fix.latitude) == 11 for fix in bench.fix.messages)


def test_remote_without_gga_has_a_fix_although_another_has_sent_gga(bench: NodeBench) -> None:
    cause = write_sentences(
        bench,
        build_sentence('GPGGA,123519,2100.000,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,'),
        build_sentence('GPRMC,123519,A,2200.000,N,01131.000,E,0,0,230394,,'),  # the same remote's
        build_sentence('GPRMC,123520,A,2300.000,N,01131.000,E,0,0,230394,,'),
        build_sentence('GPRMC,123521,A,2400.000,N,01131.000,E,0,0,230394,,'),
    )

    def latitudes() -> list[int]:
        found = (round(fix.latitude) for _, fix in bench.fix.since(cause))
        return [latitude for latitude in found if latitude in range(21, 25)]

    bench.wait(lambda: 24 in latitudes(), 'its fix')
    assert latitudes() == [21, 23, 24]


def test_tolerated_fault_leaves_the_sound_controls(bench: NodeBench) -> None:
    bench.vsc.apply('stick left_y 0.5', 'stick left_x 0.1', 'fault right_z unavailable')
    bench.wait(lambda: any(bench.axes()), 'a deflection')
    # round(0.5 * 1023) = 512 of 800, less a dead band of 0.2; 102 of 800 is within it.
    expected = (512 / 800 - 0.2) / 0.8
    assert bench.axes() == pytest.approx([0.0, expected, 0.0, 0.0, 0.0, 0.0])
    named = 'right_z unavailable'
    bench.wait(lambda: named in bench.diagnostics.value(DEVICE, 'faulty controls'), 'its name')


# To the VSC.


def test_requests_arrive_as_the_manual_says(bench: NodeBench) -> None:
    simulator = bench.vsc.simulator
    since = bench.ask(KeyValue, 'set_user_value', KeyValue(key='3', value='-123456'))
    bench.ask(KeyValue, 'set_user_name', KeyValue(key='2', value='BOOM'))
    bench.ask(String, 'display_text', String(data='one\ntwo'))
    rumble = JoyFeedback(type=JoyFeedback.TYPE_RUMBLE, id=1, intensity=1.0)
    bench.ask(JoyFeedback, 'set_feedback', rumble)
    text = {2: 'BOOM', 90: 'one', 91: 'two', 92: '', 93: ''}
    bench.wait(lambda: simulator.names == text, 'name and lines')
    bench.wait(lambda: simulator.values == {3: -123456, 99: 1}, 'value and display mode')
    bench.wait(lambda: [side for _, side in simulator.rumbles] == ['right'], 'a rumble')
    assert VECTORS['user feedback'] in bench.heard(since)
    bench.user_values.clear()
    bench.ask(UInt8, 'get_user_value', UInt8(data=81))  # Auto Off Enable, 1 as delivered
    bench.wait(lambda: bench.user_values.last is not None, 'an answer')
    assert (bench.user_values.last.key, bench.user_values.last.value) == ('81', '1')


# The software e-stop changes the node for good, so each has one of its own.


@pytest.fixture
def fresh(tmp_path: Path, observer: Observer) -> Iterator[NodeBench]:
    result = serial_bench(tmp_path, observer, software_estop_timeout=OUTLASTS_GAPS)
    result.start_anew()
    yield result
    result.close()


def topic(bench: NodeBench) -> str:
    return f'{bench.name}/software_estop'


def talker(bench: NodeBench, stop: bool, kind: Any = Bool, **options: Any) -> Talker:
    """Say this on ~/software_estop again and again."""
    message = Bool(data=stop) if kind is Bool else String(data='true')
    return Talker(bench.observer, kind, topic(bench), message, **options)


def wait_in_use(bench: NodeBench, in_use: str = 'true') -> None:
    bench.wait(
        lambda: bench.diagnostics.value(DEVICE, 'software e-stop in use') == in_use, 'its use'
    )


def wait_asked(bench: NodeBench, stop: bool) -> None:
    bench.wait(lambda: bench.vsc.simulator.host_estop is stop, f'stop {stop} in our heartbeat')


def wait_heartbeats(bench: NodeBench, count: int = 10) -> None:
    before = bench.vsc.simulator.host_heartbeats
    bench.wait(lambda: bench.vsc.simulator.host_heartbeats > before + count, 'heartbeats')


def test_software_estop_stops_the_vsc_and_is_told_as_an_echo(fresh: NodeBench) -> None:
    panel = talker(fresh, False)
    wait_in_use(fresh)
    fresh.wait_says(fresh.estop, False)
    panel.message = Bool(data=True)
    wait_asked(fresh, True)
    fresh.wait_says(fresh.estop, True)
    fresh.wait_says(fresh.own_estop, False)  # an echo, and nothing else
    panel.message = Bool(data=False)
    wait_asked(fresh, False)
    fresh.vsc.apply('ack', 'mode operational')
    fresh.wait_says(fresh.estop, False)
    panel.pause()  # once in use, silence is a stop
    wait_asked(fresh, True)


def test_second_publisher_of_the_software_estop_undoes_no_stop(fresh: NodeBench) -> None:
    first = talker(fresh, True, rate=20.0)
    talker(fresh, False, rate=20.0)
    doubled = f'stop one of the two publishers of {topic(fresh)}'
    fresh.wait(lambda: doubled in fresh.told(DEVICE), 'why')
    wait_heartbeats(fresh)  # the wire may be behind the diagnostics
    since = time.monotonic()
    fresh.observer.holds_for(lambda: fresh.vsc.simulator.host_estop, 0.5, 'the stop')
    assert CLEAR not in fresh.heard(since)
    first.leave()
    fresh.wait(lambda: doubled not in fresh.told(DEVICE), 'only one again')
    wait_asked(fresh, False)


def test_software_estop_that_can_never_be_heard_is_a_stop(fresh: NodeBench) -> None:
    """Such as of a panel that publishes best effort: its stop would be lost without a word."""
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    panel = talker(fresh, True, qos=qos)
    wait_asked(fresh, True)
    why = f'publishes {topic(fresh)} best effort: make it reliable'
    fresh.wait(lambda: why in fresh.told(DEVICE), 'why')
    talker(fresh, False, rate=20.0)
    fresh.observer.holds_for(lambda: fresh.vsc.simulator.host_estop, 1.5, 'the stop')
    panel.leave()
    wait_asked(fresh, False)


def test_topic_of_a_publisher_that_was_never_heard_is_not_in_use_once_it_has_gone(
    fresh: NodeBench,
) -> None:
    panel = talker(fresh, True, String)
    wait_asked(fresh, True)
    assert fresh.observer.change_state(fresh.name, 'deactivate')
    assert fresh.observer.change_state(fresh.name, 'activate')
    wait_heartbeats(fresh)
    wait_asked(fresh, True)
    panel.leave()
    wait_asked(fresh, False)
    wait_in_use(fresh, 'false')


def test_activation_undoes_no_stop_of_a_publisher_that_is_gone(fresh: NodeBench) -> None:
    panel = talker(fresh, False)
    wait_in_use(fresh)
    panel.leave()
    wait_asked(fresh, True)
    assert fresh.observer.change_state(fresh.name, 'deactivate')
    since = time.monotonic()
    assert fresh.observer.change_state(fresh.name, 'activate')
    wait_heartbeats(fresh)
    assert fresh.vsc.simulator.host_estop
    assert CLEAR not in fresh.heard(since)


def test_software_estop_in_use_is_a_stop_when_the_node_ends(fresh: NodeBench) -> None:
    talker(fresh, False)
    wait_in_use(fresh)
    since = time.monotonic()
    fresh.node.signal(SIGTERM)
    fresh.wait(lambda: fresh.node.process.poll() is not None, 'its end')
    assert fresh.node.process.returncode == 0
    fresh.wait(lambda: fresh.heard(since).endswith(STOP), 'its last words')


def test_node_that_is_no_part_of_the_stop_chain_does_not_trip_it_by_ending(
    fresh: NodeBench,
) -> None:
    assert fresh.node.end(SIGTERM) == 0
    fresh.wait_says(fresh.estop, True)
    assert not fresh.vsc.simulator.host_estop
    assert STOP not in fresh.heard()


# Variants of the parameters.


def test_stop_pressed_and_released_while_the_node_is_frozen_is_published(
    tmp_path: Path, observer: Observer
) -> None:
    """No freeze here is long enough for a timeout; of some the backlog is read, of some not."""
    bench = serial_bench(tmp_path, observer, patient=False, link_timeout=5.0)
    estop = observer.record(Bool, f'{bench.name}/estop', 10)  # as the mux listens

    def sent(mode: int, since: float) -> Any:
        return lambda: [
            c for c in bench.vsc.sent(since) if c.data[2] == 0x20 and c.data[4] == mode
        ]

    def stopped(since: float) -> Any:
        return lambda: [message for _, message in estop.since(since) if message.data]

    try:
        bench.start_anew()
        for frozen in (0.12, 0.15, 0.22, 0.3, 1.0):
            since = time.monotonic()
            bench.node.signal(SIGSTOP)
            pressed = bench.vsc.apply('estop remote on')
            bench.wait(sent(4, pressed), 'a heartbeat in Local')
            released = bench.vsc.apply('estop remote off', 'ack', 'mode operational')
            bench.wait(sent(9, released), 'a heartbeat in Operational')
            bench.wait(lambda end=since + frozen: time.monotonic() >= end, 'the end of the freeze')
            bench.node.signal(SIGCONT)
            bench.wait(stopped(since), f'a stop after {frozen} s')
            bench.wait_says(bench.estop, False)
    finally:
        bench.node.signal(SIGCONT)
        bench.close()


def test_paused_simulated_time_changes_no_stop_and_no_stick(
    tmp_path: Path, observer: Observer
) -> None:
    bench = serial_bench(tmp_path, observer, use_sim_time=True)  # and nobody publishes /clock
    try:
        bench.start_anew()
        bench.wait_deflected()
        assert bench.joy.last.header.stamp.sec == 0
        bench.vsc.enable_message(0x20, False)
        bench.wait_says(bench.estop, True)
    finally:
        bench.close()
