"""
Finding frames in a stream of bytes.

A serial line loses, doubles and flips bytes. What was sent still has to come out in any split, and
one bad byte may cost no more than the frame that it is in. So the parser checks what it can before
it waits for a body, slides by a single byte after a failure (a corrupt length must not hide the
frames behind it), holds no more than one largest frame, and lets a frame that never ends expire.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math


class FrameError(ValueError):
    """Bytes from the wire are not the frame that they claim to be: the peer's fault, not ours."""


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
class FrameFormat:
    """
    How frames of one protocol are told apart in a stream.

    :param header: the constant first bytes.
    :param head_size: bytes, header included, that are needed to know the frame's size.
    :param max_size: bytes of the largest frame.
    :param size_of: from the first ``head_size`` bytes to the whole frame's size in bytes; raises
        FrameError where type and length cannot be. A size outside ``head_size`` to ``max_size`` is
        malformed too.
    :param check: tells from a whole frame whether its checksum is right.
    """

    header: bytes
    head_size: int
    max_size: int
    size_of: Callable[[bytes], int]
    check: Callable[[bytes], bool]


class StreamParser:
    """
    Cuts a stream into frames. Raises nothing: what is wrong is counted.

    :param expire: seconds after which a partial frame is given up.
    """

    def __init__(self, frame_format: FrameFormat, *, expire: float = 0.05) -> None:
        self.counters = Counters()
        self._format = frame_format
        self._expire = expire
        self._buffer = b''
        self._since = 0.0
        self._in_sync = True

    @property
    def deadline(self) -> float:
        """The moment at which poll should be called; infinite while nothing is pending."""
        return self._since + self._expire if self._buffer else math.inf

    def reset(self) -> None:
        """Discard a partial frame, as after a port was closed; the counters stay."""
        self.counters.discarded_bytes += len(self._buffer)
        self._buffer = b''
        self._in_sync = True

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Return the whole, checked frames that ``data`` completes, in order."""
        self.counters.bytes += len(data)
        late = self.poll(now)  # what came before and never ended must not swallow what comes now
        pending = len(self._buffer)
        self._buffer += data
        frames = self._scan(0)
        if len(self._buffer) < pending + len(data) or not pending:
            self._since = now  # the frame at the front is a newer one
        return late + frames

    def poll(self, now: float) -> list[bytes]:
        """Give up a partial frame that is too old; return the whole frames found inside it."""
        if now < self.deadline:
            return []
        self.counters.expired += 1
        self._discard(1)
        frames = self._scan(1)
        self._since = now
        return frames

    def _scan(self, start: int) -> list[bytes]:
        """Cut frames out of the buffer from ``start`` on; keep the partial one at the end."""
        fmt, buffer, end = self._format, self._buffer, len(self._buffer)
        frames: list[bytes] = []
        while start < end:
            head = self._find_header(start)
            if head > start:
                self._discard(head - start)
                start = head
            if end - start < fmt.head_size:
                break
            size = self._size(buffer[start : start + fmt.head_size])
            if size is None:
                self.counters.malformed += 1
                self._discard(1)
                start += 1
                continue
            if end - start < size:
                break
            frame = buffer[start : start + size]
            if fmt.check(frame):
                self.counters.frames += 1
                self._in_sync = True
                frames.append(frame)
                start += size
            else:
                self.counters.checksum_errors += 1
                self._discard(1)
                start += 1
        self._buffer = buffer[start:]
        return frames

    def _size(self, head: bytes) -> int | None:
        """Return the whole frame's size; None where the head is impossible."""
        try:
            size = self._format.size_of(head)
        except FrameError:
            return None
        return size if self._format.head_size <= size <= self._format.max_size else None

    def _find_header(self, start: int) -> int:
        """Return where the next header (or at the end the beginning of one) stands, or the end."""
        header, buffer = self._format.header, self._buffer
        found = buffer.find(header, start)
        if found >= 0:
            return found
        for size in range(min(len(header) - 1, len(buffer) - start), 0, -1):
            if buffer.endswith(header[:size]):
                return len(buffer) - size
        return len(buffer)

    def _discard(self, count: int) -> None:
        self.counters.discarded_bytes += count
        if self._in_sync:
            self._in_sync = False
            self.counters.resynchronisations += 1
