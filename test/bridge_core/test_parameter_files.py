# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameter files: which sections are for a node, and that none is passed over in silence."""

from collections.abc import Iterator
import contextlib
import os
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
import yaml

from bridge_core.parameter_files import (
    beside,
    check_files,
    check_overrides,
    check_sections,
    files_of,
    parameters_for,
    sections_of,
)
from bridge_core.parameters import ParameterError
from bridge_core.runner import run
from safety_mux.node import SafetyMux
from stage.rig import run_python

NODE = '/left/safety_mux'
FOR_IT = (
    *('/left/safety_mux', 'left/safety_mux', '/**', '/**/safety_mux', '/left/**', '/*/safety_mux'),
    *('/left/*', '/**/left/safety_mux'),
)
NOT_FOR_IT = ('safety_mux', '/safety_mux', '/right/safety_mux', '/*', '/left/*/safety_mux')


@contextlib.contextmanager
def of_ros(*arguments: str, name: str = 'safety_mux', space: str = '/left') -> Iterator[Node]:
    """Give a plain node with these arguments, and with what ROS makes of them."""
    context = Context()
    rclpy.init(args=['--ros-args', *arguments], context=context)
    node = Node(
        name,
        namespace=space,
        context=context,
        automatically_declare_parameters_from_overrides=True,
    )
    yield node
    node.destroy_node()
    context.try_shutdown()


def given_by_ros(node: Node, *names: str) -> dict[str, Any]:
    return {name: node.get_parameter(name).value for name in names if node.has_parameter(name)}


def refused(capfd: Any, *arguments: str) -> str:
    """Show that the mux does not start with these arguments; return its last line."""
    assert run([SafetyMux], ['node', '--ros-args', *arguments]) == 2
    line: str = capfd.readouterr().err.splitlines()[-1]
    assert line.startswith('rugged_teleop: ')
    return line


def section(name: str) -> str:
    return f'"{name}": {{ros__parameters: {{rate: 50.0}}}}\n'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'params.yaml'


@pytest.mark.parametrize('name', [*FOR_IT, *NOT_FOR_IT])
def test_whom_a_section_is_for_is_what_ros_thinks(name: str, file: Path, tmp_path: Path) -> None:
    file.write_text(section(name))
    arguments = ['--params-file', str(file)]
    with of_ros(*arguments) as node:
        applied = given_by_ros(node, 'rate') == {'rate': 50.0}
    assert applied is (name in FOR_IT)
    assert files_of(arguments) == [file]
    empty = tmp_path / 'named.yaml'
    empty.write_text(section('/nowhere/safety_mux'))
    if applied:
        check_sections(NODE, [empty, file])
    else:
        with pytest.raises(ParameterError, match='for /left/safety_mux'):
            check_sections(NODE, [empty, file])


def test_sections_below_a_namespace_have_their_full_names(file: Path) -> None:
    file.write_text('left: {' + section('safety_mux').strip() + '}\n' + section('/right/other'))
    assert sections_of(file) == [NODE, '/right/other']
    check_sections(NODE, [file])


@pytest.mark.parametrize('order', [1, -1], ids=['general first', 'general last'])
def test_what_counts_of_several_sections_is_what_counts_in_ros(order: int, file: Path) -> None:
    sections = {
        '/**': {'a': 1, 'b': 1, 'c': 1},
        '/**/safety_mux': {'a': 2, 'b': 2, 'd': {'e': 2}},
        NODE: {'a': 3},
        '/other': {'f': 4},
    }
    content = {name: {'ros__parameters': sections[name]} for name in [*sections][::order]}
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    ours = parameters_for(NODE, [file])
    assert set(ours) == {'a', 'b', 'c', 'd.e'}
    with of_ros('--params-file', str(file)) as node:
        assert given_by_ros(node, *ours) == ours


def test_file_that_speaks_of_others_only_is_refused(file: Path) -> None:
    file.write_text(section('somebody_else') + section('/left/another'))
    text = 'no section for /left/safety_mux, .*; it has /somebody_else, /left/another'
    with pytest.raises(ParameterError, match=text):
        check_sections(NODE, [file])
    check_sections(NODE, [])


def test_each_file_has_to_be_for_somebody(file: Path, tmp_path: Path) -> None:
    other = tmp_path / 'other.yaml'
    file.write_text(section('/left/safety_mux'))
    other.write_text(section('/right/esi_drive_bridge'))
    check_files([NODE, '/right/esi_drive_bridge'], [file, other])
    with pytest.raises(ParameterError, match=r'other\.yaml: it has no section for /left'):
        check_files([NODE], [file, other])


@pytest.mark.parametrize(
    ('name', 'arguments', 'says'),
    [
        ('/**/safety_mxu', (), '/**/safety_mux'),
        ('/**/safety_mux', ('-r', '__node:=front_mux'), '/**/front_mux'),
        ('/**/esi_drive_bridge', (), '/**/safety_mux'),
        (
            '/safety_mux',
            ('-r', '__ns:=/left'),
            'its section /safety_mux is not for /left/safety_mux, and no other is; '
            'name it /**/safety_mux or /left/safety_mux',
        ),
    ],
    ids=['misspelt', 'renamed node', 'another node', 'another namespace'],
)
def test_node_that_its_file_is_not_for_does_not_start(
    name: str, arguments: tuple[str, ...], says: str, file: Path, capfd: Any
) -> None:
    file.write_text(section(name))
    line = refused(capfd, '--params-file', str(file), *arguments)
    assert name in line
    assert says in line


def test_parameters_of_a_node_are_those_that_ros_gives_it(file: Path, tmp_path: Path) -> None:
    file.write_text(
        '/**: {ros__parameters: {rate: 50.0, joint: {left: {max: 1.0}}}}\n'
        'right: {safety_mux: {ros__parameters: {rate: 1.0}}}\n'
    )
    other = tmp_path / 'other.yaml'
    other.write_text(f'{NODE}: {{ros__parameters: {{joint.left.max: 2.0, joints: [left]}}}}\n')
    by_ros = {'rate': 50.0, 'joint.left.max': 2.0, 'joints': ['left']}
    with of_ros('--params-file', str(file), '--params-file', str(other)) as node:
        assert given_by_ros(node, *by_ros) == by_ros
    assert parameters_for(NODE, [file, other]) == by_ros


MORE = '/**:\n  x: {ros__parameters: {a: 5}}\n  ros__parameters: {b: 5}\n'


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        (MORE, r"/\*\* has 'x' beside ros__parameters: give it a section"),
        ('/**/x: {ros__parameters: {a: {}, b: {}}}\n', 'a has no value'),  # ROS has a alone
    ],
)
def test_file_of_which_ros_takes_more_or_less_is_refused(text: str, why: str, file: Path) -> None:
    file.write_text(text)
    with pytest.raises(ParameterError, match=why):
        sections_of(file)


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('/**/x: {ros_parameters: {rate: 5.0}}', "/x has 'ros_parameters': write ros__parameters"),
        ('/**/x: {parameters: {rate: 5.0}}', "/x has 'parameters': write ros__parameters"),
        ('x: {rate: 5.0}', 'if it is a parameter of /x, write ros__parameters: above it'),
        ('/**: {ros__parameters: 5}', 'section /\\*\\* has 5, not a map'),
        ('/**/x:\n  ros__parameters:\n    # rate: 5.0\n', '/\\*\\*/x has no values: leave it out'),
        ('/**/x:\n/**:\n  ros__parameters: {rate: 5.0}\n', '/\\*\\*/x has no values'),
        ('/**/x: {ros__parameters: ""}\n', "has '', not a map"),
        ('rate: 5.0\n/**: {ros__parameters: {}}\n', 'section /rate has 5.0, not a map'),
        ('/**: &whole\n  ros__parameters: {again: *whole}', 'line 2: ROS takes no alias'),
        ('/**/x: {ros__parameters: {a: &v 5, b: *v}}\n', 'line 1: ROS takes no alias'),
        ('/**/x/: {ros__parameters: {}}\n', "/\\*\\*/x/ has a '/' too many"),
        ('//x: {ros__parameters: {}}\n', "//x has a '/' too many"),
        ('/**:\n  ros__parameters:\n    rates: \n', 'rates has no value'),
        *(
            (f'/**: {{ros__parameters: {{rates: {text}}}}}', 'rates = .* of several types, which')
            for text in ('[20, 5.0]', '[a, 1]', '[yes, 1]')
        ),
    ],
)
def test_file_that_yaml_reads_and_ros_does_not_is_refused(text: str, why: str, file: Path) -> None:
    file.write_text(text)
    with pytest.raises(RuntimeError, match="Couldn't parse params file"):
        rclpy.init(args=['--ros-args', '--params-file', str(file)], context=Context())
    with pytest.raises(ParameterError, match=why):
        parameters_for(NODE, [file])


SCALARS = (
    *('1e2', '1e-3', '.5', '1.', '1.e3', '-1.5E+3', '+.5', '1e', 'e1', '1e400', '1.5.2'),
    *('5', '+5', '-5', '0', '010', '08', '0x1F', '-0x10', '0b11', '0o17', '1_000', '12:30'),
    *('9223372036854775807', '9223372036854775808', '-9223372036854775809', '2001-01-01'),
    *('.inf', '-.inf', '.Inf', 'inf', '-INF', 'Infinity', '.nan', '.NaN', 'nan', 'NaN', '-nan'),
    *('y', 'Y', 'n', 'N', 'yes', 'Yes', 'no', 'NO', 'on', 'Off', 'true', 'True', 'tRue', 'FALSE'),
    *('null', '~', 'abc', "'y'", '"1e2"', "''"),
    *('!!int "5"', '!!int ""', '!!float 5', '!!str 5', '!!bool "yes"', '!!null x', '!mine 5'),
)


def test_our_idea_of_a_value_is_that_of_ros(file: Path) -> None:
    names = [f'value_{n}' for n in range(len(SCALARS))]
    lines = [f'    {name}: {text}\n' for name, text in zip(names, SCALARS, strict=True)]
    file.write_text(f'/**:\n  ros__parameters:\n    n: 1\n{"".join(lines)}')
    ours = parameters_for('/x', [file])
    assert ours.pop('n') == 1, 'a name is no truth value'
    with of_ros('--params-file', str(file), name='x', space='/') as node:
        theirs = given_by_ros(node, *names)
    assert {name: repr(value) for name, value in ours.items()} == {
        name: repr(value) for name, value in theirs.items()
    }


def test_file_is_read_as_utf_8_whatever_the_locale_says(file: Path) -> None:
    file.write_text('/**/x: {ros__parameters: {port: /dev/ü}}\n', encoding='utf-8')
    program = (
        'from pathlib import Path; from bridge_core.parameter_files import parameters_for as get; '
        f'print(ascii(get("/x", [Path({str(file)!r})])))'
    )
    plain = {'LC_ALL': 'C', 'PYTHONCOERCECLOCALE': '0', 'PYTHONUTF8': '0'}
    done = run_python('-c', program, env={**os.environ, **plain})
    assert done.stdout.strip() == ascii({'port': '/dev/ü'}), done.stderr


_TWICE = 'stands there twice; only one would count'


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        (
            '/**:\n  ros__parameters:\n    joints: [a]\n    rate: 50.0\n    joints: [b]\n',
            "line 5: 'joints'",
        ),
        (section('/**/safety_mux') * 2, "line 2: '/\\*\\*/safety_mux'"),
        ('/**: {ros__parameters: {joint: {a: 1, "a": 2}}}', "line 1: 'a'"),
        ('/**: {ros__parameters: {joint.a.max: 1.0, joint: {a: {max: 2.0}}}}', "'joint.a.max'"),
        (section('left/safety_mux') + 'left: {' + section('safety_mux').strip() + '}', NODE),
    ],
    ids=['parameter', 'section', 'quoted', 'dotted and nested', 'section by two spellings'],
)
def test_what_stands_twice_in_a_file_is_refused(text: str, why: str, file: Path) -> None:
    """ROS takes both sections and the later value, PyYAML the later of both."""
    file.write_text(text)
    for read in (lambda: parameters_for(NODE, [file]), lambda: check_sections(NODE, [file])):
        with pytest.raises(ParameterError, match=f'{why} {_TWICE}'):
            read()


@pytest.mark.parametrize(
    ('rule', 'why'),
    [
        ('safty_mux:rate:=50.0', 'there is no node safty_mux; did you mean safety_mux?'),
        ('esi_drive_bridge:baud:=1', 'there is no node esi_drive_bridge; there is safety_mux'),
    ],
)
def test_parameter_of_a_node_that_is_not_there_is_refused(rule: str, why: str, capfd: Any) -> None:
    assert refused(capfd, '-p', rule) == f'rugged_teleop: -p {rule.split(":=")[0]}: {why}'


@pytest.mark.parametrize('space', ['/', '/left'])
def test_a_parameter_by_a_nodes_name_is_refused_where_ros_passes_it_over(space: str) -> None:
    arguments = ['-p', 'safety_mux:rate:=50.0']
    with of_ros(*arguments, space=space) as node:
        name, given = node.get_fully_qualified_name(), given_by_ros(node, 'rate')
    if given:
        check_overrides(['/other', name], arguments)
    else:
        with pytest.raises(ParameterError, match='not for /left/safety_mux; set it in a file'):
            check_overrides(['/other', name], arguments)


@pytest.mark.parametrize(
    'text',
    [
        *(None, 'safety_mux: [1,\n', '- a\n', 'safety_mux:\n\tros__parameters: {}\n'),
        *('ros__parameters: {rate: 3}\n', 'safety_mux:\n  rate: 3\n', '\x00\x01\x02'),
    ],
)
def test_file_that_is_none_is_one_line(text: str | None, file: Path, capfd: Any) -> None:
    if text is not None:
        file.write_text(text)
    line = refused(capfd, '--params-file', str(file))
    assert line.startswith(f'rugged_teleop: parameter file {file}: ')


def test_argument_that_ros_refuses_is_told_without_its_sources(capfd: Any) -> None:
    line = refused(capfd, '-p', 'rate')
    assert "'-p rate'" in line
    assert '.c:' not in line


# Nodes that run beside those of a machine's file.


@pytest.mark.parametrize(
    ('sections', 'stays'),
    [
        (['/**/safety_mux'], False),
        (['/**'], False),
        (['/**/safety_mux', '/**/recorder'], True),
        (['/**/safety_mux', '/left/recorder'], True),  # to be refused, or used there
        (['/**/safety_mux', '/**/recordr'], True),
        ([], True),
    ],
)
def test_file_without_a_section_for_the_recorder_leaves_it_its_defaults(
    file: Path, sections: list[str], stays: bool, capsys: Any
) -> None:
    file.write_text('\n'.join(map(section, sections)))
    words = ['recorder', '--ros-args', '--params-file', str(file), '-p', 'quota:=5']
    rest = ['recorder', '--ros-args', '-p', 'quota:=5']
    assert beside('recorder', words) == (words if stays else rest)
    assert (str(file) in capsys.readouterr().err) is not stays


def test_renamed_recorder_has_the_section_of_its_name(file: Path) -> None:
    file.write_text(section('/**/box'))
    words = ['recorder', '--ros-args', '-r', '__node:=box', '--params-file', str(file)]
    assert beside('recorder', words) == words
