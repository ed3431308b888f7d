# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The FORT VSC bridge as a process on a port: every topic, both ways, on real bytes."""

from collections.abc import Iterator
import json
import math
from pathlib import Path
from signal import SIGCONT, SIGSTOP, SIGTERM
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import BatteryState, Joy, JoyFeedback, NavSatFix
from std_msgs.msg import Bool, Int8, String, UInt8

from fort_vsc_bridge.simulator import build_frame, build_sentence, Simulator
from stage.devices import Device
from stage.rig import latched, NodeProcess, Observer, Record, ROOT
from stage.talkers import Diagnostics, namespace, Talker

pytestmark = pytest.mark.waits(80)
NAME = 'fort_vsc_bridge'
LINK, DEVICE = 'link', 'device'  # the parts of its diagnostics
LINK_TIMEOUT = 1.0  # s; longer than a busy machine holds heartbeats up
HOST_HEARTBEAT_STOP = build_frame(0x21, b'\x01')
VECTORS = {
    entry['is']: bytes.fromhex(entry['hex'])
    for entry in json.loads((ROOT / 'test/vectors/fort_vsc.json').read_text())['serial']
}  # of several with one name the last


OUTLASTS_GAPS = 2.0  # s; of a talker that a busy machine holds up


class Bench:
    """One bridge on one simulated VSC."""

    def __init__(
        self, folder: Path, observer: Observer, *, patient: bool = True, **parameters: Any
    ) -> None:
        self.observer = observer
        self.vsc = Device(folder / 'vsc', Simulator())
        space = namespace()
        self.name = f'{space}/{NAME}'
        given = {'port': self.vsc.path, 'link_timeout': LINK_TIMEOUT, **parameters}
        self.node = NodeProcess(f'{NAME}.node', given, namespace=space, patient=patient)
        record = observer.record
        self.estop = record(Bool, f'{self.name}/estop', latched())
        self.own_estop = record(Bool, f'{self.name}/own_estop', latched())
        self.joy = record(Joy, f'{self.name}/joy')
        self.mode = record(String, f'{self.name}/mode', latched())
        self.autonomy = record(String, f'{self.name}/autonomy_mode', latched())
        self.strength = record(Int8, f'{self.name}/radio_strength', latched())
        self.battery = record(BatteryState, f'{self.name}/battery', latched())
        self.fix = record(NavSatFix, f'{self.name}/fix')
        self.nmea = record(String, f'{self.name}/nmea')
        self.user_values = record(KeyValue, f'{self.name}/user_values')
        self.diagnostics = Diagnostics(observer, self.name)

    def start_anew(self) -> None:
        """Have a fresh VSC with an operational remote, and hear that it is well."""
        self.vsc.exchange(Simulator())
        self.vsc.apply('mode operational')
        self.wait(lambda: self.says(self.mode, 'Operational'), 'Operational')
        self.wait(lambda: self.says(self.estop, False), 'no stop')
        self.wait(self.joy_since(time.monotonic()), 'sticks')

    def wait(self, condition: Any, what: str, timeout: float = 15.0) -> Any:
        return self.observer.wait_for(condition, timeout, what)

    @staticmethod
    def says(record: Record, value: Any) -> bool:
        return record.last is not None and record.last.data == value

    def joy_since(self, moment: float) -> Any:
        return lambda: list(self.joy.since(moment))

    def ask(self, kind: Any, topic: str, *messages: Any) -> None:
        """Publish once each, when the node listens."""
        publisher = self.observer.publisher(kind, f'{self.name}/{topic}')
        for message in messages:
            publisher.publish(message)

    def close(self) -> None:
        self.node.__exit__(None, None, None)
        self.vsc.close()


@pytest.fixture(scope='module')
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with Observer() as observer:
        result = Bench(tmp_path_factory.mktemp('fort'), observer, frame_id='remote')
        yield result
        result.close()


@pytest.fixture
def bench(shared: Bench) -> Bench:
    shared.start_anew()
    return shared


# From the VSC.


def test_joystick_frame_becomes_joy_with_left_and_forward_positive(bench: Bench) -> None:
    bench.vsc.enable_message(0x10, False)
    cause = bench.vsc.write(VECTORS['joystick'])  # X right 1023, Y back 296, right Z back 1
    # A neutral one of before may still be on its way.
    joys = bench.wait(lambda: [j for _, j in bench.joy.since(cause) if any(j.axes)], 'a Joy')
    joy = joys[0]
    assert list(joy.axes) == pytest.approx([-1.0, -296 / 1023, 0.0, 0.0, 0.0, -1 / 1023])
    assert list(joy.buttons) == [0, 0, 0, 1, 1, 0, 1, 0]  # left left, right down, right up
    assert joy.header.frame_id == 'remote'
    assert joy.header.stamp.sec > 0


def test_sticks_count_in_operational_mode_only(bench: Bench) -> None:
    bench.vsc.enable_message(0x10, False)
    bench.vsc.apply('mode menu')
    bench.wait(lambda: bench.says(bench.mode, 'Menu'), 'Menu')
    cause = bench.vsc.write(VECTORS['joystick'])  # a VSC would not send it
    _, joy = bench.wait(bench.joy_since(cause), 'a Joy')[0]
    assert not any(joy.axes)
    assert not any(joy.buttons)


def test_mode_follows_the_remote_and_is_none_without_a_heartbeat(bench: Bench) -> None:
    for command, mode in (
        ('mode pause', 'Pause'),
        ('mode remote', 'Remote'),
        ('estop remote on', 'Local'),
    ):
        bench.vsc.apply(command)
        bench.wait(lambda mode=mode: bench.says(bench.mode, mode), mode)
    bench.vsc.enable_message(0x20, False)
    bench.wait(lambda: bench.says(bench.mode, 'None'), 'None')


def test_silence_gives_one_neutral_joy_and_then_none(bench: Bench) -> None:
    bench.vsc.apply('stick left_y 1')
    bench.wait(lambda: bench.joy.last.axes[1] == 1.0, 'full deflection')
    bench.vsc.apply('stall on')
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    neutral = bench.wait(lambda: not any(bench.joy.last.axes), 'a neutral Joy')
    assert neutral
    count = len(bench.joy.messages)
    assert any(bench.joy.messages[-2].axes)
    bench.observer.holds_for(lambda: len(bench.joy.messages) == count, 1.0, 'silence')
    bench.vsc.apply('stall off')


def test_nothing_is_known_of_a_vsc_that_was_never_heard(
    observer: Observer, tmp_path: Path
) -> None:
    space = namespace()
    name = f'{space}/{NAME}'
    mode = observer.record(String, f'{name}/mode', latched())
    autonomy = observer.record(String, f'{name}/autonomy_mode', latched())
    strength = observer.record(Int8, f'{name}/radio_strength', latched())
    battery = observer.record(BatteryState, f'{name}/battery', latched())
    records = (mode, autonomy, strength, battery)
    port = {'port': str(tmp_path / 'none')}
    with NodeProcess(f'{NAME}.node', port, namespace=space, patient=True):
        observer.wait_for(lambda: all(record.last for record in records), 15.0, 'all four')
        assert [record.last.data for record in (mode, autonomy, strength)] == ['None', 'None', -1]
        assert not battery.last.present


def test_faulty_stick_makes_joy_neutral_and_is_named(bench: Bench) -> None:
    bench.vsc.apply('stick left_y 1', 'button left_down 1')
    bench.wait(lambda: bench.joy.last.axes[1] == 1.0, 'full deflection')
    bench.vsc.apply('fault right_z error')
    bench.wait(lambda: not any(bench.joy.last.axes) and not any(bench.joy.last.buttons), 'neutral')
    bench.wait(lambda: bench.diagnostics.value(DEVICE, 'faulty controls') != 'none', 'its name')
    status = bench.diagnostics.status(DEVICE)
    assert status.level == DiagnosticStatus.ERROR
    assert 'right_z error' in status.message
    bench.vsc.apply('fault right_z ok')
    bench.wait(lambda: bench.joy.last.axes[1] == 1.0, 'the stick back')


def test_remote_status_becomes_battery_only_while_a_remote_is_connected(bench: Bench) -> None:
    bench.vsc.write(VECTORS['remote status'])
    bench.wait(lambda: bench.battery.last and bench.battery.last.present, 'a battery')
    battery = bench.battery.last
    assert battery.percentage == pytest.approx(0.70)
    assert battery.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_CHARGING
    assert math.isnan(battery.voltage)
    bench.wait(lambda: bench.says(bench.strength, VECTORS['remote status'][6]), 'its strength')
    bench.vsc.apply('estop remote on')  # Local: no remote vouches for it any more
    bench.wait(lambda: not bench.battery.last.present, 'no battery')
    bench.wait(lambda: bench.says(bench.strength, -1), 'no strength')


def test_autonomy_mode_of_the_vsc_is_published(bench: Bench) -> None:
    bench.wait(lambda: bench.says(bench.autonomy, 'User control'), 'its name')
    bench.vsc.simulator.autonomy = 2
    bench.wait(lambda: bench.says(bench.autonomy, 'Autonomous control'), 'its change')


def test_gps_sentence_becomes_fix_and_raw_text(bench: Bench) -> None:
    # 48 deg 7.038 min north, 11 deg 31.000 min east, 545.4 m above a geoid of 46.9 m.
    sentence = '$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47'
    cause = bench.vsc.write(build_frame(0x12, b'\x00' + sentence.encode() + b'\r\n'))
    bench.wait(lambda: sentence in bench.nmea.data, 'the sentence')

    def fixes() -> list[Any]:  # the simulated remote has one of its own
        found = (fix for _, fix in bench.fix.since(cause))
        return [fix for fix in found if fix.latitude == pytest.approx(48.1173)]

    (fix,) = bench.wait(fixes, 'the fix')
    assert fix.longitude == pytest.approx(11.516667)
    assert fix.altitude == pytest.approx(592.3)
    assert fix.status.status == fix.status.STATUS_FIX
    assert fix.header.frame_id == 'remote'


def test_remote_without_gga_has_a_fix_although_another_has_sent_gga(bench: Bench) -> None:
    bench.vsc.enable_message(0x12, False)
    sentences = [
        build_sentence('GPGGA,123519,2100.000,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,'),
        build_sentence('GPRMC,123519,A,2200.000,N,01131.000,E,0,0,230394,,'),  # the same remote's
        build_sentence('GPRMC,123520,A,2300.000,N,01131.000,E,0,0,230394,,'),
        build_sentence('GPRMC,123521,A,2400.000,N,01131.000,E,0,0,230394,,'),
    ]
    frames = (build_frame(0x12, b'\0' + sentence.encode()) for sentence in sentences)
    cause = bench.vsc.write(b''.join(frames))

    def latitudes() -> list[int]:
        found = (round(fix.latitude) for _, fix in bench.fix.since(cause))
        return [latitude for latitude in found if latitude in range(21, 25)]

    bench.wait(lambda: 24 in latitudes(), 'its fix')
    assert latitudes() == [21, 23, 24]


def test_gps_sentence_with_a_bad_checksum_is_shown_and_counted_but_no_fix(bench: Bench) -> None:
    bench.vsc.enable_message(0x12, False)
    before = int(bench.diagnostics.value(DEVICE, 'bad GPS sentences') or 0)
    sentence = build_sentence('GPGGA,,1107.038,N,01131.000,E,1,08,0.9,1.0,M,1.0,M,,')
    wrong = sentence.replace('*', '1*', 1)
    bench.vsc.write(build_frame(0x12, b'\x00' + wrong.encode()))
    bench.wait(lambda: wrong.strip() in bench.nmea.data, 'the sentence')
    bench.wait(
        lambda: int(bench.diagnostics.value(DEVICE, 'bad GPS sentences') or 0) == before + 1,
        'the count',
    )
    assert not any(round(fix.latitude) == 11 for fix in bench.fix.messages)


def test_value_set_in_the_remotes_menu_is_told(bench: Bench) -> None:
    bench.vsc.write(VECTORS['user feedback'])
    bench.wait(lambda: bench.user_values.last is not None, 'a value')
    assert (bench.user_values.last.key, bench.user_values.last.value) == ('3', '-123456')


def test_unknown_message_type_is_counted_and_disturbs_nothing(bench: Bench) -> None:
    bench.vsc.write(build_frame(0x40, b'abc'))
    bench.wait(lambda: int(bench.diagnostics.value(LINK, 'unknown types') or 0) > 0, 'the count')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')


def test_link_lost_and_found_is_told_with_its_reason(bench: Bench) -> None:
    bench.vsc.apply('unplug')
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    bench.wait(
        lambda: str(bench.vsc.path) in bench.diagnostics.status(LINK).message, 'which port', 5.0
    )
    assert bench.diagnostics.status(LINK).level == DiagnosticStatus.ERROR
    before = int(bench.diagnostics.value(LINK, 'reconnects'))
    bench.vsc.apply('plug', 'mode operational')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    bench.wait(
        lambda: int(bench.diagnostics.value(LINK, 'reconnects')) == before + 1, 'the count', 5.0
    )


# To the VSC.


def on_the_wire(bench: Bench, frame: bytes, since: float) -> None:
    def seen() -> bool:
        return frame in b''.join(chunk.data for chunk in bench.vsc.received(since))

    bench.wait(seen, f'{frame.hex(" ")} on the wire')


def test_host_heartbeat_is_sent_all_the_time(bench: Bench) -> None:
    since = time.monotonic()
    on_the_wire(bench, VECTORS['host heartbeat'], since)
    bench.wait(lambda: bench.vsc.simulator.host_heartbeats > 20, 'many')
    assert not bench.vsc.simulator.host_estop


def test_user_value_is_sent_as_the_manual_says(bench: Bench) -> None:
    since = time.monotonic()
    bench.ask(KeyValue, 'set_user_value', KeyValue(key='3', value='-123456'))
    on_the_wire(bench, VECTORS['user feedback'], since)
    bench.wait(lambda: bench.vsc.simulator.values.get(3) == -123456, 'the value in the VSC')


def test_flood_of_values_goes_out_no_faster_than_the_vsc_takes_it(bench: Bench) -> None:
    publisher = bench.observer.publisher(KeyValue, f'{bench.name}/set_user_value')
    since = time.monotonic()
    for number in range(200):
        publisher.publish(KeyValue(key='4', value=str(number)))
        bench.observer.spin()
    bench.wait(lambda: bench.vsc.simulator.values.get(4) == 199, 'the newest value')
    # A busy machine may hand over several at once, but not more than were due by then.
    wire = b''.join(chunk.data for chunk in bench.vsc.received(since))
    assert wire.count(b'\x10\x01\x30') <= (time.monotonic() - since) / 0.05 + 1


def test_names_and_display_text_arrive_line_by_line(bench: Bench) -> None:
    bench.ask(KeyValue, 'set_user_name', KeyValue(key='2', value='BOOM'))
    bench.ask(String, 'display_text', String(data='one\ntwo'))
    bench.wait(lambda: bench.vsc.simulator.names.get(2) == 'BOOM', 'the name')
    names = bench.vsc.simulator.names
    bench.wait(lambda: names.get(90) == 'one' and names.get(91) == 'two', 'two lines')
    bench.wait(lambda: names.get(93) == '', 'two blank lines')
    bench.wait(lambda: bench.vsc.simulator.values.get(99) == 1, 'the text display')


def test_rumble_left_and_right(bench: Bench) -> None:
    rumble = JoyFeedback(type=JoyFeedback.TYPE_RUMBLE, id=1, intensity=1.0)
    bench.ask(JoyFeedback, 'set_feedback', rumble)
    bench.wait(lambda: bench.vsc.simulator.rumbles, 'a rumble')
    assert [side for _, side in bench.vsc.simulator.rumbles] == ['right']


def test_asked_value_is_answered(bench: Bench) -> None:
    bench.user_values.clear()
    bench.ask(UInt8, 'get_user_value', UInt8(data=81))  # Auto Off Enable, 1 as delivered
    bench.wait(lambda: bench.user_values.last is not None, 'an answer')
    assert (bench.user_values.last.key, bench.user_values.last.value) == ('81', '1')


@pytest.mark.parametrize(
    ('kind', 'topic', 'message', 'text'),
    [
        (KeyValue, 'set_user_value', KeyValue(key='3', value='much'), 'whole number'),
        (KeyValue, 'set_user_value', KeyValue(key='three', value='1'), 'whole number'),
        (KeyValue, 'set_user_value', KeyValue(key='13', value='1'), '13'),
        (KeyValue, 'set_user_value', KeyValue(key='81', value='0'), 'configure_device'),
        (KeyValue, 'set_user_name', KeyValue(key='10', value='x'), '10'),
        (KeyValue, 'set_user_name', KeyValue(key='1', value='x' * 21), '20'),
        (KeyValue, 'set_user_name', KeyValue(key='1', value='x' * 1_000_000), 'xxx...xxx'),
        (
            KeyValue,
            'set_user_name',
            KeyValue(key=' ' * 1_000_000 + '1', value='x'),
            'whole number',
        ),
        (KeyValue, 'set_user_name', KeyValue(key='1', value='ü'), 'ASCII'),
        (KeyValue, 'set_user_value', KeyValue(key='1', value='9' * 4000), 'whole number from'),
        (String, 'display_text', String(data='x' * 1_000_000), '1000000 characters'),
        (String, 'display_text', String(data='\n'.join('12345')), 'lines'),
        (String, 'display_text', String(data='grün'), ''),
        (UInt8, 'get_user_value', UInt8(data=200), '200'),
        (JoyFeedback, 'set_feedback', JoyFeedback(type=JoyFeedback.TYPE_LED), 'rumble'),
        (JoyFeedback, 'set_feedback', JoyFeedback(type=1, id=2, intensity=1.0), '2'),
        (JoyFeedback, 'set_feedback', JoyFeedback(type=1, intensity=math.nan), 'intensity'),
    ],
)
def test_request_that_makes_no_sense_is_counted_and_explained(
    bench: Bench, kind: Any, topic: str, message: Any, text: str
) -> None:
    before = int(bench.diagnostics.value(LINK, 'refused requests') or 0)
    bench.ask(kind, topic, message)
    bench.wait(
        lambda: int(bench.diagnostics.value(LINK, 'refused requests') or 0) == before + 1,
        f'the count; {bench.diagnostics.value(LINK, "last refusal")}',
        5.0,
    )
    assert text in bench.diagnostics.value(LINK, 'last refusal')
    assert len(bench.diagnostics.value(LINK, 'last refusal')) < 1000
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    assert bench.vsc.simulator.eeprom_writes == 0


# The software e-stop changes the node for good, so each has one of its own.


@pytest.fixture
def fresh(tmp_path: Path) -> Iterator[Bench]:
    with Observer() as observer:
        result = Bench(tmp_path, observer, software_estop_timeout=OUTLASTS_GAPS)
        result.start_anew()
        yield result
        result.close()


def test_software_estop_stops_the_vsc_and_is_told_as_an_echo(fresh: Bench) -> None:
    talker = Talker(fresh.observer, Bool, f'{fresh.name}/software_estop', Bool(data=False))
    fresh.wait(
        lambda: fresh.diagnostics.value(DEVICE, 'software e-stop in use') == 'true', 'in use'
    )
    fresh.wait(lambda: fresh.says(fresh.estop, False), 'no stop')
    talker.message = Bool(data=True)
    fresh.wait(lambda: fresh.vsc.simulator.host_estop, 'a stop in our heartbeat')
    fresh.wait(lambda: fresh.says(fresh.estop, True), 'the stop of the VSC')
    fresh.wait(lambda: fresh.says(fresh.own_estop, False), 'an echo, and nothing else')
    talker.message = Bool(data=False)
    fresh.wait(lambda: not fresh.vsc.simulator.host_estop, 'no stop in our heartbeat')
    fresh.vsc.apply('ack', 'mode operational')
    fresh.wait(lambda: fresh.says(fresh.estop, False), 'no stop')
    talker.pause()  # once in use, silence is a stop
    fresh.wait(lambda: fresh.vsc.simulator.host_estop, 'a stop in our heartbeat')


def test_second_publisher_of_the_software_estop_undoes_no_stop(fresh: Bench) -> None:
    topic = f'{fresh.name}/software_estop'
    first = Talker(fresh.observer, Bool, topic, Bool(data=True), rate=20.0)
    Talker(fresh.observer, Bool, topic, Bool(data=False), rate=20.0)
    doubled = f'stop one of the two publishers of {topic}'

    def message() -> str:
        status = fresh.diagnostics.status(DEVICE)
        return '' if status is None else str(status.message)

    fresh.wait(lambda: doubled in message(), 'why')
    before = fresh.vsc.simulator.host_heartbeats  # the wire may be behind the diagnostics
    fresh.wait(lambda: fresh.vsc.simulator.host_heartbeats > before + 10, 'heartbeats')
    since = time.monotonic()
    fresh.observer.holds_for(lambda: fresh.vsc.simulator.host_estop, 0.5, 'the stop')
    assert build_frame(0x21, b'\0') not in b''.join(c.data for c in fresh.vsc.received(since))
    first.leave()
    fresh.wait(lambda: doubled not in message(), 'only one again')
    fresh.wait(lambda: not fresh.vsc.simulator.host_estop, 'no stop in our heartbeat')


def test_software_estop_that_can_never_be_heard_is_a_stop(fresh: Bench) -> None:
    """Such as of a panel that publishes best effort: its stop would be lost without a word."""
    topic = f'{fresh.name}/software_estop'
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    panel = Talker(fresh.observer, Bool, topic, Bool(data=True), qos=qos)

    def message() -> str:
        status = fresh.diagnostics.status(DEVICE)
        return '' if status is None else str(status.message)

    fresh.wait(lambda: fresh.vsc.simulator.host_estop, 'a stop')
    fresh.wait(lambda: f'publishes {topic} best effort: make it reliable' in message(), 'why')
    Talker(fresh.observer, Bool, topic, Bool(data=False), rate=20.0)
    fresh.observer.holds_for(lambda: fresh.vsc.simulator.host_estop, 1.5, 'the stop')
    panel.leave()
    fresh.wait(lambda: not fresh.vsc.simulator.host_estop, 'no stop in our heartbeat')


def test_topic_of_a_publisher_that_was_never_heard_is_not_in_use_once_it_has_gone(
    fresh: Bench,
) -> None:
    topic = f'{fresh.name}/software_estop'
    panel = Talker(fresh.observer, String, topic, String(data='true'))
    fresh.wait(lambda: fresh.vsc.simulator.host_estop, 'a stop')
    assert fresh.observer.change_state(fresh.name, 'deactivate')
    before = fresh.vsc.simulator.host_heartbeats
    assert fresh.observer.change_state(fresh.name, 'activate')
    fresh.wait(lambda: fresh.vsc.simulator.host_heartbeats > before + 10, 'heartbeats')
    assert fresh.vsc.simulator.host_estop
    panel.leave()
    fresh.wait(lambda: not fresh.vsc.simulator.host_estop, 'no stop in our heartbeat')
    fresh.wait(
        lambda: fresh.diagnostics.value(DEVICE, 'software e-stop in use') == 'false', 'not in use'
    )


def test_activation_undoes_no_stop_of_a_publisher_that_is_gone(fresh: Bench) -> None:
    talker = Talker(fresh.observer, Bool, f'{fresh.name}/software_estop', Bool(data=False))
    fresh.wait(
        lambda: fresh.diagnostics.value(DEVICE, 'software e-stop in use') == 'true', 'in use'
    )
    talker.leave()
    fresh.wait(lambda: fresh.vsc.simulator.host_estop, 'the stop of silence')
    assert fresh.observer.change_state(fresh.name, 'deactivate')
    since = time.monotonic()
    before = fresh.vsc.simulator.host_heartbeats
    assert fresh.observer.change_state(fresh.name, 'activate')
    fresh.wait(lambda: fresh.vsc.simulator.host_heartbeats > before + 10, 'heartbeats')
    assert fresh.vsc.simulator.host_estop
    assert build_frame(0x21, b'\0') not in b''.join(c.data for c in fresh.vsc.received(since))


def test_software_estop_in_use_is_a_stop_when_the_node_ends(fresh: Bench) -> None:
    Talker(fresh.observer, Bool, f'{fresh.name}/software_estop', Bool(data=False))
    fresh.wait(
        lambda: fresh.diagnostics.value(DEVICE, 'software e-stop in use') == 'true', 'in use'
    )
    since = time.monotonic()
    fresh.node.signal(SIGTERM)
    fresh.wait(lambda: fresh.node.process.poll() is not None, 'its end')
    assert fresh.node.process.returncode == 0

    def heard() -> bytes:
        return b''.join(c.data for c in fresh.vsc.received(since))

    fresh.wait(lambda: heard().endswith(HOST_HEARTBEAT_STOP), 'its last words')


def test_node_that_is_no_part_of_the_stop_chain_does_not_trip_it_by_ending(fresh: Bench) -> None:
    assert fresh.node.end(SIGTERM) == 0
    fresh.wait(lambda: fresh.says(fresh.estop, True), 'its own last stop')
    assert not fresh.vsc.simulator.host_estop
    assert HOST_HEARTBEAT_STOP not in b''.join(c.data for c in fresh.vsc.received())


# Variants of the parameters.


def test_required_software_estop_stops_the_vsc_until_it_is_heard(
    tmp_path: Path, observer: Observer
) -> None:
    bench = Bench(
        tmp_path,
        observer,
        require_software_estop=True,
        software_estop_timeout=OUTLASTS_GAPS,
    )
    try:
        bench.wait(lambda: bench.vsc.simulator.host_heartbeats > 10, 'heartbeats')
        assert bench.vsc.simulator.host_estop
        wire = b''.join(chunk.data for chunk in bench.vsc.received())
        assert build_frame(0x21, b'\0') not in wire
        bench.wait(lambda: bench.says(bench.own_estop, False), 'an echo, and nothing else')
        assert bench.says(bench.estop, True)
        Talker(observer, Bool, f'{bench.name}/software_estop', Bool(data=False))
        bench.wait(lambda: not bench.vsc.simulator.host_estop, 'no stop in our heartbeat')
        bench.vsc.apply('ack', 'mode operational')
        bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    finally:
        bench.close()


def test_stop_pressed_and_released_while_the_node_is_frozen_is_published(
    tmp_path: Path, observer: Observer
) -> None:
    """No freeze here is long enough for a timeout; of some the backlog is read, of some not."""
    bench = Bench(tmp_path, observer, patient=False, link_timeout=5.0)
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
            bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    finally:
        bench.node.signal(SIGCONT)
        bench.close()


def test_tolerated_fault_leaves_the_sound_controls(tmp_path: Path, observer: Observer) -> None:
    bench = Bench(tmp_path, observer, tolerate_faulty_axes=True, axis_full_scale=800, deadband=0.2)
    try:
        bench.start_anew()
        bench.vsc.apply('stick left_y 0.5', 'stick left_x 0.1', 'fault right_z unavailable')
        bench.wait(lambda: any(bench.joy.last.axes), 'a deflection')
        # round(0.5 * 1023) = 512 of 800, less a dead band of 0.2; 102 of 800 is within it.
        expected = (512 / 800 - 0.2) / 0.8
        assert list(bench.joy.last.axes) == pytest.approx([0.0, expected, 0.0, 0.0, 0.0, 0.0])
        bench.wait(
            lambda: 'right_z unavailable' in bench.diagnostics.value(DEVICE, 'faulty controls'),
            'its name',
        )
    finally:
        bench.close()


def test_lifecycle_manager_opens_and_closes_the_port(tmp_path: Path, observer: Observer) -> None:
    bench = Bench(tmp_path, observer, autostart=False)
    try:
        bench.vsc.apply('mode operational')
        bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
        assert not bench.vsc.received()
        assert observer.state(bench.name) == 'unconfigured'
        assert observer.change_state(bench.name, 'configure')
        assert not bench.vsc.received()
        assert observer.change_state(bench.name, 'activate')
        bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
        assert observer.change_state(bench.name, 'deactivate')
        bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
        # The device may be held up, and read late what came before.
        bench.vsc.call(lambda *_: bench.vsc._read())
        moment = time.monotonic()
        observer.holds_for(lambda: not bench.vsc.received(moment), 0.3, 'a silent wire')
        observer.holds_for(lambda: bench.says(bench.estop, True), 0.1, 'a stop, repeated')
        bench.wait(lambda: list(bench.estop.since(moment)), 'it, repeated')
        assert observer.change_state(bench.name, 'activate')
        bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    finally:
        bench.close()


def test_paused_simulated_time_changes_no_stop_and_no_stick(
    tmp_path: Path, observer: Observer
) -> None:
    bench = Bench(tmp_path, observer, use_sim_time=True)  # and nobody publishes /clock
    try:
        bench.start_anew()
        bench.vsc.apply('stick left_y 1')
        bench.wait(lambda: bench.joy.last.axes[1] == 1.0, 'full deflection')
        assert bench.joy.last.header.stamp.sec == 0
        bench.vsc.enable_message(0x20, False)
        bench.wait(lambda: bench.says(bench.estop, True), 'a stop', 2.0)
    finally:
        bench.close()
