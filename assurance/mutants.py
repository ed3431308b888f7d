# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Mutants of what decides: ``make mutants``, ``python -m assurance.mutants [OPTION]... [FILE]...``.

Each mutant is one small fault in one file: a comparison, an operator or a constant is another one,
a condition is left out or turned round, a statement or a returned value is missing. It lives in
the memory of a process of its own, which runs the file's tests until one fails. One that passes
them all has survived: there is a fault that nobody would notice. ``mutants_excused.py`` says how
many of a file may, and why.

Results are kept, so that an interrupted run goes on where it was: of those that were killed until
the package changes, of survivors until its tests do. Exit status: 1 if more of a file survive than
may, 2 if the tests fail without a mutant.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
import hashlib
import importlib
import json
import multiprocessing
import os
from pathlib import Path
import random
import sys
from types import CodeType
from typing import Any, NamedTuple

from assurance.mutant_runs import Bench, patience_of, ROOT, run_tests, SURVIVED, UnfitTestsError
from assurance.mutants_excused import EXCUSED

RESULTS = ROOT / 'build' / 'mutants.jsonl'

_MUX = tuple(f'safety_mux_{name}' for name in ('rules', 'motion', 'config', 'feedback', 'chains'))
_ESI = tuple(f'esi_drive_{name}' for name in ('session', 'apart', 'ramp', 'places'))
_VSC = tuple(
    f'fort_vsc_{name}' for name in ('stories', 'session', 'echo', 'heard', 'sent', 'held')
)
_VM110 = tuple(f'vm110_{name}' for name in ('session', 'packets', 'outputs', 'session_commands'))
_SESSIONS = tuple(f'session_{name}' for name in ('order', 'settings', 'reports'))
_AKRON = tuple(
    f'akron_session_{name}' for name in ('drive', 'joysticks', 'unit', 'polls', 'motion')
)
_PROCESSES = (
    *('process_link_steps', 'process_link_starts', 'wire_process', 'process_link_exploration'),
)
_CONVERT = ('akron', 'esi_drive', 'fort_vsc', 'ssc', 'vm110')
# By file, or for all of a folder but for its files that follow. What takes long comes last: most
# mutants are dead by then.
_NAMES_OF_TESTS = {
    'bridge_core/framing.py': ('framing', 'framing_of_devices'),
    'bridge_core/packets.py': (
        'packets',
        'fort_vsc_protocol',
        'ssc_protocol',
        'framing_of_devices',
    ),
    'bridge_core/convert.py': ('shared_convert', *(f'{name}_convert' for name in _CONVERT)),
    'bridge_core/checksums.py': ('checksums',),
    'bridge_core/j1939.py': ('j1939', 'akron_protocol'),
    'bridge_core/watchdog.py': ('watchdog', 'safety_mux_activation'),
    'bridge_core/publishers.py': ('publishers',),
    'bridge_core/reasons.py': ('reasons',),
    'bridge_core/session.py': ('session_base', *_SESSIONS, *_VSC),
    'bridge_core/gate.py': ('gate',),
    'bridge_core/actuator.py': ('esi_drive_mux', 'ssc_mux', 'akron_mux'),
    'bridge_core/fingerprint.py': ('commission',),
    'bridge_core/proof.py': ('proof', 'safety_mux_proofs'),
    'bridge_core/mux_words.py': ('mux_words',),
    'bridge_core/cdr.py': ('cdr',),
    'bridge_core/lane.py': ('lane',),
    'bridge_core/rclpy_inner.py': ('rclpy_inner', 'stop_topics', 'lane'),
    'bridge_core/transports/link.py': ('link',),
    'bridge_core/transports/active.py': ('wire',),
    'bridge_core/transports/opener.py': ('wire',),
    'bridge_core/transports/wire.py': ('wire', 'waiting'),
    'bridge_core/supervisor.py': ('supervisor', *_PROCESSES),
    'bridge_core/transports/child.py': _PROCESSES,
    'bridge_core/transports/forked.py': ('template',),
    'bridge_core/transports/template.py': ('template',),
    'bridge_core/transports/started.py': _PROCESSES,
    'bridge_core/transports/process.py': _PROCESSES,
    'bridge_core/transports/wire_process.py': _PROCESSES,
    **{
        f'safety_mux/{name}.py': (*_MUX, 'safety_mux_activation', 'safety_mux_properties')
        for name in (
            *('arbiter', 'stops', 'resets', 'explanation', 'all_inputs', 'inputs', 'owners'),
        )
    },
    'safety_mux/intake.py': ('safety_mux_intake',),
    'safety_mux/proofs.py': ('safety_mux_proofs', 'safety_mux_proven_node'),
    **{
        f'safety_mux/{name}.py': (*(f'safety_mux_{n}' for n in ('intake', 'mapping')), *_MUX)
        for name in ('protocol', 'settings')
    },
    'safety_mux/outputs.py': ('safety_mux_outputs', 'safety_mux_gate_exploration'),
    'safety_mux/feedback.py': ('safety_mux_feedback', 'safety_mux_activation'),
    'safety_mux/limits.py': ('safety_mux_limits', 'safety_mux_motion'),
    'safety_mux/mapping.py': ('safety_mux_mapping',),
    'safety_mux/soft_ends.py': ('safety_mux_soft_ends',),
    'safety_mux/button.py': ('safety_mux_button',),
    'safety_mux/stamps.py': ('safety_mux_stamps',),
    'safety_mux/device_words.py': ('safety_mux_device_words',),
    'safety_mux/commissioned.py': ('commission',),
    'esi_drive_bridge/session': (*_ESI, 'session_settings', 'session_reports'),
    'esi_drive_bridge/protocol.py': ('esi_drive_protocol', _ESI[0]),
    'esi_drive_bridge/axes.py': ('esi_drive_convert', 'esi_drive_ramp', *_ESI[:2]),
    **{f'{name}_bridge/convert.py': (f'{name}_convert',) for name in _CONVERT if name != 'akron'},
    'akron_can_bridge/convert.py': ('akron_convert',),
    'fort_vsc_bridge/session': (
        *('fort_vsc_device', *_VSC, 'fort_vsc_stops', 'fort_vsc_wires'),
        *('fort_vsc_hid', 'fort_vsc_can', 'fort_vsc_line_age'),
        *(*_SESSIONS, 'fort_vsc_parameters'),
    ),
    'fort_vsc_bridge/protocol': (
        *('fort_vsc_protocol', 'fort_vsc_can', 'fort_vsc_hid', 'fort_vsc_wires'),
        *_VSC,
    ),
    'fort_vsc_bridge/session/line_age.py': ('fort_vsc_line_age',),
    'fort_vsc_bridge/protocol/hid.py': ('fort_vsc_hid',),
    'io_bridge/session': ('io_session', *_SESSIONS),
    'io_bridge/modbus.py': ('io_modbus',),
    'io_bridge/protocol.py': ('io_gpio', 'io_session'),
    'ssc_bridge/session': (
        *('ssc_session', 'ssc_session_outputs', 'ssc_session_aux', *_SESSIONS),
    ),
    'ssc_bridge/channels.py': (
        *('ssc_channels', 'ssc_convert', 'ssc_session_outputs'),
        *('ssc_session_aux', 'session_settings'),
    ),
    'ssc_bridge/protocol': ('ssc_protocol', 'ssc_session', 'framing_of_devices'),
    'akron_can_bridge/session': (*_AKRON, *_SESSIONS),
    'akron_can_bridge/protocol': (
        *('akron_protocol', 'akron_dbc'),
        *('akron_session_joysticks', 'akron_session_unit', 'akron_session_motion'),
    ),
    'vm110_bridge/session': (
        *('vm110_serials', 'vm110_lateness', 'vm110_stops', 'vm110_commands', 'vm110_report'),
        *(*_VM110, *_SESSIONS),
    ),
    'vm110_bridge/protocol': ('vm110_protocol', 'vm110_convert', *_VM110),
    **{f'rugged_teleop/ledger/{name}.py': ('ledger',) for name in ('book', 'chain')},
    **{
        f'rugged_teleop/ledger/{name}.py': ('ledger_witness', 'recorder')
        for name in ('facts', 'tried', 'witness')
    },
    'rugged_teleop/ledger/stopping.py': ('ledger_stopping', 'ledger_witness'),
    'rugged_teleop/recorder/folder.py': ('recorder',),
    'rugged_teleop/recorder/triggers.py': ('recorder',),
}


def _files(place: str) -> list[str]:
    """Return the file, or those of the folder that say anything."""
    found = sorted((ROOT / place).glob('*.py')) or [ROOT / place]
    return [str(path.relative_to(ROOT)) for path in found if path.name != '__init__.py']


_PATHS = {
    path.name: str(path.relative_to(ROOT))
    for folder in ('test', 'assurance/explorations')
    for path in (ROOT / folder).rglob('test_*.py')
}
TESTS = {
    file: tuple(_PATHS[f'test_{name}.py'] for name in names)
    for place, names in _NAMES_OF_TESTS.items()
    for file in _files(place)
}

_COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.BitOr: ast.BitAnd,
    ast.BitAnd: ast.BitOr,
}
_NAMES = {'any': 'all', 'all': 'any', 'min': 'max', 'max': 'min'}
# Neither types nor texts decide anything, and the strictness of zip is a check of its own.
_SKIPPED_FIELDS = ('annotation', 'returns', 'decorator_list')
_SKIPPED_NODES = (ast.JoinedStr, ast.Import, ast.ImportFrom)
_SKIPPED_KEYWORD = 'strict'


class Mutant(NamedTuple):
    """One fault; ``key`` names it, and the package that it is in."""

    file: str
    lines: range
    function: str
    before: str
    after: str
    code: CodeType
    key: str

    @property
    def change(self) -> str:
        return f'{self.function}: {self.before} -> {self.after}'


# What may be wrong.


def variants(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what may stand in the place of a node."""
    if isinstance(node, ast.Compare):
        for n, op in enumerate(node.ops):
            for other in _COMPARISONS[type(op)]:
                ops = [*node.ops[:n], other(), *node.ops[n + 1 :]]
                yield ast.Compare(node.left, ops, node.comparators)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.And() if isinstance(node.op, ast.Or) else ast.Or(), node.values)
        for n in range(len(node.values)):
            rest = node.values[:n] + node.values[n + 1 :]
            yield rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield node.operand
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        yield ast.BinOp(node.left, _OPERATORS[type(node.op)](), node.right)
    elif isinstance(node, ast.AugAssign) and type(node.op) in _OPERATORS:
        yield ast.AugAssign(node.target, _OPERATORS[type(node.op)](), node.value)
        yield ast.Pass()
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield ast.Constant(node.value + 1)
    elif isinstance(node, ast.Name) and node.id in _NAMES:
        yield ast.Name(_NAMES[node.id], node.ctx)
    elif isinstance(node, ast.If | ast.While | ast.IfExp):
        if not isinstance(node.test, ast.Compare | ast.BoolOp | ast.UnaryOp):  # done by those
            yield _with_test(node, ast.UnaryOp(ast.Not(), node.test))
    elif isinstance(node, ast.Return) and not _is_none(node.value):
        yield ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Raise | ast.Continue | ast.Break) or _does_something(node):
        yield ast.Pass()


def _with_test(node: ast.If | ast.While | ast.IfExp, test: ast.expr) -> ast.AST:
    if isinstance(node, ast.IfExp):
        return ast.IfExp(test, node.body, node.orelse)
    return type(node)(test, node.body, node.orelse)


def _does_something(node: ast.AST) -> bool:
    if isinstance(node, ast.Expr):
        return not isinstance(node.value, ast.Constant)
    return isinstance(node, ast.Assign) and '__slots__' not in _shown(node)


def _is_none(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and value.value is None)


def mutants(file: str) -> Iterator[Mutant]:
    """Yield all mutants of a file, in the order of its lines."""
    source = (ROOT / file).read_text(encoding='utf-8')
    digest = _digest((ROOT / file).parent.glob('*.py'))
    tree = ast.parse(source)
    for parent, field, index, function in _places(tree, ''):
        siblings = getattr(parent, field)
        node = siblings if index is None else siblings[index]
        for variant in variants(node):
            ast.fix_missing_locations(ast.copy_location(variant, node))
            _put(parent, field, index, variant)
            before, after = _shown(node), _shown(variant)
            name = f'{digest} {node.lineno} {node.col_offset} {before} {after}'
            yield Mutant(
                *(file, _lines(node), function, before, after),
                code=compile(tree, str(ROOT / file), 'exec', dont_inherit=True),
                key=hashlib.sha1(name.encode()).hexdigest(),
            )
            _put(parent, field, index, node)


def _places(node: ast.AST, function: str) -> Iterator[tuple[ast.AST, str, int | None, str]]:
    """Yield where nodes stand: their parent, its field, their index in a list, the function."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        function = f'{function}.{node.name}'.lstrip('.')
    for field, value in ast.iter_fields(node):
        if field in _SKIPPED_FIELDS:
            continue
        for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            skipped = getattr(child, 'arg', None) == _SKIPPED_KEYWORD
            if isinstance(child, ast.AST) and not (skipped or isinstance(child, _SKIPPED_NODES)):
                if hasattr(child, 'lineno'):
                    yield node, field, index, function
                yield from _places(child, function)


def _lines(node: ast.stmt | ast.expr) -> range:
    return range(node.lineno, (node.end_lineno or node.lineno) + 1)


def _put(parent: ast.AST, field: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, field, node)
    else:
        getattr(parent, field)[index] = node


def _shown(node: ast.AST) -> str:
    """Return its source in one line; of a block, its head."""
    return ast.unparse(node).splitlines()[0]


def _digest(paths: Iterable[Path]) -> str:
    return hashlib.sha1(b''.join(path.read_bytes() for path in sorted(paths))).hexdigest()


def digest_of_tests(file: str) -> str:
    """Return what changes with a file's tests and their benches."""
    benches = ROOT.glob('stage/*.py')
    return _digest([*(ROOT / test for test in TESTS[file]), *benches])


# What becomes of it.


class Results:
    """Outcomes by the mutants' keys, a line each, in a file that processes may share."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[str, dict[str, Any]] = {}

    def read(self) -> Results:
        """Learn what has been noted, by whomever; return itself."""
        if self._path.exists():
            lines = self._path.read_text(encoding='utf-8').splitlines()
            self._known = dict(map(json.loads, lines))
        return self

    def outcome(self, mutant: Mutant) -> str | None:
        """Return what became of it; None if that is not known."""
        known = self._known.get(mutant.key)
        if known is None:
            return None
        outcome, tests = str(known['outcome']), known['tests']
        return outcome if outcome != SURVIVED or tests == digest_of_tests(mutant.file) else None

    def note(self, mutant: Mutant, outcome: str, seconds: float) -> None:
        """Keep it."""
        known = {
            'file': mutant.file,
            'line': mutant.lines.start,
            'change': mutant.change,
            'outcome': outcome,
            'seconds': round(seconds, 2),
            'tests': digest_of_tests(mutant.file),
        }
        self._path.parent.mkdir(exist_ok=True)
        with self._path.open('a', encoding='utf-8') as file:
            file.write(json.dumps([mutant.key, known]) + '\n')


class Verdict(NamedTuple):
    """Of a file's mutants: what to show of them, how many were killed, and of how many."""

    words: list[str]
    killed: int
    of: int


def judge(files: Sequence[str], path: Path, sample: int | None) -> list[Verdict]:
    """
    Run the mutants of files that have the same tests. :param path: of the results.

    :raises UnfitTestsError: the tests do not pass without them.
    """
    found: dict[str, list[Mutant]] = {}
    for file in files:
        found[file] = list(mutants(file))
        if sample is not None:
            some = random.Random(0).sample(found[file], min(sample, len(found[file])))
            found[file] = sorted(some, key=_line)
    results = Results(path)
    tests = TESTS[files[0]]

    def unknown() -> list[Mutant]:
        results.read()
        return [m for file in files for m in found[file] if results.outcome(m) is None]

    def judge_most(bench: Bench) -> None:
        for mutant in unknown():
            outcome, seconds = bench.outcome(mutant.file, mutant.code, mutant.lines)
            if outcome:
                results.note(mutant, outcome, seconds)

    if unknown():
        Bench.run(files, tests, judge_most)
    if left := unknown():
        limit = patience_of(files[0], tests)
        for mutant in left:
            results.note(mutant, *run_tests(mutant.file, tests, mutant.code, limit))
        results.read()
    return [verdict_of(file, found[file], results, sample is None) for file in files]


def verdict_of(file: str, found: Sequence[Mutant], results: Results, whole: bool) -> Verdict:
    survivors = [mutant for mutant in found if results.outcome(mutant) == SURVIVED]
    reasons = EXCUSED.get(file, {})
    allowed = sum(reasons.values())
    words = []
    if len(survivors) > allowed:
        words = [f'{file}:{each.lines.start}: {each.change}' for each in survivors]
        words += [f'{file}: {count} may survive: {reason}' for reason, count in reasons.items()]
    elif whole and len(survivors) < allowed:
        words = [f'{file}: assurance/mutants_excused.py allows {allowed}: lower it']
    excused = min(len(survivors), allowed)
    count, killed = len(found) - excused, len(found) - len(survivors)
    words.append(f'{file}: {killed} of {count} killed, and {excused} may survive')
    return Verdict(words, killed, count)


def _line(mutant: Mutant) -> int:
    return mutant.lines.start


def _groups(files: Iterable[str]) -> list[list[str]]:
    """Return the files that have the same tests together."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for file in files:
        groups.setdefault(TESTS[file], []).append(file)
    return list(groups.values())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all; return the exit status."""
    parser = argparse.ArgumentParser(prog='assurance.mutants', description=(__doc__ or '').strip())
    parser.add_argument('files', nargs='*', metavar='FILE', choices=[*TESTS, []])
    parser.add_argument('--sample', type=int, metavar='N', help='only N of each file')
    parser.add_argument('--results', type=Path, default=RESULTS, help='where they are kept')
    parser.add_argument(
        '--workers',
        type=int,
        default=os.cpu_count(),
        help='groups of files with the same tests at a time',
    )
    options = parser.parse_args(arguments)
    os.chdir(ROOT)
    # So that not each process has to import what these do.
    importlib.import_module('hypothesis.stateful')
    importlib.import_module('conftest')
    work = partial(judge, path=options.results, sample=options.sample)
    verdicts: list[Verdict] = []
    unfit = False
    with multiprocessing.get_context('fork').Pool(options.workers) as pool:
        groups = _groups(options.files or TESTS)
        coming = pool.imap_unordered(work, groups)
        for _ in groups:
            try:
                for verdict in next(coming):
                    verdicts.append(verdict)
                    print(*verdict.words, sep='\n', flush=True)
            except UnfitTestsError as error:
                unfit = True
                print(error, file=sys.stderr)
    killed, count = (sum(v.killed for v in verdicts), sum(v.of for v in verdicts))
    print(f'{killed} of {count} killed: {killed / max(count, 1):.1%}')
    return 2 if unfit else int(killed < count)


if __name__ == '__main__':
    sys.exit(main())
