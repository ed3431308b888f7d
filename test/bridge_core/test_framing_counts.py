# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the stream parser counts of each thing that may come, and what it keeps: exact figures."""

import pytest

from bridge_core.framing import (
    ChecksumError,
    Counters,
    FrameError,
    FrameFormat,
    StreamParser,
    Unknown,
)

EXPIRE = 0.25  # s; sums of its multiples are exact
HEADER = b'\xaa\xaa\xaa'  # may begin anew at its second byte
BARE = 0x40  # the code of a frame that is a head alone
UNKNOWN, IMPOSSIBLE = b'\xee', b'\xff'


def size_of(head: bytes) -> int:
    """Return what the code says: bytes of the body, and one for the check."""
    if head[3] == BARE:
        return 4
    if head[3] >= 0xF0:
        raise FrameError('no such code')
    return 5 + (head[3] & 0x3F)


def decode(frame: bytes) -> bytes | Unknown:
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
GOOD = frame(b'good')
ALL_THAT_MAY_COME = {
    'nothing': (b'', [], Counters()),
    'frame': (GOOD, [GOOD], Counters(frames=1)),
    'frames one behind the other': (GOOD * 3, [GOOD] * 3, Counters(frames=3)),
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
        *(HEADER + b'\x0b' + GOOD + bytes(3), [GOOD]),
        Counters(frames=1, checksum_errors=1, resynchronisations=2, discarded_bytes=7),
    ),
    'garbage before, between and behind': (
        *(b'\x01' + GOOD + b'\x02\x03' + GOOD + b'\x04', [GOOD, GOOD]),
        Counters(frames=2, resynchronisations=3, discarded_bytes=4),
    ),
}


def parser_of(max_size: int = 68) -> StreamParser[bytes]:
    """Return one of the toy protocol, in which a code of AA is 47 bytes."""
    return StreamParser(FrameFormat(HEADER, 4, max_size, size_of, decode), expire=EXPIRE)


@pytest.mark.parametrize('name', ALL_THAT_MAY_COME)
@pytest.mark.parametrize('single', [False, True], ids=['whole', 'byte by byte'])
def test_each_thing_is_counted_as_what_it_is(name: str, single: bool) -> None:
    data, frames, counters = ALL_THAT_MAY_COME[name]
    parser = parser_of()
    pieces = [data[n : n + 1] for n in range(len(data))] if single else [data]
    assert [found for piece in pieces for found in parser.feed(piece, 1.0)] == frames
    counters.bytes = len(data)
    assert parser.counters == counters
    assert parser.poll(1.0 + EXPIRE) == []
    assert parser.counters == counters, 'something was kept'


@pytest.mark.parametrize('max_size', [46, 68], ids=['impossible size', 'wrong check'])
def test_header_that_begins_amid_another_one_is_found(max_size: int) -> None:
    """The byte that fails may be the one before: AA AA AA AA 04 is a head behind an AA."""
    parser = parser_of(max_size)
    assert parser.feed(b'\xaa' + GOOD + bytes(47), 0.0) == [GOOD]
    counters = parser.counters
    assert (counters.malformed, counters.checksum_errors) in {(1, 0), (0, 1)}
    assert counters.discarded_bytes == 48


def test_end_of_a_frame_does_not_begin_a_header() -> None:
    ends_so = frame(b'\xaa')
    parser = parser_of()
    assert parser.feed(ends_so + GOOD[:1], 0.0) == [ends_so]
    assert parser.feed(GOOD[1:], 0.0) == [GOOD]
    bytes_of_both = len(ends_so + GOOD)
    assert parser.counters == Counters(bytes=bytes_of_both, frames=2)


def test_reset_begins_anew_in_time_and_in_step() -> None:
    parser = parser_of()
    for count in (1, 2):
        now = 10.0 * count
        parser.feed(b'\x01' + GOOD[:2], now)
        assert parser.deadline == now + EXPIRE
        parser.reset()
        assert parser.counters == Counters(
            bytes=3 * count, resynchronisations=count, discarded_bytes=3 * count
        )


@pytest.mark.parametrize(('late', 'frames'), [(0.05, [GOOD]), (0.051, [])])
def test_frame_within_one_that_expired_is_news_for_50_ms_more(
    late: float, frames: list[bytes]
) -> None:
    parser = parser_of()
    assert parser.feed(HEADER + b'\x30' + GOOD, 2.0 - EXPIRE - late) == []
    assert parser.poll(2.0) == frames
    assert parser.counters.expired == 1
