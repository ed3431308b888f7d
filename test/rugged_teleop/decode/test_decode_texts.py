# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Hex listings, candump's two forms and python-can's logs."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from pathlib import Path
import re
from typing import Any
import zlib

import can
from hypothesis import given, HealthCheck, settings, strategies as st
import pytest

from rugged_teleop.decode import logs
from rugged_teleop.decode.captures import format_of, FORMATS
from rugged_teleop.decode.logs import read_log
from rugged_teleop.decode.pieces import Damage, Piece
from rugged_teleop.decode.protocols import Entry
from rugged_teleop.decode.statistics import Statistics
from rugged_teleop.decode.texts import HexListing
from stage.captures import CAN, decoded, STREAMS

HEARTBEAT = STREAMS['fort_serial'][0]


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding='ascii')
    return path


# Hex.


@pytest.mark.parametrize(
    'line',
    [
        '100120060900000000004009',
        '10 01 20 06 09 00 00 00 00 00 40 09',
        '{0x10,0x01,0x20,0x06,0x09,0x00,0x00,0x00,0x00,0x00,0x40,0x09}',
        r'\x10\x01\x20\x06\x09\x00\x00\x00\x00\x00\x40\x09',
        '10:01:20:06:09:00:00:00:00:00:40:09',
        '10-01-20-06-09-00-00-00-00-00-40-09',
        '00000000: 1001 2006 0900 0000 0000 4009            .. .......@.',
        '00000000  10 01 20 06 09 00 00 00  00 00 40 09              |.. .......@.|',
        '000000 10 01 20 06 09 00 00 00 00 00 40 09',
    ],
)
def test_hex_is_read_in_every_usual_notation(line: str) -> None:
    assert HexListing().read(line) == HEARTBEAT


def test_what_only_looks_like_hex_is_none() -> None:
    # xxd repeats the bytes as characters: here a, b, space, 1, 2.
    line = '00000000: 6162 2031 32                             ab 12'
    assert HexListing().read(line) == b'ab 12'
    with pytest.raises(ValueError, match='not hex'):  # single digits: which half is missing?
        HexListing().read('0x10, 0x01, 0x20, 0x06, 0x09, 0, 0')


def test_hexdump_ends_with_an_address_that_is_no_data(tmp_path: Path) -> None:
    listing = '00000000  10 01 20 06 09 00 00 00  00 00 40 09  |.. .......@.|\n0000000c\n'
    (entry,) = decoded(write(tmp_path / 'a.txt', listing))
    assert (entry.protocol, entry.data) == ('fort_serial', HEARTBEAT)


def test_offset_of_a_frame_in_a_listing_is_that_of_its_first_line(tmp_path: Path) -> None:
    lines = ['# the second frame is cut in two\n', f'{HEARTBEAT.hex()}\n']
    lines += [f'{HEARTBEAT[:5].hex(" ")}\n', 'no hex\n', f'{HEARTBEAT[5:].hex(" ")}\n']
    entries = decoded(write(tmp_path / 'a.txt', ''.join(lines)))
    starts = [sum(map(len, lines[:number])) for number in range(5)]
    assert [(e.name, e.offset) for e in entries] == [
        ('Heartbeat', starts[1]),
        ('damage', starts[3]),
        ('Heartbeat', starts[2]),
    ]
    assert entries[1].content == 'not hex'


def test_lines_that_hexdump_leaves_out_are_damage(tmp_path: Path) -> None:
    listing = '00000000  10 01 20 06 09 00 00 00\n*\n00000020  00 00 40 09\n'
    entries = decoded(write(tmp_path / 'a.txt', listing), 'fort_serial')
    assert 'hexdump -Cv' in entries[0].content


def test_one_endless_line_of_hex_is_read(tmp_path: Path) -> None:
    for separator in ('', ' '):
        path = write(tmp_path / 'a.txt', HEARTBEAT.hex(separator or ' ').replace(' ', separator))
        text = (path.read_text() + separator) * 3000
        entries = decoded(write(path, text))
        assert [entry.data for entry in entries] == [HEARTBEAT] * 3000


# candump.


def fields(entries: list[Entry]) -> list[tuple[Any, ...]]:
    return [(e.at, e.source, e.identifier, e.name, e.data.hex()) for e in entries]


@pytest.mark.parametrize(
    ('line', 'expected'),
    [
        (
            '(1700000000.250000) can0 0CFDE801#090000000000',
            (1700000000.25, 'can0', 0x0CFDE801, 'heartbeat', '090000000000'),
        ),
        (
            '(0.5) vcan0 18EFFF80#83C051 R',
            (0.5, 'vcan0', 0x18EFFF80, 'DigitalOutputs', '83c051'),
        ),
        ('(0.5) can0 123#R', (0.5, 'can0', 0x123, 'remote frame', '')),
        ('(0.5) can0 123#1122', (0.5, 'can0', 0x123, 'standard frame', '1122')),
        ('(0.5) can0 0CFDE801##1090000000000', (0.5, 'can0', 0x0CFDE801, 'CAN FD frame', '')),
        # An error frame: its bits must not be taken for an identifier.
        (
            '(0.5) can0 20000004#0004000000006060',
            (0.5, 'can0', 0x4, 'error frame', '0004000000006060'),
        ),
        (
            '  can0  0CFDE801   [6]  09 00 00 00 00 00',
            (None, 'can0', 0x0CFDE801, 'heartbeat', '090000000000'),
        ),
        (
            " (012.345678)  can0  RX - -  0CFDE801   [6]  09 00 00 00 00 00   '......'",
            (12.345678, 'can0', 0x0CFDE801, 'heartbeat', '090000000000'),
        ),
        ('  can0  18EFFF80   [1]  03', (None, 'can0', 0x18EFFF80, 'FirmwarePoll', '03')),
        ('  can0  123   [0]  remote request', (None, 'can0', 0x123, 'remote frame', '')),
        (
            '  can0  20000004   [8]  00 04 00 00 00 00 60 60   ERRORFRAME',
            (None, 'can0', 0x4, 'error frame', '0004000000006060'),
        ),
        (
            '  can0  123   [16]  00 11 22 33 44 55 66 77 88 99 AA BB CC DD EE FF',
            (None, 'can0', 0x123, 'CAN FD frame', ''),
        ),
    ],
)
def test_line_of_candump(line: str, expected: tuple[Any, ...], tmp_path: Path) -> None:
    assert fields(decoded(write(tmp_path / 'a.log', line + '\n'))) == [expected]


def test_date_of_candump_is_a_time(tmp_path: Path) -> None:
    line = ' (2026-11-22 12:00:00.250000)  can0  0CFDE801   [6]  09 00 00 00 00 00\n'
    (entry,) = decoded(write(tmp_path / 'a.log', line))
    assert entry.at is not None
    assert entry.at % 60 == pytest.approx(0.25)


@pytest.mark.parametrize(
    'damaged',
    ['(0.5) can0 0CFDE801#0900000', '(0.5) can0 0CFDE801#090', 'can0 0CFDE801 [6] 09 00', '????'],
)
def test_damaged_line_costs_only_itself(damaged: str, tmp_path: Path) -> None:
    good = '(0.5) can0 0CFDE801#090000000000\n'
    entries = decoded(write(tmp_path / 'a.log', f'{good}{damaged}\n{good}'))
    assert [entry.name for entry in entries] == ['heartbeat', 'damage', 'heartbeat']
    assert (entries[1].offset, entries[1].size) == (len(good), len(damaged) + 1)


def test_what_candump_and_people_add_is_no_damage(tmp_path: Path) -> None:
    """Comments, and what -e says of an error frame."""
    text = '# stop at 12:03\n  can0  20000088   [8]  00 00 80 00 00 00 00 00   ERRORFRAME\n'
    text += '\tprotocol-violation{{}{error-on-tx}}\n\tbus-error\n; the next one is good\n'
    entries = decoded(
        write(tmp_path / 'a.log', text + '  can0  0CFDE801   [6]  09 00 00 00 00 00\n')
    )
    assert [entry.name for entry in entries] == ['error frame', 'heartbeat']


def test_frames_of_both_devices_on_one_bus_are_told_apart(tmp_path: Path) -> None:
    # The same identifier: only the VSC sends FF in the bytes that it does not use.
    akron = '(0.5) can0 0CFDD633#107D046400100000\n'
    vsc = '(0.5) can0 0CFDD633#01000100FF00FFFF\n'
    other = '(0.5) can0 18EFFF80#99\n'
    path = write(tmp_path / 'a.log', akron + vsc + other)
    names = [(entry.protocol, entry.name) for entry in decoded(path)]
    assert names == [('akron', 'BasicJoystick'), ('fort_can', 'left_basic'), ('', 'other')]
    assert [entry.protocol for entry in decoded(path, 'akron')] == ['akron', 'akron', '']


def test_impossible_frame_of_our_own_identifier_is_damage(tmp_path: Path) -> None:
    path = write(tmp_path / 'a.log', '(0.5) can0 0CFDE801#0900\n(0.5) can0 0CFDD634#0900\n')
    assert [entry.damaged for entry in decoded(path)] == [True, True]
    assert 'heartbeat has 6 bytes, not 2' in str(decoded(path)[0].content)


# python-can's own formats.

WRITERS: dict[str, Callable[..., Any]] = {
    'asc': can.ASCWriter,
    'blf': can.BLFWriter,
    'csv': can.CSVWriter,
    'db': can.SqliteWriter,
    'trc': can.TRCWriter,
    'candump': can.CanutilsLogWriter,
}
each_log = pytest.mark.parametrize('kind', WRITERS)


def write_log(path: Path, kind: str, count: int = 3) -> Path:
    writer = WRITERS[kind](str(path))
    for number in range(count):
        for place, (identifier, data) in enumerate(CAN):
            at = 1700000000.0 + number + place / 100
            writer.on_message_received(
                can.Message(timestamp=at, arbitration_id=identifier, data=data, channel=0)
            )
    writer.stop()
    return path


@each_log
def test_log_of_python_can_is_read(kind: str, tmp_path: Path) -> None:
    path = write_log(tmp_path / 'capture', kind)
    with path.open('rb') as file:
        assert format_of(file.read(4096)) == kind
    entries = decoded(path)
    # The reader of ASC takes the first line for one more of the header if there is none of events.
    assert [(e.identifier, e.data) for e in entries][-len(CAN) :] == CAN
    assert len(entries) == 3 * len(CAN)
    assert not any(entry.damaged for entry in entries)
    times = [entry.at or 0.0 for entry in entries]
    assert times[-1] - times[0] == pytest.approx(2.0 + (len(CAN) - 1) / 100, abs=0.002)


@pytest.mark.parametrize('kind', ['asc', 'csv', 'trc', 'candump'])
@pytest.mark.parametrize('place', [1, 5, -1])
def test_damaged_line_of_a_log_is_skipped_at_its_offset(
    kind: str, place: int, tmp_path: Path
) -> None:
    path = write_log(tmp_path / 'capture', kind)
    lines = path.read_text(encoding='utf-8').splitlines(keepends=True)
    frames = [number for number, line in enumerate(lines) if is_frame(kind, line)]
    assert len(frames) == 3 * len(CAN)
    number = frames[place]
    # Its last byte, or the base64 of all of them, cannot be.
    lines[number] = re.sub(r'[0-9A-Fa-f]{2}( [RT])?\s*$|,[^,]*$', r',Z\1\n', lines[number])
    path.write_text(''.join(lines), encoding='utf-8', newline='')
    entries = decoded(path)
    (bad,) = (entry for entry in entries if entry.damaged)
    assert bad.offset == sum(len(line.encode()) for line in lines[:number])
    assert len(entries) == 3 * len(CAN)
    whole = [(e.identifier, e.data) for e in entries if not e.damaged]
    expected = CAN * 3
    assert whole == expected[: frames.index(number)] + expected[frames.index(number) + 1 :]


def is_frame(kind: str, line: str) -> bool:
    pattern = {
        'asc': r'\s*[\d.]+\s+\d+\s+[0-9A-F]+x\s',
        'csv': r'[\d.]+,',
        'trc': r'\s*\d+\s+[\d.]+\s+DT',
        'candump': r'\(',
    }[kind]
    return re.match(pattern, line) is not None


def test_cut_blf_gives_what_is_whole_and_says_so(tmp_path: Path) -> None:
    path = write_log(tmp_path / 'capture', 'blf', 1000)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + b'XXXX' * 10)
    entries = decoded(path)
    assert len(entries) > 1000
    assert [entry.damaged for entry in entries[-2:]] == [False, True]
    assert 'the rest is not read' in entries[-1].content


def test_blf_with_an_object_of_size_0_ends(tmp_path: Path) -> None:
    path = write_log(tmp_path / 'capture', 'blf')
    data = bytearray(path.read_bytes())
    start = data.index(b'LOBJ')
    head, body = data[: start + 32], bytearray(zlib.decompress(data[start + 32 :]))
    place = body.index(b'LOBJ', body.index(b'LOBJ') + 1)
    body[place + 8 : place + 12] = bytes(4)  # the second one's size
    head[start + 8 : start + 12] = (32 + len(body)).to_bytes(4, 'little')
    head[start + 16 : start + 18] = bytes(2)  # not compressed
    path.write_bytes(head + body)
    with path.open('rb') as file:
        first, last = islice(read_log('blf', file), 5)
    assert isinstance(first, Piece)
    assert isinstance(last, Damage)
    assert 'object of size 0' in last.reason


def test_hopeless_log_ends(tmp_path: Path) -> None:
    path = write(tmp_path / 'a.csv', 'timestamp,arbitration_id,x\n' + 'nonsense\n' * 1000)
    entries = decoded(path)
    assert len(entries) < 200
    assert 'the rest is not read' in entries[-1].content


@pytest.mark.parametrize('kind', ['asc', 'csv', 'trc', 'candump'])
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_no_text_makes_it_fail(kind: str, tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / 'capture'
    if not path.exists():  # once: some name the moment of their writing, at changing lengths
        write_log(path, kind)
    whole = bytearray(path.read_bytes())
    for place in data.draw(st.lists(st.integers(0, len(whole) - 1), max_size=8)):
        whole[place] = data.draw(st.integers(0, 255))
    path = tmp_path / 'damaged'
    path.write_bytes(whole)
    statistics = Statistics(250000)
    for entry in decoded(path, kind=kind):
        assert 0 <= entry.offset <= len(whole)
        statistics.note(entry)
    assert list(statistics.lines())


def test_reader_that_fails_before_the_first_line_is_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(lines: Any) -> Any:
        raise TypeError('expected a path')

    monkeypatch.setitem(logs._TEXTS, 'asc', fails)
    entries = decoded(write(tmp_path / 'a.asc', 'date\n'), kind='asc')
    assert 'TypeError of python-can: expected a path' in entries[0].content
    assert 'the rest is not read' in entries[-1].content


def test_log_of_nothing_that_its_reader_knows_says_so(tmp_path: Path) -> None:
    """python-can's reader passes over what is of no known type."""
    text = ';$FILEVERSION=1.1\n;$STARTTIME=45000.5\n     1)      1059.9 Xx 0300 1 00\n'
    statistics = Statistics(250000)
    assert not decoded(write(tmp_path / 'a.trc', text), kind='trc')
    assert list(statistics.lines()) == ['nothing was found in it']


def test_time_that_is_no_number_is_none(tmp_path: Path) -> None:
    lines = [f'({text})  can0  0CFDE801  [0]\n' for text in ('nan', 'inf', '1e999', '2.5')]
    entries = decoded(write(tmp_path / 'a.log', ''.join(lines)))
    assert [entry.at for entry in entries] == [None, None, None, 2.5]


# Formats.


def test_formats_are_told_by_their_beginning() -> None:
    for head, kind in (
        (b'10 01 20\n', 'hex'),
        (b'# comment\n\n(0.5) can0 123#11\n', 'candump'),
        (b'\x10\x01\x20\x06', 'raw'),
        (b'\xa1\xb2\xc3\xd4', 'pcap'),
        (b'\x0a\x0d\x0d\x0a', 'pcapng'),
        (b'$GPGGA\xff', 'raw'),
    ):
        assert format_of(head) == kind
        assert kind in FORMATS
    for head, error in ((b'', 'empty'), (b'hello\nworld\n', '--format')):
        with pytest.raises(ValueError, match=error):
            format_of(head)
