# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands of the documents: what stands in their indented blocks."""

from __future__ import annotations

from collections.abc import Iterator
import itertools
from pathlib import Path
import re
import shlex
import textwrap
from typing import NamedTuple

from stage.rig import ROOT

PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(ROOT / 'docs').rglob('*.md'))
    if '_build' not in path.parts
)
_CODE = re.compile(r' {4,}(?=\S)')
_FENCE = re.compile(r'```(\w*)\n(.*?)```', re.DOTALL)
_COMMENT = re.compile(r'(?:^|\s+)#(?: |$)')


class Command(NamedTuple):
    """A line that is typed, and what stands behind # in it."""

    text: str
    comment: str = ''

    @property
    def words(self) -> list[str]:
        """As a shell splits it."""
        return shlex.split(self.text)


def text_of(page: str) -> str:
    return (ROOT / Path(page)).read_text(encoding='utf-8')


def blocks(text: str) -> Iterator[str]:
    """Yield the indented blocks, and those between fences for a shell, without indentation."""
    found: list[str] = []
    lines = [*_FENCE.sub(_indented, text).splitlines(), 'end']
    for before, line in itertools.pairwise(lines):
        if (_CODE.match(line) and (found or not before.strip())) or (found and not line.strip()):
            found.append(line)
        elif found:
            margin = min(len(each) - len(each.lstrip()) for each in found if each.strip())
            yield '\n'.join(each[margin:] for each in found).rstrip()
            found = []


def commands(block: str) -> Iterator[Command]:
    """Yield the lines of a block, those with a backslash at the end joined to the next."""
    for line in block.replace('\\\n', ' ').splitlines():
        text, *comment = _COMMENT.split(line, 1)
        if text.strip():
            yield Command(' '.join(text.split()), ''.join(comment).strip())


def _indented(fence: re.Match[str]) -> str:
    """Return what stands between fences as a block; empty where it is code of a file."""
    typed = fence[1] in ('', 'sh', 'bash', 'console')
    return '\n' + textwrap.indent(fence[2], '    ') if typed else ''
