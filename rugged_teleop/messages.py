# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The messages of the nodes, from the tables of the pages that say what to do about each.

The site shows all tables on one page: docs/messages.md, which lists the pages that have them.
"""

from collections.abc import Iterator
from pathlib import Path
import posixpath
import re

FOLDER = Path(__file__).resolve().parent.parent / 'docs'

# How the first heading of such a table begins.
_HEADS = ('message', 'inhibit', 'neutral because', 'disabled because', 'answer')
_TABLE = re.compile(r'(?:^\|.*\n)+', re.MULTILINE)
_LISTED = re.compile(r'^- \[[^]]+\]\(([^)]+)\)$', re.MULTILINE)
_LINK = re.compile(r'(?<=\]\()(?!\w+:)[^)#]*')


def pages() -> list[str]:
    """Return the pages with such tables, relative to docs/, as docs/messages.md lists them."""
    return _LISTED.findall((FOLDER / 'messages.md').read_text(encoding='utf-8'))


def catalogue() -> str:
    """Return the tables of all these pages, each page's below its title."""
    return '\n'.join(map(_section, pages()))


def tables(text: str) -> Iterator[list[str]]:
    """Yield each such table of a page, as its lines."""
    for table in _TABLE.findall(text):
        if table.startswith(tuple(f'| {head}' for head in _HEADS)):
            yield table.splitlines()


def messages(text: str) -> Iterator[str]:
    """Yield the messages of a page; … stands for what is filled in, or left out."""
    for _, _, *rows in tables(text):
        for row in rows:
            yield from row.split(' | ')[0].strip('| ').replace('`', '').split('<br>')


def _section(page: str) -> str:
    text = (FOLDER / page).read_text(encoding='utf-8')
    title = text.partition('\n')[0].strip('# ')
    found = '\n\n'.join('\n'.join(table) for table in tables(text))
    moved = _LINK.sub(lambda link: _moved(link[0], page), found)
    return f'## {title}\n\nFrom [{page}]({page}).\n\n{moved}\n'


def _moved(link: str, page: str) -> str:
    """Return a link of a page as it is to be here."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(page), link)) if link else page
