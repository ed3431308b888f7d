# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The catalogue of messages against the code, both ways.

Both are compared by clauses, which marks such as : and ( divide. In a page … stands for what is
filled in or left out, in the code for what is filled in. The doctor's findings are a table of the
code already (test_doctor.py).
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
import re

import pytest

from rugged_teleop.messages import catalogue, FOLDER, messages, pages, tables
from stage.rig import ROOT

# Where the words of ~/status and /diagnostics come from.
SPEAKERS = (
    '*_bridge/node.py',
    '*_bridge/session/*.py',
    'bridge_core/actuator.py',
    'bridge_core/bridge_diagnostics.py',
    'bridge_core/input_guard.py',
    'bridge_core/mux_words.py',
    'bridge_core/node.py',
    'bridge_core/report.py',
    'bridge_core/session.py',
    'bridge_core/transports/*.py',
    'bridge_core/watchdog.py',
    'esi_drive_bridge/protocol.py',
    'fort_vsc_bridge/protocol/wires.py',
    'rugged_teleop/recorder/node.py',
    'safety_mux/[!p]*.py',
)
# They speak before anything runs, or of nothing but bytes.
SILENT = {'parameters.py', 'settings.py', 'configuration.py', 'serials.py', 'inbox.py'}
LOG = {'debug', 'error', 'info', 'warning'}
WORD = re.compile(r'(?<!\S)\S*[A-Za-z]{2}')
FILLED_IN = re.compile(r'\{[^}]*\}')  # of what format() is called on
LEAST_WORDS = 3  # of a clause that is a message; shorter ones are names and states


def literal(node: ast.expr) -> str | None:
    """Return a text of the code, … for what is filled in; None for what is no text."""
    if isinstance(node, ast.JoinedStr):
        return ''.join(str(v.value) if isinstance(v, ast.Constant) else '…' for v in node.values)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return FILLED_IN.sub('…', node.value)
    return None


def spoken(node: ast.AST) -> Iterator[str]:
    """Yield the texts below a node, without docstrings, errors, log lines and names of values."""
    if isinstance(node, ast.Raise | ast.Compare) or is_docstring(node):
        return
    if isinstance(node, ast.Call) and getattr(node.func, 'attr', '') in LOG:
        return
    if isinstance(node, ast.expr):
        text = literal(node)
        if text is not None:
            yield text
    children = ast.iter_child_nodes(node)
    if isinstance(node, ast.Dict):
        children = iter(node.values)
    elif isinstance(node, ast.DictComp):
        children = iter((node.value, *node.generators))
    if not isinstance(node, ast.JoinedStr):
        for child in children:
            yield from spoken(child)
        return
    for value in node.values:
        if isinstance(value, ast.FormattedValue):
            yield from spoken(value)


def is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and literal(node.value) is not None


def clauses(text: str, least: int = 1) -> list[str]:
    """Return what stands between marks, without numbers, if it has so many words."""
    found = (part.strip(" .'?±/") for part in re.split(r'[:;,()`"]|\d+', text))
    return [part for part in found if len(WORD.findall(part)) >= least]


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding='utf-8'))


def is_catalogue(path: Path) -> bool:
    """Tell whether the pages are made of it: what it says proves nothing."""
    return path.name in ('reasons.py', 'shared_reasons.py') and path.parent.parent == ROOT


@cache
def said() -> str:
    """Return every clause of the production code, a line each."""
    packages = (path.parent for path in ROOT.glob('*/py.typed'))
    files = (path for package in packages for path in package.rglob('*.py'))
    files = (path for path in files if not is_catalogue(path))
    nodes = (node for path in files for node in ast.walk(parsed(path)))
    texts = (literal(node) for node in nodes if isinstance(node, ast.expr))
    return '\n'.join({clause for text in texts if text for clause in clauses(text)})


@cache
def patterns() -> list[re.Pattern[str]]:
    """Return what has names filled in, as patterns with a group for each."""
    parts = (clause.split('…') for clause in said().splitlines() if '…' in clause)
    # Of many holes only figures are made, and they would take a pattern for ever.
    return [re.compile('(.+)'.join(map(re.escape, each))) for each in parts if len(each) < 4]


def is_said(clause: str) -> bool:
    """Tell whether the code says it: as it stands, or with what it says itself filled in."""
    if clause in said():
        return True
    found = (pattern.fullmatch(clause) for pattern in patterns())
    return any(all(group in said() for group in match.groups()) for match in found if match)


def text_of(page: str) -> str:
    return (FOLDER / page).read_text(encoding='utf-8')


def test_every_page_with_messages_is_listed() -> None:
    found = (path for path in FOLDER.rglob('*.md') if '_build' not in path.parts)
    names = {path.relative_to(FOLDER).as_posix() for path in found}
    assert {name for name in names if any(tables(text_of(name)))} == set(pages())


def test_links_of_the_tables_lead_on_from_the_page_that_has_them_all() -> None:
    links = re.findall(r'\]\((?!\w+:)([^)#]+)', catalogue())
    assert len(links) > len(pages())
    assert [link for link in links if not (FOLDER / link).exists()] == []


@pytest.mark.parametrize('page', pages())
def test_every_catalogued_message_is_said_by_the_code(page: str) -> None:
    rotten = [
        (message, clause)
        for message in messages(text_of(page))
        for part in message.split('…')
        for clause in clauses(part, least=2)
        if not is_said(clause)
    ]
    assert rotten == []


def test_every_message_of_the_code_is_on_a_page() -> None:
    paths = {path for glob in SPEAKERS for path in ROOT.glob(glob) if path.name not in SILENT}
    paths = {path for path in paths if not is_catalogue(path)}
    texts = re.sub(r'\s+', ' ', ' '.join(map(text_of, pages()))).replace('`', '')
    unknown = [
        f'{path.relative_to(ROOT)}: {text}'
        for path in sorted(paths)
        for text in spoken(parsed(path))
        if (found := [part for each in text.split('…') for part in clauses(each, LEAST_WORDS)])
        and not any(clause in texts for clause in found)
    ]
    assert not unknown, '\n'.join(unknown)
