# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What went over the wire to a drive, where ~/raw was recorded: when it was told to stop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from bridge_core.decoding import StreamDecoder
from rugged_teleop.decode.protocols import recording_entries
from rugged_teleop.decode.recorded import pieces_of
from rugged_teleop.devices import protocols
from rugged_teleop.recordings import Said
from rugged_teleop.why.events import Event

_SENT = '/raw/sent'
_PROTOCOLS: dict[str, StreamDecoder] = {each.name: each for _, each in protocols(StreamDecoder)}


def wire_events(said: Iterable[Said]) -> Iterator[Event]:
    """Yield an event for each packet to a drive that enables where the one before did not."""
    pieces = (piece for each in said if each.topic.endswith(_SENT) for piece in pieces_of(each))
    enabled: dict[str, bool] = {}
    for entry in recording_entries(pieces, ''):
        protocol = _PROTOCOLS.get(entry.protocol)
        enables = protocol.enables(entry.content) if protocol else None
        if enables is None or entry.at is None:
            continue
        node = entry.source.removesuffix(_SENT)
        before = enabled.get(node)
        enabled[node] = enables
        if enables != before:
            text = f'{node} tells the drive to {"enable" if enables else "disable"}, on the wire'
            yield Event(entry.at, f'wire {node}', enables, '' if before is None else text)
