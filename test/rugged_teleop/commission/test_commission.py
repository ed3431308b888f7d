# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The trial without a machine: its order, its looks, its folder, and what a mux says of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
import errno
import io
import json
import math
import os
from pathlib import Path
from signal import SIGCONT, SIGKILL
import termios
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core import clock
from bridge_core.fingerprint import differences, fingerprint, version
from bridge_core.parameters import ParameterError
from rugged_teleop.commission import folder, looks
from rugged_teleop.commission.daily import daily_steps, result_of
from rugged_teleop.commission.engine import Benched, Engine, LeftError
from rugged_teleop.commission.faces import line_of, Terminal
from rugged_teleop.commission.history import History
from rugged_teleop.commission.machine import Machine
from rugged_teleop.commission.main import main, nodes_of, read_machine
from rugged_teleop.commission.mover import Mover
from rugged_teleop.commission.step import (
    Act,
    Command,
    Measured,
    Phase,
    Question,
    Record,
    Result,
    Seen,
    Step,
)
from rugged_teleop.commission.steps import steps_of
from rugged_teleop.ledger.stopping import curves_of
from safety_mux.commissioned import tried
from test.rugged_teleop.commission.rig import ACTUATORS_FILE, FILE, heard_as
from test.rugged_teleop.commission.test_commission_folder import HEAD

MUX = '/safety_mux'


@pytest.fixture(scope='module')
def machine() -> Machine:
    return read_machine(FILE)[0]


class Paper:
    """A machine and a person of paper: time passes when it is spun, and all is answered."""

    person = 1.0

    def __init__(self, begin: str = 'run') -> None:
        self.history = History()
        self.time, self.acts, self._begin = 100.0, list[str](), begin
        self.wishes, self.again = list[str](), list[bool]()
        self.commands = list[Command | None]()

    def now(self) -> float:
        return self.time

    def spin(self, seconds: float) -> None:
        self.time += seconds

    def reset(self) -> tuple[bool, str]:
        return True, ''

    def command(self, command: Command | None) -> bool:
        self.commands.append(command)
        return True

    def pid_of(self, node: str, process: str) -> int:
        return 1

    def bench(self, node: str, joint: str, heed: Callable[[], object]) -> Benched:
        heed()
        return Benched('', 0.1, 6.3)

    def keep(self, step: str, since: float) -> str:
        return f'{step}.mcap'

    def begin(self, step: Step) -> str:
        return self._begin

    def accept(self, step: Step, problems: Sequence[str]) -> str:
        return ''

    def act(self, act: Act) -> bool:
        self.acts.append(act.text)
        return True

    def ask(self, step: Step, question: Question) -> str:
        return {'which': 'left', 'way': 'forward'}.get(question.name, '1')

    def expect(self, phase: Phase | None) -> None:
        pass

    def wish(self) -> str:
        return self.wishes.pop(0) if self.wishes else ''

    def tell(self, record: Record) -> bool:
        return bool(self.again.pop(0)) if self.again else False


def _engine(paper: Paper) -> Engine:
    return Engine(paper, paper, lambda: 'now')


def _record(name: str, result: Result, **values: Any) -> Record:
    return Record(name, name, result, 'text', 'now', **values)


# The order


def test_each_stop_of_the_machine_has_its_step(machine: Machine) -> None:
    ways = ['fort.remote', 'fort.wired', 'fort.off', 'fort.cable', 'drive.cable', 'actuators']
    assert [step.name for step in steps_of(machine) if step.stops] == [f'stop.{w}' for w in ways]


def test_blocked_step_does_nothing() -> None:
    paper = Paper()
    step = Step(name='a', title='a', moves=True, undo=(Act('undone'),))
    assert _engine(paper).run(step, 'blocked').result is Result.NOT_RUN
    assert not paper.acts


def test_skipped_step_keeps_its_reason() -> None:
    record = _engine(Paper('no wheels yet')).run(Step(name='a', title='a'))
    assert (record.result, record.reason) == (Result.SKIPPED, 'no wheels yet')


NEVER = Phase('never', lambda *_: None, (Act('press'),), limit=0.1, person=True)


@pytest.mark.parametrize(
    ('wish', 'result', 'took'),
    [
        ('', Result.FAILED, 1.1),  # the time that a person has, and the limit
        ('done', Result.FAILED, 0.1),
        ('no remote', Result.SKIPPED, 0.0),
    ],
)
def test_person_says_that_it_is_done_or_skipped(wish: str, result: Result, took: float) -> None:
    paper = Paper()
    paper.wishes = [wish]
    step = Step(name='a', title='a', phases=(NEVER,), undo=(Act('let go'),))
    record = _engine(paper).run(step)
    assert (record.result, record.reason) == (result, wish * (result is Result.SKIPPED))
    assert paper.acts == ['press', 'let go']
    assert took <= paper.time - 100.0 <= took + 0.1


def test_phase_that_resets_waits_until_all_is_done() -> None:
    """The mux may be READY without a remote that refuses to be armed by now."""
    paper = Paper()
    refusals = iter((False, False, True))
    paper.act = lambda act: next(refusals)  # type: ignore[method-assign]
    phase = Phase('ready', lambda *_: Seen(True, 'ready'), (Act('arm'),), resets=True)
    assert _engine(paper).run(Step(name='a', title='a', phases=(phase,))).result is Result.PASSED
    assert next(refusals, None) is None


def test_nothing_is_reset_for_ever_where_nobody_says_that_he_is_there() -> None:
    """A page may be closed, and who works at the machine may press its e-stop and release it."""
    paper, resets = Paper(), list[float]()
    paper.person = math.inf
    paper.history.add('state', 100.0, 'STOPPED')
    paper.history.add('status', 100.0, {'stops clear': 'true', 'operators at rest': 'true'})

    def reset() -> tuple[bool, str]:
        resets.append(paper.time)
        return True, ''

    paper.reset = reset  # type: ignore[method-assign]
    paper.wishes = [''] * 10_000 + ['done']
    phase = Phase('ready', lambda *_: None, (Act('arm'),), limit=1.0, resets=True)
    _engine(paper).run(Step(name='a', title='a', phases=(phase,)))
    assert [at for at in resets if 170.0 < at < 299.0] == []
    assert resets[0] < 110.0
    assert resets[-1] > 299.0, 'who says that it is done is there'


def test_joint_that_turns_ends_where_the_trial_is_left() -> None:
    paper = Paper()
    paper.wishes = ['leave']
    with pytest.raises(LeftError):
        _engine(paper).run(Step(name='a', title='a', joint='left', node='/n'))


def test_step_is_done_again_and_left() -> None:
    paper = Paper()
    paper.again = [True, True]
    _engine(paper).run(Step(name='a', title='a', phases=(NEVER,)))
    assert paper.acts == ['press'] * 3
    paper.wishes = ['leave']
    with pytest.raises(LeftError):
        _engine(paper).run(Step(name='a', title='a', phases=(NEVER,), undo=(Act('let go'),)))
    assert paper.acts[-1] == 'let go'


@pytest.mark.parametrize(
    ('value', 'result'),
    [
        (0.2, Result.PASSED),
        (0.3, Result.FAILED),
        (-0.001, Result.FAILED),  # no effect comes before its cause
        (float('nan'), Result.FAILED),
    ],
)
def test_number_beyond_its_limit_fails(value: float, result: Result) -> None:
    seen = Seen(True, 'fine', (Measured('reaction', value, limit=0.25),))
    step = Step(name='a', title='a', phases=(Phase('it', lambda *_: seen),))
    assert _engine(Paper()).run(step).result is result


def test_number_without_a_limit_may_be_negative() -> None:
    assert Measured('turned', -0.5, 'turns').text == 'turned: -0.5 turns'


def test_what_came_of_a_step_is_kept_before_a_person_is_asked_who_may_leave() -> None:
    paper, kept = Paper(), list[Record]()

    def leave(record: Record) -> bool:
        raise LeftError

    paper.tell = leave  # type: ignore[method-assign]
    with pytest.raises(LeftError):
        _engine(paper).run(Step(name='a', title='a', phases=(NEVER,)), keep=kept.append)
    assert [each.result for each in kept] == [Result.FAILED]


def test_trial_that_is_left_as_a_step_failed_has_failed_with_the_file_that_it_began_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, paper = tmp_path / 'my.yaml', Paper()
    file.write_bytes(FILE.read_bytes())

    def leave(record: Record) -> bool:
        file.write_text('# edited')
        raise LeftError

    paper.tell = leave  # type: ignore[method-assign]
    face = SimpleNamespace(ask=paper.ask, say=lambda _: True, end=lambda _: None)
    stand_ins: dict[str, object] = {
        '_engine': lambda *_: (_engine(paper), face, face),
        'steps_of': lambda *_: [Step(name='a', title='a', phases=(NEVER,))],
        'require': lambda *_: None,
        '_end_in_order': lambda: None,
    }
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(f'{main.__module__}.{name}', stand_in)
    with pytest.raises(SystemExit) as ended:
        main([str(file), '--folder', str(tmp_path / 'trial')])
    assert ended.value.code == 1
    assert folder.verify(tmp_path / 'trial')['verdict'] == 'failed'
    assert (tmp_path / 'trial' / folder.PARAMETERS).read_bytes() == FILE.read_bytes()


def test_what_is_not_measured_is_not_plotted() -> None:
    paper = Paper()
    paper.history.add('joints', 100.0, {'left': math.nan, 'right': 1.0})
    record = _engine(paper).run(Step(name='a', title='a', moves=True))
    assert record.series == {'joints right': [[0.0, 1.0]]}


# What the trial moves by itself

MOVE = Act('Move it', '/n', command=Command('/n', (0.2,)))


def test_while_the_trial_moves_something_nobody_is_waited_for_without_an_end() -> None:
    """A page waits for ever; the phone may have lost its network."""
    paper = Paper()
    paper.person = math.inf
    paper.wishes = [''] * 7000 + ['leave']
    for person in (False, True):
        phases = (Phase('its end', lambda *_: None, (MOVE,), person=person),)
        record = _engine(paper).run(Step(name='a', title='a', phases=phases))
        assert record.result is Result.FAILED
        assert paper.commands[-1] is None
    assert paper.time - 100.0 < 130.0


def test_nothing_is_moved_while_a_person_is_asked() -> None:
    paper, ask = Paper(), Paper.ask

    def asked(step: Step, question: Question) -> str:
        assert paper.commands[-1] is None
        return ask(paper, step, question)

    paper.ask = asked  # type: ignore[method-assign]
    phases = (Phase('motion', lambda *_: Seen(True, ''), (MOVE,)),)
    step = Step(name='a', title='a', phases=phases, questions=(Question('q', 'Which way?'),))
    assert _engine(paper).run(step).answers == {'q': '1'}


def test_what_is_moved_rests_though_nobody_undoes_the_rest() -> None:
    paper = Paper()

    def gone(act: Act) -> bool:
        raise LeftError

    paper.act = gone  # type: ignore[method-assign]
    phases = (Phase('motion', lambda *_: Seen(True, ''), (MOVE,)),)
    with pytest.raises(LeftError):
        _engine(paper).run(Step(name='a', title='a', phases=phases, undo=(Act('let go'),)))
    assert paper.commands[-1] is None


def test_command_of_a_trial_that_was_held_up_is_an_old_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a stopped process, or a terminal that takes nothing: somebody may be near by now."""
    time, sent = [100.0], list[Any]()
    publisher = SimpleNamespace(get_subscription_count=lambda: 1, publish=sent.append)
    node = SimpleNamespace(
        create_publisher=lambda *_: publisher,
        destroy_publisher=lambda _: None,
        count_publishers=lambda _: 1,
    )
    monkeypatch.setattr(clock, 'now', lambda: time[0])
    mover = Mover(node, read_machine(ACTUATORS_FILE)[0], History())
    mover.command(Command('/ssc_bridge', (0.2, 0.2)))
    for seconds, count in ((0.0, 1), (0.9, 2), (1.1, 2), (0.1, 2)):
        time[0] += seconds
        mover.publish()
        assert len(sent) == count


@pytest.mark.parametrize(
    ('turned', 'turns', 'way', 'says'),
    [
        (6.0, '0.95', 'forward', 'turns forward, as far as it says'),
        (6.0, '0.95', 'back', 'turned the wrong way'),
        (6.0, '2', 'forward', '2.1 times as far'),
        (6.0, '0', 'forward', 'left did not turn'),
        (0.0, '0.95', 'forward', 'the feedback says nothing of left'),
        (math.nan, '0.95', 'forward', 'the feedback says nothing of left'),
    ],
)
def test_joint_is_held_against_the_eye(
    machine: Machine, turned: float, turns: str, way: str, says: str
) -> None:
    judge = next(step for step in steps_of(machine) if step.name == 'joint.left').judge
    assert judge is not None
    answers = {'which': 'left', 'way': way, 'turns': turns}
    assert says in judge(answers, {'turned': turned, 'enabling': 0.1}).text


@pytest.mark.parametrize(
    ('missing', 'says'),
    [
        ('joint.left.max', 'joint.left.max is the default'),
        ('commissioning.stop_time', 'commissioning.stop_time is not given'),
        ('commissioning.stop_angle', 'commissioning.stop_angle is not given'),
    ],
)
def test_limit_left_at_its_default_is_named(machine: Machine, missing: str, says: str) -> None:
    given = {name: value for name, value in machine.given.items() if name != missing}
    changed = Machine([machine.mux, *machine.bridges], given)
    if missing.startswith('commissioning'):
        changed.values = {**machine.values, missing: 0.0}
    limits = next(step for step in steps_of(changed) if step.name == 'what.limits')
    assert says in limits.problems[0]
    assert not next(s for s in steps_of(machine) if s.name == 'what.limits').problems


# The daily check


def test_daily_check_has_each_button_and_each_deadman_once(machine: Machine) -> None:
    steps = daily_steps(machine)
    stops, deadmen = ['stop.fort.remote', 'stop.fort.wired'], ['deadman.fort.0']
    assert [step.name for step in steps] == [*stops, *deadmen]
    assert [step.name for step in steps if step.stops] == stops
    assert _engine(Paper()).blocked(steps[-1], steps, {})
    done = {name: _record(name, Result.PASSED) for name in stops}
    assert result_of(steps, done, 'A. B.') == 'not passed: deadman.fort.0 not done; by A. B.'
    done['deadman.fort.0'] = _record('deadman.fort.0', Result.PASSED)
    assert result_of(steps, done, 'A. B.') == 'passed; by A. B.'


@pytest.mark.parametrize(
    ('values', 'ok'),
    [
        ([('joy fort', 1.1, ([], [0])), ('state', 1.2, 'READY')], True),
        ([('joy fort', 1.1, ([], [0])), ('state', 1.2, 'STOPPED')], False),
        ([('command', 1.1, {'left': 0.1})], False),
        ([('joy fort', 1.1, ([], [0]))], None),
        ([('state', 1.2, 'READY')], None),
    ],
)
def test_deadman_that_is_let_go_of_ends_control(
    machine: Machine, values: list[Any], ok: bool | None
) -> None:
    look = daily_steps(machine)[-1].phases[-1].look
    seen = look(heard_as(*values), {'since': 1.0}, 2.0)
    assert (seen and seen.ok) is ok


# Looks


AGE = 'from node to wire, at most (s)'


@pytest.mark.parametrize(
    ('ages', 'ok', 'limited'),
    [
        (['0.05', '0.1'], True, True),
        (['0.05', '0.45'], True, False),
        (['0.1', 'unknown'], False, True),
    ],
)
def test_second_computer_that_is_late_is_seen(ages: list[str], ok: bool, limited: bool) -> None:
    heard = heard_as(*(('status', 1.0 + n, {AGE: age}) for n, age in enumerate(ages)))
    seen = looks.fresh_on_the_way(AGE, 0.3)(heard, {'since': 0.0}, 4.0)
    assert seen is not None
    assert seen.ok is ok
    assert all(each.is_within for each in seen.measured) is limited


@pytest.mark.parametrize(
    ('channel', 'value', 'says'),
    [
        ('enabled', True, 'enabled by itself'),
        ('command', {'left': 0.1}, 'motion was commanded'),
        ('joints', {'left': 0.0, 'right': -0.3}, 'turned by itself'),
        ('state', 'READY', 'the mux is'),
    ],
)
def test_what_moves_by_itself_is_seen(channel: str, value: Any, says: str) -> None:
    heard = heard_as(('state', 0.5, 'STOPPED'), (channel, 1.5, value))
    seen = looks.still('STOPPED', 0.2)(heard, {'since': 1.0}, 2.0)
    assert seen is not None
    assert not seen.ok
    assert says in seen.text


@pytest.mark.parametrize(('channel', 'value'), [('state', 'STOPPED'), ('joints', {'left': 0.0})])
def test_what_has_fallen_silent_does_not_stand(channel: str, value: Any) -> None:
    look, heard = looks.still('STOPPED', 0.2), heard_as((channel, 0.5, value))
    assert look(heard, {'since': 1.0}, 2.0) is None
    heard.add(channel, 1.5, value)
    assert look(heard, {'since': 1.0}, 2.0) is not None


def test_reset_that_counts_while_pressed_is_seen() -> None:
    heard = heard_as(('state', 1.0, 'STOPPED'), ('reset', 1.1, (True, 'done')))
    seen = looks.refused(heard, {'since': 1.0}, 2.0)
    assert seen is not None
    assert not seen.ok


def test_way_to_standstill_is_measured() -> None:
    speeds = [(1.0, 2.0), (1.5, 1.0), (2.0, 0.0), (2.6, 0.0)]
    heard = heard_as(*(('joints', at, {'left': speed}) for at, speed in speeds))
    look = looks.stands(0.2, 0.6, 1.4)
    seen = look(heard, {'began': 1.0}, 2.6)
    assert seen is not None
    assert seen.stopping == {}, 'the mux did not stop it'
    assert all(each.is_within for each in seen.measured)
    assert look(heard_as(('joints', 1.0, {'left': 2.0})), {'began': 1.0}, 9.0) is None
    for gone in ({'left': math.nan}, {}):  # is no standstill
        heard = heard_as(
            ('joints', 1.0, {'left': 2.0}), *(('joints', 1.1 + n, gone) for n in (0, 1))
        )
        assert look(heard, {'began': 1.0}, 9.0) is None


@pytest.mark.parametrize(
    ('began', 'states'),
    [
        (1.0, [(0.5, 'ACTIVE'), (1.3, 'STOPPED'), (1.8, 'STOPPED')]),
        (1.35, [(0.5, 'ACTIVE'), (1.3, 'READY'), (1.36, 'STOPPED')]),
    ],
    ids=['at once', 'after its deadman'],
)
def test_standstill_is_measured_as_in_use(began: float, states: list[tuple[float, str]]) -> None:
    """From the mux's stop on, of what moved; not from its cause, which a link may have hidden."""
    speeds = [(0.9, 2.0), (1.3, 2.0), (1.5, 1.0), (1.7, 0.0), (1.81, 0.0), (2.3, 0.0)]
    joints = [('joints', at, {'left': speed, 'right': 0.0}) for at, speed in speeds]
    heard = heard_as(*joints, *(('state', at, state) for at, state in states))
    seen = looks.stands(0.2, 0.6, 1.4)(heard, {'began': began}, 2.3)
    assert seen is not None
    curves = curves_of({'stopping': {name: [each] for name, each in seen.stopping.items()}})
    assert [*curves] == ['left']
    assert curves['left'][0] == pytest.approx((2.0, 0.36))


# What decides


NODES: dict[str, dict[str, Any]] = {
    MUX: {'joint.left.max': 10.0, 'hardware_id': 'a'},
    '/drive': {'port': 'x'},
}


def test_order_and_names_do_not_decide() -> None:
    other: dict[str, dict[str, Any]] = {
        '/drive': {'port': 'x'},
        MUX: {'hardware_id': 'b', 'joint.left.max': 10.0},
    }
    assert fingerprint(NODES) == fingerprint(other)
    assert differences(NODES, other) == []


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({MUX: {'joint.left.max': 12.0}}, 'joint.left.max was 10.0, is 12.0'),
        ({MUX: {}}, 'joint.left.max was 10.0, is not there'),
        ({'/drive': {'port': 'y'}}, 'port was x, is y'),
        ({'/new': {}}, '/new is new'),
    ],
)
def test_what_decides_is_named(change: dict[str, dict[str, Any]], says: str) -> None:
    other = {**NODES, **change}
    assert fingerprint(NODES) != fingerprint(other)
    assert differences(NODES, other) == [says]


# The folder


def _report(machine: Machine, *records: Record) -> dict[str, Any]:
    nodes = nodes_of(machine)
    head: dict[str, Any] = {'version': version(), 'date': 'today'}
    head |= {'parameters': nodes, 'fingerprint': fingerprint(nodes)}
    steps = [Step(name=each.name, title=each.name) for each in records]
    return folder.report_of({**HEAD, **head}, steps, {each.name: each for each in records})


@pytest.fixture
def written(machine: Machine, tmp_path: Path) -> Path:
    record = _record('motion.a', Result.PASSED)
    folder.write(tmp_path, _report(machine, record), FILE.read_bytes())
    return tmp_path


@pytest.mark.parametrize(
    ('results', 'verdict'),
    [
        ([Result.PASSED], 'passed'),
        ([Result.PASSED, Result.SKIPPED], 'passed with exceptions'),
        ([Result.PASSED, Result.ACCEPTED], 'passed with exceptions'),
        ([Result.PASSED, Result.NOT_RUN], 'passed with exceptions'),
        ([Result.SKIPPED, Result.FAILED], 'failed'),
        ([], 'failed'),
    ],
)
def test_verdict_names_every_exception(
    machine: Machine, results: list[Result], verdict: str
) -> None:
    records = [_record(f'step {n}', result, reason='why') for n, result in enumerate(results)]
    report = _report(machine, *records)
    assert report['verdict'] == verdict
    open_ = [each for each in records if each.result not in (Result.PASSED, Result.FAILED)]
    assert len(report['exceptions']) == len(open_)


def test_command_verifies_and_checks(written: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(['verify', str(written)])
    assert 'passed on today' in capsys.readouterr().out
    changed = written.parent / 'changed.yaml'
    changed.write_text(FILE.read_text().replace('left: {max: 10.0}', 'left: {max: 12.0}'))
    for file, status in ((FILE, 0), (changed, 1)):
        with pytest.raises(SystemExit) as ended:
            main(['check', str(written), str(file)])
        assert ended.value.code == status
    assert 'not validated: joint.left.max was 10.0, is 12.0' in capsys.readouterr().out
    (written / 'report.html').write_text('x')
    with pytest.raises(SystemExit) as ended:
        main(['verify', str(written)])
    assert ended.value.code == 1


@pytest.mark.parametrize(
    'arguments', [['a', 'b'], ['nowhere.yaml'], [str(FILE), '--patience', '2']]
)
def test_wrong_arguments_are_refused(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2


# At a terminal


@pytest.mark.parametrize('kind', ['text', 'number', ('left', 'right')])
def test_input_that_ends_leaves_the_trial(
    kind: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('sys.stdin', io.StringIO('neither\n' if kind != 'text' else ''))
    step = Step(name='a', title='A')
    with pytest.raises(LeftError):
        Terminal({}).ask(step, Question('q', 'Which?', kind))
    assert capsys.readouterr().out.count('Which?') <= 2


@pytest.mark.parametrize('prompts', [False, True])
def test_key_that_was_hit_before_it_was_asked_for_begins_nothing(
    prompts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    master, slave = os.openpty()
    flush = termios.tcflush

    def flush_then_type(*given: int) -> None:
        flush(*given)
        os.write(master, b's\nnobody is there\n')

    os.write(master, b'\n')
    monkeypatch.setattr(termios, 'tcflush', flush_then_type)
    with os.fdopen(slave) as terminal:
        monkeypatch.setattr('sys.stdin', terminal)
        if prompts:
            Terminal({}).prompt('End the mux')
            assert line_of('') == 'nobody is there'
        else:
            step = Step(name='a', title='A', moves=True)
            assert Terminal({}).begin(step) == 'nobody is there'
    os.close(master)


@pytest.fixture
def killed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the signals that were sent to a process."""
    sent: list[int] = []
    monkeypatch.setattr(os, 'kill', lambda _, number: sent.append(number))
    return sent


def _of_process(line: str) -> Act:
    return Act('do it', '/python', (line,), pid=os.getpid())


@pytest.mark.parametrize(('typed', 'kills'), [('', True), ('n', False)])
def test_nothing_stands_still_while_it_is_asked_whether_to_kill(
    monkeypatch: pytest.MonkeyPatch, killed: list[int], typed: str, kills: bool
) -> None:
    """What the trial moves would rest before what is to be seen."""
    read, write = os.pipe()
    terminal = Terminal({})
    with os.fdopen(read) as typing:
        monkeypatch.setattr('sys.stdin', typing)
        for _ in range(2):
            assert not terminal.act(_of_process('kill'))
            assert terminal.wish() == ''
        os.write(write, f'{typed}\n'.encode())
        assert terminal.wish() == ''
        assert terminal.act(_of_process('kill'))
        assert killed == [SIGKILL] * kills
        os.write(write, b'\n')
        assert terminal.wish() == 'done'
    os.close(write)


@pytest.mark.parametrize(
    ('error', 'says'),
    [
        (None, ''),
        (PermissionError, 'It is of another user: do it yourself'),
        (ProcessLookupError, ''),
    ],
)
def test_what_was_frozen_goes_on_without_a_question(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: type[OSError] | None,
    says: str,
) -> None:
    """The terminal may be gone; and what cannot be reached ends no trial."""

    def kill(pid: int, number: int) -> None:
        assert number == SIGCONT
        if error:
            raise error

    monkeypatch.setattr(os, 'kill', kill)
    assert Terminal({}).act(_of_process('thaw'))
    assert says in capsys.readouterr().out
    assert Terminal({}).act(replace(_of_process('thaw'), pid=1 << 30))
    assert '-> do it' in capsys.readouterr().out


def test_terminal_that_is_gone_keeps_nothing_from_being_undone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(_: str) -> None:
        raise OSError(errno.EIO, 'Input/output error')

    monkeypatch.setattr('sys.stdout', SimpleNamespace(write=fail, flush=lambda: None))
    assert Terminal({}).act(Act('Let go of the stick'))


# What the mux says


def _tried(machine: Machine, path: Path, **changes: Any) -> Any:
    values: Mapping[str, Any] = {
        **machine.values,
        'commissioning.report': str(path / 'report.json'),
        **changes,
    }
    return tried(values, MUX)


def test_mux_with_what_was_tried_says_when_and_by_whom(machine: Machine, written: Path) -> None:
    found = _tried(machine, written)
    assert found.words == 'commissioned on today by x & <y>: passed'
    assert not found.problem
    assert _tried(machine, written, **{'commissioning.required': True}) == found
    assert tried(machine.values, MUX) is None


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({'version': '0.0.1'}, 'the package was 0.0.1'),
        ({'simulated': True}, 'simulated machine'),
        ({'verdict': 'failed'}, 'the trial failed'),
        ({'parameters': {}}, 'of another machine, of no nodes'),
        ({'parameters': {'/other/safety_mux': {}}}, 'of another machine, of /other/safety_mux'),
        ({'parameters': 3}, 'is no report'),
        (None, 'is no report: No such file'),
        ('{', 'is no report: Expecting property name'),
        ('[]', 'is no report: list indices'),
        ('{}', "is no report: it has no 'date'"),
        ('[' * 100_000, 'is no report: maximum recursion depth'),
    ],
)
def test_trial_that_does_not_count_is_named(
    machine: Machine, written: Path, change: dict[str, Any] | str | None, says: str
) -> None:
    path = written / 'report.json'
    if isinstance(change, dict):
        change = json.dumps({**json.loads(path.read_text()), **change})
    path.unlink()
    if change is not None:
        path.write_text(change)
    found = _tried(machine, written)
    assert found.problem.startswith('not validated: ')
    assert says in found.problem
    with pytest.raises(ParameterError, match='not validated'):
        _tried(machine, written, **{'commissioning.required': True})


def test_changed_parameter_is_named_and_stops_nothing_by_itself(
    machine: Machine, written: Path
) -> None:
    five = [f'left.{each}' for each in ('max', 'acceleration', 'deceleration')]
    five += ['right.max', 'right.acceleration']
    told = _tried(machine, written, **{f'joint.{name}': 11.5 for name in five}).problem
    assert 'more' not in told
    changed = {'joint.left.max': 12.0}
    found = _tried(machine, written, **changed)
    assert found.problem == 'not validated: joint.left.max was 10.0, is 12.0'
    with pytest.raises(ParameterError, match=r'joint\.left\.max was 10\.0, is 12\.0'):
        _tried(machine, written, **changed, **{'commissioning.required': True})
    with pytest.raises(ParameterError, match='is empty'):
        tried({**machine.values, 'commissioning.required': True}, MUX)
