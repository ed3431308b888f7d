# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recorder's parts, without a node: ring, schedule, reasons, files and their folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import errno
import os
from pathlib import Path
import threading
import time
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest
from rcl_interfaces.msg import ListParametersResult, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from bridge_core import clock
from bridge_core.fingerprint import fingerprint
from bridge_core.parameter_files import check_names
from bridge_core.parameters import ParameterError
from rugged_teleop.ledger.book import Book
from rugged_teleop.ledger.facts import Facts
from rugged_teleop.ledger.stopping import Trend
from rugged_teleop.reasons import catalogue
from rugged_teleop.recorder.asked import AskedParameters
from rugged_teleop.recorder.definitions import definition_of, message_class
from rugged_teleop.recorder.folder import file_name, Folder
from rugged_teleop.recorder.node import _curves, Recorder
from rugged_teleop.recorder.ring import Channel, Heard, Ring
from rugged_teleop.recorder.triggers import Nodes, Schedule, Triggers
from rugged_teleop.recorder.writer import FileWriter, RecordingFile
from rugged_teleop.recordings import read, Said
from rugged_teleop.stack import BESIDE, configured_nodes, NODES
from safety_mux.node import SafetyMux
from stage.rig import NodeProcess, own_domain, wait_for

BOOL = Channel('/mux/estop', 'std_msgs/msg/Bool', definition_of('std_msgs/msg/Bool'))
JOINTS = Channel(
    '/drive/joint_states',
    'sensor_msgs/msg/JointState',
    definition_of('sensor_msgs/msg/JointState'),
)
MUX, VSC = '/safety_mux', '/left/fort_vsc_bridge'


def heard(at: float, size: int = 8) -> Heard:
    return Heard(at, at, BOOL, bytes(size))


# The ring.


def test_newest_of_a_latched_topic_is_kept_however_old() -> None:
    ring, channel = Ring(60.0, 1_000_000), BOOL._replace(topic='/drive/link_up', latched=True)
    for second in (0.0, 1.0):
        ring.add(Heard(second, second, channel, b'up'))
    for second in range(2, 100):
        ring.add(heard(float(second)))
    assert ring.messages()[:2] == [Heard(39.0, 1.0, channel, b'up'), heard(39.0)]


def test_flood_takes_no_more_memory_than_allowed() -> None:
    ring = Ring(60.0, 100_000)
    for number in range(1000):
        ring.add(heard(number * 1e-4, 1000))
        assert ring.size <= 100_000
    assert len(ring) == 83
    ring.clear()
    assert (len(ring), ring.size) == (0, 0)


# The schedule.


def run_schedule(asked: dict[float, str], until: float) -> list[tuple[float, float]]:
    """Return when recordings begin and end, in whole seconds, with what is asked when."""
    schedule, found, begun = Schedule(after=10.0, period=60.0), [], 0.0
    for second in range(int(until)):
        now = float(second)
        if now in asked:
            schedule.ask(asked[now], now, at_once=asked[now] == 'save')
        if schedule.may_end(now):
            schedule.ended(now)
            found.append((begun, now))
        if schedule.may_begin(now):
            schedule.begin(now)
            begun = now
    return found


@pytest.mark.parametrize(
    ('asked', 'recorded'),
    [
        (dict.fromkeys(map(float, range(5, 200)), 'stop'), [5, 65, 65, 125, 125, 185, 185, 209]),
        ({5.0: 'stop', 30.0: 'stop'}, [5, 15, 65, 66]),
        ({5.0: 'stop', 14.0: 'fault'}, [5, 24]),
        ({5.0: 'stop', 30.0: 'save'}, [5, 15, 30, 40]),
    ],
    ids=['a storm gives one a minute', 'soon after one', 'during one', 'save waits for nothing'],
)
def test_schedule_of_recordings(asked: dict[float, str], recorded: list[float]) -> None:
    assert [each for span in run_schedule(asked, 300.0) for each in span] == recorded


def test_stop_names_the_recording_whatever_was_heard_before_it() -> None:
    schedule = Schedule(after=10.0, period=60.0)
    for reason in ('save', 'fault_drive: link', 'stop', 'trip'):
        schedule.ask(reason, 0.0)
    assert schedule.reason == 'stop'


# The reasons.


def reasons(nodes: Nodes) -> Triggers:
    found = Triggers(lambda kind, data: deserialize_message(data, message_class(kind)))
    found.know(nodes)
    return found


def estop(data: bool) -> bytes:
    return bytes(serialize_message(Bool(data=data)))


def test_stop_of_the_mux_is_a_reason_but_no_stop_that_was_there_before() -> None:
    found = reasons(Nodes((VSC, MUX), (MUX,)))
    told = [
        found.reason_of(f'{MUX}/estop', estop(stop)) for stop in (True, True, False, True, True)
    ]
    assert told == ['', '', '', 'stop', '']
    # Of a bridge it is none: the mux says which of them stop the machine.
    assert [found.reason_of(f'{VSC}/estop', estop(stop)) for stop in (False, True)] == ['', '']


def test_stop_of_a_bridge_is_a_reason_where_there_is_no_mux() -> None:
    found = reasons(Nodes((VSC,)))
    told = [found.reason_of(f'{VSC}/estop', estop(stop)) for stop in (False, True)]
    assert told == ['', 'stop_left/fort_vsc_bridge']


def test_fault_is_a_reason_once_and_those_of_strangers_are_none() -> None:
    found = reasons(Nodes((VSC,)))

    def told(name: str, level: bytes) -> str:
        status = DiagnosticStatus(name=name, level=level)
        return found.reason_of('/diagnostics', serialize_message(DiagnosticArray(status=[status])))

    levels = (DiagnosticStatus.ERROR, DiagnosticStatus.OK, DiagnosticStatus.ERROR)
    name = 'left/fort_vsc_bridge: device'
    assert [told(name, level) for level in levels] == ['', '', f'fault_{name}']
    assert [told('camera: image', level) for level in levels] == ['', '', '']


def status_of(by: str, tripped: str = 'false') -> bytes:
    values = [KeyValue(key='trip active', value=tripped), KeyValue(key='stopped by', value=by)]
    return bytes(serialize_message(DiagnosticStatus(values=values)))


def test_trip_is_a_reason_though_the_machine_is_stopped_already() -> None:
    found = reasons(Nodes((MUX,), (MUX,)))
    assert not found.reason_of(f'{MUX}/status', status_of("operator 'fort'"))
    assert found.reason_of(f'{MUX}/status', status_of('trip', 'true')) == 'trip'


def test_stop_is_named_by_the_mux_that_stopped_and_by_that_stop() -> None:
    other = '/right/safety_mux'
    found = reasons(Nodes((MUX, other), (MUX, other)))

    def stop(mux: str) -> None:
        assert not found.reason_of(f'{mux}/estop', estop(False))
        assert found.reason_of(f'{mux}/estop', estop(True)) == 'stop'

    stop(MUX)
    found.reason_of(f'{MUX}/status', status_of('trip'))
    found.reason_of(f'{MUX}/status', status_of('none'))  # it was reset
    assert found.stopped_by == 'trip'
    stop(other)
    found.reason_of(f'{MUX}/status', status_of('trip'))
    assert found.stopped_by == '', 'not what the other one was stopped by'
    found.reason_of(f'{other}/status', status_of("operator 'fort'"))
    assert found.stopped_by == "operator 'fort'"
    stop(MUX)  # as its process ended; the next one knows of no cause
    found.reason_of(f'{MUX}/status', status_of('none'))
    assert found.stopped_by == ''


# The parameters.


class Foreign:
    """Creates clients of a node with such parameters, which answer at once: ``values``."""

    def __init__(self, *values: ParameterValue, names: Sequence[str] = ('a', 'b')) -> None:
        result = ListParametersResult(names=names)
        self._answers: dict[type, Any] = {ListParameters: ListParameters.Response(result=result)}
        self.answer(*values)

    def answer(self, *values: ParameterValue) -> None:
        """Answer this from now on."""
        self._answers[GetParameters] = GetParameters.Response(values=values)

    def create_client(self, kind: type, name: str) -> Any:
        future = Future()
        future.set_result(self._answers[kind])
        return SimpleNamespace(service_is_ready=lambda: True, call_async=lambda _: future)

    def destroy_client(self, client: Any) -> None:
        pass


ONE = ParameterValue(type=Parameter.Type.INTEGER.value, integer_value=1)


@pytest.mark.parametrize(
    ('values', 'known'),
    [
        ((ONE, ParameterValue()), {'a': '1', 'b': 'null'}),
        ((), {}),
        ((ONE,), {}),
        ((ONE, ParameterValue(type=99)), {}),
    ],
    ids=['all', 'none', 'too few', 'of an unknown type'],
)
def test_node_that_answers_wrongly_has_no_parameters(
    values: tuple[ParameterValue, ...], known: dict[str, str]
) -> None:
    asked = AskedParameters(Foreign(*values))
    for now in (0.0, 0.5):
        asked.look({'/plc': set()}, now)
    assert asked.known == {'/plc': known}


def test_node_that_was_killed_and_is_back_is_asked_anew_though_it_was_never_missed() -> None:
    foreign = Foreign(ONE, names=['a'])
    asked = AskedParameters(foreign)
    for now in (0.0, 0.5):
        asked.look({'/plc': {b'1'}}, now)
    assert asked.known == {'/plc': {'a': '1'}}
    foreign.answer(ParameterValue())
    asked.look({'/plc': {b'1', b'2'}}, 1.0)
    assert asked.known == {}
    asked.look({'/plc': {b'2'}}, 1.5)
    assert asked.known == {'/plc': {'a': 'null'}}


def test_ledger_has_the_fingerprint_of_a_commissioning_report(context: Any) -> None:
    node = SafetyMux(context=context, parameter_overrides=[Parameter('rate', value=50.0)])
    names = node.list_parameters([], 0).names
    values = [node.get_parameter(name).get_parameter_value() for name in names]
    asked = AskedParameters(Foreign(*values, names=names))
    for now in (0.0, 0.5):
        asked.look({MUX: set()}, now)
    expected = {MUX: node.values}
    node.destroy_node()
    facts = Facts()
    tuple(facts.of_nodes([MUX, '/drive']))
    ((_, first),) = facts.of_parameters(asked.known)
    both = {**asked.known, '/drive': {'port': '"a"'}}
    ((_, second),) = facts.of_parameters(both)
    assert first['sha256'] == first['all'] == fingerprint(expected)
    assert second['sha256'] == fingerprint({'/drive': {'port': 'a'}})
    assert second['all'] == fingerprint({**expected, '/drive': {'port': 'a'}})
    tuple(facts.of_nodes(['/drive']))  # the mux has left
    ((_, third),) = facts.of_parameters({**both, '/drive': {'port': '"b"'}})
    assert third['all'] == third['sha256'] != second['sha256']


# The files.


def test_definition_has_every_type_within_once() -> None:
    text = definition_of('sensor_msgs/msg/Joy')
    assert [line for line in text.splitlines() if line.startswith('MSG: ')] == [
        'MSG: std_msgs/Header',
        'MSG: builtin_interfaces/Time',
    ]
    with pytest.raises(LookupError, match='no_msgs/msg/Nothing is not installed'):
        definition_of('no_msgs/msg/Nothing')


def test_names_sort_by_time_and_say_why() -> None:
    names = [file_name(0.25, "stop_e-stop source 'fort'"), file_name(1e9, 'save')]
    assert names == [
        '19700101T000000.250Z_stop_e-stop-source-fort.mcap',
        '20010909T014640.000Z_save.mcap',
    ]


def test_oldest_go_first_and_nothing_that_is_not_ours(tmp_path: Path) -> None:
    (tmp_path / 'notes.txt').write_bytes(bytes(1000))
    names = [file_name(float(second), 'stop') for second in range(5)]
    names[0] += '.part'  # it was never finished
    for name in names:
        (tmp_path / name).write_bytes(bytes(100))
    assert Folder(tmp_path, 1000, 4).make_room() == [tmp_path / names[0]]
    assert Folder(tmp_path, 250, 4).make_room() == [tmp_path / name for name in names[1:3]]
    assert Folder(tmp_path, 50, 4).make_room() == [tmp_path / names[3]]  # never the newest
    assert sorted(path.name for path in tmp_path.iterdir()) == [names[4], 'notes.txt']


@pytest.mark.parametrize(
    ('files', 'quota', 'left'),
    [
        (4, 1000, ['save', 'stop_a', 'fault_c', 'fault_d']),
        (3, 1000, ['save', 'stop_a', 'fault_d']),
        (9, 250, ['stop_a', 'fault_d']),
        (1, 50, ['fault_d']),
    ],
)
def test_faults_go_before_what_somebody_did(
    tmp_path: Path, files: int, quota: int, left: list[str]
) -> None:
    reasons = ['save', 'fault_b', 'stop_a', 'fault_c', 'fault_d']
    for second, reason in enumerate(reasons):
        (tmp_path / file_name(float(second), reason)).write_bytes(bytes(100))
    folder = Folder(tmp_path, quota, files)
    folder.make_room()
    kept = [path.stem.partition('Z_')[2] for path in folder.recordings()]
    assert kept == left


def test_kept_recording_stays_and_no_longer_counts(tmp_path: Path) -> None:
    folder = Folder(tmp_path, 50, 1)
    for second in range(2):
        (tmp_path / file_name(float(second), 'stop')).write_bytes(bytes(100))
    kept = folder.keep(folder.recordings()[0])
    assert folder.make_room() == []
    assert kept.stat().st_size == 100


class Bench:
    """A writer, and what it has said."""

    def __init__(self, path: Path) -> None:
        self.said: list[str] = []
        self.writer = FileWriter(Folder(path, 1_000_000, 10), lambda text, _: self.say(text))

    def say(self, text: str) -> None:
        self.said.append(text)

    def record(self) -> None:
        now = clock.now()
        joints = JointState(name=['left'], velocity=[1.5])
        joints.header.frame_id = 'base'
        before = [Heard(now - 2.0, now - 2.1, BOOL, estop(True))]
        parameters = {'/safety_mux': {'rate': '100.0'}}
        self.writer.begin('stop', parameters, before)
        self.writer.add([Heard(now, now, JOINTS, serialize_message(joints))])
        late = {'/safety_mux': {'rate': '50.0'}, '/drive': {'axes': '1'}}  # known by the end
        self.writer.finish('stop_trip', parameters | late)

    def wait(self, *beginnings: str) -> None:
        wait_for(lambda: len(self.said) >= len(beginnings), what=lambda: str(self.said))
        assert all(map(str.startswith, self.said, beginnings)), self.said


@pytest.fixture
def make_bench(tmp_path: Path) -> Any:
    benches: list[Bench] = []

    def make(path: Path) -> Bench:
        benches.append(Bench(path))
        return benches[-1]

    yield make
    for bench in benches:
        bench.writer.stop(5.0)


def test_file_is_read_back_by_the_readers_of_mcap(
    tmp_path: Path, make_bench: Callable[[Path], Bench]
) -> None:
    bench = make_bench(tmp_path / 'new')
    bench.record()
    bench.wait('recorded ')
    (path,) = (tmp_path / 'new').iterdir()
    assert path.name.endswith('Z_stop_trip.mcap')
    assert not (path.stat().st_mode | path.parent.stat().st_mode) & 0o027  # for owner and group
    with path.open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == 'ros2'
        (_, _, first, stop), (_, channel, second, joints) = reader.iter_decoded_messages()
        metadata = {each.name: each.metadata for each in reader.iter_metadata()}
    assert stop.data is True
    assert (channel.topic, joints.header.frame_id) == ('/drive/joint_states', 'base')
    assert (list(joints.name), list(joints.velocity)) == (['left'], [1.5])
    assert second.log_time - first.log_time == pytest.approx(2e9, abs=1e4)
    assert first.log_time - first.publish_time == pytest.approx(1e8, abs=1e4)
    assert metadata == {
        'parameters of /safety_mux': {'rate': '100.0'},
        'parameters of /drive': {'axes': '1'},
        'recording': {'reason': 'stop_trip'},
    }


def test_recording_of_a_computer_whose_clock_is_late_is_not_the_first_to_go(
    tmp_path: Path, make_bench: Callable[[Path], Bench]
) -> None:
    for second in range(11):  # one more than there may be
        (tmp_path / file_name(4e9 + second, 'stop')).write_bytes(b'x')
    make_bench(tmp_path).record()
    wait_for(lambda: [*tmp_path.glob('*_stop_trip.mcap')], what='the recording')
    wait_for(lambda: len([*tmp_path.iterdir()]) == 10, what='room')
    assert [*tmp_path.glob('*_stop_trip.mcap')]


def test_what_was_heard_is_on_the_disk_before_the_recording_ends(
    tmp_path: Path, make_bench: Callable[[Path], Bench]
) -> None:
    def count() -> int:
        paths = [*tmp_path.iterdir()]
        if not paths:
            return 0
        with paths[0].open('rb') as file:
            return sum(isinstance(each, Said) for each in read(file))

    writer, now = make_bench(tmp_path).writer, clock.now()
    stop = [Heard(now, now, BOOL, estop(True))]
    writer.begin('stop', {}, stop)
    wait_for(lambda: count() == 1, what='the stop')
    writer.add(stop)
    wait_for(lambda: count() == 2, what='what came after it')


def test_full_disk_is_said_and_the_next_recording_tried(
    tmp_path: Path, make_bench: Callable[[Path], Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: RecordingFile) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    bench = make_bench(tmp_path)
    with monkeypatch.context() as full:
        full.setattr(RecordingFile, 'flush', fail)
        bench.record()
        bench.wait('no recording: No space left on device')
    assert bench.writer.error.startswith('No space left on device')
    bench.record()
    bench.wait('no recording', 'recorded ')
    assert bench.writer.error == ''


def test_disk_that_hangs_costs_messages_but_no_memory_and_no_recording(
    tmp_path: Path, make_bench: Callable[[Path], Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench(tmp_path)
    hang = threading.Event()
    monkeypatch.setattr(RecordingFile, 'flush', lambda _: hang.wait(20.0))
    bench.writer.begin('stop', {}, [])
    for _ in range(1000):
        bench.writer.add([heard(0.0), heard(0.0)])
    bench.writer.finish('stop', {})
    hang.set()
    bench.wait('recorded ')
    assert 0 < bench.writer.dropped < 2000


# The node.


def test_stop_is_not_recorded_again_when_the_node_is_activated_again(
    context: Any, tmp_path: Path
) -> None:
    values = {'folder': str(tmp_path), 'autostart': False}
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    node = Recorder(context=context, parameter_overrides=overrides)
    node.trigger_configure()
    node.trigger_activate()
    now = clock.now()
    node.lane.call(node._schedule.ask, 'stop', now)
    node.lane.call(node._step, now)
    node.trigger_deactivate()
    node.trigger_activate()
    node.lane.call(node._step, now + 100.0)
    node.shut_down()
    node.destroy_node()
    assert len([*tmp_path.glob('*.mcap')]) == 1


def test_stop_soon_after_a_recording_that_failed_is_recorded(
    context: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = {'folder': str(tmp_path), 'seconds': 5.0, 'after': 1.5, 'period': 3.0}
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    node = Recorder(context=context, parameter_overrides=overrides)
    node.trigger_configure()
    node.trigger_activate()
    with monkeypatch.context() as full:
        full.setattr(RecordingFile, 'flush', lambda _: os.write(-1, b''))
        node.lane.call(node._schedule.ask, 'stop', clock.now())
        wait_for(lambda: bool(node._writer.error), what='an error')
    time.sleep(0.3)  # it would have gone on
    node.lane.call(node._schedule.ask, 'stop', clock.now())
    wait_for(lambda: [*tmp_path.glob('*_stop.mcap*')], what='a recording of the second')
    node.shut_down()
    node.destroy_node()


@pytest.mark.parametrize(
    ('file', 'text'),
    [('none', 'No such file'), ('[', 'Expecting value'), ('{}', 'stopping: ')],
)
def test_report_that_is_none_stops_the_node(tmp_path: Path, file: str, text: str) -> None:
    if file != 'none':
        (tmp_path / 'report.json').write_text(file, encoding='utf-8')
    with pytest.raises(ParameterError, match=f'parameter commissioning.report = .*{text}'):
        _curves(str(tmp_path))


ANSWERS = [  # the service, what is wrong, and the code
    ('save', {}, ''),
    ('save', {'saves': TimeoutError('it hangs')}, 'recorder.hangs'),
    ('save', {'active': False}, 'node.inactive'),
    ('save', {'slow': True}, 'recorder.slow'),
    ('save', {'error': 'File too large'}, 'recorder.failed'),
    ('keep', {}, ''),
    ('keep', {'slow': True}, 'recorder.slow'),
    ('keep', {'names': []}, 'recorder.none'),
]


@pytest.mark.parametrize(('service', 'wrong', 'code'), ANSWERS)
def test_answer_of_a_service_that_failed_ends_with_its_code(
    service: str, wrong: dict[str, Any], code: str
) -> None:
    def call(function: Any) -> Any:
        if 'saves' in wrong:
            raise wrong['saves']
        return function()

    node: Any = SimpleNamespace(
        active=wrong.get('active', True),
        folder=SimpleNamespace(path=Path()),
        lane=SimpleNamespace(call=call),
        _writer=SimpleNamespace(
            error=wrong.get('error', ''),
            wait=lambda _: not wrong.get('slow'),
            keep=lambda tell: [tell(name) for name in wrong.get('names', ['a'])],
        ),
        _schedule=SimpleNamespace(
            ask=lambda *_, **__: None, may_begin=lambda _: False, after=1.0, is_open=True
        ),
    )
    node._save = lambda: Recorder._save(node)
    answer = getattr(Recorder, f'_on_{service}')(node, Trigger.Request(), Trigger.Response())
    assert answer.success is not bool(code)
    assert answer.message.endswith(f' [{code}]' if code else ('more', 'count'))
    assert not code or code in catalogue()


def test_status_says_what_is_wrong_with_the_ledger_or_the_brakes() -> None:
    ledger = SimpleNamespace(error='', lost=0, anchor=SimpleNamespace(error=''), book=Book(Path()))
    trend, late = Trend({}, 0.25), list[str]()
    tried = SimpleNamespace(overdue=lambda _: late, said=lambda _: ['fort 25 h ago'])
    node: Any = SimpleNamespace(
        _ledger=ledger,
        _witness=SimpleNamespace(trend=trend, last_stop='', tried=tried),
    )

    def said() -> str:
        status = Recorder._ledger_status(node)
        return f'{status.level.name} {status.message}'

    assert said() == 'OK ok'
    ledger.anchor.error = 'No such file'
    assert said() == 'WARN correct ledger.anchor: No such file'
    late.append('fort 25 h ago')
    anchor = '; correct ledger.anchor: No such file'
    assert said().endswith(f'last seen to work: fort 25 h ago{anchor}')
    trend.judge('left', 10.0, 0.62)
    trend.judge('left', 9.0, None)
    values = Recorder._ledger_status(node).values
    assert values['last seen to work'] == 'fort 25 h ago'
    assert values['stops of left (rad/s, s, commissioned s)'] == '10.00 0.62 -; 9.00 - -'
    trend.warnings['left'] = 'left: 0.62 s'
    assert 'they stop slower than commissioned: left: 0.62 s; press' in said()
    late.clear()
    trend.warnings.clear()
    ledger.anchor.error = ''
    ledger.lost = 3
    assert said() == 'WARN make room: some lines are lost for ever'
    ledger.error = 'No space left on device'
    lost = '; make room: some lines are lost for ever'
    assert said() == f'ERROR make room or correct ledger.file: No space left on device{lost}'
    reasons = Recorder._ledger_status(node).reasons
    assert [each.code for each in reasons] == ['recorder.ledger.failed', 'recorder.ledger.lost']


def test_recorder_without_mcap_is_one_line_and_status_2_even_for_its_help() -> None:
    own_domain()
    source = 'import sys; sys.modules["mcap.writer"] = None; sys.argv[1:] = ["--help"]\n'
    source += 'from rugged_teleop.recorder.node import main; main()'
    with NodeProcess(source=source) as node:
        assert node.wait() == 2
        assert 'the recorder needs pip install mcap' in node.output
        assert node.output.count('\n') == 1


def test_section_of_the_recorder_is_no_fault_of_the_stack(tmp_path: Path) -> None:
    file = tmp_path / 'all.yaml'
    file.write_text('/**/safety_mux: {ros__parameters: {}}\n/**/recorder: {ros__parameters: {}}\n')
    check_names((*NODES, *BESIDE), [file])
    assert configured_nodes(['stack', '--params-file', str(file)]) == ['safety_mux']
