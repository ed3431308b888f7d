# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters as data: every way to give a bad one ends in one line that says what is allowed."""

import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.parameters import Parameter, ParameterError, resolve, with_named

RATE = Parameter('rate', 20.0, 'How often.', unit='Hz', minimum=5.0, maximum=200.0)
TIMEOUT = Parameter('timeout', 0.25, 'How long.', unit='s', above=0.0)
COUNT = Parameter('count', 3, 'How many.', minimum=1, maximum=4_000_000)
FLAG = Parameter('flag', False, 'Whether.')
TEXT = Parameter('text', '', 'What.')
MODE = Parameter('mode', 'torque', 'Which.', choices=('torque', 'velocity'))
SCALES = Parameter('scales', [1.0, 1.0], 'Factors.', minimum=-2.0, maximum=2.0)
NAMES = Parameter('names', ['a'], 'Names.')
MODES = Parameter('modes', ['torque'], 'Which ones.', choices=('torque', 'velocity'))
SOURCES = Parameter('sources', [], 'Names, none by default.')


def refused(parameter: Parameter, value: Any) -> str:
    with pytest.raises(ParameterError) as caught:
        resolve([parameter], {parameter.name: value})
    text = str(caught.value)
    assert text.startswith(f'parameter {parameter.name} = {value!r}: ')
    assert '\n' not in text
    return text.split(': ', 1)[1]


@pytest.mark.parametrize(
    ('parameter', 'allowed'),
    [
        (RATE, 'allowed is a number from 5 to 200 Hz'),
        (TIMEOUT, 'allowed is a number above 0 s'),
        (COUNT, 'allowed is a whole number from 1 to 4000000'),
        (FLAG, 'allowed is true or false'),
        (TEXT, 'allowed is a string'),
        (MODE, "allowed is one of 'torque', 'velocity'"),
        (SCALES, 'allowed is a list, each a number from -2 to 2'),
        (NAMES, 'allowed is a list, each a string'),
        (MODES, "allowed is a list, each one of 'torque', 'velocity'"),
    ],
    ids=lambda item: item.name if isinstance(item, Parameter) else '',
)
def test_value_of_no_type_at_all_names_what_is_allowed(parameter: Parameter, allowed: str) -> None:
    assert refused(parameter, None) == allowed


WRONG = [
    *[(RATE, value) for value in (math.nan, math.inf, -math.inf, 4.999, 200.1, -20.0, '20', True)],
    *[(RATE, value) for value in ([20.0], [], 201, 0)],
    *[(TIMEOUT, value) for value in (0.0, 0, -0.0, -1, math.nan, math.inf, '0.25')],
    *[(COUNT, value) for value in (0, -1, 4_000_001, 1.0, 3.5, True, '3', [3])],
    *[(FLAG, value) for value in (0, 1, 'true', '', [True])],
    *[(TEXT, value) for value in (0, 1.0, True, ['a'])],
    *[(MODE, value) for value in ('', 'Torque', 'position', 0, True)],
    *[(SCALES, value) for value in ([math.nan, 1.0], [1.0, 2.1], [1.0, 'x'], ['1.0'], 'x')],
    *[(SCALES, value) for value in ([True], [[1.0]])],
    *[(NAMES, value) for value in ([1], ['a', 1.0], 1)],
    *[(MODES, value) for value in (['torque', 'x'], [1])],
    *[(SOURCES, value) for value in ([1], [1.0], [True])],
]


@pytest.mark.parametrize(('parameter', 'value'), WRONG, ids=lambda item: getattr(item, 'name', ''))
def test_wrong_type_nan_or_out_of_range_is_refused(parameter: Parameter, value: Any) -> None:
    assert parameter.allowed in refused(parameter, value)


@pytest.mark.parametrize(
    ('parameter', 'value', 'result'),
    [
        (RATE, 5, 5.0),
        (RATE, 200.0, 200.0),
        (TIMEOUT, 1e-9, 1e-9),
        (COUNT, 4_000_000, 4_000_000),
        (FLAG, True, True),
        (TEXT, 'nan', 'nan'),
        (MODE, 'velocity', 'velocity'),
        (SCALES, [1, -2], [1.0, -2.0]),
        (SCALES, (0.5,), [0.5]),
        (SCALES, 2, [2.0]),
        (NAMES, [], []),
        (NAMES, 'one', ['one']),
        (SOURCES, ['fort', 'vm'], ['fort', 'vm']),
    ],
)
def test_good_value_comes_out_in_the_parameters_own_type(
    parameter: Parameter, value: Any, result: Any
) -> None:
    got = resolve([parameter], {parameter.name: value})[parameter.name]
    assert got == result
    assert type(got) is type(result)
    if isinstance(result, list):
        assert [type(item) for item in got] == [type(item) for item in result]


@pytest.mark.parametrize('names', [['', 'a'], ['a', ''], ['', '']])
def test_empty_name_beside_others_is_not_passed_over(names: list[str]) -> None:
    assert refused(NAMES, names) == "'' is none, and stands alone"
    assert resolve([NAMES], {'names': ['']}) == {'names': ['']}


def test_defaults_are_checked_too() -> None:
    with pytest.raises(ParameterError, match=r'^parameter rate = 1\.0: '):
        resolve([Parameter('rate', 1.0, '', minimum=5.0)], {})


def test_default_list_is_not_shared_between_nodes() -> None:
    first = resolve([SCALES], {})['scales']
    first.append(9.0)
    assert resolve([SCALES], {})['scales'] == [1.0, 1.0]


def test_unknown_name_is_refused_and_a_near_one_proposed() -> None:
    with pytest.raises(ParameterError) as caught:
        resolve([RATE, TIMEOUT], {'rate': 20.0, 'timout': 1.0})
    assert str(caught.value) == (
        'parameter timout: there is no such parameter; did you mean timeout?'
    )
    with pytest.raises(ParameterError, match=r'^parameter xyz: there is no such parameter$'):
        resolve([RATE], {'xyz': 1})


def test_own_check_names_parameter_value_and_reason() -> None:
    def even(value: int) -> None:
        if value % 2:
            raise ValueError('must be even')

    parameter = Parameter('count', 2, '', check=even)
    assert resolve([parameter], {'count': 4}) == {'count': 4}
    assert refused(parameter, 3) == 'must be even'


def test_own_check_runs_only_on_values_of_the_right_type() -> None:
    seen: list[Any] = []
    parameter = Parameter('rate', 1.0, '', minimum=0.0, check=seen.append)
    for bad in ('x', math.nan, -1.0):
        refused(parameter, bad)
    assert seen == []
    resolve([parameter], {'rate': 2})
    assert seen == [2.0]


def test_named_copy_keeps_its_range() -> None:
    copy = RATE.named('left.rate', 10.0)
    assert copy.name == 'left.rate'
    assert copy.default == 10.0
    assert refused(copy, 1.0) == 'allowed is a number from 5 to 200 Hz'
    assert FLAG.named('other', False).default is False
    assert RATE.named('other').default == 20.0


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=4,
)
ALL = [RATE, TIMEOUT, COUNT, FLAG, TEXT, MODE, SCALES, NAMES, MODES, SOURCES]


@given(st.sampled_from(ALL), ANYTHING)
def test_anything_is_either_taken_or_refused_in_one_line(parameter: Parameter, value: Any) -> None:
    error = ''
    try:
        got = resolve([parameter], {parameter.name: value})[parameter.name]
    except ParameterError as refusal:
        error = str(refusal)
    if error:
        assert len(error.splitlines()) == 1
        assert parameter.name in error
    else:
        items = got if isinstance(parameter.default, list) else [got]
        assert type(got) is type(parameter.default)
        assert all(not isinstance(item, float) or math.isfinite(item) for item in items)


# Parameters of what lists name.

_GENERAL = (Parameter('joints', ['left'], 'Names.'),)
_GROUPS = (
    ('joints', 'joint', (Parameter('max', 1.0, 'Limit.'), Parameter('min', 0.0, 'Limit.'))),
)


@pytest.mark.parametrize(
    ('given', 'names'),
    [({}, ['left']), ({'joints': ['a', 'b']}, ['a', 'b']), ({'joints': ['']}, [])],
)
def test_each_name_has_the_parameters_of_its_group(
    given: dict[str, Any], names: list[str]
) -> None:
    table = {p.name: p for p in with_named(_GENERAL, _GROUPS, given, {'joint.left.max': 5.0})}
    assert list(table) == [
        'joints',
        *(f'joint.{n}.{what}' for n in names for what in ('max', 'min')),
    ]
    assert [table[f'joint.{n}.max'].default for n in names] == [
        5.0 if n == 'left' else 1.0 for n in names
    ]


def test_list_of_names_is_fixed() -> None:
    """A running node has no parameters of a name that is new."""
    first, *others = with_named(_GENERAL, _GROUPS, {}, {})
    assert first.fixed
    assert not any(each.fixed for each in others)


def test_list_of_names_that_is_none_is_refused() -> None:
    with pytest.raises(ParameterError, match='parameter joints = 5'):
        with_named(_GENERAL, _GROUPS, {'joints': 5}, {})
