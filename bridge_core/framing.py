# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Finding frames in a stream of bytes.

A serial line loses, doubles and flips bytes. What was sent still has to come out in any split, and
one bad byte may cost no more than the frame that it is in. So the parser checks what it can before
it waits for a body, slides by a single byte after a failure (a corrupt length must not hide the
frames behind it), holds no more than one largest frame, and expires a frame that never ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Generic, TypeVar

MessageT = TypeVar('MessageT')
FrameT = TypeVar('FrameT')

_EXPIRE = 0.05  # s
BITS_PER_BYTE = 10  # 8N1
# s; frames found inside an expired one, where they waited behind a corrupt length, are handed out
# until this long after its time. Anything older is history, not news.
_LATE = 0.05


def expiry(size: int, baud: float) -> float:
    """
    Return after how many seconds a partial frame is given up: twice the time that it may take.

    :param size: bytes of the largest frame that comes. :param baud: of the line.
    """
    return max(_EXPIRE, 2.0 * size * BITS_PER_BYTE / baud)


class Datagram(bytes):
    """What one datagram has brought. :param source: its sender, as 'address:port'."""

    source: str

    def __new__(cls, data: bytes, source: str) -> Datagram:
        """Return the bytes, which know where they come from."""
        datagram = super().__new__(cls, data)
        datagram.source = source
        return datagram


class FrameError(ValueError):
    """Bytes from the wire are not the frame that they claim to be: the peer's fault, not ours."""


class ChecksumError(FrameError):
    """The check of a frame is wrong: its length may be, too, so the next byte may begin one."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """A sound frame of a type that this software does not know. :param kind: its number."""

    kind: int


@dataclass(slots=True)
class Counters:
    """What a link has received so far; noise is normal, uncounted noise is invisible."""

    bytes: int = 0
    frames: int = 0  # with a good check, known type or not
    checksum_errors: int = 0
    malformed: int = 0  # impossible type or length, or contents that a good check cannot excuse
    unknown_types: int = 0  # good frames of a type that this software does not know
    resynchronisations: int = 0  # times that the parser had to look for the next header
    discarded_bytes: int = 0
    expired: int = 0  # partial frames whose rest did not come in time


@dataclass(frozen=True, slots=True)
class FrameFormat(Generic[MessageT]):
    """
    How frames of one protocol are told apart in a stream.

    :param header: the constant first bytes.
    :param head_size: bytes, header included, that are needed to know the frame's size.
    :param max_size: bytes of the largest frame.
    :param size_of: from the first ``head_size`` bytes to the whole frame's size in bytes; raises
        FrameError where type and length cannot be. A size outside ``head_size`` to ``max_size`` is
        malformed too.
    :param decode: from a whole frame to its message, or Unknown for a type that is not known;
        raises ChecksumError for a wrong check, FrameError for contents that cannot be.
    """

    header: bytes
    head_size: int
    max_size: int
    size_of: Callable[[bytes], int]
    decode: Callable[[bytes], MessageT | Unknown]


class Decoder(Generic[FrameT, MessageT]):
    """
    Turns what was received (bytes, datagrams, CAN frames) into messages, each checked once.

    Raises nothing: what is wrong is counted, and so are messages of an unknown type.
    """

    def __init__(self) -> None:
        self.counters = Counters()
        self.held_up = 0.0  # s, so that sound frames were discarded as too old; until a reset

    @property
    def deadline(self) -> float:
        """The moment at which poll should be called; infinite while nothing is pending."""
        return math.inf

    def reset(self) -> None:
        """Discard what was received in part, as after a port was closed; the counters stay."""

    def expect_gaps(self, seconds: float) -> None:
        """Take a frame whose parts come so far from each other; those of other lines do not."""

    def feed(self, data: FrameT, now: float) -> list[MessageT]:
        """Return the messages that ``data`` completes, in order."""
        raise NotImplementedError

    def poll(self, now: float) -> list[MessageT]:
        """Return the messages found in what has expired."""
        del now
        return []


class StreamParser(Decoder[bytes, MessageT]):
    """
    Decodes a stream of bytes.

    :param expire: seconds after which a partial frame is given up; see expiry.
    """

    def __init__(self, frame_format: FrameFormat[MessageT], *, expire: float = _EXPIRE) -> None:
        super().__init__()
        self._format = frame_format
        self._expire = expire
        self._buffer = b''
        self._arrivals: list[tuple[int, float]] = []  # of the buffer: number of bytes, time
        self._in_sync = True

    @property
    def format(self) -> FrameFormat[MessageT]:
        """How it tells frames apart."""
        return self._format

    @property
    def deadline(self) -> float:
        """The moment at which poll should be called; infinite while nothing is pending."""
        return self._arrivals[0][1] + self._expire if self._buffer else math.inf

    def expect_gaps(self, seconds: float) -> None:
        """Wait as long for the rest of a frame; behind a corrupt length, others wait as long."""
        self._expire = max(self._expire, seconds)

    def reset(self) -> None:
        """Discard a partial frame, as after a port was closed; the counters stay."""
        self.counters.discarded_bytes += len(self._buffer)
        self._buffer = b''
        self._arrivals.clear()
        self._in_sync = True
        self.held_up = 0.0

    def feed(self, data: bytes, now: float) -> list[MessageT]:
        """Return the messages of the frames that ``data`` completes, in order."""
        self.counters.bytes += len(data)
        # What came before and never ended must not swallow what comes now.
        late = self.poll(now) if self._buffer else []
        if data:
            self._buffer += data
            self._arrivals.append((len(data), now))
        return late + self._scan()

    def poll(self, now: float) -> list[MessageT]:
        """Give up a partial frame that is too old; return the messages found inside it."""
        messages: list[MessageT] = []
        while now >= self.deadline:
            self.counters.expired += 1
            oldest = now - self._expire - _LATE
            stale = max(1, sum(size for size, at in self._arrivals if at < oldest))
            late = now - self._arrivals[0][1]
            whole = StreamParser(self._format).feed(self._buffer[1:], now) if stale > 1 else []
            self._discard(stale)
            found = self._scan(stale)
            if len(whole) > len(found):  # what is too old to count may have said stop
                self.held_up = late
            messages += found
        return messages

    def _scan(self, start: int = 0) -> list[MessageT]:
        """Decode the frames in the buffer from ``start`` on; keep the partial one at the end."""
        fmt, counters, buffer = self._format, self.counters, self._buffer
        messages: list[MessageT] = []
        behind = start  # the last frame: what follows up to ``start`` is none
        while start < len(buffer):
            found = buffer.find(fmt.header, start)
            if found < 0:
                start = self._header_begins(start)
                break
            start = found
            head = buffer[start : start + fmt.head_size]
            if len(head) < fmt.head_size:
                break
            size = self._size(head)
            if not size:
                counters.malformed += 1
                start += 1
                continue
            if len(buffer) - start < size:
                break
            try:
                message = fmt.decode(buffer[start : start + size])
                if isinstance(message, Unknown):
                    counters.unknown_types += 1
                else:
                    messages.append(message)
            except ChecksumError:
                counters.checksum_errors += 1
                start += 1
                continue
            except FrameError:
                counters.malformed += 1
            if start > behind:
                self._discard(start - behind)
            counters.frames += 1
            self._in_sync = True
            behind = start = start + size
        if start > behind:
            self._discard(start - behind)
        self._buffer = buffer[start:]
        self._forget_arrivals(start)
        return messages

    def _forget_arrivals(self, count: int) -> None:
        """Forget when the first ``count`` bytes arrived, which are not in the buffer any more."""
        if not self._buffer:
            self._arrivals.clear()
            return
        while count:
            size, at = self._arrivals[0]
            if size > count:
                self._arrivals[0] = (size - count, at)
                return
            del self._arrivals[0]
            count -= size

    def _size(self, head: bytes) -> int:
        """Return the whole frame's size; 0 where the head is impossible."""
        try:
            size = self._format.size_of(head)
        except FrameError:
            return 0
        return size if self._format.head_size <= size <= self._format.max_size else 0

    def _header_begins(self, start: int) -> int:
        """Return where the beginning of a header stands at the buffer's end, or the end."""
        header, buffer = self._format.header, self._buffer
        for size in range(min(len(header) - 1, len(buffer) - start), 0, -1):
            if buffer.endswith(header[:size]):
                return len(buffer) - size
        return len(buffer)

    def _discard(self, count: int) -> None:
        """Count bytes that are no frame."""
        self.counters.discarded_bytes += count
        if self._in_sync:
            self._in_sync = False
            self.counters.resynchronisations += 1
