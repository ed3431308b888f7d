"""The packet protocol's stream (7), and what a VSC with another firmware would say on it."""

from __future__ import annotations

from bridge_core.framing import Decoder
from bridge_core.framing import FrameError
from bridge_core.packets import HEAD_SIZE
from bridge_core.packets import OVERHEAD
from fort_vsc_bridge.protocol.frames import MessageType
from fort_vsc_bridge.protocol.frames import PACKETS
from fort_vsc_bridge.protocol.frames import Received
from fort_vsc_bridge.protocol.frames import Rejected
from fort_vsc_bridge.protocol.messages import parser

_UNEXPECTED = (
    'update this software or the VSC, their firmware does not match: its {name} message has '
    '{length} bytes, not {expected}'
)


class SerialDecoder(Decoder[bytes, Received]):
    """
    A parser, and beside it a search for sound frames whose length is not that of their type.

    The parser never waits for the body of such a frame, as its length is corrupt more often than
    not; the search delays nothing.
    """

    def __init__(self) -> None:
        self._parser = parser()
        self.counters = self._parser.counters
        self._tail = b''  # of the stream: may be the beginning of such a frame

    @property
    def deadline(self) -> float:
        """When a partial frame expires."""
        return self._parser.deadline

    def reset(self) -> None:
        """Discard what was received in part."""
        self._parser.reset()
        self._tail = b''

    def feed(self, data: bytes, now: float) -> list[Received]:
        """Return the messages that ``data`` completes, in order."""
        return [*self._parser.feed(data, now), *self._unexpected(data)]

    def poll(self, now: float) -> list[Received]:
        """Return the messages found in a partial frame that has expired."""
        return list(self._parser.poll(now))

    def _unexpected(self, data: bytes) -> list[Received]:
        stream, found, start = self._tail + data, [], 0
        while (start := stream.find(PACKETS.header, start)) >= 0:
            frame = stream[start : start + PACKETS.max_size]
            if len(frame) < HEAD_SIZE:
                break
            kind, size = frame[2], frame[3] + OVERHEAD
            if kind not in PACKETS.lengths or not _is_unexpected(frame):
                start += 1
            elif len(frame) < size:
                break
            elif _is_sound(frame[:size]):
                found.append(_rejected(kind, frame[3]))
                start += size
            else:
                start += 1
        self._tail = stream[start:] if start >= 0 else stream[-1:]
        return list(found)


def _is_unexpected(frame: bytes) -> bool:
    """Tell whether the length is possible, but not for this type."""
    return frame[3] <= PACKETS.max_length and frame[3] not in PACKETS.lengths[frame[2]]


def _is_sound(frame: bytes) -> bool:
    try:
        PACKETS.checked(frame)
    except FrameError:
        return False
    return True


def _rejected(kind: int, length: int) -> Rejected:
    name = MessageType(kind).name.lower().replace('_', ' ')
    expected = next(iter(PACKETS.lengths[kind]))
    return Rejected(_UNEXPECTED.format(name=name, length=length, expected=expected))
