# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What nodes say of their devices: to whom it is passed on, and for how long it is believed."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core.reasons import Coded
from safety_mux.device_words import DeviceWords
from safety_mux.inputs import SourceInput
from safety_mux.settings import EStopSource

OK, WARN = b'\0', b'\1'
SOURCE, OPERATOR, DRIVE = ('e-stop source', 'fort'), ('operator', 'a'), ('drive', 'left')
TOPICS = {
    SOURCE: '/x/remote/estop',
    OPERATOR: '/x/remote/joy',
    DRIVE: '/x/esi/enabled',
    ('autonomy', 'autonomy'): '/x/remote/plan',
}


class Bench:
    def __init__(self) -> None:
        self.words: dict[tuple[str, str], str] = {}
        self.device = DeviceWords(
            lambda kind, name, words: self.words.update({(kind, name): words})
        )
        for (kind, name), topic in TOPICS.items():
            self.device.listen(kind, name, topic)  # type: ignore[arg-type]

    def say(
        self,
        message: str,
        level: bytes = OK,
        node: str = 'x/remote',
        now: float = 1.0,
        values: Sequence[Any] = (),
    ) -> Any:
        status = SimpleNamespace(
            name=f'{node}: device', level=level, message=message, values=values
        )
        waits = self.device.hear_diagnostics([status])
        self.device.pass_on(now)
        return waits


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize(
    ('level', 'message', 'of_source', 'of_operator'),
    [
        (OK, 'ok', '', ''),
        (OK, 'ok; in a menu', '', 'in a menu'),
        (WARN, 'pull the button', 'pull the button', 'pull the button'),
        (WARN, 'call ~/clear, ~/x', 'call /x/remote/clear, /x/remote/x', None),
        (WARN, 'x' * 1001, 'x' * 1000, None),
    ],
)
def test_words_go_to_the_inputs_of_their_node(
    bench: Bench, level: bytes, message: str, of_source: str, of_operator: str | None
) -> None:
    assert bench.say(message, level)
    operator = of_source if of_operator is None else of_operator
    assert bench.words == {SOURCE: of_source, OPERATOR: operator}


def test_words_keep_their_code_and_node_and_words_without_one_get_none(bench: Bench) -> None:
    bench.say('ok; in a menu', values=[SimpleNamespace(key='code.1', value='x.menu')])
    words = bench.words[OPERATOR]
    assert isinstance(words, Coded)
    assert (words.code, words.fields) == ('x.menu', {'node': 'x/remote'})
    bench.say('ok; of a foreign node', now=2.0)
    assert not isinstance(bench.words[OPERATOR], Coded)  # or the mux would pass on no code


def test_words_of_others_are_nobodys(bench: Bench) -> None:
    for node in ('remote', 'x/y/remote', 'x'):
        assert not bench.say('ok; in a menu', node=node)
    assert not bench.device.hear_diagnostics(
        [SimpleNamespace(name='x/remote: link', level=OK, message='x', values=())]
    )
    assert bench.words == {}


def test_words_end_with_those_that_say_them(bench: Bench) -> None:
    bench.say('ok; in a menu', now=1.0)
    bench.say('ok; disabled', now=2.0, node='x/esi')
    bench.device.forget_old(4.0)
    assert bench.words == {SOURCE: '', OPERATOR: 'in a menu', DRIVE: 'disabled'}
    bench.device.forget_old(4.01)
    assert bench.words == {SOURCE: '', OPERATOR: '', DRIVE: 'disabled'}
    bench.words.clear()
    bench.device.forget_old(4.02)
    assert bench.words == {}
    bench.say('ok; in a menu', now=4.1)
    assert bench.words[OPERATOR] == 'in a menu'


def test_words_are_passed_on_once_and_the_newest_only(bench: Bench) -> None:
    for message in ('first', 'second'):
        status = SimpleNamespace(name='x/remote: device', level=WARN, message=message, values=())
        assert bench.device.hear_diagnostics([status])
    bench.device.pass_on(1.0)
    assert bench.words == {SOURCE: 'second', OPERATOR: 'second'}
    assert not bench.device.hear_diagnostics([])
    bench.words.clear()
    bench.device.pass_on(1.0)
    assert bench.words == {}


def test_words_of_a_kind_are_taken_back(bench: Bench) -> None:
    bench.say('pull the button', WARN)
    bench.say('ok; disabled', node='x/esi')
    bench.device.forget('drive')
    assert bench.words == {SOURCE: 'pull the button', OPERATOR: 'pull the button', DRIVE: ''}


@pytest.mark.parametrize('field', ['node', 'code', 'text', 'cls', 'severity'])
def test_field_of_a_foreign_node_with_a_name_of_ours_harms_nothing(
    bench: Bench, field: str
) -> None:
    pairs = {'code.1': 'x.menu', f'code.1.{field}': 'other'}
    bench.say('x', WARN, values=[SimpleNamespace(key=k, value=v) for k, v in pairs.items()])
    words = bench.words[SOURCE]
    assert isinstance(words, Coded)
    assert words.fields == {field: 'other'} | {'node': 'x/remote'}


def test_note_of_a_device_is_not_why_its_node_is_stale() -> None:
    source = SourceInput(EStopSource('fort', 0.2))
    source.estop(False, 0.0)
    codes = {}
    for severity in ('note', 'step', 'stop'):
        source.device_words = Coded('x.said', 'said', severity=severity, node='x/remote')
        reason = source.stop_reason(1.0)
        assert reason is not None
        assert 'its device says: said' in reason
        codes[severity] = reason.code
    assert codes == {'note': 'mux.source.stale', 'step': 'x.said', 'stop': 'x.said'}


def test_diagnostic_of_nonsense_is_cut_and_ends_nothing(bench: Bench) -> None:
    said = {'code.1': 'x' * 10**6, 'code.1.node': 'other', 'code.1.name': 'y' * 10**6}
    said['code.1000000000'] = 'z'
    values = [SimpleNamespace(key=key, value=value) for key, value in said.items()]
    assert bench.say('{}' * 10**6, WARN, values=values)
    words = bench.words[SOURCE]
    assert isinstance(words, Coded)
    assert words.fields['node'] == 'x/remote'
    assert max(map(len, (words, words.code, words.fields['name']))) <= 1000
