# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What was heard of the machine, and when. Pure; times in seconds of ``bridge_core.clock``."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from typing import Any

from rugged_teleop.decode.recorded import pieces_of
from rugged_teleop.recordings import Said
from rugged_teleop.why.events import wire_changes

_KEPT = 20_000  # values of each channel
_SILENCE = 6.0  # s; more than any link_timeout
_OVERLAP = 1.0  # s of bytes before the wanted ones, for the value that they change


class History:
    """
    Values by channel: 'state', 'status' (its fields), 'enabled', 'command' and 'joints' (by name),
    'estop NAME', 'joy NAME' (axes, buttons), 'raw' (of ~/raw). 'joints' are of the mux's feedback,
    or of each drive's where it has none. 'enabled': any drive is, and 'enabled NODE' this one;
    where the mux hears no drive, that the mux is neither STOPPED nor READY.

    :param epoch: seconds since 1970 at which the clock was 0, for the labels of ~/raw.
    """

    def __init__(self, epoch: float = 0.0) -> None:
        self.epoch = epoch
        self._channels: dict[str, tuple[list[float], list[Any]]] = {}

    def add(self, channel: str, at: float, value: Any) -> None:
        """Keep a value, behind those that are there."""
        times, values = self._channels.setdefault(channel, ([], []))
        times.append(max(at, times[-1]) if times else at)
        values.append(value)
        if len(times) > 2 * _KEPT:
            del times[:_KEPT], values[:_KEPT]

    def channels(self, kind: str) -> list[str]:
        """Return the names behind a kind, such as those of e-stop sources."""
        found = (name.partition(' ') for name in self._channels)
        return sorted(name for first, _, name in found if first == kind)

    def last(self, channel: str, otherwise: Any = None) -> Any:
        """Return the newest value."""
        values = self._channels.get(channel, ([], []))[1]
        return values[-1] if values else otherwise

    def heard_at(self, channel: str) -> float:
        """Return when the newest value came; 0: never."""
        times = self._channels.get(channel, ([], []))[0]
        return times[-1] if times else 0.0

    def since(self, channel: str, at: float) -> Iterator[tuple[float, Any]]:
        """Yield what came at or after a moment."""
        times, values = self._channels.get(channel, ([], []))
        first = bisect_left(times, at)
        yield from zip(times[first:], values[first:], strict=True)

    def before(self, channel: str, at: float) -> Any:
        """Return the newest value that had come by then."""
        times, values = self._channels.get(channel, ([], []))
        place = bisect_right(times, at)
        return values[place - 1] if place else None

    def first(self, channel: str, at: float, wanted: Callable[[Any], bool]) -> float | None:
        """Return when the first wanted value came since then."""
        return next((when for when, value in self.since(channel, at) if wanted(value)), None)

    def on_wire(self, way: str, at: float, wanted: bool) -> dict[str, float]:
        """Return, by node, when a wire first changed to this since then; see ``wire_changes``."""
        said: list[Said] = [each for _, each in self.since('raw', at - _OVERLAP)]
        firsts: dict[str, float] = {}
        for moment, node, value, is_first in wire_changes(said, way):
            if value is wanted and not is_first and moment - self.epoch >= at:
                firsts.setdefault(node, moment - self.epoch)
        return firsts

    def last_frame(self, node: str, at: float) -> float | None:
        """Return when a device was heard last up to then, by its bytes."""
        topic = f'{node}/raw/received'
        said = (each for _, each in self.since('raw', at - _SILENCE) if each.topic == topic)
        pieces = (piece for each in said for piece in pieces_of(each))
        times = (piece.at - self.epoch for piece in pieces if piece.at is not None)
        return max((each for each in times if each <= at), default=None)
