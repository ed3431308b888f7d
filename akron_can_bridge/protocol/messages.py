# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From a frame to its message: by PGN, type byte and length."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from akron_can_bridge.protocol import broadcasts, joysticks, polls
from akron_can_bridge.protocol.frames import Message, PROPRIETARY_PGN
from bridge_core.framing import FrameError, Unknown
from bridge_core.j1939 import CanFrame, J1939Id

MESSAGES: tuple[type[Message], ...] = tuple(
    kind
    for module in (joysticks, polls, broadcasts)
    for kind in vars(module).values()
    if isinstance(kind, type) and issubclass(kind, Message) and kind.__module__ == module.__name__
)
# A poll and its response share a type; their lengths tell them apart.
_READERS: dict[tuple[int, int | None, int], Callable[[bytes], Message]] = {
    (kind.PGN, kind.TYPE, length): kind.from_data for kind in MESSAGES for length in kind.LENGTHS
}
_KNOWN: set[tuple[int, int | None]] = {(kind.PGN, kind.TYPE) for kind in MESSAGES}


class Received(NamedTuple):
    """What came in one frame, and from whom to whom. Unknown: by its first byte, or its PGN."""

    message: Message | Unknown
    id: J1939Id


def decode(frame: CanFrame) -> Received:
    """Read a frame; see ``read``. :raises FrameError: its data cannot be what it says."""
    parts = J1939Id.from_identifier(frame.identifier)
    return tuple.__new__(Received, (read(parts.pgn, frame.data), parts))  # half of its own time


def read(pgn: int, data: bytes) -> Message | Unknown:
    """
    Read a frame's data. The priority does not count ("General Message Characteristics").

    PGN EF00 is every maker's own: believe such a message only from a unit's address.

    :raises FrameError: the data cannot be what PGN and type say.
    """
    number = None
    if pgn == PROPRIETARY_PGN:
        if not data:
            raise FrameError('a message without its type byte')
        number = data[0]
    reader = _READERS.get((pgn, number, len(data)))
    if reader is not None:
        return reader(data)
    if (pgn, number) in _KNOWN:
        name = f'PGN {pgn}' if number is None else f'type {number:02X}'
        raise FrameError(f'{name} cannot have {len(data)} bytes')
    return Unknown(pgn if number is None else number)
