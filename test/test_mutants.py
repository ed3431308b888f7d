# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Which files have mutants, and of what kind these are."""

from __future__ import annotations

import ast
import itertools
import subprocess
import sys

import pytest

from test import mutants
from test.mutants_excused import EXCUSED

# Of the mux: what shows, wires, or says what may be set.
_NOT_DECIDING = {
    *('__init__', 'configuration', 'node', 'outputs', 'parameters', 'protocol', 'report'),
}
_BRIDGES = [path.parent.name for path in mutants.ROOT.glob('*_bridge/node.py')]


def deciding(folder: str) -> list[str]:
    """Return the files of a package that decide: its sessions and protocols, or the mux's own."""
    root = mutants.ROOT
    if folder == 'safety_mux':
        found = [*(root / folder).glob('*.py')]
        return [str(p.relative_to(root)) for p in found if p.stem not in _NOT_DECIDING]
    found = [p for kind in ('session', 'protocol') for p in (root / folder).glob(f'{kind}*/*.py')]
    found += (root / folder).glob('protocol.py')
    return [str(p.relative_to(root)) for p in found if p.stem != '__init__']


@pytest.mark.parametrize('folder', [*_BRIDGES, 'safety_mux'])
def test_every_file_that_decides_has_mutants_and_tests(folder: str) -> None:
    files = deciding(folder)
    assert files
    assert not set(files) - set(mutants.TESTS)


def test_all_that_is_named_is_there() -> None:
    for file, tests in mutants.TESTS.items():
        for path in (file, *tests):
            assert (mutants.ROOT / path).is_file(), path
    assert not set(EXCUSED) - set(mutants.TESTS)


def test_comparison_has_the_mutants_that_are_nearest() -> None:
    (node,) = (n for n in ast.walk(ast.parse('a < b')) if isinstance(n, ast.Compare))
    shown = [ast.unparse(each) for each in itertools.islice(mutants.variants(node), 9)]
    assert shown == ['a <= b', 'a >= b']


def test_fault_counts_in_a_module_that_is_loaded_already() -> None:
    code = (
        'import bridge_core.watchdog; from test import mutants; '
        'fault = compile("raise ImportError", "watchdog.py", "exec"); '
        'print(mutants.run_tests("bridge_core/watchdog.py", fault, 60.0)[0])'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, cwd=mutants.ROOT, check=True
    )
    assert done.stdout.split() == ['killed']
