# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Streams of bytes: what they are, where each frame stands, and what is damaged."""

from __future__ import annotations

from pathlib import Path
import random
import tracemalloc

from hypothesis import given, HealthCheck, settings, strategies as st
import pytest

from bridge_core.checksums import crc16_ccitt_false
from fort_vsc_bridge.protocol import PACKETS
import rugged_teleop.decode.captures as captures
from rugged_teleop.decode.pieces import Piece
from rugged_teleop.decode.protocols import entries_of, Entry, STREAM_PROTOCOLS
from stage.captures import decoded, STREAMS

SECOND = STREAMS['fort_serial'][1]
each_protocol = pytest.mark.parametrize('protocol', STREAMS)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / 'capture.bin'


def entries(data: bytes, protocol: str = '', split: int = 1 << 16) -> list[Entry]:
    pieces = (Piece(at, data[at : at + split]) for at in range(0, len(data), split))
    return list(entries_of(captures.Capture('x', 'raw', len(data), pieces), protocol))


@each_protocol
def test_protocol_is_told_by_the_content(protocol: str, path: Path) -> None:
    path.write_bytes(b'noise' + b''.join(STREAMS[protocol]))
    first, *others = decoded(path)
    assert first.damaged
    assert [entry.data for entry in others] == STREAMS[protocol]
    assert {entry.protocol for entry in others} == {protocol}


def test_compact_layout_of_a_drive_is_told_from_the_padded_one() -> None:
    # One axis, enabled, velocity mode, 1000 rpm: axis A of the manual's example 4.2.4.
    body = bytes.fromhex('05E803')
    packet = b'\xf0\xf0' + body + crc16_ccitt_false(body).to_bytes(2, 'little')
    assert {entry.protocol for entry in entries(packet * 4)} == {'esi_command_compact'}


@each_protocol
@pytest.mark.parametrize('split', [1, 7])
def test_offsets_are_those_of_the_file_in_any_split(protocol: str, split: int) -> None:
    data, expected = b'', []
    for frame in STREAMS[protocol]:
        data += b'\x00\x01'
        expected.append((len(data), frame))
        data += frame
    found = [entry for entry in entries(data, protocol, split) if not entry.damaged]
    assert [(entry.offset, entry.data) for entry in found] == expected


@pytest.mark.parametrize(
    ('broken', 'reason'),
    [
        (b'\x10\x01\x20\x07\x09', 'a type or length that cannot be'),
        (b'\x10\x01\x20\x06\x09\x00', 'shorter than its length says'),
        (b'\x20\x06\x09\x00\x00\x00', 'no beginning of a frame'),
        (b'\x10\x01', 'no beginning of a frame'),
        (bytes((*SECOND[:6], SECOND[6] ^ 0x40, *SECOND[7:])), 'wrong check'),
    ],
)
def test_damage_says_what_is_wrong(broken: bytes, reason: str) -> None:
    frame = STREAMS['fort_serial'][0]
    for data, place in ((frame + broken + frame, 1), (frame + broken, 1), (broken + frame, 0)):
        bad = entries(data)[place]
        assert (bad.offset, bad.size, bad.content) == (place * len(frame), len(broken), reason)


def test_contents_that_cannot_be_are_damage_of_one_whole_frame() -> None:
    key_of_200 = PACKETS.build(0x32, b'\xc8')
    bad, good = entries(key_of_200 + STREAMS['fort_serial'][0])
    assert (bad.offset, bad.size, bad.damaged) == (0, len(key_of_200), True)
    assert 'key' in bad.content
    assert good.name == 'Heartbeat'


def test_unknown_type_is_shown_and_no_damage() -> None:
    frame = PACKETS.build(0x40, b'\x01\x02')
    (entry,) = entries(frame)
    assert (entry.name, entry.fields(), entry.damaged) == ('unknown', {'type': '0x40'}, False)


def test_long_noise_is_one_damaged_place() -> None:
    frame = STREAMS['ssc'][0]
    noise = bytes(300_000)  # more than the sample that tells the protocol
    _, bad, last = entries(frame + noise + frame, split=4096)
    assert (bad.offset, bad.size) == (len(frame), len(noise))
    assert last.offset == len(frame) + len(noise)
    assert len(bad.data) <= 32


def test_noise_alone_names_what_was_looked_for() -> None:
    with pytest.raises(ValueError, match='no frame of fort_serial'):
        entries(bytes(1000))
    (bad,) = entries(bytes(1000), 'ssc')
    assert bad.size == 1000


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_every_byte_has_one_entry_and_every_message_is_the_bridges(data: st.DataObject) -> None:
    protocol = data.draw(st.sampled_from(list(STREAMS)))
    parts = st.one_of(st.sampled_from(STREAMS[protocol]), st.binary(max_size=12))
    stream = bytearray(b''.join(data.draw(st.lists(parts, min_size=1, max_size=12))))
    for place in data.draw(st.lists(st.integers(0, max(0, len(stream) - 1)), max_size=3)):
        if stream:
            stream[place] ^= data.draw(st.integers(1, 255))
    found = entries(bytes(stream), protocol, data.draw(st.integers(1, 40)))

    position = 0
    for entry in found:
        assert entry.offset == position
        position += entry.size
    assert position == len(stream)

    parser = STREAM_PROTOCOLS[protocol].parser()
    expected = parser.feed(bytes(stream), 0.0)
    if parser.deadline < 1.0:  # something is left
        expected += parser.poll(parser.deadline)
    sound = [entry for entry in found if not entry.damaged and entry.name != 'unknown']
    assert [entry.content for entry in sound] == expected


@pytest.mark.proof  # tracing takes a while
def test_file_need_not_fit_into_memory(path: Path) -> None:
    chance = random.Random(1)
    block = b''.join(chance.choice(STREAMS['fort_serial']) for _ in range(1000))
    path.write_bytes((block + bytes(400_000)) * 6)
    tracemalloc.start()
    try:
        with captures.opened(str(path)) as capture:
            count = sum(1 for _ in entries_of(capture))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == 6 * (1000 + 1)
    assert peak < path.stat().st_size / 2
