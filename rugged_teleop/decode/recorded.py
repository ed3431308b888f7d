# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings: the messages of topics, and of ~/raw what went over the ports."""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import Any, BinaryIO

from rugged_teleop.decode.pieces import Damage, Piece, Recorded
from rugged_teleop.recordings import Cut, Parameters, read, Said

_RAW = ('/raw/received', '/raw/sent')  # ends of topics
_SENT_WITHIN = 1.0  # s, from the last that a message has to the message


def mcap(file: BinaryIO) -> Iterator[Piece | Damage | Recorded]:
    """Read a recording; offsets are those behind the chunk that something stands in."""
    for each in read(file):
        offset = file.tell()
        if isinstance(each, Cut):
            yield Damage(offset, 0, f'the rest is not read: {each.reason}')
        elif isinstance(each, Parameters):
            yield Recorded(offset, each.node, 'parameters', each.values)
        elif each.foreign:
            yield Recorded(offset, each.topic, f'message in {each.foreign}', None, each.at)
        elif each.message is None:
            yield Damage(offset, 0, f'a message of {each.type}', at=each.at, source=each.topic)
        elif each.topic.endswith(_RAW):
            yield from pieces_of(each, offset)
        else:
            yield Recorded(offset, each.topic, each.type, _plain(each.message), each.at)


def pieces_of(said: Said, offset: int = 0) -> list[Piece | Damage]:
    """Return what went over a port, of a message of ~/raw."""
    try:
        return [*_pieces(said, offset)]
    except (AttributeError, TypeError, ValueError):
        reason = f'a message of {said.type} that is none of ~/raw'
        return [Damage(offset, 0, reason, at=said.at, source=said.topic)]


def _pieces(said: Said, offset: int) -> Iterator[Piece]:
    data, start = bytes(said.message.data), 0
    dimensions = said.message.layout.dim
    labels = [dimension.label.partition(' ') for dimension in dimensions]
    times = [float(at) for at, _, _ in labels]
    for dimension, at, (_, _, identifier) in zip(dimensions, times, labels, strict=True):
        end = start + dimension.size
        yield Piece(
            offset,
            data[start:end],
            said.at - (_sent_at(said, times[-1]) - at),
            said.topic,
            int(identifier, 16) if identifier else None,
        )
        start = end


def _sent_at(said: Said, last: float) -> float:
    """
    Return when a message was published by the clock that its labels have.

    :param last: the last label, which counts where what is known is of another clock.
    """
    sent_at = said.at if said.sent_at is None else said.sent_at
    return sent_at if abs(sent_at - last) < _SENT_WITHIN else last


def _plain(value: Any) -> Any:
    """Return a decoded message as JSON has it; what is not a number is null."""
    if hasattr(value, '__slots__'):
        return {name: _plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value).hex()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
