# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The stream parser against a hostile line, with toy formats that no device uses.

``LONG``: header 0xA5 0x5A, type 1 to 3, length 0 to 40, body, CRC-16; a header cannot overlap
itself. ``FIXED``: header 0xF0 0xF0, six bytes, CRC-16 over the body; its header overlaps itself.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
import itertools
import math
import random

from hypothesis import given, strategies as st
import pytest

from bridge_core.checksums import crc16_ccitt_false
from bridge_core.framing import (
    ChecksumError,
    Counters,
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


def parse(parser: StreamParser[bytes], pieces: Iterable[bytes]) -> list[bytes]:
    return [frame for piece in pieces for frame in parser.feed(piece, 1.0)]


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
def test_flipped_bit_costs_at_most_its_frame(fmt: FrameFormat[bytes], frames: list[bytes]) -> None:
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
def test_lost_or_doubled_byte_costs_its_frame(
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
    'only the damaged frame is lost': ([(CLAIM + WHOLE, 1.0, []), (b'', 1.06, [WHOLE])], 1),
    'frozen process polls nothing old': (
        [(CLAIM + WHOLE, 2.0, []), (b'', 5.0, []), (WHOLE, 5.1, [WHOLE])],
        1,
    ),
    'frozen process reads nothing old': ([(CLAIM + WHOLE, 6.0, []), (WHOLE, 9.0, [WHOLE])], 1),
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
    parser = StreamParser(replace(FIXED, size_of=lambda head: size))
    assert parser.feed(FIXED_FRAMES[0], 1.0) == []
    assert parser.counters.malformed == 1
    assert parser.deadline == math.inf


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
    heads: list[int] = []  # the size of each that was looked at, and of each frame
    checked: list[int] = []

    def counted_size_of(head: bytes) -> int:
        heads.append(len(head))
        return LONG.size_of(head)

    def counted_decode(frame: bytes) -> bytes | Unknown:
        checked.append(len(frame))
        return LONG.decode(frame)

    parser = StreamParser(replace(LONG, size_of=counted_size_of, decode=counted_decode))
    frames = []
    for start in range(0, len(flood), 4096):
        frames += parser.feed(flood[start : start + 4096], 1.0)
        assert 0 <= pending(parser, frames) < LONG.max_size
    # At most one look at each byte as a head, and one check of the claimed frame behind it.
    assert len(heads) + len(checked) <= 2 * len(flood)
    assert set(heads) <= {LONG.head_size}
    assert sum(checked) <= LONG.max_size * len(flood) // len(LONG.header)
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


@given(st.lists(st.tuples(STREAMS, st.floats(0.0, 0.2)), max_size=10), GOOD)
def test_every_byte_is_accounted_for_and_a_good_frame_comes_through_after_a_pause(
    pieces: list[tuple[bytes, float]], good: bytes
) -> None:
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
    assert parser.feed(good, 100.0) == [good]


# What is counted of each thing that may come, and what is kept: exact figures of a third format.


QUARTER = 0.25  # s; sums of its multiples are exact
HEADER = b'\xaa\xaa\xaa'  # may begin anew at its second byte
BARE = 0x40  # the code of a frame that is a head alone
UNKNOWN, IMPOSSIBLE = b'\xee', b'\xff'


def toy_size_of(head: bytes) -> int:
    """Return what the code says: bytes of the body, and one for the check."""
    if head[3] == BARE:
        return 4
    if head[3] >= 0xF0:
        raise FrameError('no such code')
    return 5 + (head[3] & 0x3F)


def toy_decode(frame: bytes) -> bytes | Unknown:
    body = frame[4:-1]
    if frame[3] != BARE and sum(body) & 0xFF != frame[-1]:
        raise ChecksumError('wrong check')
    if body == UNKNOWN:
        return Unknown(0)
    if body == IMPOSSIBLE:
        raise FrameError('no such body')
    return frame


def frame(body: bytes) -> bytes:
    return HEADER + bytes((len(body),)) + body + bytes((sum(body) & 0xFF,))


BARE_FRAME = HEADER + bytes((BARE,))
SOUND = frame(b'good')
ALL_THAT_MAY_COME = {
    'nothing': (b'', [], Counters()),
    'frame': (SOUND, [SOUND], Counters(frames=1)),
    'frames one behind the other': (SOUND * 3, [SOUND] * 3, Counters(frames=3)),
    'bare': (BARE_FRAME * 2, [BARE_FRAME] * 2, Counters(frames=2)),
    'unknown': (frame(UNKNOWN) * 2, [], Counters(frames=2, unknown_types=2)),
    'body that cannot be': (frame(IMPOSSIBLE) * 2, [], Counters(frames=2, malformed=2)),
    'wrong check': (
        *(HEADER + b'\x01\x07\x08', []),
        Counters(checksum_errors=1, resynchronisations=1, discarded_bytes=6),
    ),
    'code that cannot be': (
        *(HEADER + b'\xf0\x00', []),
        Counters(malformed=1, resynchronisations=1, discarded_bytes=5),
    ),
    'frame within one whose check is wrong': (
        *(HEADER + b'\x0b' + SOUND + bytes(3), [SOUND]),
        Counters(frames=1, checksum_errors=1, resynchronisations=2, discarded_bytes=7),
    ),
    'garbage before, between and behind': (
        *(b'\x01' + SOUND + b'\x02\x03' + SOUND + b'\x04', [SOUND, SOUND]),
        Counters(frames=2, resynchronisations=3, discarded_bytes=4),
    ),
}


def parser_of(max_size: int = 68) -> StreamParser[bytes]:
    """Return one of the toy protocol, in which a code of AA is 47 bytes."""
    return StreamParser(FrameFormat(HEADER, 4, max_size, toy_size_of, toy_decode), expire=QUARTER)


@pytest.mark.parametrize('name', ALL_THAT_MAY_COME)
@pytest.mark.parametrize('single', [False, True], ids=['whole', 'byte by byte'])
def test_each_thing_is_counted_as_what_it_is(name: str, single: bool) -> None:
    data, frames, counters = ALL_THAT_MAY_COME[name]
    parser = parser_of()
    pieces = [data[n : n + 1] for n in range(len(data))] if single else [data]
    assert [found for piece in pieces for found in parser.feed(piece, 1.0)] == frames
    counters.bytes = len(data)
    assert parser.counters == counters
    assert parser.poll(1.0 + QUARTER) == []
    assert parser.counters == counters, 'something was kept'


@pytest.mark.parametrize('max_size', [46, 68], ids=['impossible size', 'wrong check'])
def test_header_that_begins_amid_another_one_is_found(max_size: int) -> None:
    """The byte that fails may be the one before: AA AA AA AA 04 is a head behind an AA."""
    parser = parser_of(max_size)
    assert parser.feed(b'\xaa' + SOUND + bytes(47), 0.0) == [SOUND]
    counters = parser.counters
    assert (counters.malformed, counters.checksum_errors) in {(1, 0), (0, 1)}
    assert counters.discarded_bytes == 48


def test_end_of_a_frame_does_not_begin_a_header() -> None:
    ends_so = frame(b'\xaa')
    parser = parser_of()
    assert parser.feed(ends_so + SOUND[:1], 0.0) == [ends_so]
    assert parser.feed(SOUND[1:], 0.0) == [SOUND]
    bytes_of_both = len(ends_so + SOUND)
    assert parser.counters == Counters(bytes=bytes_of_both, frames=2)


def test_reset_begins_anew_in_time_and_in_step() -> None:
    parser = parser_of()
    for count in (1, 2):
        now = 10.0 * count
        parser.feed(b'\x01' + SOUND[:2], now)
        assert parser.deadline == now + QUARTER
        parser.reset()
        assert parser.counters == Counters(
            bytes=3 * count, resynchronisations=count, discarded_bytes=3 * count
        )


@pytest.mark.parametrize(('late', 'frames'), [(0.05, [SOUND]), (0.051, [])])
def test_frame_within_an_expired_one_is_news_for_50_ms(late: float, frames: list[bytes]) -> None:
    parser = parser_of()
    assert parser.feed(HEADER + b'\x30' + SOUND, 2.0 - QUARTER - late) == []
    assert parser.poll(2.0) == frames
    assert parser.counters.expired == 1
    assert (parser.held_up > 0.0) is (frames == [])
