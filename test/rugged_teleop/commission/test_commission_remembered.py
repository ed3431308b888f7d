# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A trial that is continued, its file of answers, and what a running mux says of its report."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from sensor_msgs.msg import JointState

from bridge_core import clock
from bridge_core.fingerprint import fingerprint, version
from rugged_teleop.commission import folder, looks
from rugged_teleop.commission.answers import read_answers
from rugged_teleop.commission.history import History
from rugged_teleop.commission.main import main, nodes_of, read_machine
from rugged_teleop.commission.running import Running
from rugged_teleop.commission.step import Question, Record, Result, Step
from stage.rig import latched, NodeProcess, Observer, wait_for
from test.rugged_teleop.commission.rig import FILE
from test.rugged_teleop.commission.test_commission_folder import HEAD

STEPS = [
    Step(name='joint.left', title='a', questions=(Question('turns', 'How many?', 'number'),)),
    Step(name='chain.a', title='b', questions=(Question('meter', 'Open?', ('open', 'closed')),)),
]


@pytest.fixture(scope='module')
def report() -> dict[str, Any]:
    parameters = nodes_of(read_machine(FILE)[0])
    head = {'parameters': parameters, 'fingerprint': fingerprint(parameters)}
    done = Record('what.limits', 'a', Result.PASSED, 'fine')
    step = Step(name=done.name, title=done.title)
    return folder.report_of({**HEAD, **head, 'version': version()}, [step], {done.name: done})


# Answers


def test_answers_are_read(tmp_path: Path) -> None:
    file = tmp_path / 'answers.yaml'
    answers = {
        'machine': 'acme 7',
        'accept': 'trial run',
        'joint.left.turns': 1.5,
        'meter': 'open',
        'skip': {'chain.a': 'no meter'},
    }
    file.write_text(json.dumps(answers))
    assert read_answers(file, STEPS) == answers
    file.write_text('')
    assert read_answers(file, STEPS) == {}


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('[1, 2]', 'is no mapping'),
        ('{', 'while parsing'),
        ('\xff', "codec can't decode"),
        ('whom: me', 'nothing asks for whom'),
        ('joint.right.turns: 1', 'nothing asks for joint.right.turns'),
        ('1: me', 'nothing asks for 1'),
        ('turns: many', 'turns: many is not a number'),
        ('turns: .nan', 'turns: nan is not a number'),
        ('chain.a.meter: shut', 'chain.a.meter: shut is not one of open, closed'),
        ('machine: [a]', "machine: ['a'] is not a text"),
        ('who:', 'who: None is not a text'),
        ('skip: chain.a', 'skip is no mapping of steps to reasons'),
        ('skip: {chain.b: x}', 'there is no step chain.b'),
        ('skip: {chain.a: }', 'chain.a has no reason'),
    ],
)
def test_answer_that_answers_nothing_is_refused(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / 'answers.yaml'
    file.write_bytes(text.encode('latin-1'))
    with pytest.raises(ValueError, match=r'^--answers ') as caught:
        read_answers(file, STEPS)
    assert says in str(caught.value)
    assert '\n' not in str(caught.value)


# A folder that was left


def _run(*words: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(FILE), '--simulated', *words])
    return int(str(ended.value.code))


def test_wrong_answers_are_refused_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run('--folder', str(tmp_path / 'new'), '--answers', str(tmp_path / 'none')) == 2
    assert 'none: No such file' in capsys.readouterr().err
    assert not (tmp_path / 'new').exists()


@pytest.mark.parametrize(
    ('change', 'status', 'says'),
    [
        ({'simulated': False}, 2, 'is of the machine'),
        ({'joint.left.max': 12.0}, 2, 'of another trial: joint.left.max was 12.0, is 10.0'),
        ({'commissioning.stop_time': 9.0}, 2, 'of another trial: commissioning.stop_time was 9'),
        ({'version': '0.0.1'}, 2, 'of another trial: the package was 0.0.1, is '),
        ({'format': 2}, 1, 'no report of this version'),
    ],
)
def test_folder_of_another_trial_is_refused_and_left_as_it_is(
    tmp_path: Path,
    report: dict[str, Any],
    capsys: pytest.CaptureFixture[str],
    change: dict[str, Any],
    status: int,
    says: str,
) -> None:
    other = json.loads(json.dumps({**report, 'simulated': True}))
    is_parameter = '.' in ''.join(change)
    place = other['parameters']['/safety_mux'] if is_parameter else other
    place |= change
    folder.write(tmp_path, other, b'')
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert _run('--folder', str(tmp_path)) == status
    assert says in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


# What is heard of a machine


def test_feedback_is_recorded_once_and_what_is_commanded_is_of_the_interface(
    observer: Observer,
) -> None:
    machine = read_machine(FILE)[0]
    machine.values = {**machine.values, 'interface': 'effort'}
    topic = machine.mux.topic(machine.values['feedback.topic'])
    feedback, command = (
        observer.node.create_publisher(JointState, name, 10)
        for name in (topic, '/safety_mux/command')
    )
    with Running(machine, lambda _: contextlib.nullcontext()) as running:
        heard = running.history

        def is_heard() -> bool:
            feedback.publish(JointState(name=['left'], velocity=[1.0], position=[0.5]))
            command.publish(JointState(name=['left'], effort=[2.0]))
            running.spin(0.05)
            return bool(heard.last('positions') and heard.last('command'))

        wait_for(is_heard, what='both')
        recorded = [each for each in running._ring.messages() if each.channel.topic == topic]
        assert len(recorded) == len([*heard.since('joints', 0.0)])
        assert heard.last('joints') == {'left': 1.0}
        assert heard.last('positions') == {'left': 0.5}
        assert heard.last('command') == {'left': 2.0}


def test_reset_that_nobody_answers_is_not_a_refused_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f'{Running.__module__}._ANSWER_LIMIT', 0.01)
    call = SimpleNamespace(done=lambda: False)
    client = SimpleNamespace(service_is_ready=lambda: True, call_async=lambda _: call)
    mux = SimpleNamespace(_reset=client, history=History(), spin=lambda _: None)
    mux.history.add('state', clock.now(), 'STOPPED')
    assert Running.reset(mux) == (False, 'no answer')  # type: ignore[arg-type]
    assert looks.refused(mux.history, {'since': 0.0}, clock.now() + 9.0) is None


# A running mux

CHANGED = 'not validated: joint.left.max was 10.0, is 12.0'


def test_running_mux_says_that_it_was_not_tried_as_it_is(
    observer: Observer, report: dict[str, Any], tmp_path: Path
) -> None:
    """What else it says of a report: test_commission.py."""
    folder.write(tmp_path, report, b'')
    status = observer.record(DiagnosticStatus, '/safety_mux/status', latched())
    file = tmp_path.with_suffix('.yaml')
    file.write_text(FILE.read_text().replace('left: {max: 10.0}', 'left: {max: 12.0}'))
    given = {'commissioning.report': str(tmp_path / folder.REPORT)}
    with NodeProcess('safety_mux.node', given, arguments=('--params-file', str(file))):

        def said() -> str:
            values = status.last.values if status.last else []
            return next((str(v.value) for v in values if v.key == 'commissioning'), '')

        observer.wait_for(lambda: CHANGED in said(), what=said)
        assert CHANGED in status.last.message
