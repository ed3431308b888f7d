# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which files have mutants, and of what kind these are."""

from __future__ import annotations

import ast
import itertools
from pathlib import Path
import subprocess
import sys

import pytest

from assurance import mutants
from assurance.mutant_runs import ROOT
from assurance.mutants_excused import EXCUSED

# Of the mux: what shows, wires, or says what may be set.
_NOT_DECIDING = {
    *('__init__', 'configuration', 'listening', 'node', 'outputs', 'parameters', 'protocol'),
    *('parameters_of_each', 'reasons', 'report', 'services'),
}
_BRIDGES = [path.parent.name for path in ROOT.glob('*_bridge/node.py')]


def deciding(folder: str) -> list[str]:
    """Return the files of a package that decide: its sessions and protocols, or the mux's own."""
    root = ROOT
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
            assert (ROOT / path).is_file(), path
    assert not set(EXCUSED) - set(mutants.TESTS)


def test_comparison_has_the_mutants_that_are_nearest() -> None:
    (node,) = (n for n in ast.walk(ast.parse('a < b')) if isinstance(n, ast.Compare))
    shown = [ast.unparse(each) for each in itertools.islice(mutants.variants(node), 9)]
    assert shown == ['a <= b', 'a >= b']


@pytest.mark.parametrize(
    ('allowed', 'whole', 'said', 'killed'),
    [
        (0, True, ['a.py:1: f: b -> c', '1 of 2 killed, and 0 may survive'], 1),
        (1, True, ['1 of 1 killed, and 1 may survive'], 1),
        (2, True, ['allows 2: lower it', '1 of 1 killed, and 1 may survive'], 1),
        (2, False, ['1 of 1 killed, and 1 may survive'], 1),
    ],
)
def test_file_with_more_survivors_than_it_may_have_shows_them_all(
    monkeypatch: pytest.MonkeyPatch, allowed: int, whole: bool, said: list[str], killed: int
) -> None:
    code = compile('', '', 'exec')
    found = [mutants.Mutant('a.py', range(1, 2), 'f', 'b', 'c', code, key) for key in '12']
    results = mutants.Results(Path('none'))
    outcomes = {'1': 'killed', '2': 'survived'}
    monkeypatch.setattr(results, 'outcome', lambda mutant: outcomes[mutant.key])
    monkeypatch.setattr(mutants, 'EXCUSED', {'a.py': {'any': allowed}} if allowed else {})
    verdict = mutants.verdict_of('a.py', found, results, whole)
    assert all(words.endswith(end) for words, end in zip(verdict.words, said, strict=True))
    assert verdict[1:] == (killed, 2 - min(allowed, 1))


def in_python(code: str, *arguments: str) -> str:
    """Run this apart from the tests that run here; return what it says."""
    command = [sys.executable, '-c', code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True).stdout


@pytest.mark.proof  # it runs tests by itself
def test_fault_counts_in_a_module_that_is_loaded_already() -> None:
    said = in_python(
        'import bridge_core.watchdog; from assurance import mutant_runs; '
        'fault = compile("raise ImportError", "watchdog.py", "exec"); '
        'tests = ["test/bridge_core/test_watchdog.py"]; '
        'print(mutant_runs.run_tests("bridge_core/watchdog.py", tests, fault, 60.0)[0])'
    )
    assert said.split() == ['killed']


_JUDGED = """
import sys
from assurance import mutant_runs
from assurance import mutants

FILE = 'bridge_core/checksums.py'

def judge(bench):
    for mutant in mutants.mutants(FILE):
        if mutant.function in ('', 'crc16_ccitt_false'):
            say(mutant.function or 'import', bench.outcome(FILE, mutant.code, mutant.lines))
    say('no fault', bench.outcome(FILE, mutant_runs.compiled(FILE), range(1000)))

def say(name, outcome):
    print(name, outcome[0], file=said, flush=True)

with open(sys.argv[1], 'w') as said:
    tests = ['test/bridge_core/test_checksums.py']
    mutant_runs.Bench.run([FILE, 'bridge_core/watchdog.py'], tests, judge)
"""


@pytest.mark.proof
def test_bench_tells_of_faults_in_functions_alone(tmp_path: Path) -> None:
    in_python(_JUDGED, str(tmp_path / 'said'))
    said = {line.strip() for line in (tmp_path / 'said').open()}
    assert said == {'crc16_ccitt_false killed', 'import None', 'no fault None'}


_CLOSURE = """
import sys
from assurance import mutant_runs
from assurance import mutants

FILE = 'akron_can_bridge/protocol/fields.py'

def judge(bench):
    for mutant in mutants.mutants(FILE):
        if mutant.function == 'degrees.pack' and 'value * 10' in mutant.change:
            print(bench.outcome(FILE, mutant.code, mutant.lines)[0], file=said, flush=True)

with open(sys.argv[1], 'w') as said:
    mutant_runs.Bench.run([FILE], ['test/akron_can_bridge/test_akron_protocol.py'], judge)
"""


@pytest.mark.proof  # it runs tests by itself
def test_fault_counts_in_a_function_that_another_one_made_at_the_import(tmp_path: Path) -> None:
    in_python(_CLOSURE, str(tmp_path / 'said'))
    assert set((tmp_path / 'said').read_text().split()) == {'killed'}


@pytest.mark.proof  # it runs tests by itself
def test_results_are_kept_and_taken_up_again(tmp_path: Path) -> None:
    call = (
        'import sys; from assurance import mutants; '
        'mutants.main(["safety_mux/stamps.py", "--results", sys.argv[1], "--workers", "1"])'
    )
    results = tmp_path / 'results'
    said = in_python(call, str(results))
    known = results.read_text()
    assert said.endswith('100.0%\n')
    assert len(known.splitlines()) == len([*mutants.mutants('safety_mux/stamps.py')])
    assert in_python(call, str(results)) == said
    assert results.read_text() == known
