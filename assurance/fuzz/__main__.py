# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Run hostile inputs through everything that reads what others wrote.

    make fuzz                              # ten million for each parser, 100 000 for all else
    make fuzz ARGS='--count 100000 ssc'    # those whose name contains ssc
    make fuzz ARGS='--grow 5000 vsc'       # look for inputs that reach more, and keep them

A run that was cut goes on where it was, as build/fuzz has it, if no source has changed since.
Exit status: 0 nothing was found; 1 an input shows a fault, and is printed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from functools import partial
import gzip
import io
import json
import multiprocessing
import os
from pathlib import Path
import sys
import time
from typing import Any

from assurance.fuzz import TARGETS
from assurance.fuzz.campaign import (
    CORPUS,
    corpus,
    corpus_of,
    Finding,
    Fuzzer,
    smallest,
    watch_for_hangs,
)
from assurance.proof import digest_of_sources
from stage.rig import ROOT

RESULTS = ROOT / 'build' / 'fuzz'  # a file for each target
_PARSED, _COUNT = 10_000_000, 100_000
_BATCH = 2000
_KEPT = 60  # inputs of each target in the corpus


def _run(name: str, count: int | None, folder: Path) -> bool:
    """Run batches up to a count; tell whether nothing was found."""
    target, path = TARGETS[name], folder / f'{name.replace(" ", "_")}.json'
    count = count or (_PARSED if 'parser' in name else _COUNT)
    sources = digest_of_sources()
    row: dict[str, Any] = {
        'target': name,
        'sources': sources,
        'inputs': 0,
        'seconds': 0.0,
        'findings': [],
    }
    if path.exists():
        known = json.loads(path.read_text(encoding='utf-8'))
        row = known if known.get('sources') == sources else row
    fuzzer = Fuzzer(target, corpus_of(corpus().get(name, [])))
    try:
        for reads in fuzzer.pool:
            fuzzer.check(reads)
    except Finding as finding:
        row['findings'] = [str(finding)]
    while row['inputs'] < count and not row['findings']:
        begun = time.process_time()
        outcome = fuzzer.batch(row['inputs'], min(_BATCH, count - row['inputs']))
        row['inputs'] += outcome.inputs
        row['seconds'] = round(row['seconds'] + time.process_time() - begun, 3)
        row['findings'] += [str(finding) for finding in outcome.findings]
        row['reached'] = len(fuzzer.pairs)
        row['corpus'] = len(fuzzer.pool)
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = path.with_suffix('.new')
        scratch.write_text(json.dumps(row) + '\n', encoding='utf-8')
        scratch.replace(path)
    print(f'{name}: {row["inputs"]} inputs, {row["seconds"]} s', *row['findings'], sep='\n')
    return not row['findings']


def _grow(name: str, count: int) -> bool:
    """Look for inputs that reach more than those of the corpus; keep the smallest that do."""
    target, stored = TARGETS[name], corpus()
    fuzzer = Fuzzer(target, corpus_of(stored.get(name, [])))
    for reads in fuzzer.pool:
        fuzzer.check(reads)
    before = len(fuzzer.pairs)
    outcome = fuzzer.batch(len(fuzzer.pool) + 1_000_000, count, traced=1)
    for each in outcome.findings:
        print(each)
    kept = smallest(target, [*fuzzer.pool, *outcome.found], _KEPT)
    stored[name] = [[[pause, data.hex()] for pause, data in reads] for reads in kept]
    text = json.dumps(dict(sorted(stored.items())), separators=(',', ':'))
    CORPUS.write_bytes(gzip.compress(text.encode(), mtime=0))
    after = Fuzzer(target, kept)
    for reads in after.pool:
        after.check(reads)
    print(f'{name}: {len(kept)} inputs kept; {len(after.pairs)} pairs of lines, {before} before')
    return not outcome.findings


def _aside(work: Callable[[str], bool], name: str) -> bool:
    """Do it without what libraries tell of each damaged line, and without hanging."""
    watch_for_hangs()
    with redirect_stderr(io.StringIO()):
        clean = work(name)
    sys.stdout.flush()
    return clean


def main(arguments: Sequence[str] | None = None) -> int:
    """Run; return the exit status."""
    parser = argparse.ArgumentParser(prog='assurance.fuzz', description=(__doc__ or '').strip())
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument('names', nargs='*', metavar='NAME', help='a part of a name; default: all')
    parser.add_argument('--count', type=int, help='inputs of each; default: see above')
    parser.add_argument(
        '--grow', type=int, metavar='N', help='look for N inputs, traced, and keep'
    )
    parser.add_argument('--results', type=Path, default=RESULTS, help='where they are kept')
    parser.add_argument('--workers', type=int, default=os.cpu_count(), help='targets at a time')
    options = parser.parse_args(arguments)
    chosen = [
        name
        for name in TARGETS
        if not options.names or any(part in name for part in options.names)
    ]
    work = partial(_run, count=options.count, folder=options.results)
    if options.grow:  # one after the other, as they share the corpus
        work, options.workers = partial(_grow, count=options.grow), 1
    with multiprocessing.get_context('fork').Pool(options.workers) as pool:
        clean = all([*pool.imap_unordered(partial(_aside, work), chosen)])
    return 0 if clean else 1


if __name__ == '__main__':
    sys.exit(main())
