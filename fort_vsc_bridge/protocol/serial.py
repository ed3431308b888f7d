# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The packet protocol's stream (7), and what a VSC with another firmware would say on it."""

from __future__ import annotations

from bridge_core.framing import StreamParser
from bridge_core.packets import HEAD_SIZE, OVERHEAD
from fort_vsc_bridge.protocol.frames import MAX_LENGTH, MessageType, PACKETS, Received, Rejected
from fort_vsc_bridge.protocol.messages import decode_payload

_UNEXPECTED = (
    'update this software or the VSC, their firmware does not match: its {name} message has '
    '{length} bytes, not {expected}'
)


class SerialDecoder(StreamParser[Received]):
    """
    A parser, and beside it a search for sound frames whose length is not that of their type.

    The parser never waits for the body of such a frame, because a length is corrupt more often
    than the firmware is another one. The search delays nothing.
    """

    def __init__(self) -> None:
        super().__init__(PACKETS.frame_format(decode_payload))
        self._tail = b''  # of the stream: may be the beginning of such a frame

    def reset(self) -> None:
        """Discard what was received in part."""
        super().reset()
        self._tail = b''

    def feed(self, data: bytes, now: float) -> list[Received]:
        """Return the messages that ``data`` completes, in order."""
        begun, frames = bool(self._buffer), self.counters.frames
        messages = super().feed(data, now)
        stream = self._tail + data
        if begun or stream.count(PACKETS.header) > self.counters.frames - frames:
            return messages + self._unexpected(stream)
        self._tail = stream[-1:]  # every header in it is that of a sound frame
        return messages

    def _unexpected(self, stream: bytes) -> list[Received]:
        header, lengths, size = PACKETS.header, PACKETS.lengths, len(stream)
        found: list[Received] = []
        start = 0
        while (start := stream.find(header, start)) >= 0:
            if size - start < HEAD_SIZE:
                break
            kind, length = stream[start + 2], stream[start + 3]
            if kind not in lengths or length in lengths[kind] or length > MAX_LENGTH:
                start += 1
                continue
            end = start + length + OVERHEAD
            if end > size:
                break
            if PACKETS.is_sound(stream, start, end):
                found.append(_rejected(kind, length))
                start = end
            else:
                start += 1
        self._tail = stream[start:] if start >= 0 else stream[-1:]
        return found


def _rejected(kind: int, length: int) -> Rejected:
    name = MessageType(kind).name.lower().replace('_', ' ')
    expected = next(iter(PACKETS.lengths[kind]))
    return Rejected(_UNEXPECTED.format(name=name, length=length, expected=expected))
