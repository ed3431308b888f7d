# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From pieces of a capture to messages, by the codecs of the bridges; every byte has its entry."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
import itertools
from typing import Any, TypeVar

from bridge_core.decoding import CanDecoder, DatagramDecoder, StreamDecoder
from bridge_core.framing import ChecksumError, FrameError, StreamParser
from bridge_core.j1939 import CanFrame
from rugged_teleop.decode.captures import Capture, RECORDING, STREAMS
from rugged_teleop.decode.pieces import Damage, Piece, Recorded
from rugged_teleop.decode.plain import plain
from rugged_teleop.devices import protocols as installed

_SAMPLE = 1 << 18  # bytes of a stream by which its protocol is told
_SHOWN = 32  # bytes of what is damaged
_SAMPLE_OF_GAP = 1024  # bytes by which is told what is wrong with it: more than any frame has
_OTHER = 'other'
_PieceT = TypeVar('_PieceT', Piece, Piece | Damage)


@dataclass(frozen=True, slots=True)
class Entry:
    """
    One frame, datagram or damaged place.

    :param protocol: empty for what no protocol of ours reads, and for damage.
    :param name: of the message. :param content: the message; a reason, for damage.
    :param size: bytes of the whole. :param data: these bytes; of what is damaged the first.
    """

    offset: int
    protocol: str
    name: str
    content: Any
    size: int
    data: bytes
    at: float | None = None
    source: str = ''
    identifier: int | None = None

    @property
    def damaged(self) -> bool:
        """It could not be read, and was skipped."""
        return self.name == 'damage'

    def fields(self) -> dict[str, Any]:
        """Return what it says, as JSON has it."""
        if self.damaged:
            return {'bytes': self.size, 'reason': self.content}
        values = plain(self.content)
        return values if isinstance(values, dict) else {}


def _damage(damage: Damage) -> Entry:
    shown = damage.data[:_SHOWN]
    where = (damage.at, damage.source, damage.identifier)
    return Entry(damage.offset, '', 'damage', damage.reason, damage.size, shown, *where)


def _entry(piece: Piece, protocol: str, name: str, content: Any = None) -> Entry:
    where = (piece.at, piece.source, piece.identifier)
    return Entry(piece.offset, protocol, name, content, len(piece.data), piece.data, *where)


STREAM_PROTOCOLS: dict[str, StreamDecoder] = {p.name: p for _, p in installed(StreamDecoder)}
_CAN_READERS: dict[str, CanDecoder] = {p.name: p for _, p in installed(CanDecoder)}
_DATAGRAMS: tuple[DatagramDecoder, ...] = tuple(p for _, p in installed(DatagramDecoder))
CAN_PROTOCOLS = tuple(_CAN_READERS)
PROTOCOLS = tuple(
    dict.fromkeys((*STREAM_PROTOCOLS, *CAN_PROTOCOLS, *(p.name for p in _DATAGRAMS)))
)


# Streams


@dataclass(frozen=True, slots=True)
class _Found:
    """A frame with a good check. :param content: its message; or why that cannot be."""

    frame: bytes
    content: Any


class _Stream:
    """
    A bridge's own parser, and where in the stream it has found its frames.

    It hands frames out whole and in order, so each stands where its bytes are seen first behind
    the frame before it; what is between the two was discarded.
    """

    def __init__(self, protocol: str) -> None:
        self._format = STREAM_PROTOCOLS[protocol].parser().format
        self._parser = StreamParser(replace(self._format, decode=self._read))
        self._window = b''  # of the stream: from the first byte on that is not accounted for
        self._position = 0  # of the window
        self._framed = 0  # bytes in frames
        self._gap = Damage(0, 0, '')  # what was discarded since the last frame

    def _read(self, frame: bytes) -> _Found:
        try:
            return _Found(frame, self._format.decode(frame))
        except ChecksumError:
            raise
        except FrameError as error:
            return _Found(frame, error)

    def feed(self, data: bytes) -> Iterator[tuple[int, _Found | Damage]]:
        """Yield frames and damage with their positions in the stream."""
        self._window += data
        yield from self._located(self._parser.feed(data, 0.0))

    def end(self) -> Iterator[tuple[int, _Found | Damage]]:
        """Yield what is left."""
        if self._window:
            yield from self._located(self._parser.poll(self._parser.deadline))
        yield from self._end_of_gap()

    def _located(self, found: Iterable[_Found]) -> Iterator[tuple[int, _Found | Damage]]:
        window, start, origin = self._window, 0, self._position
        for each in found:
            place = window.index(each.frame, start)
            self._skip(window[start:place])
            yield from self._end_of_gap()
            yield origin + place, each
            start = place + len(each.frame)
            self._framed += len(each.frame)
            self._position = origin + start
        # What the parser has neither framed nor discarded is begun; the rest of it is to come.
        counters = self._parser.counters
        begun = len(window) - (counters.bytes - counters.discarded_bytes - self._framed)
        self._skip(window[start:begun])
        self._window = window[begun:]

    def _skip(self, data: bytes) -> None:
        gap = self._gap if self._gap.size else Damage(self._position, 0, '')
        sample = gap.data if len(gap.data) >= _SAMPLE_OF_GAP else gap.data + data
        self._gap = replace(gap, size=gap.size + len(data), data=sample[:_SAMPLE_OF_GAP])
        self._position += len(data)

    def _end_of_gap(self) -> Iterator[tuple[int, Damage]]:
        if self._gap.size:
            yield self._gap.offset, replace(self._gap, reason=self._why(self._gap))
            self._gap = replace(self._gap, size=0)

    def _why(self, gap: Damage) -> str:
        """Return what is wrong with bytes that are no frame."""
        start = gap.data.find(self._format.header)
        head = gap.data[start:][: self._format.head_size]
        if start < 0 or len(head) < self._format.head_size:
            return 'no beginning of a frame'
        try:
            size = self._format.size_of(head)
        except FrameError:
            size = 0
        if not self._format.head_size <= size <= self._format.max_size:
            return 'a type or length that cannot be'
        return 'wrong check' if start + size <= gap.size else 'shorter than its length says'


class _Places:
    """Where in the file a position of the stream is."""

    def __init__(self, exact: bool) -> None:
        self._exact = exact  # the file is the stream; else a piece is a line
        self._pieces: deque[tuple[int, Piece]] = deque()  # with their positions
        self._end = 0

    def add(self, piece: Piece) -> None:
        self._pieces.append((self._end, piece))
        self._end += len(piece.data)

    def of(self, position: int) -> Piece:
        """Return the piece, with the offset; positions are asked for in order."""
        while len(self._pieces) > 1 and self._pieces[1][0] <= position:
            self._pieces.popleft()
        start, piece = self._pieces[0]
        return replace(piece, offset=piece.offset + (position - start if self._exact else 0))


def _stream_entries(
    protocol: str, pieces: Iterable[Piece | Damage], *, exact: bool
) -> Iterator[Entry]:
    stream, places = _Stream(protocol), _Places(exact)
    for piece in pieces:
        if isinstance(piece, Damage):
            yield _damage(piece)
            continue
        places.add(piece)
        for position, found in stream.feed(piece.data):
            yield _stream_entry(protocol, places.of(position), found)
    for position, found in stream.end():
        yield _stream_entry(protocol, places.of(position), found)


def _stream_entry(protocol: str, piece: Piece, found: _Found | Damage) -> Entry:
    """Return the entry of what begins in a piece."""
    if isinstance(found, Damage):
        return _damage(replace(found, offset=piece.offset, at=piece.at, source=piece.source))
    frame = replace(piece, data=found.frame)
    if isinstance(found.content, FrameError):
        return _damaged_piece(frame, str(found.content))
    name = STREAM_PROTOCOLS[protocol].named(found.content)
    return _entry(frame, protocol, name, found.content)


def guess(pieces: Iterable[Piece | Damage]) -> str:
    """Return the protocol that most of a stream's bytes are sound frames of; empty: none."""
    data = b''.join(piece.data for piece in pieces if isinstance(piece, Piece))
    sound = {}
    for protocol in STREAM_PROTOCOLS:
        stream = _Stream(protocol)
        found = (each for _, each in itertools.chain(stream.feed(data), stream.end()))
        frames = (each for each in found if isinstance(each, _Found))
        sound[protocol] = sum(
            len(each.frame) for each in frames if not isinstance(each.content, FrameError)
        )
    best = max(sound, key=lambda protocol: sound[protocol])
    return best if sound[best] else ''


# CAN frames and datagrams


def _damaged_piece(piece: Piece, reason: str) -> Entry:
    where = (piece.at, piece.source, piece.identifier)
    return _damage(Damage(piece.offset, len(piece.data), reason, piece.data, *where))


def _can_entry(piece: Piece, identifier: int, protocols: Iterable[str]) -> Entry:
    if piece.form:
        return _entry(piece, '', piece.form)
    frame = CanFrame(identifier, piece.data)
    for protocol in protocols:
        try:
            found = _CAN_READERS[protocol].read(frame)
        except FrameError as error:
            return _damaged_piece(piece, str(error))
        if found is not None:
            return _entry(piece, protocol, *found)
    return _entry(piece, '', _OTHER)


def _datagram_entry(piece: Piece) -> Entry:
    found = [each for each in _DATAGRAMS if piece.data.startswith(each.beginnings)]
    if not found:
        return _entry(piece, '', piece.form or 'datagram of another protocol')
    if piece.form:
        return _damaged_piece(piece, piece.form)
    try:
        content = found[0].read(piece.data)
    except FrameError as error:
        return _damaged_piece(piece, str(error))
    return _entry(piece, found[0].name, found[0].named(content), content)


def _frame_entries(pieces: Iterable[Piece | Damage], protocols: Iterable[str]) -> Iterator[Entry]:
    for piece in pieces:
        if isinstance(piece, Damage):
            yield _damage(piece)
        elif piece.identifier is not None:
            yield _can_entry(piece, piece.identifier, protocols)
        else:
            yield _datagram_entry(piece)


# Recordings


def recording_entries(
    pieces: Iterable[Piece | Damage | Recorded], protocol: str
) -> Iterator[Entry]:
    """Yield the messages; then, port by port and direction by direction, what went over it."""
    lines: dict[str, list[Piece]] = {}
    for piece in pieces:
        if isinstance(piece, Piece):
            lines.setdefault(piece.source, []).append(piece)
        elif isinstance(piece, Damage):
            yield _damage(piece)
        else:
            at = piece.at, piece.source
            protocol_of = '' if piece.content is None else 'ros'
            yield Entry(piece.offset, protocol_of, piece.name, piece.content, 0, b'', *at)
    for line in lines.values():
        if line[0].identifier is not None:
            yield from _frame_entries(line, [protocol] if protocol else CAN_PROTOCOLS)
        elif found := protocol or guess(_beginning(line)):
            yield from _stream_entries(found, line, exact=False)
        else:
            yield from (_entry(piece, '', _OTHER) for piece in line)


def _beginning(pieces: Iterable[_PieceT]) -> Iterator[_PieceT]:
    """Yield the pieces by which a protocol is told, and take no more."""
    size = 0
    for piece in pieces:
        yield piece
        size += len(piece.data)
        if size >= _SAMPLE:
            return


def entries_of(capture: Capture, protocol: str = '') -> Iterator[Entry]:
    """
    Yield what a capture says, in its order.

    :param protocol: one of PROTOCOLS; empty: every frame of CAN by all that know its identifier,
        a stream by what its beginning is.
    :raises ValueError: none is found, or the format cannot carry the one that is given.
    """
    if capture.format == RECORDING:
        yield from recording_entries(capture.recorded, protocol)
        return
    if capture.format not in STREAMS:
        if protocol and protocol not in (*CAN_PROTOCOLS, *(each.name for each in _DATAGRAMS)):
            raise ValueError(f'{capture.format} has frames of CAN or UDP, not {protocol}')
        yield from _frame_entries(capture.pieces, [protocol] if protocol else CAN_PROTOCOLS)
        return
    if protocol in CAN_PROTOCOLS:
        raise ValueError(f'{capture.format} has a stream of bytes, not {protocol}')
    sample = [] if protocol else [*_beginning(capture.pieces)]
    protocol = protocol or guess(sample)
    if not protocol:
        size = sum(len(piece.data) for piece in sample)
        raise ValueError(
            f'no frame of {", ".join(STREAM_PROTOCOLS)} is in its first {size} bytes; '
            '--protocol shows what is wrong with them'
        )
    pieces = itertools.chain(sample, capture.pieces)
    yield from _stream_entries(protocol, pieces, exact=capture.format == 'raw')
