# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is generated from the parameter tables: files with the defaults, tables of whole rows."""

import re
from typing import Any

import pytest
import yaml

from bridge_core.parameters import Parameter, resolve
from rugged_teleop import reference
from rugged_teleop.reference import Node, NODES, Table
from rugged_teleop.schema import GENERIC

each_node = pytest.mark.parametrize('node', NODES, ids=lambda node: node.name)


def flat(tree: dict[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return nested maps as ROS reads them: names joined by dots."""
    values: dict[str, Any] = {}
    for name, value in tree.items():
        full = f'{prefix}{name}'
        values |= flat(value, f'{full}.') if isinstance(value, dict) else {full: value}
    return values


def values_of(node: Node, text: str) -> dict[str, Any]:
    ((section, body),) = yaml.safe_load(text).items()
    # With the wildcard the file serves in every namespace; the stack goes by the last part.
    assert section == f'/**/{node.name}'
    assert list(body) == ['ros__parameters']
    return flat(body['ros__parameters'])


@each_node
def test_values_of_the_file_are_the_defaults_in_their_own_types(node: Node) -> None:
    values = values_of(node, reference.parameter_file(node))
    table = {p.name: p for p in (*node.common, *node.table({}))}
    assert values == {name: p.default for name, p in table.items()}
    # 1 is equal to 1.0 and to true, yet ROS would see another type.
    for name, parameter in table.items():
        assert type(values[name]) is type(parameter.default), name
    assert resolve(table.values(), values) == values


@each_node
def test_each_parameter_of_the_file_is_explained_once(node: Node) -> None:
    lines = [line.strip() for line in reference.parameter_file(node).splitlines()]
    explained = [line for line in lines if re.match(r'(# +)?\w+: .* # ', line)]
    kinds = {(p.name.split('.')[0], p.name.split('.')[-1]) for p in whole_table(node)}
    assert len(explained) == len(kinds)


def whole_table(node: Node) -> Table:
    return (*node.common, *node.generic_table())


@each_node
def test_ends_of_a_range_are_allowed_as_they_are_shown(node: Node) -> None:
    for each in whole_table(node):
        for end in (each.minimum, each.maximum):
            assert end is None or each.hex_digits or float(f'{end:g}') == end, each.name


def test_example_of_a_list_that_names_nothing_is_what_a_name_there_would_bring() -> None:
    (ssc,) = (node for node in NODES if node.name == 'ssc_bridge')
    text = reference.parameter_file(ssc).replace("servos: ['']", 'servos: [pan]')
    example = re.sub(r'^    # (?=servo:|  )', '    ', text, flags=re.MULTILINE)
    values = values_of(ssc, example.replace(GENERIC, 'pan'))
    table = (*ssc.common, *ssc.table({'servos': ['pan']}))
    assert values == {p.name: p.default for p in table} | {'servos': ['pan']}


@each_node
def test_no_text_breaks_its_row_or_is_taken_for_markup(node: Node) -> None:
    table = reference.markdown_table(whole_table(node), node.table({}))
    for row in table[table.index('|') :].splitlines():
        assert row.count('|') == 5, row
        assert not re.search(r'[<*~]', re.sub('`[^`]*`', '', row)), row


def test_restart_is_a_mark_with_a_legend_and_a_meaning_stands_once() -> None:
    fixed = Parameter('a.rate', 1.0, 'How often.', fixed=True)
    again = Parameter('b.rate', 1.0, 'How often.')
    legend, _, *_, first, second = reference.markdown_table([fixed, again], []).splitlines()
    assert legend == '† needs a restart.'
    assert first == '| `a.rate`† | `1.0` |  | How often. |'
    assert second == '| `b.rate` | `1.0` |  | As `a.rate`. |'
    assert '†' not in reference.markdown_table([again], [])


def test_names_with_defaults_of_their_own_are_shown_before_the_others() -> None:
    general = Parameter('joint.<name>.max', 1.0, 'Limit.', unit='m', above=0.0)
    named = [general.named('joint.a.max', 5.0), general.named('joint.b.max')]
    assert reference.markdown_table([general], named).splitlines()[-1] == (
        '| `joint.<name>.max` | a: `5.0`; others: `1.0` | above 0 m | Limit. |'
    )


def test_number_that_is_written_in_hexadecimal_is_allowed_in_hexadecimal() -> None:
    address = Parameter('address', 0x33, 'Ours.', minimum=0x10, maximum=0xFE, hex_digits=4)
    assert reference.markdown_table([address], []).splitlines()[-1] == (
        '| `address` | `0x0033` | 0x10 to 0xFE | Ours. |'
    )


def test_table_replaces_the_one_before_and_nothing_else() -> None:
    page = f'a\n{reference.BEGIN}\n| old |\n{reference.END}\nb\n'
    once = reference.with_table(page, '| new |\n')
    assert once == f'a\n{reference.BEGIN}\n\n| new |\n\n{reference.END}\nb\n'
    assert reference.with_table(once, '| new |\n') == once


@pytest.mark.parametrize('page', ['', reference.BEGIN, f'{reference.END}{reference.BEGIN}'])
def test_page_without_a_place_for_its_table_is_refused(page: str) -> None:
    with pytest.raises(ValueError, match='a page needs the lines'):
        reference.with_table(page, '')
