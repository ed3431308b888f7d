# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Kill the ledger's writer again and again: nothing that it acknowledged may be lost.

A process writes lines of random lengths and reports each once it counts. It is killed at a random
moment soon after some of them, and the file is cut at a random byte behind what was reported, as a
loss of power would. Then the next writer goes on. In the end the chain has to hold, with every
line that was reported.

    python -m assurance.ledger_kills --kills 1000
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import os
from pathlib import Path
import random
import signal
import sys
import tempfile
import time
from typing import NamedTuple, NoReturn

from rugged_teleop.ledger.book import Book, now
from rugged_teleop.ledger.chain import digest, Head, Reader

_LONGEST = 6000  # characters: several pages of a disk, at times
_LINES = 4  # that a writer reports, at most, until it is killed soon
_SOON = 0.005  # s


class Result(NamedTuple):
    """:param reported: lines that counted. :param torn_ends: that were named."""

    reported: int
    torn_ends: int
    faults: list[str]


def run(kills: int, folder: Path, seed: int) -> Result:
    """Kill so often; return what has become of the ledger."""
    path, chance = folder / 'ledger.jsonl', random.Random(seed)
    reported: dict[int, str] = {}  # digests by number
    safe = 0  # bytes
    for kill in range(kills):
        safe = max(safe, _write_until_killed(path, reported, chance))
        size = path.stat().st_size if path.exists() else 0
        if size > safe and kill % 2:
            os.truncate(path, chance.randint(safe, size))
    Book(path).append(now(), 'end', {})
    reader = Reader(Head())
    found = {}
    with path.open('rb') as file:
        for line in file:
            fields = reader.read(line)
            if fields is not None:
                found[fields['n']] = digest(line[:-1])
    lost = [f'line {n} is lost' for n, each in reported.items() if found.get(n) != each]
    return Result(len(reported), reader.torn_ends, [*reader.faults, *lost])


def _write_until_killed(path: Path, reported: dict[int, str], chance: random.Random) -> int:
    """Return up to where the file is safe, in bytes."""
    safe = 0
    read, write = os.pipe()
    pid = os.fork()
    if not pid:
        _write(path, chance.randrange(1 << 30), write)
    os.close(write)
    with os.fdopen(read, 'rb') as reports:
        before = [reports.readline() for _ in range(chance.randrange(_LINES))]
        time.sleep(chance.uniform(0.0, _SOON))
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        for report in map(bytes.decode, [*before, *reports]):
            number, hexadecimal, size = report.split()
            reported[int(number)] = hexadecimal
            safe = int(size)
    return safe


def _write(path: Path, seed: int, reports: int) -> NoReturn:
    """Write lines and report each, until killed."""
    try:
        book, chance = Book(path), random.Random(seed)
        while True:
            text = 'x' * chance.randrange(chance.choice((20, 200, _LONGEST)))
            book.append(now(), 'kill', {f'part {n}': text[n::4] for n in range(4)})
            report = f'{book.head.number} {book.head.digest} {path.stat().st_size}\n'
            os.write(reports, report.encode())
    finally:
        os._exit(1)


def main(arguments: Sequence[str] | None = None) -> None:
    """Kill, and say what has become of it; exit status 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--kills', type=int, default=1000)
    parser.add_argument('--seed', type=int, default=time.time_ns())
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        result = run(options.kills, Path(folder), options.seed)
    print(
        f'{options.kills} kills (seed {options.seed}): {result.reported} lines counted, '
        f'{result.torn_ends} torn ends were named, {len(result.faults)} faults'
    )
    for fault in result.faults:
        print(fault)
    sys.exit(1 if result.faults else 0)


if __name__ == '__main__':
    main()
