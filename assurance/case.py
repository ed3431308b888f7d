# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The safety case, run: ``make case``, or ``python -m assurance.case``.

The claims and their arguments are rows of the pages' tables; ``case.yaml`` names the evidence of
each. Every piece has to exist, to have passed when it last ran, and to have done so lately enough.
``case_results.json`` says when that was, and at which commit; benchmarks have their own file. A
result counts for days, not until the sources change: every commit would make the case red.

``--record FILE...`` takes in what a run has given: a junit file of pytest, ``build/proof.json``,
a file of ``campaign --json`` or ``campaign random --json``. ``--run`` runs the tests and worlds
whose result is missing, old or of another history first. docs/images/case.svg is drawn anew.

Exit status: 0 all holds; 1 something does not, and is named.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
import datetime
import json
from pathlib import Path
import re
import subprocess
import sys
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree

import yaml

from assurance import case_drawing

ROOT: Final = Path(__file__).resolve().parents[1]
CASE, RESULTS = ROOT / 'assurance' / 'case.yaml', ROOT / 'assurance' / 'case_results.json'
BENCHMARKS = ROOT / 'assurance' / 'benchmarks' / 'results.json'
PICTURE = ROOT / 'docs' / 'images' / 'case.svg'
_NO_BOUND = '\u2013'  # in the column bound: none is promised


class Result(NamedTuple):
    """What evidence gave when it last ran; ``words`` are figures."""

    passed: bool
    date: str
    commit: str
    words: str = ''


@dataclass
class Claim:
    """
    A row of a page. :param number: such as H3. :param key: its first cell.

    :param argument: why it should hold. :param evidence: what shows it, by name.
    :param left: what no evidence here shows; empty: nothing.
    """

    number: str
    key: str
    argument: str
    evidence: list[str] = field(default_factory=list)
    left: str = ''
    faults: list[str] = field(default_factory=list)


@dataclass
class Part:
    """Claims of one table. :param strategy: how they support the goal."""

    name: str
    page: str
    strategy: str
    claims: list[Claim]
    faults: list[str]  # rows and keys that do not meet


@dataclass
class Case:
    """:param counts: days for which a result counts, by kind of evidence."""

    goal: str
    context: str
    counts: dict[str, int]
    parts: list[Part]

    @property
    def claims(self) -> list[Claim]:
        return [claim for part in self.parts for claim in part.claims]

    @property
    def evidence(self) -> list[str]:
        return list(dict.fromkeys(name for claim in self.claims for name in claim.evidence))

    @property
    def faults(self) -> list[str]:
        found = [f'{part.page}: {fault}' for part in self.parts for fault in part.faults]
        return found + [
            f'{claim.number} {claim.key}: {fault}'
            for claim in self.claims
            for fault in claim.faults
        ]


# What is claimed.


def rows(text: str, head: str) -> Iterator[dict[str, str]]:
    """Yield the rows of the table with this heading, by heading; the first column is ''."""
    headings: list[str] = []
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r'(?<!\\)\|', line.strip().strip('|'))]
        if not line.startswith('|'):
            headings = []
        elif not headings:
            headings = ['', *cells[1:]] if head in cells else ['?']
        elif headings != ['?'] and not re.fullmatch(r'[|\s:-]+', line):
            yield dict(zip(headings, cells, strict=False))


def read(root: Path = ROOT) -> Case:
    """Read the case and the tables that it is about."""
    given = yaml.safe_load((root / 'assurance' / 'case.yaml').read_text(encoding='utf-8'))
    parts = []
    for name, part in given['parts'].items():
        text = (root / part['page']).read_text(encoding='utf-8')
        known = {str(key): value for key, value in part['evidence'].items()}
        claims: list[Claim] = []
        faults: list[str] = []
        for row in rows(text, part['table']):
            if row.get('bound') == _NO_BOUND:
                continue
            number = f'{name[0].upper()}{len(claims) + 1}'
            claim = Claim(number, row[''], row[part['argument']])
            if bound := row.get('bound'):
                claim.argument += f' ({bound})'
            for each in known.pop(claim.key, None) or []:
                if isinstance(each, dict):
                    claim.left = each['left']
                else:
                    claim.evidence.append(each)
            claims.append(claim)
        faults += [f'no row of the table is {key!r}' for key in known]
        if not claims:
            faults.append(f'there is no table with {part["table"]!r}')
        parts.append(Part(name, part['page'], part['strategy'], claims, faults))
    return Case(given['goal'], given['context'], given['counts'], parts)


# Whether it is shown.


def kind_of(evidence: str) -> str:
    """Return what kind of evidence has this name."""
    word = evidence.partition(' ')[0]
    if word in ('campaign', 'random', 'benchmark'):
        return word
    return 'world' if evidence.startswith('assurance/') else 'test'


def tests_of(path: Path) -> set[str]:
    """Return the names of the tests in a file; none of one that is not there."""
    if not path.is_file():
        return set()
    body = ast.walk(ast.parse(path.read_text(encoding='utf-8')))
    return {
        each.name
        for each in body
        if isinstance(each, ast.FunctionDef) and each.name.startswith('test_')
    }


def names_of(kinds: Iterable[str]) -> dict[str, set[str]]:
    """Return what there is of these kinds, but for tests and worlds."""
    found: dict[str, set[str]] = {}
    if 'campaign' in kinds:
        from assurance.campaign import FAULTS
        from assurance.subjects import SUBJECTS

        found['campaign'] = {f'{who}: {fault.name}' for who in SUBJECTS for fault in FAULTS}
    if 'random' in kinds:
        from assurance.machine import Setting
        from assurance.random_faults import kinds_of

        found['random'] = set(kinds_of(Setting(two_hosts=True)))
    if 'benchmark' in kinds:
        from assurance.benchmarks.results import TARGETS

        found['benchmark'] = {target.name for target in TARGETS}
    return found


def is_there(evidence: str, names: Mapping[str, set[str]], root: Path = ROOT) -> bool:
    """Tell whether there is such evidence. :param names: see ``names_of``."""
    kind, (_, _, name) = kind_of(evidence), evidence.partition(' ')
    if kind in names:
        return name in names[kind]
    file, _, test = evidence.partition('::')
    return test in tests_of(root / file) if test else (root / file).is_file()


def results(root: Path = ROOT) -> dict[str, Result]:
    """Return what is known of the last runs."""
    known = _recorded(root)
    path = root / BENCHMARKS.relative_to(ROOT)
    if path.exists():
        measured = json.loads(path.read_text(encoding='utf-8'))
        for row in measured['rows']:
            values = row['figures' if row['absolute'] else 'ratio']
            is_met = all(values[name] <= limit for name, limit in row['target'].items())
            figures = ', '.join(f'{name} {value:g}' for name, value in row['figures'].items())
            words = f'{figures} {row["unit"]}'
            known[f'benchmark {row["name"]}'] = Result(
                is_met, measured['machine']['date'], '', words
            )
    return known


def _recorded(root: Path) -> dict[str, Result]:
    path = root / RESULTS.relative_to(ROOT)
    found = json.loads(path.read_text(encoding='utf-8')) if path.exists() else {}
    return {name: Result(**each) for name, each in found.items()}


def judge(
    case: Case,
    known: Mapping[str, Result],
    today: datetime.date,
    root: Path = ROOT,
    commits: frozenset[str] | None = None,
) -> None:
    """
    Fill in what is wrong.

    :param commits: of this history, shortened; None: it is not known, as in an sdist.
    """
    names = names_of({kind_of(each) for each in case.evidence})
    for claim in case.claims:
        if not claim.evidence:
            claim.faults.append('no evidence')
        for each in claim.evidence:
            fault = 'there is none' if not is_there(each, names, root) else ''
            fault = fault or _fault(each, known.get(each), case.counts, today, commits)
            if fault:
                claim.faults.append(f'{each}: {fault}')


def _fault(
    evidence: str,
    result: Result | None,
    counts: Mapping[str, int],
    today: datetime.date,
    commits: frozenset[str] | None,
) -> str:
    """Say what is wrong with a result; empty: nothing."""
    if result is None:
        return 'no result'
    days = (today - datetime.date.fromisoformat(result.date)).days
    if not result.passed:
        return f'failed on {result.date}: {result.words}'.rstrip(': ')
    if days > counts[kind_of(evidence)]:
        return f'old: it ran {days} days ago, and counts for {counts[kind_of(evidence)]}'
    if result.commit and commits is not None and result.commit not in commits:
        return f'it ran at {result.commit}, which is not in this history'
    return ''


def history(root: Path = ROOT) -> frozenset[str] | None:
    """Return the commits of this history, shortened; None where git knows none."""
    done = _git(root, 'log', '--format=%H')
    return frozenset(line[:_SHORT] for line in done.splitlines()) or None


_SHORT = 10


def _git(root: Path, *words: str) -> str:
    try:
        done = subprocess.run(
            ['git', '-C', str(root), *words], capture_output=True, text=True, check=False
        )
    except OSError:
        return ''
    return done.stdout if done.returncode == 0 else ''


# What a run has given.


def outcomes(path: Path) -> Iterator[tuple[str, bool, str, str]]:
    """Yield name, whether it passed, date and words of what a file has results of."""
    date = datetime.date.fromtimestamp(path.stat().st_mtime).isoformat()
    if path.suffix == '.xml':
        yield from _of_junit(path)
        return
    text = path.read_text(encoding='utf-8')
    if text.startswith('{"seed"'):
        some: dict[str, list[Any]] = {}
        for trial in map(json.loads, text.splitlines()[1:]):
            some.setdefault(f'random {trial["kind"]}', []).append(not trial['findings'])
        for name, held in some.items():
            yield name, all(held), date, f'{sum(held)} of {len(held)} held'
        return
    for name, value in json.loads(text).items():
        if isinstance(value, list):
            held = [bool(trial['held']) for trial in value]
            yield f'campaign {name}', all(held), date, f'{sum(held)} of {len(held)} held'
        elif name == 'states':
            for world in sorted(ROOT.glob('assurance/explorations/test_*.py')):
                place = world.relative_to(ROOT).as_posix()
                yield place, not value['status'], value['ended'][:10], 'all states'


def _of_junit(path: Path) -> Iterator[tuple[str, bool, str, str]]:
    """Yield each test, and each file of tests as a world."""
    passed: dict[str, list[bool]] = {}
    root = ElementTree.parse(path).getroot()
    date = next(each.get('timestamp', '') for each in root.iter('testsuite'))[:10]
    for case in root.iter('testcase'):
        if case.find('skipped') is not None:
            continue
        file = case.get('classname', '').replace('.', '/') + '.py'
        held = case.find('failure') is None and case.find('error') is None
        name = case.get('name', '').partition('[')[0]
        for each in (f'{file}::{name}', file):
            passed.setdefault(each, []).append(held)
    for each, held_all in passed.items():
        yield each, all(held_all), date, f'{sum(held_all)} of {len(held_all)} passed'


def record(paths: Iterable[Path], case: Case, root: Path = ROOT) -> int:
    """Keep what these files say of the evidence; return of how much."""
    wanted, known = set(case.evidence), _recorded(root)
    commit = _git(root, 'rev-parse', 'HEAD')[:_SHORT]
    count = 0
    for name, passed, date, words in (each for path in paths for each in outcomes(path)):
        if name in wanted:
            known[name] = Result(passed, date, commit, words)
            count += 1
    table = {name: known[name]._asdict() for name in sorted(known) if name in wanted}
    text = ',\n'.join(f' {json.dumps(name)}: {json.dumps(each)}' for name, each in table.items())
    (root / RESULTS.relative_to(ROOT)).write_text(f'{{\n{text}\n}}\n', encoding='utf-8')
    return count


def run(
    case: Case,
    known: Mapping[str, Result],
    today: datetime.date,
    commits: frozenset[str] | None = None,
) -> list[Path]:
    """Run the tests and worlds that count no more; return the junit files: one, or none."""
    names = [
        each
        for each in case.evidence
        if kind_of(each) in ('test', 'world')
        and _fault(each, known.get(each), case.counts, today, commits)
    ]
    file = ROOT / 'build' / 'case.xml'
    if not names:
        return []
    command = [sys.executable, '-m', 'pytest', '-q', f'--junitxml={file}', *names]
    subprocess.run(command, cwd=ROOT, check=False)
    return [file]


# What is shown.


def markdown(case: Case, known: Mapping[str, Result]) -> str:
    """Return the tables of the page."""
    lines = []
    for part in case.parts:
        head = f'| | claim | argument, by [the page]({Path(part.page).name}) | evidence |'
        lines += [f'## {part.name.capitalize()}', '', head, '| --- | --- | --- | --- |']
        for claim in part.claims:
            shown = [_shown(each, known.get(each)) for each in claim.evidence]
            shown += [f'not shown here: {claim.left}'] * bool(claim.left)
            lines.append(
                f'| {claim.number} | {claim.key} | {claim.argument} | {"<br>".join(shown)} |'
            )
        lines.append('')
    return '\n'.join(lines)


def _shown(evidence: str, result: Result | None) -> str:
    if result is None:
        return f'`{evidence}`: no result'
    verdict = 'passed' if result.passed else 'FAILED'
    return f'`{evidence}`: {verdict}, {", ".join(filter(None, result[1:]))}'


def main(arguments: Sequence[str] | None = None) -> int:
    """Check the case and draw it; return the exit status."""
    parser = argparse.ArgumentParser(prog='assurance.case', description=(__doc__ or '').strip())
    parser.add_argument('--record', nargs='+', type=Path, default=[], metavar='FILE')
    parser.add_argument('--run', action='store_true')
    given = parser.parse_args(arguments)
    case, today = read(), datetime.date.today()
    files = run(case, results(), today, history()) if given.run else []
    if given.record or files:
        print(f'{record([*files, *given.record], case)} results recorded')
    judge(case, results(), today, commits=history())
    PICTURE.write_text(case_drawing.draw(case), encoding='utf-8')
    for fault in case.faults:
        print(fault)
    count = sum(bool(claim.faults) for claim in case.claims)
    print(
        f'{len(case.claims)} claims, {len(case.evidence)} pieces of evidence: '
        f'{f"{count} claims are not shown" if case.faults else "all shown"}'
    )
    return int(bool(case.faults))


if __name__ == '__main__':
    sys.exit(main())
