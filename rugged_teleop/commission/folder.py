# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The folder that a trial leaves: report.json, report.html, the parameter file, recordings of the
steps that moved something, and a manifest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import contextlib
from fnmatch import fnmatch
import hashlib
import json
import os
from pathlib import Path
from typing import Any

from rugged_teleop.commission.page import page
from rugged_teleop.commission.step import Record, Result, Step

REPORT, PAGE, PARAMETERS = 'report.json', 'report.html', 'parameters.yaml'
MANIFEST = 'manifest.json'
FORMAT = 1
_NEW = '.new'
_EXCEPTIONS = (Result.ACCEPTED, Result.SKIPPED, Result.NOT_RUN)


class FolderError(ValueError):
    """It is no folder of a trial, or not as it was left."""


def verdict(records: Iterable[Record]) -> str:
    """Return 'failed', 'passed with exceptions' or 'passed'."""
    results = {each.result for each in records}
    if Result.FAILED in results or not results:
        return 'failed'
    return 'passed with exceptions' if results & set(_EXCEPTIONS) else 'passed'


def exceptions(records: Iterable[Record]) -> list[str]:
    """Name what was accepted, skipped or not run, and why."""
    return [
        f'{each.name}: {each.result.value}: {each.reason or each.text}'
        for each in records
        if each.result in _EXCEPTIONS
    ]


def stopping_of(records: Iterable[Record]) -> dict[str, list[dict[str, float]]]:
    """Return how each joint stopped, stop by stop."""
    found: dict[str, list[dict[str, float]]] = {}
    for record in records:
        for joint, stop in record.stopping.items():
            found.setdefault(joint, []).append(stop)
    return found


def report_of(
    head: Mapping[str, Any], steps: Sequence[Step], done: Mapping[str, Record]
) -> dict[str, Any]:
    """Return what report.json has. :param head: who, where, with what."""
    missing = [
        Record(each.name, each.title, Result.NOT_RUN, 'not done')
        for each in steps
        if each.name not in done
    ]
    records = [*done.values(), *missing]
    return {
        'format': FORMAT,
        **head,
        'verdict': verdict(records),
        'exceptions': exceptions(records),
        'failed': [
            f'{each.name}: {each.text}' for each in records if each.result is Result.FAILED
        ],
        'steps': [each.to_json() for each in records],
        'stopping': stopping_of(records),
    }


def write(folder: Path, report: Mapping[str, Any], parameters: bytes) -> None:
    """
    Write all, the manifest last.

    The pieces that the report names are there: new ones as ``new_piece`` names them.
    """
    text = json.dumps(report, indent=1, ensure_ascii=False, sort_keys=True)
    files = {
        REPORT: text.encode(),
        PAGE: page(report).encode(),
        PARAMETERS: parameters,
    }
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    for name in pieces_of(report):
        new = new_piece(folder, name)
        data = (new if new.exists() else folder / name).read_bytes()
        hashes[name] = hashlib.sha256(data).hexdigest()
    for name, data in (files | {MANIFEST: _manifest(hashes)}).items():
        with new_piece(folder, name).open('wb') as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    names = {step['name'] for step in report['steps']}
    for piece in folder.glob('*.mcap'):
        if piece.stem in names and piece.name not in hashes:  # done again, and then skipped
            piece.unlink()
    complete(folder)


def complete(folder: Path) -> None:
    """Put what was written into its place, though ``write`` was ended amid it."""
    names: Sequence[str] = ()
    with contextlib.suppress(FileNotFoundError, ValueError):  # not all is written: it stays as is
        names = (*json.loads(new_piece(folder, MANIFEST).read_bytes())['sha256'], MANIFEST)
    for name in names:
        if (new := new_piece(folder, name)).exists():
            os.replace(new, folder / name)
    for left in folder.glob(f'.*{_NEW}'):  # of a step that no report names
        left.unlink()


def pieces_of(report: Mapping[str, Any]) -> list[str]:
    """Return the names of its recordings."""
    return [each['piece'] for each in report['steps'] if each.get('piece')]


def new_piece(folder: Path, name: str) -> Path:
    """Return where a file waits until all of them are there."""
    return folder / f'.{name}{_NEW}'


def _manifest(hashes: Mapping[str, str]) -> bytes:
    """Return its bytes, of which any other would be a change."""
    return json.dumps({'sha256': hashes}, indent=1, sort_keys=True).encode()


def read(path: Path) -> dict[str, Any]:
    """Return a report. :raises FolderError: it is none."""
    try:
        report = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        raise FolderError(f'{path}: {error}') from error
    if not isinstance(report, dict) or report.get('format') != FORMAT:
        raise FolderError(f'{path}: is no report of this version')
    return report


def records_of(report: Mapping[str, Any]) -> dict[str, Record]:
    """Return what was done, by step. :raises FolderError: it is no report."""
    try:
        records = [Record.from_json(each) for each in report['steps']]
    except (KeyError, TypeError, ValueError) as error:
        raise FolderError(f'a step of the report is none: {error}') from error
    return {each.name: each for each in records if each.text != 'not done'}


def verify(folder: Path) -> dict[str, Any]:
    """Return the report of a folder of which nothing changed. :raises FolderError: it did."""
    try:
        manifest = (folder / MANIFEST).read_bytes()
        hashes = json.loads(manifest)['sha256']
        if manifest != _manifest(hashes):
            raise FolderError(f'{folder / MANIFEST} is not as it was left')
        for name, digest in sorted(hashes.items()):
            if hashlib.sha256((folder / name).read_bytes()).hexdigest() != digest:
                raise FolderError(f'{folder / name} is not as it was left')
        report = read(folder / REPORT)
        missing = {REPORT, PAGE, PARAMETERS, *pieces_of(report)} - set(hashes)
        if missing:
            raise FolderError(f'{folder / MANIFEST} does not name {", ".join(sorted(missing))}')
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, FolderError):
            raise
        raise FolderError(f'{folder}: {error!r}') from error
    there = {each.name for each in folder.iterdir() if not fnmatch(each.name, f'.*{_NEW}*')}
    strangers = there - {*hashes, MANIFEST}
    if strangers:
        raise FolderError(
            f'{folder} has files that are not of the trial: {", ".join(sorted(strangers))}'
        )
    return report
