# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Entries as a table for people, JSON lines, or CSV with a line for each value."""

from __future__ import annotations

from collections.abc import Callable
import csv
import json
from typing import Any, Protocol, TextIO

from rugged_teleop.decode.plain import flat, text
from rugged_teleop.decode.protocols import Entry


class Writer(Protocol):
    """What takes entries."""

    def write(self, name: str, entry: Entry) -> None:
        """Write an entry of the file of this name."""


class Table:
    """One line an entry; what is no frame of ours, nor of a CAN bus, is left out."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._name = ''

    def write(self, name: str, entry: Entry) -> None:
        """Write a line; before the first of a file its name."""
        if name != self._name:
            self._name = name
            print(f'# {name}', file=self._out)
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
        print(f'{at}{entry.offset:9} {source}{identifier}{what}'.rstrip(), file=self._out)


class JsonLines:
    """One object an entry."""

    def __init__(self, out: TextIO) -> None:
        self._out = out

    def write(self, name: str, entry: Entry) -> None:
        """Write a line."""
        values = {**_head(name, entry), 'fields': entry.fields(), 'raw': entry.data.hex()}
        print(json.dumps(values, ensure_ascii=False), file=self._out)


class Csv:
    """One line a value, so that every message fits the same columns."""

    def __init__(self, out: TextIO) -> None:
        self._writer = csv.writer(out, lineterminator='\n')
        self._writer.writerow((*_HEAD, 'field', 'value'))

    def write(self, name: str, entry: Entry) -> None:
        """Write the lines; one where there is no value."""
        head = _head(name, entry).values()
        for field, value in [*flat(entry.fields())] or [('', '')]:
            self._writer.writerow([_without_nul(each) for each in (*head, field, value)])


def _without_nul(value: Any) -> Any:
    """Return what csv can write: before Python 3.11 it refuses a NUL, as damaged texts have."""
    return value.replace('\0', r'\x00') if isinstance(value, str) else value


_HEAD = ('file', 'offset', 'time', 'source', 'identifier', 'protocol', 'message')


def _head(name: str, entry: Entry) -> dict[str, Any]:
    identifier = None if entry.identifier is None else f'{entry.identifier:08X}'
    where = (name, entry.offset, entry.at, entry.source, identifier)
    return dict(zip(_HEAD, (*where, entry.protocol, entry.name), strict=True))


class Nothing:
    """Writes nothing, where only the statistics are wanted."""

    def __init__(self, out: TextIO) -> None:
        del out

    def write(self, name: str, entry: Entry) -> None:
        """Do nothing."""


WRITERS: dict[str, Callable[[TextIO], Writer]] = {
    'table': Table,
    'json': JsonLines,
    'csv': Csv,
    'statistics': Nothing,
}
