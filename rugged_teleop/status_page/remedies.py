# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What to do about an inhibit of the mux: the table of docs/inhibits.md, read by a program."""

from __future__ import annotations

from collections.abc import Iterator
import re

_HEAD = '| inhibit | what to do |'
_ANYTHING = '…'
_BETWEEN = '<br>'  # two inhibits with one remedy
_MARKDOWN = re.compile(r'`|\[([^]]*)\]\([^)]*\)')


class Remedies:
    """:param page: the text of docs/inhibits.md."""

    def __init__(self, page: str) -> None:
        found = [
            (_pattern(inhibit), _plain(what_to_do))
            for inhibits, what_to_do in _rows(page)
            for inhibit in inhibits.split(_BETWEEN)
        ]
        # What begins like it goes before what may begin like anything; what says more goes first.
        self._table = sorted(found, key=_rank)

    def __len__(self) -> int:
        return len(self._table)

    def of(self, inhibit: str) -> str:
        """Return what to do; empty for what the table does not have."""
        return next((text for pattern, text in self._table if pattern.match(inhibit)), '')


def _rows(page: str) -> Iterator[tuple[str, str]]:
    _, _, table = page.partition(f'{_HEAD}\n')
    for line in table.splitlines()[1:]:
        if not line.startswith('|'):
            return
        inhibits, what_to_do = line.strip('|').split('|')
        yield inhibits.strip(), what_to_do.strip()


def _pattern(inhibit: str) -> re.Pattern[str]:
    parts = map(re.escape, _plain(inhibit).split(_ANYTHING))
    return re.compile('.*?'.join(parts), re.DOTALL)


def _rank(row: tuple[re.Pattern[str], str]) -> tuple[bool, int]:
    pattern = row[0].pattern
    return pattern.startswith('.*'), -len(pattern)


def _plain(markdown: str) -> str:
    """Return the words without marks and links."""
    return _MARKDOWN.sub(lambda match: match[1] or '', markdown).strip()
