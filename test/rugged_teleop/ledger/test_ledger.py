# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ledger's file: nothing that counted is lost, a torn end is named, a change is found."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

from hypothesis import given, settings, strategies as st
import pytest

from rugged_teleop.ledger.book import Book, lines, now, tail
from rugged_teleop.ledger.chain import Head, Moment, parse, Reader, TORN
from stage.rig import ROOT


def check(path: Path) -> tuple[Reader, list[dict[str, Any]]]:
    reader = Reader(Head())
    found = [*lines(path, reader)]
    return reader, found


def append(path: Path, *texts: str) -> list[dict[str, Any]]:
    """Append by a writer of its own; return the whole ledger, whose chain must hold."""
    book = Book(path)
    for text in texts:
        book.append(now(), text, {})
    book.close()
    reader, found = check(path)
    assert (reader.faults, reader.rest) == ([], b'')
    return found


def test_file_that_is_cut_at_any_byte_goes_on_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / 'ledger.jsonl'
    append(path, 'first', 'second')
    data = path.read_bytes()
    second = data.index(b'\n') + 1
    for size in range(len(data) + 1):
        path.write_bytes(data[:size])
        whats = [each['what'] for each in append(path, 'third')]
        torn = size not in (0, second - 1, second, len(data) - 1, len(data))
        kept = ['first', 'second'][: (size >= second - 1) + (size >= len(data) - 1)]
        assert whats == [*kept, *[TORN] * torn, 'third'], size


@given(rest=st.binary(max_size=40), again=st.binary(max_size=40))
@settings(max_examples=100, deadline=None)
def test_whatever_stands_at_the_end_stays_and_is_named(
    tmp_path_factory: pytest.TempPathFactory, rest: bytes, again: bytes
) -> None:
    path = tmp_path_factory.mktemp('torn') / 'ledger.jsonl'
    append(path, 'first')
    for torn in (rest, again):
        with path.open('ab') as file:
            file.write(torn)
        append(path, 'next')
    data = path.read_bytes()
    assert rest in data
    assert again in data


def _with(line: bytes, name: str, value: Any) -> bytes:
    return json.dumps(json.loads(line) | {name: value}).encode() + b'\n'


@pytest.mark.parametrize(
    ('change', 'fault'),
    [
        (lambda a: a[:1] + a[2:], 'line 3 does not follow line 1'),
        (lambda a: [a[0], a[2], a[1], a[3]], 'line 3 does not follow line 1'),
        (lambda a: a[1:], 'line 2 does not follow line 0'),
        (lambda a: [a[0], a[1].replace(b'1', b'2', 1), *a[2:]], 'does not follow'),
        (lambda a: [a[0], b'x' + a[1], *a[2:]], 'does not follow'),
        (lambda a: [a[0], b'x\n', *a[1:]], 'what is before line 2 is not what it says'),
        (lambda a: [a[0], _with(a[1], 'at', 5), *a[2:]], 'does not follow'),
        (lambda a: [a[0], _with(a[1], 'what', []), *a[2:]], 'does not follow'),
    ],
    ids=['left out', 'exchanged', 'beginning', 'digit', 'no line', 'more', 'no time', 'no kind'],
)
def test_change_amid_the_ledger_is_found(tmp_path: Path, change: Any, fault: str) -> None:
    path = tmp_path / 'ledger.jsonl'
    append(path, 'a', 'b', 'c', 'd')
    path.write_bytes(b''.join(change(path.read_bytes().splitlines(keepends=True))))
    assert any(fault in each for each in check(path)[0].faults)


def test_each_changed_byte_is_found_but_in_the_last_line(tmp_path: Path) -> None:
    path = tmp_path / 'ledger.jsonl'
    append(path, 'a')
    with path.open('ab') as file:
        file.write(b'torn')
    append(path, 'b')
    data = path.read_bytes()
    last = data.rindex(b'\n', 0, -1) + 1
    for place in range(last):
        path.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
        reader, _ = check(path)
        assert reader.faults or reader.rest, place


def test_line_counts_only_once_it_is_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def noted(what: str, call: Any) -> Any:
        def note_and_call(*args: Any) -> Any:
            done.append(what)
            return call(*args)

        return note_and_call

    monkeypatch.setattr(os, 'fsync', noted('fsync', os.fsync))
    monkeypatch.setattr(os, 'write', noted('write', os.write))
    book = Book(tmp_path / 'ledger.jsonl')
    for _ in range(2):
        book.append(now(), 'a', {})
        assert done[-2:] == ['write', 'fsync']


def test_full_disk_tears_a_line_and_the_next_names_it(tmp_path: Path) -> None:
    path = tmp_path / 'ledger.jsonl'
    code = (
        'import resource, signal, sys; from rugged_teleop.ledger.book import *\n'
        'signal.signal(signal.SIGXFSZ, signal.SIG_IGN); book = Book(Path(sys.argv[1]))\n'
        'book.append(now(), "first", {})\n'
        'size, most = book.path.stat().st_size, resource.RLIM_INFINITY\n'
        'for more in (50, 60, 60):\n'
        '    resource.setrlimit(resource.RLIMIT_FSIZE, (size + more, most))\n'
        '    try: book.append(now(), "second", {})\n'
        '    except OSError as error: print(error.errno)\n'
        'resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))\n'
        'book.append(now(), "third", {})\n'
    )
    command = [sys.executable, '-c', code, str(path)]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert ran.stdout.split() == [str(errno.EFBIG)] * 3
    assert [each['what'] for each in append(path)] == ['first', TORN, 'third']


def test_second_writer_is_refused_until_the_first_has_left(tmp_path: Path) -> None:
    first, second = (Book(tmp_path / 'ledger.jsonl') for _ in range(2))
    first.append(now(), 'a', {})
    with pytest.raises(OSError, match='another process writes it'):
        second.append(now(), 'b', {})
    first.close()
    second.append(now(), 'b', {})
    second.close()
    assert [each['what'] for each in append(second.path)] == ['a', 'b']


def test_ledger_that_was_moved_away_goes_on_in_a_new_file(tmp_path: Path) -> None:
    path, old = tmp_path / 'ledger.jsonl', tmp_path / 'old.jsonl'
    book = Book(path)
    book.append(now(), 'a', {})
    path.rename(old)
    book.append(now(), 'b', {})
    book.close()
    reader = Reader(Head())
    assert [each['what'] for file in (old, path) for each in lines(file, reader)] == ['a', 'b']
    assert reader.faults == []
    Book(old).append(now(), 'c', {})  # nobody holds it any more


@pytest.mark.parametrize('size', [-30, 0, 5], ids=['cut', 'cut between lines', 'more'])
def test_change_under_the_writer_is_found_and_costs_no_later_line(
    tmp_path: Path, size: int
) -> None:
    book = Book(tmp_path / 'ledger.jsonl')
    for text in ('a', 'b'):
        book.append(now(), text, {})
    data = book.path.read_bytes()
    os.truncate(book.path, data.index(b'\n') + 1 if not size else len(data) + size)
    for text in ('c', 'd'):
        book.append(now(), text, {})
    book.close()
    reader, found = check(book.path)
    assert [each['what'] for each in found][-2:] == ['c', 'd']
    assert len(reader.faults) == 1


@pytest.mark.parametrize(
    ('window', 'newest'),
    [(10_000, ['a', 'b', 'c']), (300, ['c']), (10, ['a', 'b', 'c'])],
    ids=['all', 'some', 'none, so all'],
)
def test_start_looks_at_the_newest_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, window: int, newest: list[str]
) -> None:
    path = tmp_path / 'ledger.jsonl'
    append(path, 'a', 'b', 'c')
    monkeypatch.setattr('rugged_teleop.ledger.book._WINDOW', window)
    reader, found = tail(path)
    assert [each['what'] for each in found] == newest
    assert reader.head == check(path)[0].head
    assert reader.faults == []


def test_moment_names_the_start_of_the_computer_where_it_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / 'boot_id'
    monkeypatch.setattr('rugged_teleop.ledger.book._BOOT', file)
    assert now().boot == ''
    file.write_text('12345678-abcd', encoding='ascii')
    assert now().boot == '12345678'


def test_clock_that_jumps_and_words_of_any_length_break_no_chain(tmp_path: Path) -> None:
    book = Book(tmp_path / 'a' / 'b' / 'ledger.jsonl')
    for at, text in ((0.0, ''), (4e9, 'ä\n"\ud800'), (-1e9, 'x' * 10_000)):
        line = book.append(Moment(at, 'boot', 0.0), 'a', {'text': text})
        assert parse(line) is not None
        assert len(line) < 3000
    book.close()
    assert len(append(book.path)) == 3


def test_killed_writers_lose_nothing_that_counted() -> None:
    command = [sys.executable, '-m', 'assurance.ledger_kills', '--kills', '25', '--seed', '1']
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
