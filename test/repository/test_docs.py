# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The documents against the code: what is generated is up to date; topics and services, both ways.

A page has tables whose first heading is 'topic' or 'service'; names stand in backticks in the
first column. ``<anything>`` in a name stands for what a list of the node names.
"""

import ast
from collections.abc import Iterator
import importlib
import re
from typing import Any

import pytest

from bridge_core.parameters import MANAGED_PARAMETERS
from rugged_teleop import reference
from rugged_teleop.stack import BESIDE, NODES

ROOT = reference.ROOT
COMMON_PAGE = 'docs/common.md'
COMMON_MODULES = ('node', 'stop_topics', 'proof_topics', 'bridge_diagnostics')
# How the names of what makes an interface begin.
MAKERS = ('create_', 'publisher', 'stop_', 'command_', 'asked_', 'subscribe', 'Command')
MOST_WORDS = 40  # of a cell


each_node = pytest.mark.parametrize('node', reference.NODES, ids=lambda node: node.name)


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
        if isinstance(call, ast.Call):
            name = getattr(call.func, 'attr', getattr(call.func, 'id', ''))
            kind = 'service' if name == 'create_service' else 'topic'
            if name.startswith(MAKERS):
                found[kind] |= {each for arg in call.args for each in literal_names(arg)}
    return found


def literal_names(node: ast.expr) -> Iterator[str]:
    """Yield the topic in an argument, if it is written out; <name> for what is filled in."""
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    texts = [str(p.value) if isinstance(p, ast.Constant) else '<name>' for p in parts]
    if ''.join(texts).startswith(('~/', '/')):
        yield ''.join(texts)


def node_class_of(node: reference.Node) -> Any:
    module, name = {**NODES, **BESIDE}[node.name]
    return getattr(importlib.import_module(module), name)


def node_interfaces(node: reference.Node) -> dict[str, set[str]]:
    folder = (node.package or node.name).replace('.', '/')
    sources = [path.read_text(encoding='utf-8') for path in (ROOT / folder).glob('*.py')]
    if any('ProofTopics(self' in each for each in sources):
        sources.append((ROOT / 'bridge_core/proof_topics.py').read_text(encoding='utf-8'))
    found = interfaces('\n'.join(each.replace('from __future__', '#') for each in sources))
    kind = node_class_of(node)
    found['service'] |= {f'~/{name}' for name in getattr(kind, 'SERVICES', ())}
    if getattr(kind, 'TELLS_DEVICE', False):
        found['topic'].add('~/device')
    return found


def common_interfaces() -> dict[str, set[str]]:
    files = (ROOT / f'bridge_core/{name}.py' for name in COMMON_MODULES)
    found = interfaces('\n'.join(file.read_text(encoding='utf-8') for file in files))
    found['topic'].discard('~/device')  # of some bridges
    return found


def executables() -> set[str]:
    """Return what ``ros2 run rugged_teleop`` runs: the console scripts of setup.py, and tools/."""
    setup = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    texts = (node.value for node in ast.walk(setup) if isinstance(node, ast.Constant))
    scripts = (re.fullmatch(r'(\w+) = [\w.]+:\w+', text) for text in texts if type(text) is str)
    return {script[1] for script in scripts if script} | {
        path.name for path in (ROOT / 'tools').iterdir()
    }


# Prose.


@pytest.mark.parametrize('page', [*pages(), 'QUALITY_DECLARATION.md'])
def test_no_cell_of_a_table_has_more_than_40_words(page: str) -> None:
    found = re.findall(r'^\|.*', (ROOT / page).read_text(encoding='utf-8'), re.MULTILINE)
    cells = (cell for line in found for cell in re.split(r'(?<!\\)\||<br>', line))
    assert [cell for cell in cells if len(cell.split()) > MOST_WORDS] == []


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


def test_generated_files_are_up_to_date() -> None:
    generated = reference.files().items()
    stale = [path.name for path, text in generated if path.read_text(encoding='utf-8') != text]
    assert not stale, 'run make reference'


def test_no_table_of_parameters_is_written_by_hand() -> None:
    for page, text in pages().items():
        by_hand = re.sub(f'{reference.BEGIN}.*?{reference.END}', '', text, flags=re.DOTALL)
        assert names(by_hand, 'parameter') == set(), page


@each_node
def test_table_of_the_reference_is_that_of_the_node(node: reference.Node) -> None:
    node_class = node_class_of(node)
    # Which parameters there are depends on no instance, and one would need a running ROS.
    table = node_class.parameter_table(node_class.__new__(node_class), {})
    assert table == (*node.common, *node.table({}))


# Topics and services.


def test_common_topics_and_their_table_agree() -> None:
    for heading, found in common_interfaces().items():
        assert names(pages()[COMMON_PAGE], heading) == found


@each_node
@pytest.mark.parametrize('heading', ['topic', 'service'])
def test_every_interface_is_documented(node: reference.Node, heading: str) -> None:
    documented = names(pages()[node.page], heading)
    assert node_interfaces(node)[heading] - documented == set()


@each_node
@pytest.mark.parametrize('heading', ['topic', 'service'])
def test_every_documented_interface_exists(node: reference.Node, heading: str) -> None:
    documented = names(pages()[node.page], heading)
    existing = node_interfaces(node)[heading]
    if node.common != MANAGED_PARAMETERS:
        existing |= common_interfaces()[heading]
    assert documented - existing == set()


def test_topics_of_the_migration_page_exist() -> None:
    fort = next(node for node in reference.NODES if node.name == 'fort_vsc_bridge')
    existing = node_interfaces(fort)['topic'] | common_interfaces()['topic']
    named = set(re.findall(r'`(~/[^`]+)`', pages()['docs/migration.md']))
    assert len(named) > 8
    assert named - existing == set()


def test_every_test_that_a_page_names_exists() -> None:
    """A file, ``test_x.py``, or a test, by its function's name."""
    files = [p for name in ('test', 'assurance') for p in (ROOT / name).rglob('*.py')]
    known = {name for path in files for name in (path.name, path.stem)}
    for path in files:
        known |= set(
            re.findall(r'^def (test_\w+)', path.read_text(encoding='utf-8'), re.MULTILINE)
        )
    named = {
        (page, name)
        for page, text in pages().items()
        for name in re.findall(r'`(?:[a-z_0-9/]+/)?(test_\w+[a-z0-9](?:\.py)?)`', text)
    }
    assert len(named) > 10
    assert not {(page, name) for page, name in named if name not in known}
