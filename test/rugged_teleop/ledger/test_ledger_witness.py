# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is heard becomes lines of the ledger; its thread, and the command that reads it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import errno
import os
from pathlib import Path
import threading
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from lifecycle_msgs.msg import State, TransitionEvent
import pytest
from rcl_interfaces.msg import Log, Parameter, ParameterEvent, ParameterValue
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String

from bridge_core.reasons import Coded, to_values
from rugged_teleop.ledger import main as command
from rugged_teleop.ledger.book import Book, lines, now
from rugged_teleop.ledger.chain import Head, Reader
from rugged_teleop.ledger.stopping import Trend
from rugged_teleop.ledger.tried import Tried
from rugged_teleop.ledger.witness import Witness
from rugged_teleop.ledger.writer import Anchor, LedgerWriter
from rugged_teleop.recorder.definitions import message_class
from safety_mux.reasons import REASONS
from stage.rig import wait_for

MUX, DRIVE, NODES = '/safety_mux', '/esi_drive_bridge', ('/esi_drive_bridge', '/safety_mux')


class Listening:
    """A witness, and what it has noted."""

    def __init__(self, written: Any = ()) -> None:
        self.lines: list[tuple[str, dict[str, Any]]] = []
        trend = Trend({'left': [(10.0, 0.4)]}, 0.25)
        self.witness = Witness(
            lambda kind, data: deserialize_message(data, message_class(kind)),
            lambda what, **facts: self.lines.append((what, facts)),
            written,
            trend,
            Tried(24.0, ['esi_drive_bridge'], written),
        )
        self.witness.know(NODES, (MUX,), {})
        self.lines.clear()

    def hear(self, topic: str, message: Any, at: float = 0.0) -> list[tuple[str, dict[str, Any]]]:
        """Hear it; return what was noted."""
        self.lines.clear()
        self.witness.hear(topic, serialize_message(message), at)
        return self.lines


def log(node: str, text: str, level: int = 20, sec: int = 5) -> Log:
    message = Log(name=node.strip('/').replace('/', '.'), msg=text, level=level)
    message.stamp.sec = sec
    return message


@pytest.mark.parametrize(
    ('node', 'text', 'what', 'facts'),
    [
        (MUX, 'STOPPED: release it', 'stop', {'state': 'STOPPED', 'why': 'release it'}),
        (MUX, 'STOPPING: a gate', 'stop', {'state': 'STOPPING', 'why': 'a gate'}),
        (MUX, "ACTIVE: operator 'fort'", 'control', {'why': "operator 'fort'"}),
        (MUX, 'READY: it was reset', 'no control', {'why': 'it was reset'}),
        (MUX, '~/reset: reset: READY', 'asked', {'by': '~/reset', 'answer': 'reset: READY'}),
        (MUX, 'reset button: reset', 'asked', {'by': 'reset button', 'answer': 'reset'}),
        ('/status_page', 'page: /m: trip', 'asked', {'by': 'page', 'answer': '/m: trip'}),
        (DRIVE, 'stop: overcurrent', 'stop', {'reason': 'overcurrent'}),
        ('/commission', 'daily check: passed', 'daily check', {'says': 'passed'}),
        ('/commission', 'trial: failed', 'trial', {'says': 'failed'}),
        (MUX, 'cannot activate: no', 'refused', {'why': 'no'}),
        (MUX, 'the link ends: x', 'fault', {'why': 'the link ends: x'}),
        (MUX, 'a line of no weight', '', {}),
        ('/camera', 'STOPPED: somebody else', '', {}),
    ],
)
def test_lines_of_logs_are_noted_once(node: str, text: str, what: str, facts: Any) -> None:
    message = log(node, text, level=40 if what == 'fault' else 20)
    expected = {'node': node, **facts, 'said': '5.000000000'}
    assert Listening().hear('/rosout', message) == ([(what, expected)] if what else [])
    # A recorder that starts again hears latched logs again.
    assert Listening([{'what': what, **expected}]).hear('/rosout', message) == []


def test_what_nodes_are_and_do_is_noted() -> None:
    bench = Listening()
    value = Parameter(name='rate', value=ParameterValue(type=3, double_value=50.0))
    event = ParameterEvent(node=MUX, changed_parameters=[value])
    changed = {'node': MUX, 'name': 'rate', 'value': 50.0}
    assert bench.hear('/parameter_events', event) == [('parameter changed', changed)]
    active = TransitionEvent(goal_state=State(label='active'))
    assert bench.hear(f'{MUX}/transition_event', active) == [
        ('lifecycle', {'node': MUX, 'state': 'active'})
    ]
    status = DiagnosticStatus(values=[KeyValue(key='commissioning', value='on 2026-11-28')])
    said = [('commissioning', {'node': MUX, 'says': 'on 2026-11-28'})]
    assert [[*bench.hear(f'{MUX}/status', status)] for _ in range(2)] == [said, []]
    bench.lines.clear()
    for values in ({'a': '1', 'b': '2'}, {'b': '2', 'a': '1'}, {'a': '1', 'b': '3'}):
        bench.witness.know(NODES[1:], (MUX,), {MUX: values})
    left, first, second = bench.lines
    assert left == ('node left', {'node': DRIVE})
    assert first[0] == second[0] == 'parameters'
    assert first[1]['sha256'] != second[1]['sha256']


def test_clock_that_is_set_is_noted() -> None:
    bench = Listening()
    for at, wall in ((0.0, 100.0), (1.0, 101.1), (2.0, 3702.0), (3.0, 3703.0)):
        bench.witness.look(at, wall)
    assert bench.lines == [('clock stepped', {'seconds': 3599.9})]


def test_stop_is_measured_and_a_slow_one_named() -> None:
    bench = Listening()

    def joints(speed: float, at: float) -> None:
        message = JointState(name=['left'], velocity=[speed], position=[0.0])
        bench.witness.hear(f'{DRIVE}/joint_states', serialize_message(message), at)

    joints(10.0, 0.0)
    bench.hear(f'{MUX}/state', String(data='STOPPED'))  # as it was when the recorder came
    bench.hear(f'{MUX}/state', String(data='ACTIVE'))
    bench.hear(f'{DRIVE}/enabled', Bool(data=True))
    bench.hear(f'{MUX}/enabled', Bool(data=True))  # which has no joints
    joints(10.0, 0.99)
    bench.hear(f'{MUX}/state', String(data='ACTIVE'))  # as it was
    bench.hear(f'{DRIVE}/estop', Bool(data=False))
    front = '/front/safety_mux'
    bench.witness.know((*NODES, front), (MUX, front), {})
    for node in ('/camera', front):  # of nobody of ours, or not of this drive
        bench.hear(f'{node}/joint_states', JointState(name=['left'], velocity=[1.0]), 0.995)
        for state in ('ACTIVE', 'STOPPED'):
            bench.hear(f'{node}/state', String(data=state), 0.995)
    bench.hear(f'{MUX}/state', String(data='STOPPED'), 1.0)
    bench.hear(f'{DRIVE}/enabled', Bool(data=False), 1.02)
    for at, speed in ((1.3, 5.0), (1.55, 1.2), (1.6, 0.2), (1.65, 0.0), (1.71, 0.0)):
        joints(speed, at)
        still = JointState(name=['left'], velocity=[0.0])
        bench.witness.hear('/camera/joint_states', serialize_message(still), at)
    ((what, facts),) = bench.lines
    assert what == 'stood'
    assert (facts['joint'], facts['speed'], facts['disabled'], facts['time']) == (
        *('left', 10.0, 0.02),
        0.6,
    )
    assert facts['unheard'] == 0.05
    assert facts['slow'] == 'left: 0.60 s from 10.0 rad/s, commissioned 0.40'
    # It is known after a restart, too.
    (recent,) = bench.witness.trend.recent['left']
    assert recent == pytest.approx((10.0, 0.6, 0.4))
    assert Listening([{'what': what, **facts}]).witness.trend.warnings == {'left': facts['slow']}


@pytest.mark.parametrize(
    ('said', 'works'),
    [
        (['clear', 'stop', 'stop', 'clear'], True),
        (['stop', 'clear'], False),
        (['clear', 'stop'], False),
        (['clear', 'stop', 'stale', 'stop', 'clear'], False),
        (['clear', 'stop', 'LOST', 'stop', 'clear'], False),
        (['clear', 'ECHO', 'clear'], False),
        (['clear', 'ECHO', 'stop', 'ECHO', 'clear'], True),
    ],
    ids=[
        *('pressed and released', 'start', 'pressed', 'silent', 'lost link', 'stopped by others'),
        'pressed meanwhile',
    ],
)
def test_stop_works_when_it_was_pressed_and_released(said: list[str], works: bool) -> None:
    bench = Listening()
    bench.witness.look(0.0, 1000.0)
    sources = {
        'estop.fort.topic': '"fort/estop"',
        'estop.drive.topic': '"/esi_drive_bridge/estop"',
    }
    bench.witness.know(('/fort', *NODES), (MUX,), {MUX: sources})
    found = []
    for at, word in enumerate(said):
        values = [
            KeyValue(key="condition of e-stop source 'fort'", value=word),
            KeyValue(key="condition of operator 'fort'", value=word),
        ]
        if word == 'ECHO':
            why = Coded('mux.source.echo', "'fort' demands a stop", source='fort')
            values[0].value = 'stop'
            values += [KeyValue(key=k, value=v) for k, v in to_values([why], REASONS).items()]
        if word == 'LOST':
            bench.hear('/fort/link_up', Bool(data=False))
        else:
            found += bench.hear(f'{MUX}/status', DiagnosticStatus(values=values), float(at))
    assert found == [('stop worked', {'node': MUX, 'source': 'fort'})] * works
    overdue = bench.witness.tried.overdue
    assert overdue(1004.0) == ([] if works else ['fort never'])
    assert overdue(1003.0 + 25 * 3600) == ['fort 25 h ago' if works else 'fort never']


READY, ACTIVE = ('READY', 'none'), ('ACTIVE', 'fort')
RELEASED = "ACTIVE to READY, 0.0 s ago: operator 'fort' released its deadman"


@pytest.mark.parametrize(
    ('said', 'works'),
    [
        ([(READY, ''), (ACTIVE, ''), (ACTIVE, ''), (READY, RELEASED)], 1),
        ([(READY, ''), *[(ACTIVE, ''), (READY, RELEASED)] * 2, (READY, RELEASED)], 2),
        ([(READY, ''), (ACTIVE, 'moving'), (READY, RELEASED, 'moving'), (READY, RELEASED)], 1),
        ([(READY, ''), (ACTIVE, ''), (READY, RELEASED, 'moving')], 0),
        ([(ACTIVE, ''), (ACTIVE, ''), (READY, RELEASED)], 0),
        ([(READY, ''), (READY, RELEASED)], 0),
        ([(READY, ''), (ACTIVE, ''), (READY, 'it was reset')], 0),
        ([(READY, ''), (ACTIVE, ''), (('STOPPED', 'none'), ''), (READY, RELEASED)], 0),
        ([(READY, ''), (('ACTIVE', 'other'), ''), (ACTIVE, ''), (READY, RELEASED)], 0),
    ],
    ids=[
        *('at rest', 'again', 'in motion', 'does not stand', 'held at the start', 'not pressed'),
        *('not released', 'stopped', 'taken over'),
    ],
)
def test_deadman_works_when_it_gave_control_and_ended_it(said: list[Any], works: int) -> None:
    bench = Listening()
    bench.witness.look(0.0, 1000.0)
    bench.witness.know(NODES, (MUX,), {MUX: {'operator.fort.topic': '"fort/joy"'}})
    found = []
    for (state, owner), transition, *feedback in said:
        values = {'state': state, 'owner': owner, 'last transition': transition}
        values |= dict.fromkeys(['condition of the feedback'], *feedback) if feedback else {}
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        found += bench.hear(f'{MUX}/status', DiagnosticStatus(values=pairs), 1.0)
    assert found == [('deadman worked', {'node': MUX, 'operator': 'fort'})] * works
    for age, ago in ((3000.0, '50 min ago'), (3600.0, '1 h ago')):
        words = f'deadman of fort {ago if works else "never"}'
        assert bench.witness.tried.said(1001.0 + age) == [words]
    again = Tried(
        24.0,
        (),
        [{'what': what, **facts, 'at': '1970-01-01T01:00:00+00:00'} for what, facts in found],
    )
    again.know({MUX: {'operator.fort.topic': '"fort/joy"'}})
    late = 3600.0 * 26.0
    assert again.overdue(late) == [f'deadman of fort {"25 h ago" if works else "never"}']


@pytest.mark.parametrize(
    ('interval', 'now', 'overdue'),
    [
        (24.0, 1003.0 + 86400.0, []),
        (24.0, 1003.0 + 86401.0, ['fort 24 h ago']),
        (24.0, 1002.0, ['fort never']),  # the clock was wrong then
        (0.0, 1e9, []),
    ],
)
def test_stop_that_nobody_tried_is_known_after_a_restart(
    interval: float, now: float, overdue: list[str]
) -> None:
    line = {
        'what': 'stop worked',
        'node': MUX,
        'source': 'fort',
        'at': '1970-01-01T00:16:43+00:00',
    }
    again = Tried(interval, ['drive'], [line])
    again.know({MUX: {f'estop.{name}.topic': f'"{name}/estop"' for name in ('fort', 'drive')}})
    assert again.overdue(now) == overdue


@pytest.mark.parametrize(
    'line',
    [
        {'what': 'stop worked'},
        {'what': 'stop worked', 'node': [], 'source': 'fort', 'at': '1970-01-01'},
        {'what': 'stop worked', 'node': MUX, 'source': 'fort', 'at': 'yesterday'},
        {'what': 'stood', 'joint': 'left'},
        {'what': 'stood', 'joint': 'left', 'speed': 'fast', 'time': 1.0},
        {'what': 'stop', 'node': [], 'said': {}},
    ],
)
def test_line_of_a_stranger_keeps_nobody_from_starting(line: dict[str, Any]) -> None:
    trend, tried = Trend({'left': [(10.0, 0.4)]}, 0.2), Tried(24.0, (), [line])
    Witness(lambda kind, data: None, lambda *_, **__: None, [line], trend, tried)


# The thread.


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[LedgerWriter]:
    result = LedgerWriter(tmp_path / 'new' / 'ledger.jsonl', tmp_path / 'anchor', lambda _: None)
    yield result
    result.stop(5.0)


def test_lines_wait_for_another_writer_and_are_anchored(
    writer: LedgerWriter, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = Book(writer.book.path)
    other.append(now(), 'a', {})
    writer.note('b', text='x')
    wait_for(lambda: writer.error, what='a word about the other one')
    assert writer.error.startswith('another process writes it: ')
    other.close()
    anchor = tmp_path / 'anchor'
    wait_for(lambda: anchor.exists() and anchor.read_text(encoding='utf-8'), what='the anchor')
    assert writer.error == ''
    arguments = [str(writer.book.path), '--anchor', str(anchor)]
    assert run('verify', *arguments) == 0
    assert capsys.readouterr().out.startswith('2 lines, 0 ends')
    # Without its last line it is whole, but not as the anchor says.
    data = writer.book.path.read_bytes()
    writer.book.path.write_bytes(data[: data.index(b'\n') + 1])
    assert run('verify', arguments[0]) == 0
    assert run('verify', *arguments) == 1
    assert 'line 2 is not the one that the anchor has kept' in capsys.readouterr().err


def _unread(anchor: Path) -> str:
    os.mkfifo(anchor)
    return 'No such device or address'


def _missing(anchor: Path) -> str:
    anchor.symlink_to(anchor.parent / 'unplugged' / 'anchor')
    return 'No such file or directory'


@pytest.mark.parametrize('spoil', [_unread, _missing])
def test_anchor_that_is_away_is_named_and_gets_the_head_once_it_is_back(
    writer: LedgerWriter, tmp_path: Path, spoil: Callable[[Path], str]
) -> None:
    anchor = tmp_path / 'anchor'
    words = spoil(anchor)
    writer.note('a')
    gone = writer.anchor
    assert gone is not None
    wait_for(lambda: gone.error.startswith(words), what=words)
    assert writer.book.head.number == 1, 'it holds up no line'
    anchor.unlink()
    wait_for(lambda: not gone.error, what='the anchor without another line')
    assert run('verify', str(writer.book.path), '--anchor', str(anchor)) == 0


def test_anchor_that_does_not_answer_is_named(
    writer: LedgerWriter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, monkey = threading.Event(), Anchor._write
    monkeypatch.setattr(Anchor, '_write', lambda *given: (hangs.wait(), monkey(*given)))
    monkeypatch.setattr('rugged_teleop.ledger.writer._HANGS', 0.1)
    for what in ('a', 'b'):
        writer.note(what)
    anchor = writer.anchor
    assert anchor is not None
    wait_for(lambda: anchor.error == f'no answer: {tmp_path / "anchor"}', what='a word of it')
    wait_for(lambda: writer.book.head.number == 2, what='lines that it does not hold up')
    hangs.set()
    wait_for(lambda: not anchor.error, what='an answer')


def test_anchor_on_a_full_disk_accuses_nobody(
    writer: LedgerWriter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room, write = [20], os.write

    def scarce(file: int, data: bytes) -> int:
        if threading.current_thread().name != 'ledger anchor':
            return write(file, data)
        if not room[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        data = data[: room[0]]
        room[0] -= len(data)
        return write(file, data)

    monkeypatch.setattr(os, 'write', scarce)
    writer.note('a')
    anchor, path = writer.anchor, tmp_path / 'anchor'
    assert anchor is not None
    wait_for(lambda: anchor.error.startswith('No space left'), what='a word of it')
    assert len(path.read_bytes()) == 20
    room[0] = 1000
    wait_for(lambda: not anchor.error, what='room')
    assert run('verify', str(writer.book.path), '--anchor', str(path)) == 0


def test_line_of_anything_neither_ends_the_thread_nor_forges_the_chain(
    writer: LedgerWriter,
) -> None:
    writer.note('a', path=Path('/x'), before='0' * 64, n=7)
    writer.note('b')
    wait_for(lambda: writer.book.head.number == 2, what='both lines')
    assert run('verify', str(writer.book.path)) == 0


def test_ledger_that_cannot_be_opened_waits_until_it_can(
    writer: LedgerWriter, tmp_path: Path
) -> None:
    writer.book.path.mkdir(parents=True)
    writer.note('a')
    wait_for(lambda: writer.error.startswith('Is a directory'), what='a word of it')
    writer.book.path.rmdir()
    wait_for(lambda: writer.book.head.number == 1, what='the line')
    assert writer.error == ''


def test_lines_that_find_no_room_are_counted_to_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('rugged_teleop.ledger.writer._WAITING', 1)
    path = tmp_path / 'ledger.jsonl'
    path.mkdir()
    writer = LedgerWriter(path, None, lambda _: None)
    writer.note('written')
    wait_for(lambda: writer.error, what='a line that waits')
    append, late = writer.book.append, [1]

    def meanwhile(moment: Any, what: str, facts: Any) -> bytes:
        line = append(moment, what, facts)
        if what == 'lost lines' and late:
            late.clear()
            writer.note('lost, too')
        return line

    monkeypatch.setattr(writer.book, 'append', meanwhile)
    for _ in range(4):  # the first waits
        writer.note('lost')
    path.rmdir()
    wait_for(lambda: writer.book.head.number == 4, what='all lines')
    writer.stop(5.0)
    found = [*lines(path, Reader(Head()))]
    assert sum(each.get('count', 0) for each in found) == 4


def run(*arguments: str) -> Any:
    with pytest.raises(SystemExit) as end:
        command.main(arguments)
    return end.value.code


def test_ledger_is_shown_and_exported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    book = Book(tmp_path / 'ledger.jsonl')
    book.append(now(), 'stop', {'node': MUX, 'why': 'a, "b"'})
    book.append(now(), 'stood', {'speed': 2.5, 'time': None})
    path = str(book.path)
    assert run('show', path, '--what', 'stop') == 0
    assert capsys.readouterr().out.endswith(f'  stop: node {MUX}, why a, "b"\n')
    assert run('export', path) == 0
    assert '"a, ""b""",,' in capsys.readouterr().out
    for since, shown in {'2000-01-01': 2, '2000-01-01 12:00+09:00': 2, '2999-01-01': 0}.items():
        assert run('show', path, '--since', since) == 0
        assert len(capsys.readouterr().out.splitlines()) == shown
    for text in ('no line of a ledger', ''):
        (other := tmp_path / 'notes.txt').write_text(text)
        assert run('verify', str(other)) == 1
        assert 'this is no ledger' in capsys.readouterr().err
    assert run('show', path, '--since', 'yesterday') == 2
    words = 'argument --since: yesterday is no time such as 2026-11-22; see '
    assert words in capsys.readouterr().err
    assert run('show', str(tmp_path / 'none')) == 2
    assert run('verify', path, '--anchor', path) == 1
    assert capsys.readouterr().err.endswith(f'{path} has kept no line\n')
