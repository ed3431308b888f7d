# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""make case: green while all evidence is there, passed and counts; else red, and named."""

from __future__ import annotations

from collections.abc import Callable
import datetime
import json
from pathlib import Path
import re
import subprocess
from xml.etree import ElementTree

import pytest

from assurance import case, case_drawing

TODAY = datetime.date(2026, 6, 30)
PAGE = """
| hazard | what stands against it | left |
| --- | --- | --- |
| it moves | the deadman | |
| it jumps | the ramp | |

| what fails | then | bound |
| --- | --- | --- |
| radio | stop | 50 ms |
| terminal | nothing | \u2013 |
"""
TABLE = 'page: docs/page.md\n    strategy: each row\n    argument'
GIVEN = f"""
goal: it stops
context: simulated
counts: {{test: 30, world: 30, campaign: 30, random: 30, benchmark: 30}}
parts:
  hazards:
    {TABLE}: what stands against it
    table: hazard
    evidence:
      it moves: ['test/test_it.py::test_stop']
      it jumps: [assurance/explorations/test_it_exploration.py, left: the load]
  bounds:
    {TABLE}: then
    table: what fails
    evidence:
      radio: ['campaign drive: SIGKILL', 'random VSC: silent']
"""  # fmt: skip
EVIDENCE = (
    'test/test_it.py::test_stop',
    'assurance/explorations/test_it_exploration.py',
    'campaign drive: SIGKILL',
    'random VSC: silent',
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    known = {name: {'passed': True, 'date': '2026-06-20', 'commit': 'abc'} for name in EVIDENCE}
    files = {
        'docs/page.md': PAGE,
        'assurance/case.yaml': GIVEN,
        'assurance/case_results.json': json.dumps(known),
        'assurance/explorations/test_it_exploration.py': '',
        'test/test_it.py': 'def test_stop() -> None: ...\n',
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def judged(root: Path) -> case.Case:
    found = case.read(root)
    case.judge(found, case.results(root), TODAY, root, frozenset({'abc'}))
    return found


def test_case_whose_evidence_passed_lately_is_green(root: Path) -> None:
    found = judged(root)
    assert found.faults == []
    assert [claim.number for claim in found.claims] == ['H1', 'H2', 'B1']
    assert (found.claims[1].left, found.claims[2].argument) == ('the load', 'stop (50 ms)')


def edit(name: str, before: str, after: str) -> Callable[[Path], None]:
    def change(root: Path) -> None:
        text = (root / name).read_text()
        assert before in text
        (root / name).write_text(text.replace(before, after))

    return change


RESULTS, CASE = 'assurance/case_results.json', 'assurance/case.yaml'


@pytest.mark.parametrize(
    ('change', 'fault'),
    [
        (lambda root: (root / 'test/test_it.py').unlink(), 'test_stop: there is none'),
        (edit('test/test_it.py', 'test_stop', 'test_other'), 'test_stop: there is none'),
        (lambda root: (root / EVIDENCE[1]).unlink(), 'exploration.py: there is none'),
        (edit(CASE, 'drive: SIGKILL', 'drive: SIGBURP'), 'SIGBURP: there is none'),
        (edit(CASE, 'VSC: silent', 'VSC: sings'), 'VSC: sings: there is none'),
        (edit(RESULTS, '06-20', '05-20'), 'old: it ran 41 days ago, and counts for 30'),
        (edit(RESULTS, 'true', 'false'), 'failed on 2026-06-20'),
        (edit(RESULTS, '"abc"', '"def"'), 'it ran at def, which is not in this history'),
        (edit(RESULTS, 'VSC: silent', 'VSC: sings'), 'VSC: silent: no result'),
        (
            edit(CASE, "      it moves: ['test/test_it.py::test_stop']\n", ''),
            'H1 it moves: no',
        ),
        (edit('docs/page.md', '| it jumps', '| it runs'), "no row of the table is 'it jumps'"),
        (edit('docs/page.md', '| hazard', '| danger'), "there is no table with 'hazard'"),
        (edit('docs/page.md', '| radio', '| x | y | 1 s |\n| radio'), 'B1 x: no evidence'),
    ],
    ids=lambda value: value if isinstance(value, str) else '',
)
def test_what_is_not_shown_is_named(
    change: Callable[[Path], None], fault: str, root: Path
) -> None:
    change(root)
    found = judged(root)
    assert any(fault in each for each in found.faults), found.faults
    assert 'red' in case_drawing.draw(found).partition('</style>')[2]


JUNIT = """<testsuites><testsuite timestamp="2026-06-29T10:00:00">
<testcase classname="test.test_it" name="test_stop[1]"/>
<testcase classname="test.test_it" name="test_stop[2]">{}</testcase>
<testcase classname="test.test_it" name="test_other"><skipped/></testcase>
<testcase classname="assurance.explorations.test_it_exploration" name="test_near"/>
</testsuite></testsuites>"""
TRIALS = '{"seed": 1}\n{"kind": "VSC: silent", "findings": []}\n{"kind": "other", "findings": []}'


@pytest.mark.parametrize(
    ('name', 'text', 'found'),
    [
        (
            'a.xml',
            JUNIT.format(''),
            {EVIDENCE[0]: (True, '2 of 2 passed'), EVIDENCE[1]: (True, '')},
        ),
        ('a.xml', JUNIT.format('<failure/>'), {EVIDENCE[0]: (False, '1 of 2 passed')}),
        ('a.json', '{"drive: SIGKILL": [{"held": true}]}', {EVIDENCE[2]: (True, '1 of 1 held')}),
        ('a.json', '{"drive: SIGKILL": [{"held": false}]}', {EVIDENCE[2]: (False, '0 of 1 held')}),
        ('a.jsonl', TRIALS, {EVIDENCE[3]: (True, '1 of 1 held')}),
    ],
)
def test_result_of_a_run_is_kept(
    name: str, text: str, found: dict[str, tuple[bool, str]], root: Path
) -> None:
    (root / RESULTS).unlink()
    (root / name).write_text(text)
    assert case.record([root / name], case.read(root), root) >= len(found)
    known = case.results(root)
    assert {n: known[n].passed for n in found} == {n: passed for n, (passed, _) in found.items()}
    assert all(known[n].words.startswith(words) for n, (_, words) in found.items())


@pytest.mark.parametrize(
    ('commits', 'again'),
    [(None, []), (frozenset({'abc'}), []), (frozenset({'def'}), [*EVIDENCE[:2]])],
    ids=['no history', 'of this history', 'of another'],
)
def test_what_counts_no_more_runs_again(
    commits: frozenset[str] | None, again: list[str], root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[str] = []
    monkeypatch.setattr(subprocess, 'run', lambda command, **_: ran.extend(command))
    found = case.read(root)
    files = case.run(found, case.results(root), datetime.date(2026, 6, 30), commits)
    assert len(files) == bool(again)
    assert [each for each in ran if each in EVIDENCE] == again


def test_evidence_of_this_repository_is_there_and_every_row_has_some() -> None:
    """Whether it passed, and still counts, is for make case to say."""
    found = case.read()
    names = case.names_of({case.kind_of(each) for each in found.evidence})
    assert [fault for part in found.parts for fault in part.faults] == []
    assert [claim.key for claim in found.claims if not claim.evidence] == []
    assert [each for each in found.evidence if not case.is_there(each, names)] == []
    assert {len(part.claims) for part in found.parts} >= {16}


def test_drawing_has_every_claim_and_is_that_of_the_case() -> None:
    found = case.read()
    drawn = case_drawing.draw(found)
    boxes = ElementTree.fromstring(drawn).iter('{http://www.w3.org/2000/svg}circle')
    assert len([*boxes]) == sum(len(claim.evidence) for claim in found.claims)
    kept = case.PICTURE.read_text(encoding='utf-8')
    assert re.sub(' red"', '"', kept) == drawn, 'run make case'


def test_tables_of_the_page_have_every_claim() -> None:
    found = case.read()
    text = case.markdown(found, case.results())
    assert all(f'| {claim.number} | ' in text for claim in found.claims)
