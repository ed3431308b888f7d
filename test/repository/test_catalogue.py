# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The catalogue of reasons against the code that gives them, and against the pages."""

import ast
from collections.abc import Iterator
import importlib
from pathlib import Path
import re
from typing import Any, get_args

import pytest

from bridge_core.reasons import Coded, Entry
from bridge_core.session import Level
from rugged_teleop.devices import devices
from rugged_teleop.messages import FOLDER, pages
from rugged_teleop.reasons import catalogue
from rugged_teleop.recorder import report
from stage.rig import ROOT

MOST_WORDS = 9  # of a cause, and of each step: read at a glance
WHO = {'operator', 'technician', 'integrator', 'nobody'}
GIVES = {'Coded': 0, 'passed_on': 2, '_coded': 0}  # where in a call the code is
SILENT = r'mux\.\w+\.(silent|stale|was_stale)'  # by the condition of an input


def given() -> Iterator[str]:
    """Yield the codes in the code, as patterns: of some a part is filled in."""
    packages = (path.parent for path in ROOT.glob('*/py.typed'))
    for path in (path for package in packages for path in package.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Call):
                yield from code_of(node)


def code_of(call: ast.Call) -> Iterator[str]:
    name = getattr(call.func, 'id', getattr(call.func, 'attr', ''))
    at = GIVES.get(name, len(call.args))
    for argument in call.args[at : at + 1]:
        if isinstance(argument, ast.Constant) and argument.value:
            of_input = r'\w+\.\w+\.' * (name == '_coded')
            yield of_input + re.escape(str(argument.value))
        elif isinstance(argument, ast.JoinedStr):
            parts = argument.values
            yield ''.join(
                re.escape(str(v.value)) if isinstance(v, ast.Constant) else r'[\w.]+'
                for v in parts
            )


def test_every_code_that_is_given_is_in_the_catalogue_and_the_other_way_round() -> None:
    patterns = set(given())
    assert len(patterns) > 100
    codes = set(catalogue())
    of_axes = {code.rpartition('.')[0] for code in codes if code.endswith(('.a', '.b'))}
    unknown = [p for p in patterns if not any(re.fullmatch(p, c) for c in codes | of_axes)]
    assert unknown == []
    narrow = [SILENT, *(p for p in patterns if not p.startswith('[') and p.count('[') < 2)]
    assert [c for c in codes if not any(re.match(p, c) for p in narrow)] == []


@pytest.mark.parametrize('name', devices())
def test_sessions_return_sentences_with_a_code_alone(name: str) -> None:
    """Mypy then finds one without; what is above, that the code is in the catalogue."""
    session = importlib.import_module(f'{name}.session').Session
    for method in ('stop_reasons', 'inhibits', 'problems', '_silence'):
        returned = getattr(session, method).__annotations__['return']
        assert re.findall('Coded|str', returned) == ['Coded'], method


@pytest.mark.parametrize('problems', [report.of_recordings, report.of_ledger])
def test_recorder_says_sentences_with_a_code_alone(problems: Any) -> None:
    assert problems.__annotations__['return'] == 'Iterator[Problem]'
    assert get_args(report.Problem) == (Level, Coded)


@pytest.mark.parametrize('name', devices())
def test_node_says_how_urgent_its_own_codes_are(name: str) -> None:
    node = getattr(importlib.import_module(f'{name}.node'), devices()[name].node_class)
    assert node.REASONS is devices()[name].reasons


@pytest.mark.parametrize(('code', 'entry'), catalogue().items(), ids=list(catalogue()))
def test_entry_is_read_at_a_glance_and_is_on_a_page(code: str, entry: Entry) -> None:
    assert entry.who in WHO
    assert 1 <= len(entry.steps) <= 3
    assert entry.says
    for text in (entry.cause, *entry.steps):
        assert len(text.split()) <= MOST_WORDS, text
    assert not entry.more or Path(FOLDER, entry.more.partition('#')[0]).exists()
    assert any(f'`{code}`' in Path(FOLDER, page).read_text(encoding='utf-8') for page in pages())
