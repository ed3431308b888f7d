# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""make proof: steps that have passed are not done again, all others are."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from assurance import proof

NOTE = "-c open('FILE','a').write('x')"
STEPS = {'good': NOTE, 'bad': f"{NOTE};print('why');exit(3)"}


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(proof, 'STEPS', STEPS)
    monkeypatch.setattr(proof, 'digest_of_sources', lambda: 'now')
    return tmp_path / 'proof.json'


def times(results: Path, step: str, sources: str = 'now') -> int:
    return len((results.parent / 'proof' / sources / f'{step}.json').read_text())


def test_what_has_passed_is_not_done_again_and_what_failed_is(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert proof.main([], results) == 1
    assert proof.main([], results) == 1
    assert (times(results, 'good'), times(results, 'bad')) == (1, 2)
    assert 'bad                  failed, status 3' in capsys.readouterr().out
    known = json.loads(results.read_text())
    assert (known['bad']['status'], known['bad']['words']) == (3, ['why'])
    assert proof.main(['good'], results) == 0


def test_other_sources_want_another_proof(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert proof.main(['good'], results) == 0
    monkeypatch.setattr(proof, 'digest_of_sources', lambda: 'then')
    assert proof.main(['good'], results) == 0
    assert times(results, 'good') == times(results, 'good', 'then') == 1


def test_interrupted_step_is_no_result(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(proof, 'run', interrupted)
    with pytest.raises(KeyboardInterrupt):
        proof.main(['good'], results)
    assert not results.exists()


def test_sources_are_those_of_package_and_tests() -> None:
    assert len(proof.digest_of_sources()) == 12
    for words in proof.STEPS.values():
        module = words.split()[1]
        place = proof.ROOT / module.replace('.', '/')
        assert module == 'pytest' or place.is_dir() or place.with_suffix('.py').is_file()
