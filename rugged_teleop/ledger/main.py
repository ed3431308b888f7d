# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Show, verify or export the ledger: starts, resets, stops and whatever else people are asked about.

The recorder writes it. `verify` says whether each line follows the one before, and with an anchor
whether anything was cut off or written anew since. docs/record.md says more.

Exit status: 0 all is well; 1 something is wrong with the ledger; 2 wrong arguments, or a file that
cannot be read.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import csv
from datetime import datetime, timezone
from itertools import chain
import json
from pathlib import Path
import re
import sys
from typing import Any

from rugged_teleop.command_line import is_of_output, Parser
from rugged_teleop.ledger.book import default_file, lines
from rugged_teleop.ledger.chain import FIELDS, Head, Reader

_KEPT = re.compile(r'(\d+) ([0-9a-f]{64}) (-?[\d.]+)')  # a line of an anchor
_EXAMPLES = """\
examples:
  {prog} show                                  # ~/.ros/rugged_teleop/ledger.jsonl
  {prog} show --since 2026-11-22 --what stop
  {prog} verify --anchor /mnt/office/machine.anchor
  {prog} export ledger.jsonl > ledger.csv
"""


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    result.add_argument('action', choices=('show', 'verify', 'export'))
    result.add_argument(
        'files',
        nargs='*',
        metavar='FILE',
        type=Path,
        help='in the order of time (the default one)',
    )
    result.add_argument('--anchor', type=Path, metavar='FILE', help='what ledger.anchor has kept')
    result.add_argument('--since', type=utc_time, metavar='TIME', help='UTC, such as 2026-11-22')
    result.add_argument('--what', default='', help='only lines of this kind')
    return result


def utc_time(text: str) -> str:
    """Return a time as it stands in lines."""
    try:
        at = datetime.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text} is no time such as 2026-11-22') from None
    at = at if at.tzinfo else at.replace(tzinfo=timezone.utc)
    return at.astimezone(timezone.utc).isoformat(timespec='milliseconds')


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop ledger') -> None:
    """Do it; the command's entry point."""
    options = parser(prog).parse_mixed(arguments)
    reader, digests = Reader(Head()), {}
    columns: list[dict[str, Any]] = []
    try:
        files = options.files or [default_file()]
        for fields in chain.from_iterable(lines(path, reader) for path in files):
            assert reader.head is not None
            digests[fields['n']] = reader.head.digest
            if fields['at'] < (options.since or '') or options.what not in ('', fields['what']):
                continue
            if options.action == 'show':
                print(told(fields))
            elif options.action == 'export':
                columns.append(fields)
        wrong = [*reader.faults, *_cut(options.anchor, digests)]
        if not digests:
            wrong.append('this is no ledger: it has no whole line of one')
    except OSError as error:
        if is_of_output(error):
            raise
        print(f'{prog}: {error.filename}: {error.strerror}', file=sys.stderr)
        sys.exit(2)
    if columns:
        _export(columns)
    if options.action == 'verify':
        print(_verdict(reader, len(digests), bool(options.anchor)))
    for fault in wrong:
        print(f'{prog}: {fault}', file=sys.stderr)
    sys.exit(1 if wrong else 0)


def told(fields: dict[str, Any]) -> str:
    """Return a line for people."""
    facts = ', '.join(
        f'{key} {value if isinstance(value, str) else json.dumps(value)}'
        for key, value in fields.items()
        if key not in FIELDS
    )
    return f'{fields["at"]}  {fields["what"]}: {facts}'


def _cut(anchor: Path | None, digests: dict[int, str]) -> Iterator[str]:
    """Say what the anchor has kept and the ledger has not, or has otherwise."""
    if anchor is None:
        return
    text = anchor.read_text(encoding='ascii', errors='replace')
    kept = [found for line in text.splitlines() if (found := _KEPT.fullmatch(line))]  # not torn
    if not kept:
        yield f'{anchor} has kept no line'
    for number, digest, _ in map(re.Match.groups, kept):
        if digests.get(int(number)) != digest:
            yield f'line {number} is not the one that the anchor has kept'


def _verdict(reader: Reader, count: int, anchored: bool) -> str:
    text = f'{count} lines, {reader.torn_ends} ends that were torn and named'
    if reader.rest:
        text += f'; {len(reader.rest)} bytes at the end are no line: the next start names them'
    if not anchored:
        text += '; without --anchor this proves nothing against somebody who may write the file'
    return text


def _export(columns: Sequence[dict[str, Any]]) -> None:
    names = dict.fromkeys((*FIELDS, *(name for each in columns for name in each)))
    writer = csv.DictWriter(sys.stdout, [*names])
    writer.writeheader()
    for each in columns:
        writer.writerow(
            {k: v if isinstance(v, str | int | float) else json.dumps(v) for k, v in each.items()}
        )
