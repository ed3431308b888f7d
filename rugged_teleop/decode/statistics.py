# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How often what came, where it paused, what was damaged, and how full the buses were."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
import math

from rugged_teleop.decode.protocols import Entry

_MOST_KINDS = 1000  # more are counted together: a capture may name any number of senders
_OTHERS = ('', '', 'others')
# s of a bus whose load is told: times are of packets of a USB adapter, which has some frames each.
_LOAD_TIME = 1.0
_FULL = 100.0  # %
_HEADINGS: tuple[str, ...] = (
    *('source', 'id', 'message', 'count'),
    *('rate/s', 'mean ms', 'longest gap'),
)
# Bits of a frame of classic CAN beside its data, and those of them that may need stuffing.
_BITS = {True: (67, 54), False: (47, 34)}  # 29-bit identifier, 11-bit identifier


@dataclass(slots=True)
class _Kind:
    """One message of one sender."""

    count: int = 0
    timed: int = 0  # of them
    first: float = math.nan
    last: float = math.nan
    gap: float = 0.0
    gap_offset: int = 0

    def note(self, entry: Entry) -> None:
        self.count += 1
        if entry.at is None:
            return
        if entry.at - self.last > self.gap:
            self.gap, self.gap_offset = entry.at - self.last, entry.offset
        self.timed += 1
        if self.timed == 1:
            self.first = entry.at
        self.last = entry.at

    def row(self) -> tuple[str, ...]:
        duration = self.last - self.first
        if not duration > 0.0:
            return str(self.count), '', '', ''
        mean = duration / (self.timed - 1)
        gap = f'{self.gap * 1e3:.1f} ms at {self.gap_offset}'
        return str(self.count), f'{1 / mean:.1f}', f'{mean * 1e3:.1f}', gap


@dataclass(slots=True)
class _Bus:
    """Bits on one channel, without and with as many stuff bits as there can be."""

    first: float
    last: float
    least: int = 0
    most: int = 0
    second: int = 0  # number, bits in it, and the fullest of all
    in_second: int = 0
    fullest: int = 0

    def note(self, entry: Entry, at: float) -> None:
        fixed, stuffed = _BITS[entry.name != 'standard frame']
        bits = fixed + 8 * entry.size
        self.least += bits
        self.most += bits + (stuffed + 8 * entry.size - 1) // 4
        if int(at) != self.second:
            self.second, self.in_second = int(at), 0
        self.in_second += bits
        self.fullest = max(self.fullest, self.in_second)
        self.last = max(self.last, at)


@dataclass
class Statistics:
    """
    What a capture has in all. :param bitrate: of the CAN buses, bit/s.

    It does not grow with the capture.
    """

    bitrate: int
    decoded: int = 0
    damaged: int = 0
    damaged_bytes: int = 0
    first_damage: int | None = None
    backwards: int = 0  # times that are before the one before, of the same source
    _reasons: Counter[str] = field(default_factory=Counter)
    _kinds: dict[tuple[str, ...], _Kind] = field(default_factory=dict)
    _buses: dict[str, _Bus] = field(default_factory=dict)
    _at: float = -math.inf
    _source: str = ''  # at that time

    def note(self, entry: Entry) -> None:
        """Count an entry."""
        if entry.at is not None:
            self.backwards += entry.at < self._at and entry.source == self._source
            self._at, self._source = entry.at, entry.source
        if entry.identifier is not None and entry.at is not None:
            bus = self._buses.setdefault(entry.source, _Bus(entry.at, entry.at))
            bus.note(entry, entry.at)
        if entry.damaged:
            self._add_damage(entry)
            return
        self.decoded += bool(entry.protocol)
        identifier = '' if entry.identifier is None else f'{entry.identifier:08X}'
        # Of other programs on a network only the number is of interest.
        ours = entry.protocol or identifier
        key = (entry.source if ours else '', identifier, entry.name)
        if key not in self._kinds and len(self._kinds) >= _MOST_KINDS:
            key = _OTHERS
        self._kinds.setdefault(key, _Kind()).note(entry)

    def _add_damage(self, entry: Entry) -> None:
        self.damaged += 1
        self.damaged_bytes += entry.size
        if self.first_damage is None:
            self.first_damage = entry.offset
        # Some name numbers of the one frame.
        known = entry.content in self._reasons or len(self._reasons) < _MOST_KINDS
        self._reasons[entry.content if known else 'others'] += 1

    def lines(self) -> Iterator[str]:
        """Yield the report."""
        if not self._kinds and not self.damaged:
            yield 'nothing was found in it'
            return
        rows = [(*key, *kind.row()) for key, kind in sorted(self._kinds.items())]
        columns = [
            (heading, *cells)
            for heading, *cells in zip(_HEADINGS, *rows, strict=True)
            if any(cells)
        ]
        widths = [max(map(len, column)) for column in columns]
        for row in zip(*columns, strict=True):
            cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            yield '  '.join(cells).rstrip()
        for channel, bus in sorted(self._buses.items()):
            yield from self._bus_line(channel or 'the bus', bus)
        if self.damaged:
            yield (
                f'damage: {self.damaged} places, {self.damaged_bytes} bytes, the first at offset '
                f'{self.first_damage}'
            )
            for reason, count in self._reasons.most_common(10):
                yield f'  {count} times: {reason}'
        if self.backwards:
            yield f'times: {self.backwards} are before the one before; rates and gaps are rough'

    def _bus_line(self, channel: str, bus: _Bus) -> Iterator[str]:
        duration = bus.last - bus.first
        if 0.0 < duration < _LOAD_TIME:
            yield f'load of {channel}: {duration:.2g} s are too short to tell'
        elif duration > 0.0:
            least, most = (100 * bits / duration / self.bitrate for bits in (bus.least, bus.most))
            fullest = 100 * bus.fullest / self.bitrate
            yield (
                f'load of {channel}: {least:.1f} to {most:.1f} % of {self.bitrate} bit/s by its '
                f'stuff bits, {fullest:.1f} % and more in the fullest second'
                f'{"; more than it can carry: see --bitrate" if least > _FULL else ""}'
            )
