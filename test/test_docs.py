"""
The documents against the code, both ways: executables, parameters, topics, services, YAML files.

A page has tables whose first heading is 'parameter', 'topic' or 'service'; names stand in
backticks in the first column. ``<anything>`` in a name stands for what a list of the node names.
A cell under 'default' that reads as a number, a list, true or false must be the default.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
import importlib
import itertools
from pathlib import Path
import re
from typing import Any

import pytest
import yaml

from bridge_core.parameters import BRIDGE_PARAMETERS
from bridge_core.parameters import Parameter
from bridge_core.parameters import resolve

ROOT = Path(__file__).resolve().parent.parent
COMMON_PAGE = 'docs/common.md'
COMMON_MODULE = 'bridge_core/node.py'


@dataclass(frozen=True)
class Documented:
    """One node and where it is described; its YAML file is config/<name>.yaml."""

    name: str
    class_name: str
    page: str

    @property
    def module(self) -> str:
        return f'{self.name}.node'

    @property
    def yaml_file(self) -> Path:
        return ROOT / 'config' / f'{self.name}.yaml'

    def parameters(self, given: dict[str, Any] | None = None) -> tuple[Parameter, ...]:
        """Return the parameters that the node has when these are given."""
        node = getattr(importlib.import_module(self.module), self.class_name)
        # Which parameters there are depends on no instance, and one would need a running ROS.
        table: tuple[Parameter, ...] = node.parameter_table(node.__new__(node), given or {})
        return table

    def parameter_names(self) -> set[str]:
        """Return all names, with <name> for what the node's own lists name."""
        lists = [p.name for p in self.parameters() if p.default and is_list_of(p.default, str)]
        unnamed = {p.name for p in self.parameters({name: [''] for name in lists})}
        named = {p.name for p in self.parameters({name: ['<name>'] for name in lists})}
        return unnamed | named


NODES = (
    Documented('akron_can_bridge', 'AkronCanBridge', 'docs/devices/akron.md'),
    Documented('esi_drive_bridge', 'EsiDriveBridge', 'docs/devices/esi_drive.md'),
    Documented('fort_vsc_bridge', 'FortVscBridge', 'docs/devices/fort_vsc.md'),
    Documented('safety_mux', 'SafetyMux', 'docs/safety_mux.md'),
    Documented('ssc_bridge', 'SscBridge', 'docs/devices/ssc.md'),
    Documented('vm110_bridge', 'Vm110Bridge', 'docs/devices/vm110.md'),
)
each_node = pytest.mark.parametrize('node', NODES, ids=lambda node: node.name)


def is_list_of(value: Any, kind: type) -> bool:
    return isinstance(value, list) and all(isinstance(item, kind) for item in value)


# Reading the documents.


def pages() -> dict[str, str]:
    """Return the text of every document for users."""
    found = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding='utf-8') for path in found}


def rows(text: str, *headings: str) -> Iterator[dict[str, str]]:
    """Yield the rows of every table whose first heading is one of these, as heading to cell."""
    head: list[str] = []
    for line in text.splitlines():
        if not line.startswith('|'):
            head = []
            continue
        cells = [cell.strip() for cell in re.split(r'(?<!\\)\|', line.strip().strip('|'))]
        if not head:
            head = [cell.lower() for cell in cells]
        elif not re.fullmatch(r'[|\s:-]+', line) and head[0] in headings:
            yield dict(zip(head, cells, strict=False))


def names(text: str, *headings: str) -> set[str]:
    """Return the names in backticks in the first column of such tables."""
    first_cells = (next(iter(row.values())) for row in rows(text, *headings))
    return {generic(name) for cell in first_cells for name in re.findall(r'`([^`]+)`', cell)}


def generic(name: str) -> str:
    return re.sub(r'<[^>]+>', '<name>', name)


# Reading the code.


def interfaces(source: str) -> dict[str, set[str]]:
    """Return the names of topics and services that a node's source makes, by heading."""
    found: dict[str, set[str]] = {'topic': set(), 'service': set()}
    for call in ast.walk(ast.parse(source)):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute):
            kind = 'service' if call.func.attr == 'create_service' else 'topic'
            if call.func.attr.startswith(('create_', 'publisher')):
                found[kind] |= {name for arg in call.args for name in literal_names(arg)}
    return found


def literal_names(node: ast.expr) -> Iterator[str]:
    """Yield the topic in an argument, if it is written out; <name> for what is filled in."""
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    texts = [str(p.value) if isinstance(p, ast.Constant) else '<name>' for p in parts]
    if ''.join(texts).startswith(('~/', '/')):
        yield ''.join(texts)


def node_interfaces(node: Documented) -> dict[str, set[str]]:
    path = importlib.import_module(node.module).__file__
    assert path is not None
    return interfaces(Path(path).read_text(encoding='utf-8'))


def common_interfaces() -> dict[str, set[str]]:
    return interfaces((ROOT / COMMON_MODULE).read_text(encoding='utf-8'))


def executables() -> set[str]:
    """Return the console scripts that setup.py lists."""
    setup = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    texts = (node.value for node in ast.walk(setup) if isinstance(node, ast.Constant))
    scripts = (re.fullmatch(r'(\w+) = [\w.]+:\w+', text) for text in texts if type(text) is str)
    return {script[1] for script in scripts if script}


# Executables.


def test_every_executable_is_documented() -> None:
    text = '\n'.join(pages().values())
    assert {name for name in executables() if not re.search(rf'`[^`]*\b{name}\b', text)} == set()


def test_every_command_in_the_documents_exists() -> None:
    commands = executables()
    tools = {'activate', 'mypy', 'pip', 'pytest', 'python', 'ruff'}
    for page, text in pages().items():
        run = set(re.findall(r'ros2 run rugged_teleop (\w+)', text))
        run |= set(re.findall(r'\.venv/bin/(\w+)', text)) - tools
        assert run <= commands, page
        launched = set(re.findall(r'ros2 launch rugged_teleop ([\w.]+)', text))
        assert launched <= {path.name for path in (ROOT / 'launch').iterdir()}, page


# Parameters.


def test_common_parameters_and_their_table_agree() -> None:
    documented = names(pages()[COMMON_PAGE], 'parameter')
    assert documented == {parameter.name for parameter in BRIDGE_PARAMETERS}


@each_node
def test_every_parameter_is_documented(node: Documented) -> None:
    common = {p.name for p in BRIDGE_PARAMETERS if p in node.parameters()}
    documented = names(pages()[node.page], 'parameter')
    assert node.parameter_names() - common - documented == set()


@each_node
def test_every_documented_parameter_exists(node: Documented) -> None:
    documented = names(pages()[node.page], 'parameter')
    existing = {p.name for p in node.parameters()} | node.parameter_names()
    assert documented - existing == set()


@each_node
def test_documented_defaults_are_the_defaults(node: Documented) -> None:
    text = pages()[node.page]
    parameters = {p.name: p for p in (*node.parameters(), *template(node))}
    wrong = [
        f'{name}: {row["default"]}, not {parameters[name].default}'
        for row in rows(text, 'parameter')
        if 'default' in row
        for name in map(generic, re.findall(r'`([^`]+)`', row['parameter']))
        if name in parameters and not may_mean(row['default'], parameters[name].default)
    ]
    assert not wrong


def template(node: Documented) -> list[Parameter]:
    """Return the parameters that lists bring, under their <name>."""
    lists = [p.name for p in node.parameters() if p.default and is_list_of(p.default, str)]
    return [p for p in node.parameters({n: ['<name>'] for n in lists}) if '<name>' in p.name]


def may_mean(cell: str, default: Any) -> bool:
    """Tell whether a cell does not contradict the default; words ('the port') never do."""
    try:
        value = yaml.safe_load(cell.replace('`', '').replace('\N{MINUS SIGN}', '-'))
    except yaml.YAMLError:
        return True
    if isinstance(default, str) or isinstance(value, str | None):
        return True
    if isinstance(default, list) and not isinstance(value, list):
        value = [value] * len(default)
    same_kind = isinstance(value, bool) == isinstance(default, bool)
    return same_kind and bool(value == default)


# Topics and services.


def test_common_topics_and_their_table_agree() -> None:
    for heading, found in common_interfaces().items():
        assert names(pages()[COMMON_PAGE], heading) == found


@each_node
@pytest.mark.parametrize('heading', ['topic', 'service'])
def test_every_interface_is_documented(node: Documented, heading: str) -> None:
    documented = names(pages()[node.page], heading)
    assert node_interfaces(node)[heading] - documented == set()


@each_node
@pytest.mark.parametrize('heading', ['topic', 'service'])
def test_every_documented_interface_exists(node: Documented, heading: str) -> None:
    documented = names(pages()[node.page], heading)
    existing = node_interfaces(node)[heading]
    if all(parameter in node.parameters() for parameter in BRIDGE_PARAMETERS):
        existing |= common_interfaces()[heading]
    assert documented - existing == set()


# The annotated parameter files.


def flat(tree: dict[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return nested maps as ROS reads them: names joined by dots."""
    values: dict[str, Any] = {}
    for name, value in tree.items():
        full = f'{prefix}{name}'
        values |= flat(value, f'{full}.') if isinstance(value, dict) else {full: value}
    return values


def yaml_values(node: Documented) -> dict[str, Any]:
    content = yaml.safe_load(node.yaml_file.read_text(encoding='utf-8'))
    ((section, body),) = content.items()
    # With the wildcard the file serves in every namespace; the stack goes by the last part.
    assert section == f'/**/{node.name}'
    assert list(body) == ['ros__parameters']
    return flat(body['ros__parameters'])


@each_node
def test_yaml_holds_every_parameter_and_no_other(node: Documented) -> None:
    assert set(yaml_values(node)) == {p.name for p in node.parameters()}


@each_node
def test_yaml_values_are_the_defaults(node: Documented) -> None:
    values = yaml_values(node)
    table = {p.name: p for p in node.parameters() if p.name in values}
    assert values == {name: p.default for name, p in table.items()}
    # 1 is equal to 1.0 and to true, yet ROS would see another type.
    for name, parameter in table.items():
        assert type(values[name]) is type(parameter.default), name
    assert resolve(table.values(), values) == values


@each_node
def test_yaml_explains_every_parameter(node: Documented) -> None:
    """Each has a comment on its line or above it; of those that lists bring, one will do."""
    lines = [line.strip() for line in node.yaml_file.read_text(encoding='utf-8').splitlines()]
    explained = {
        line.split(':')[0].rsplit('.', 1)[-1]
        for above, line in itertools.pairwise(lines)
        if ':' in line and not line.startswith('#') and ('#' in line or above.startswith('#'))
    }
    needed = {name.rsplit('.', 1)[-1] for name in yaml_values(node)}
    assert needed - explained == set()
