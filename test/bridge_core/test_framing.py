# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The stream parser against a hostile line, with toy formats that no device uses.

``LONG``: header 0xA5 0x5A, type 1 to 3, length 0 to 40, body, CRC-16; a header cannot overlap
itself. ``FIXED``: header 0xF0 0xF0, six bytes, CRC-16 over the body; its header overlaps itself.
"""

from collections.abc import Iterable, Iterator
import itertools
import math
import random

from hypothesis import given, strategies as st
import pytest

from bridge_core.checksums import crc16_ccitt_false
from bridge_core.framing import (
    ChecksumError,
    Decoder,
    expiry,
    FrameError,
    FrameFormat,
    StreamParser,
    Unknown,
)

EXPIRE = 0.05


def decode(frame: bytes) -> bytes:
    if crc16_ccitt_false(frame[2:-2]).to_bytes(2, 'little') != frame[-2:]:
        raise ChecksumError('wrong check')
    return frame


def size_of(head: bytes) -> int:
    if not 1 <= head[2] <= 3 or head[3] > 40:
        raise FrameError('impossible type or length')
    return 4 + head[3] + 2


LONG = FrameFormat(header=b'\xa5\x5a', head_size=4, max_size=46, size_of=size_of, decode=decode)
FIXED = FrameFormat(
    header=b'\xf0\xf0', head_size=2, max_size=10, size_of=lambda head: 10, decode=decode
)


def long_frame(body: bytes, kind: int = 1) -> bytes:
    inner = bytes([kind, len(body)]) + body
    return LONG.header + inner + crc16_ccitt_false(inner).to_bytes(2, 'little')


def fixed_frame(body: bytes) -> bytes:
    return FIXED.header + body + crc16_ccitt_false(body).to_bytes(2, 'little')


LONG_FRAMES = [
    long_frame(b''),
    long_frame(b'\x00' * 7, 2),
    long_frame(b'\xa5\x5a\x01', 3),  # a header in the body
    long_frame(b'\xff' * 40),
    long_frame(b'\xa5' * 9, 2),
    long_frame(bytes(range(20)), 3),
]
FIXED_FRAMES = [
    fixed_frame(b'\x00\x00\x00\x00\x00\x01'),
    fixed_frame(b'\xf0\xf0\xf0\xf0\x00\x02'),
    fixed_frame(b'\xf0\x01\x02\x03\x04\xf0'),
    fixed_frame(b'\x10\x20\x30\x40\x50\x60'),
]
BOTH = [(LONG, LONG_FRAMES), (FIXED, FIXED_FRAMES)]
both_formats = pytest.mark.parametrize(('fmt', 'frames'), BOTH, ids=['long', 'fixed'])


def drain(parser: StreamParser[bytes]) -> list[bytes]:
    """Let the line fall idle until nothing is pending."""
    frames: list[bytes] = []
    while parser.deadline < math.inf:
        frames += parser.poll(parser.deadline)
    return frames


def parse(parser: StreamParser[bytes], pieces: Iterable[bytes], now: float = 1.0) -> list[bytes]:
    return [frame for piece in pieces for frame in parser.feed(piece, now)]


def pending(parser: StreamParser[bytes], frames: list[bytes]) -> int:
    """Return the bytes that are neither in a frame nor discarded: what the parser holds."""
    counters = parser.counters
    assert counters.frames == len(frames)
    return counters.bytes - sum(map(len, frames)) - counters.discarded_bytes


def single_bytes(data: bytes) -> Iterator[bytes]:
    return (data[i : i + 1] for i in range(len(data)))


def test_decoder_without_parts_has_nothing_to_expire() -> None:
    decoder: Decoder[bytes, bytes] = Decoder()
    assert decoder.deadline == math.inf
    assert decoder.poll(1.0) == []


@both_formats
def test_one_flipped_bit_anywhere_costs_at_most_its_frame(
    fmt: FrameFormat[bytes], frames: list[bytes]
) -> None:
    data = b''.join(frames)
    owners = [number for number, frame in enumerate(frames) for _ in frame]
    for at, bit in itertools.product(range(len(data)), range(8)):
        spoilt = bytearray(data)
        spoilt[at] ^= 1 << bit
        rest = [frame for number, frame in enumerate(frames) if number != owners[at]]
        for pieces in ([bytes(spoilt)], single_bytes(bytes(spoilt))):
            parser = StreamParser(fmt)
            got = parse(parser, pieces) + drain(parser)
            assert got == rest, f'bit {bit} of byte {at}'
            assert pending(parser, got) == 0


@both_formats
def test_one_lost_or_doubled_byte_costs_at_most_its_frame(
    fmt: FrameFormat[bytes], frames: list[bytes]
) -> None:
    data = b''.join(frames)
    owners = [number for number, frame in enumerate(frames) for _ in frame]
    for at in range(len(data)):
        rest = [frame for number, frame in enumerate(frames) if number != owners[at]]
        for spoilt in (data[:at] + data[at + 1 :], data[: at + 1] + data[at:]):
            parser = StreamParser(fmt)
            got = parse(parser, [spoilt]) + drain(parser)
            # Doubling a byte beside a frame may leave that frame whole.
            assert [frame for frame in got if frame in rest] == rest, f'byte {at}'


def test_truncated_frame_expires_and_the_next_one_comes_through() -> None:
    first, second = LONG_FRAMES[3], LONG_FRAMES[5]
    for cut in range(1, len(first)):
        parser = StreamParser(LONG, expire=EXPIRE)
        assert parser.feed(first[:cut], 1.0) == []
        assert parser.deadline == 1.0 + EXPIRE
        assert parser.poll(1.0 + EXPIRE - 0.001) == []
        # Nobody polled in time: what comes now must not be taken for the rest.
        assert parser.feed(second, 1.0 + EXPIRE) == [second]
        assert parser.counters.expired >= 1
        assert parser.deadline == math.inf


def test_gap_that_the_line_makes_loses_no_frame() -> None:
    parser = StreamParser(LONG, expire=EXPIRE)
    parser.expect_gaps(3 * EXPIRE)
    parser.expect_gaps(0.0)  # never shorter than the frames need
    frame = LONG_FRAMES[0]
    assert parser.feed(frame[:-1], 1.0) == []
    assert parser.feed(frame[-1:], 1.0 + 2.9 * EXPIRE) == [frame]


CLAIM = LONG.header + b'\x01\x28'  # a corrupt length: the head of 46 bytes
WHOLE = long_frame(b'0123456789')
TEN = [long_frame(bytes([number] * 5)) for number in range(10)]
TRICKLE: list[tuple[bytes, float, list[bytes]]] = [
    (LONG_FRAMES[3][n : n + 1], 1.0 + 0.01 * n, []) for n in range(len(LONG_FRAMES[3]))
]
# What is received, when, and which frames come of it; b'' is a poll. And what has expired.
PLAYS: dict[str, tuple[list[tuple[bytes, float, list[bytes]]], int]] = {
    'corrupt length before good frames': ([(CLAIM + WHOLE, 1.0, []), (b'', 1.05, [WHOLE])], 1),
    'corrupt length on a busy line': ([(CLAIM + b''.join(TEN), 1.0, TEN)], 0),
    'claims within claims': ([(CLAIM * 3 + WHOLE, 1.0, []), (b'', 1.05, [WHOLE])], 3),
    'new partial frame has its full time': (
        [(WHOLE[:5], 1.0, []), (WHOLE[5:] + WHOLE[:5], 1.04, [WHOLE]), (WHOLE[5:], 1.08, [WHOLE])],
        0,
    ),
    'partial frame behind an expired one has its time': (
        [(CLAIM, 1.0, []), (WHOLE[:5], 1.04, []), (b'', 1.05, []), (WHOLE[5:], 1.06, [WHOLE])],
        1,
    ),
    'on time only the damaged frame is lost': (
        [(CLAIM + WHOLE, 1.0, []), (b'', 1.06, [WHOLE])],
        1,
    ),
    'frozen process gets nothing old by a poll': (
        [(CLAIM + WHOLE, 2.0, []), (b'', 5.0, []), (WHOLE, 5.1, [WHOLE])],
        1,
    ),
    'frozen process gets nothing old by a read': (
        [(CLAIM + WHOLE, 6.0, []), (WHOLE, 9.0, [WHOLE])],
        1,
    ),
    'clock that runs backwards': ([(WHOLE[:7], 100.0, []), (WHOLE[7:], 1.0, [WHOLE])], 0),
    'trickle': (TRICKLE, 1),
}


@pytest.mark.parametrize('name', PLAYS)
def test_partial_frame_expires_in_its_time_and_hides_nothing_for_longer(name: str) -> None:
    reads, expired = PLAYS[name]
    parser = StreamParser(LONG, expire=EXPIRE)
    for data, now, frames in reads:
        assert (parser.feed(data, now) if data else parser.poll(now)) == frames, now
    assert parser.counters.expired == expired
    assert parser.deadline == math.inf


@pytest.mark.parametrize(('baud', 'expire'), [(1200, 2 * 46 * 10 / 1200), (115200, EXPIRE)])
def test_frame_on_a_slow_line_gets_twice_the_time_of_the_largest(baud: int, expire: float) -> None:
    parser = StreamParser(LONG, expire=expiry(len(LONG_FRAMES[3]), baud))
    now, got = 1.0, list[bytes]()
    for byte in single_bytes(LONG_FRAMES[3] + LONG_FRAMES[0][:3]):
        got += parser.poll(now) + parser.feed(byte, now)
        now += 10 / baud
    assert (got, parser.counters.expired) == ([LONG_FRAMES[3]], 0)
    assert parser.deadline == pytest.approx(now - 3 * 10 / baud + expire)


@pytest.mark.parametrize('size', [-1, 0, 1, 11, 10**9])
def test_size_beyond_the_format_is_malformed_and_never_waited_for(size: int) -> None:
    fmt = FrameFormat(
        header=b'\xf0\xf0', head_size=2, max_size=10, size_of=lambda head: size, decode=decode
    )
    parser = StreamParser(fmt)
    assert parser.feed(FIXED_FRAMES[0], 1.0) == []
    assert parser.counters.malformed == 1
    assert parser.deadline == math.inf


# A format that counts what it is asked, to bound work without a clock.


class Meter:
    def __init__(self, fmt: FrameFormat[bytes]) -> None:
        self.calls = self.checked_bytes = 0
        self._fmt = fmt
        self.format: FrameFormat[bytes] = FrameFormat(
            header=fmt.header,
            head_size=fmt.head_size,
            max_size=fmt.max_size,
            size_of=self._size_of,
            decode=self._decode,
        )

    def _size_of(self, head: bytes) -> int:
        self.calls += 1
        assert len(head) == self._fmt.head_size
        return self._fmt.size_of(head)

    def _decode(self, frame: bytes) -> bytes | Unknown:
        self.calls += 1
        self.checked_bytes += len(frame)
        return self._fmt.decode(frame)


FLOODS = {
    'random': random.Random(1).randbytes(1 << 20),
    'headers': b'\xa5\x5a' * (1 << 19),
    'half headers': b'\xa5' * (1 << 20),
    'largest claims': b'\xa5\x5a\x01\x28' * (1 << 18),
    'zeros': bytes(1 << 20),
}


@pytest.mark.parametrize('name', FLOODS)
def test_flood_of_a_megabyte_takes_bounded_work_and_memory(name: str) -> None:
    flood, good = FLOODS[name], long_frame(b'after the flood')
    meter = Meter(LONG)
    parser = StreamParser(meter.format)
    frames = []
    for start in range(0, len(flood), 4096):
        frames += parser.feed(flood[start : start + 4096], 1.0)
        assert 0 <= pending(parser, frames) < LONG.max_size
    # At most one look at each byte as a head, and one check of the claimed frame behind it.
    assert meter.calls <= 2 * len(flood)
    assert meter.checked_bytes <= LONG.max_size * len(flood) // len(LONG.header)
    frames += drain(parser)
    assert parser.feed(good, 10.0) == [good]
    assert pending(parser, [*frames, good]) == 0


# Properties over streams of good frames, cut frames and noise.

NOISE = st.binary(max_size=12) | st.sampled_from(
    [b'\xa5', b'\xa5\x5a', b'\xa5\x5a\x01', b'\xa5\x5a\x01\x28', b'\x5a\xa5']
)
GOOD = st.builds(long_frame, st.binary(max_size=40), st.integers(1, 3))
CUT = st.builds(lambda frame, size: frame[:size], GOOD, st.integers(1, 45))
STREAMS = st.lists(NOISE | GOOD | CUT, max_size=12).map(b''.join)


@given(STREAMS, st.lists(st.integers(0, 400), max_size=8))
def test_any_split_gives_the_same_frames_and_counts(stream: bytes, cuts: list[int]) -> None:
    places = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    whole, split = StreamParser(LONG), StreamParser(LONG)
    frames = parse(whole, [stream])
    assert parse(split, (stream[a:b] for a, b in itertools.pairwise(places))) == frames
    assert split.counters == whole.counters
    assert 0 <= pending(split, frames) < LONG.max_size


@given(st.lists(st.tuples(STREAMS, st.floats(0.0, 0.2)), max_size=10))
def test_every_byte_is_accounted_for_at_any_time(pieces: list[tuple[bytes, float]]) -> None:
    parser, now, frames = StreamParser(LONG), 1.0, list[bytes]()
    for data, pause in pieces:
        frames += parser.feed(data, now)
        assert 0 <= pending(parser, frames) < LONG.max_size
        assert (pending(parser, frames) > 0) == (parser.deadline < math.inf)
        now += pause
        frames += parser.poll(now)
    frames += drain(parser)
    assert pending(parser, frames) == 0
    assert all(decode(frame) for frame in frames)


@given(STREAMS, GOOD)
def test_after_any_stream_and_a_pause_a_good_frame_comes_through(
    stream: bytes, good: bytes
) -> None:
    parser = StreamParser(LONG)
    parser.feed(stream, 1.0)
    drain(parser)
    assert parser.feed(good, 100.0) == [good]
