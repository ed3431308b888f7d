# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Entries as a table for people, JSON lines, or CSV with a line for each value."""

from __future__ import annotations

from collections.abc import Callable
import csv
import json
from typing import Any, TextIO

from rugged_teleop.decode.plain import flat, text
from rugged_teleop.decode.protocols import Entry

# Takes the entries of a file, with its name.
Writer = Callable[[str, Entry], None]
_HEAD = ('file', 'offset', 'time', 'source', 'identifier', 'protocol', 'message')


def table(out: TextIO) -> Writer:
    """Write a line an entry, the name before the first of a file; of others CAN frames only."""
    shown = ''  # the name of the file

    def write(name: str, entry: Entry) -> None:
        nonlocal shown
        if name != shown:
            shown = name
            print(f'# {name}', file=out)
        if entry.damaged:
            what = f'!! {entry.size} bytes: {entry.content}  {entry.data.hex(" ")}'
        elif entry.protocol:
            values = ' '.join(f'{key}={text(item)}' for key, item in entry.fields().items())
            what = f'{entry.protocol} {entry.name}  {values}'
        elif entry.identifier is not None:
            what = f'{entry.name}  {entry.data.hex(" ")}'
        else:
            return
        at = '' if entry.at is None else f'{entry.at:17.6f} '
        identifier = '' if entry.identifier is None else f'{entry.identifier:08X} '
        source = f'{entry.source} ' if entry.source else ''
        print(f'{at}{entry.offset:9} {source}{identifier}{what}'.rstrip(), file=out)

    return write


def json_lines(out: TextIO) -> Writer:
    """Write an object an entry."""

    def write(name: str, entry: Entry) -> None:
        values = {**_head(name, entry), 'fields': entry.fields(), 'raw': entry.data.hex()}
        print(json.dumps(values, ensure_ascii=False), file=out)

    return write


def csv_lines(out: TextIO) -> Writer:
    """Write a line a value, so that every message fits the same columns; one where it has none."""
    rows = csv.writer(out, lineterminator='\n')
    rows.writerow((*_HEAD, 'field', 'value'))

    def write(name: str, entry: Entry) -> None:
        head = _head(name, entry).values()
        for field, value in [*flat(entry.fields())] or [('', '')]:
            rows.writerow([_without_nul(each) for each in (*head, field, value)])

    return write


def _without_nul(value: Any) -> Any:
    """Return what csv can write: before Python 3.11 it refuses a NUL, as damaged texts have."""
    return value.replace('\0', r'\x00') if isinstance(value, str) else value


def _head(name: str, entry: Entry) -> dict[str, Any]:
    identifier = None if entry.identifier is None else f'{entry.identifier:08X}'
    where = (name, entry.offset, entry.at, entry.source, identifier)
    return dict(zip(_HEAD, (*where, entry.protocol, entry.name), strict=True))


WRITERS: dict[str, Callable[[TextIO], Writer]] = {
    'table': table,
    'json': json_lines,
    'csv': csv_lines,
    'statistics': lambda out: lambda name, entry: None,
}
