# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reasons as data: on their way through processes and key-value pairs, and which comes first."""

import pickle

import pytest

from bridge_core.reasons import (
    cause_of,
    causes,
    Coded,
    entries,
    from_values,
    in_a_line,
    passed_on,
    to_values,
)

CATALOGUE = entries("""
x.stop: stop, operator: {name} stops
    it stops …
    -> Release it
    -> Reset
    more x.md
x.step: step, operator: The next step
    go on
    -> Go
        on
x.echo x.other: echo, nobody: It follows
    …
    -> Wait
x.note: note, nobody: By the way
    …
    -> Look
""")
STOP, SAME = Coded('x.stop', 'it stops', name='a'), Coded('x.stop', 'a cannot: it stops', name='a')
STEP, ECHO, NOTE = (Coded(f'x.{word}', word) for word in ('step', 'echo', 'note'))


def test_reason_is_its_sentence_and_keeps_its_code_through_a_process() -> None:
    again = pickle.loads(pickle.dumps(STOP))
    assert (again, again.code, again.fields) == ('it stops', 'x.stop', {'name': 'a'})
    assert type(again) is Coded


def test_reasons_come_back_from_values_by_the_number_of_their_sentence() -> None:
    values = to_values([ECHO, 'of another', STOP], CATALOGUE)
    assert values == {
        'code': 'x.stop',
        'code.1': 'x.echo',
        'code.1.severity': 'echo',
        'code.3': 'x.stop',
        'code.3.name': 'a',
        'code.3.severity': 'stop',
    }
    found = from_values(values, ['echo', 'of another', 'it stops'])
    assert [getattr(each, 'code', '') for each in found] == ['x.echo', '', 'x.stop']
    assert cause_of(found[2], CATALOGUE) == 'a stops'
    assert from_values({}, ['x']) == ['x']
    # Who has no catalogue ranks them alike, whatever their number.
    assert causes(found[::2], {}) == causes(found[::2], CATALOGUE) == ['it stops']


@pytest.mark.parametrize('number', ['1000000000', '9' * 5000, '0', '-1', '٣'])
def test_number_that_no_reason_has_costs_no_time_and_no_memory(number: str) -> None:
    found = from_values({f'code.{number}': 'x.stop', f'code.{number}.name': 'a', 'code.1': 'x.y'})
    assert [each.code for each in found if isinstance(each, Coded)] == ['x.y']
    assert len(found) == 1


@pytest.mark.parametrize(
    ('said', 'first'),
    [
        ([STEP, ECHO, STOP, SAME], [STOP, STEP]),  # twice the same, and what follows from it
        ([NOTE, STEP, ECHO], [ECHO, STEP]),  # no stop explains it
        ([NOTE], [NOTE]),
        ([STEP, 'of another'], ['of another', STEP]),  # what nobody knows may be a stop
        ([Coded('x.stop', 's', name='b'), STOP], ['s', STOP]),
        ([], []),
    ],
)
def test_cause_stands_first_and_once(said: list[str], first: list[str]) -> None:
    assert causes(said, CATALOGUE) == first


def test_what_passes_a_reason_on_has_its_code() -> None:
    text = passed_on(STOP, f'b waits: {STOP}', 'x.step')
    assert (text, text.code, text.fields) == ('b waits: it stops', 'x.stop', {'name': 'a'})
    assert passed_on('plain', 'y', 'x.step', n=1).fields == {'n': 1}


def test_catalogue_is_read_with_lines_that_go_on() -> None:
    assert list(CATALOGUE) == ['x.stop', 'x.step', 'x.echo', 'x.other', 'x.note']
    assert CATALOGUE['x.step'].steps == ('Go on',)
    assert CATALOGUE['x.stop'].more == 'x.md'


def test_code_that_stands_twice_is_refused() -> None:
    with pytest.raises(ValueError, match='stands there twice'):
        entries('x.stop: stop, operator: A\n    a\nx.stop x.b: note, operator: B\n    b')


@pytest.mark.parametrize(
    ('steps', 'line'),
    [([], ''), (['Reset'], 'Reset'), (['Release it', 'Reset'], '1 Release it. 2 Reset')],
)
def test_steps_stand_in_a_line_numbered_where_there_are_several(
    steps: list[str], line: str
) -> None:
    assert in_a_line(steps) == line
