# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Several faults at once: all who show them name the same one first, and say its steps once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
import itertools
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core.diagnostics import to_msg
from bridge_core.reasons import Coded, entries, Severity, to_values
from bridge_core.report import Status
from bridge_core.session import Level
from fort_vsc_bridge.display_texts import lines_of, status_from
from rugged_teleop.commission.looks import instead
from rugged_teleop.doctor.graph import Graph, graph_findings, Said
from rugged_teleop.doctor.main import _as_list
from rugged_teleop.operate import _told
from rugged_teleop.reasons import catalogue, markdown_table, to_do
from rugged_teleop.why.story import _cause
from safety_mux.device_words import DeviceWords
from safety_mux.report import report_of, Surroundings
from stage.page_rig import model, MUX
from stage.safety_mux_bench import Bench

AROUND = Surroundings('', (), None, {}, {}, {}, None)
# Of mux, of all nodes and of devices, of each severity: as somebody said it.
FAULTS = (
    *('mux.source.stale', 'mux.button.held', 'mux.source.echo', 'mux.reset.due', 'mux.joy.held'),
    *('mux.operator.stale', 'mux.stopped', 'link.interrupted', 'gate.stopped', 'gate.neutral'),
    *('fort.estop.remote', 'fort.remote.off', 'fort.remote.menu', 'fort.battery.low'),
    *('esi.clear', 'vm110.ru.stopped', 'acme.unknown'),
)


def heard(code: str, node: str = 'a/drive') -> Coded:
    """Return a fault as the mux has it: what a device says comes by /diagnostics."""
    if code.startswith('mux.'):
        return Coded(code, f'{code}!', source='near', operator='near')
    said = Status(Level.ERROR, f'{code}!', {}, [Coded(code, f'{code}!')])
    words: list[Any] = []
    device = DeviceWords(lambda kind, name, text: words.append(text))
    device.listen('drive', 'd', f'/{node}/enabled')
    device.hear_diagnostics([to_msg(said, f'{node}: device', '', catalogue())])
    device.pass_on(0.0)
    assert isinstance(words[0], Coded)
    return words[0]


def status_of(*inhibits: Coded) -> dict[str, str]:
    """Return the values of ~/status of a mux that is kept still by these."""
    bench = Bench()
    bench.run(0.1)
    status = replace(bench.arbiter.status(bench.now), inhibits=inhibits)
    said = to_msg(report_of(status, AROUND, bench.now), MUX[1:], '')
    return {pair.key: pair.value for pair in said.values}


def on_page(values: Mapping[str, str]) -> dict[str, Any]:
    page = model()
    page.status(MUX, dict(values), 1.0)
    page.state(MUX, values['state'], 1.0)
    (now,) = page.snapshot(1.1, 1.0)['muxes'][0]['now']
    return dict(now)


@pytest.mark.parametrize('pair', [*itertools.permutations(FAULTS, 2)], ids=' '.join)
def test_two_faults_at_once_have_one_order_wherever_they_are_shown(pair: tuple[str, str]) -> None:
    reasons = [heard(code) for code in pair]
    values = status_of(*reasons)
    first = to_do(reasons, values['state'])
    assert first is not None
    assert values['code'] == first.code
    assert on_page(values)['code'] == first.code
    assert _told(values).splitlines()[1] == first.line
    said = Said.of('safety_mux', 1, '', values)
    (still,) = (each for each in graph_findings(Graph([], [said])) if each.kind == 'still')
    assert (still.code, still.text) == (first.code, f'safety_mux: it does not move: {first.cause}')
    remote = status_from(values, '')
    assert remote.code == first.code
    assert lines_of(remote)
    stops = [
        each
        for each in pair
        if catalogue().get(each, catalogue()['mux.inactive'])[0] is Severity.STOP
    ]
    trial: Any = SimpleNamespace(
        channels=lambda kind: [],
        last=lambda kind, *_: values if kind == 'status' else values['state'],
    )
    assert instead(trial, 0.0).endswith(f'the mux is STOPPED: {first.code}!')
    told = [*_cause([values])]
    assert bool(told) == (first.code in stops and first.code in catalogue())
    assert all(f'[{first.code}]' in line for line in told)


def test_warnings_of_the_mux_never_stand_before_what_keeps_it_still() -> None:
    for code in (
        'mux.operator.may_be_gone',
        'mux.input.creeping',
        'gate.creeping',
        'mux.commissioning',
    ):
        assert catalogue()[code].severity is Severity.NOTE


@pytest.mark.parametrize(
    ('reasons', 'cause'),
    [
        # Two drives with one cause.
        (
            [heard('esi.motor_temperature.a', node) for node in ('left/esi', 'right/esi')],
            '{} (left/esi, right/esi)',
        ),
        # One device, whose words two inputs pass on.
        ([heard('esi.motor_temperature.a', 'left/esi')] * 2, '{}'),
        # The cause names the first.
        (
            [Coded('mux.source.stale', name, source=name) for name in ('near', 'far')],
            'The node of near is not heard (far, too)',
        ),
        # Of another node, which has no codes.
        (['one', 'other'], 'one'),
    ],
)
def test_steps_of_a_code_are_said_once_with_who_is_concerned(
    reasons: list[str], cause: str
) -> None:
    first = to_do(reasons, 'READY')
    assert first is not None
    catalogued = catalogue().get(first.code)
    assert first.cause == cause.format(catalogued.cause if catalogued else '')
    values = {'state': 'READY'} | {f'inhibit {n}': each for n, each in enumerate(reasons, 1)}
    told = _told(values | to_values(reasons, catalogue()))
    for step in first.steps:
        assert told.count(step) == 1
    assert told.count(f'[{first.code}]') == len(reasons) * bool(first.code)
    said = Said.of('safety_mux', 1, '', values | to_values(reasons, catalogue()))
    listed = _as_list([*graph_findings(Graph([], [said]))], False).partition('\n')[2]
    assert all(listed.count(step) == 1 for step in first.steps)


@pytest.mark.parametrize(
    ('sentence', 'more', 'cell'),
    [
        ('charge the remote: its battery is at … %', '', 'as it says'),
        ('the battery of a remote is at … %: charge it', '', 'as it says'),
        ('its battery is at … %', '', 'Charge the remote'),
        ('charge the remotes', '', 'Charge the remote'),
        ('charge the remote', 'Reset', 'Charge the remote. Reset'),
        ('charge the remote; keep it dry', 'Keep it dry\n    -> Reset', 'as it says. Reset'),
    ],
)
def test_page_repeats_no_step_that_the_sentence_says(sentence: str, more: str, cell: str) -> None:
    steps = 'Charge the remote' + f'\n    -> {more}' * bool(more)
    table = entries(f"""
x.low: note, operator: It is low
    {sentence}
    -> {steps}
""")
    assert markdown_table(table, 'message').splitlines()[-1].endswith(f'| operator | {cell} |')


def test_page_keeps_all_steps_where_the_sentence_says_some() -> None:
    table = entries("""
x.hot: stop, operator: It is hot
    let it cool, it is hot
    -> Let it cool
    -> Clear its errors
""")
    assert markdown_table(table, 'message').endswith('| Let it cool. Clear its errors |\n')
