# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The suite is run as often as asked, and each run counts."""

from __future__ import annotations

import json
from pathlib import Path
import sys

import pytest

from assurance import saturated

NOTE = """
import sys
with open(sys.argv[1], 'a+') as file:
    file.seek(0)
    count = len(file.read())
    file.write('x')
print('FAILED test_a.py::test_b - why' if count == 1 else 'all is well')
print('9 passed')
exit(count == 1)
"""


def test_each_run_counts_and_is_told_and_none_is_repeated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = (sys.executable, '-c', NOTE, str(tmp_path / 'count'))
    results = tmp_path / 'runs.json'
    assert saturated.main(['1', '--idle', '--json', str(results)], command) == 0
    assert saturated.main(['3', '--json', str(results)], command) == 1
    assert saturated.main(['3', '--json', str(results)], command) == 1
    assert (tmp_path / 'count').read_text() == 'xxx'
    runs = [json.loads(line) for line in results.read_text().splitlines()]
    assert [run['status'] for run in runs] == [0, 1, 0]
    assert [run['failed'] for run in runs] == [[], ['FAILED test_a.py::test_b - why'], []]
    (log,) = tmp_path.glob('*.log')
    assert (log.name, log.read_text()) == (
        'runs.2.log',
        'FAILED test_a.py::test_b - why\n9 passed\n',
    )
    assert capsys.readouterr().out.endswith('2 of 3 passed\n')
