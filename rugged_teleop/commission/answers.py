# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A file of answers: each of them is used, or the file is refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from rugged_teleop.commission.faces import ACCEPT, is_answer, wanted
from rugged_teleop.commission.step import Step

SKIP = 'skip'  # of answers: by step, why it is skipped
Kind = str | tuple[str, ...]  # of a question
WHO = ('machine', 'place', 'who')


def read_answers(path: Path, steps: Sequence[Step]) -> dict[str, Any]:
    """
    Return what a file answers, by 'STEP.NAME' or NAME.

    :param steps: all that may be asked for. :raises ValueError: something in it answers nothing.
    """
    try:
        answers = yaml.safe_load(path.read_text(encoding='utf-8')) or {}
    except OSError as error:
        raise ValueError(f'--answers {path}: {error.strerror}') from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise ValueError(f'--answers {path}: {" ".join(str(error).split())}') from error
    if not isinstance(answers, dict):
        raise ValueError(f'--answers {path}: is no mapping')
    skips = answers.get(SKIP) or {}
    if not isinstance(skips, dict):
        raise ValueError(f'--answers {path}: {SKIP} is no mapping of steps to reasons')
    names = {step.name for step in steps}
    wrong = [f'{SKIP}: there is no step {name}' for name in skips if name not in names]
    wrong += [
        f'{SKIP}: {name} has no reason'
        for name, why in skips.items()
        if not (isinstance(why, str) and why.strip())
    ]
    kinds = _kinds(steps)
    wrong += [_wrong(str(name), answer, kinds) for name, answer in answers.items() if name != SKIP]
    wrong = [*filter(None, wrong)]
    if wrong:
        raise ValueError(f'--answers {path}: {"; ".join(wrong)}')
    return answers


def _kinds(steps: Sequence[Step]) -> dict[str, Kind]:
    """Return of what kind an answer has to be, by each name that it may have."""
    kinds: dict[str, Kind] = dict.fromkeys((*WHO, ACCEPT), 'text')
    for step in steps:
        asked = {question.name: question.kind for question in step.questions} | {ACCEPT: 'text'}
        for name, kind in asked.items():
            kinds.setdefault(name, kind)
            kinds[f'{step.name}.{name}'] = kind
    return kinds


def _wrong(name: str, answer: Any, kinds: Mapping[str, Kind]) -> str:
    """Return what is wrong with an answer; empty: nothing."""
    if name not in kinds:
        return f'nothing asks for {name}'
    kind = kinds[name]
    if isinstance(answer, (dict, list)) or answer is None or not is_answer(str(answer), kind):
        return f'{name}: {answer} is not {wanted(kind)}'
    return ''
