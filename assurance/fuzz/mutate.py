# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Inputs, and how one becomes another.

An input is what a port would give: reads, each with the pause before it. Files are inputs of which
only the bytes count. Beside plain damage there are steps that know the format: they repair checks
behind the damage, double, cut, splice and join frames, and split reads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import random

Read = tuple[float, bytes]  # s before it, what is read
Input = tuple[Read, ...]
Repair = Callable[[bytes, random.Random], bytes]

_MOST_READS = 40
_LARGEST_READ = 4096  # bytes
_BYTES = (0x00, 0x01, 0x7F, 0x80, 0xFE, 0xFF)


def unrepaired(data: bytes, rng: random.Random) -> bytes:
    """Return it as it is: the format has no check."""
    del rng
    return data


@dataclass(frozen=True)
class Kit:
    """
    What a target's inputs are made of.

    :param seeds: inputs to begin with. :param tokens: bytes that mean something.
    :param pauses: s, what may be between two reads. :param repair: makes checks and lengths fit.
    """

    seeds: Sequence[Input]
    tokens: Sequence[bytes]
    pauses: Sequence[float] = (0.0,)
    repair: Repair = unrepaired


def whole(*frames: bytes) -> Input:
    """Return reads of one frame each, without a pause."""
    return tuple((0.0, frame) for frame in frames)


def joined(reads: Input) -> bytes:
    """Return all bytes of an input."""
    return b''.join(data for _, data in reads)


class Mutator:
    """Makes inputs out of others. :param rng: decides all, so a seed gives the same inputs."""

    def __init__(self, kit: Kit, rng: random.Random) -> None:
        self._kit = kit
        self._rng = rng
        self._in_read = (
            self._flip,
            self._flip,
            self._set,
            self._set,
            self._insert,
            self._delete,
            self._truncate,
            self._double_part,
            self._overwrite,
            self._repaired,
            self._repaired,
        )
        self._of_reads = (
            self._pause,
            self._double,
            self._drop,
            self._swap,
            self._split,
            self._join,
        )

    def mutate(self, parent: Input, other: Input) -> Input:
        """Return a changed copy; ``other`` gives parts."""
        rng = self._rng
        reads = list(parent) or [(0.0, b'')]
        for _ in range(1 + int(rng.random() ** 2 * 5)):
            at = int(rng.random() * len(reads))
            kind = rng.random()
            if kind < 0.7:
                pause, data = reads[at]
                step = self._in_read[int(rng.random() * len(self._in_read))]
                reads[at] = pause, step(data)
            elif kind < 0.9:
                self._of_reads[int(rng.random() * len(self._of_reads))](reads, at)
            else:
                self._splice(reads, at, other)
            if not reads:
                reads = [(0.0, b'')]
        return tuple((pause, data[:_LARGEST_READ]) for pause, data in reads[:_MOST_READS])

    # Within a read.

    def _place(self, data: bytes) -> int:
        return int(self._rng.random() * len(data))

    def _flip(self, data: bytes) -> bytes:
        if not data:
            return data
        at = self._place(data)
        return data[:at] + bytes((data[at] ^ 1 << int(self._rng.random() * 8),)) + data[at + 1 :]

    def _set(self, data: bytes) -> bytes:
        if not data:
            return data
        rng, at = self._rng, self._place(data)
        many = rng.random() < 0.5
        value = _BYTES[int(rng.random() * len(_BYTES))] if many else int(rng.random() * 256)
        return data[:at] + bytes((value,)) + data[at + 1 :]

    def _token(self) -> bytes:
        tokens = self._kit.tokens
        if tokens and self._rng.random() < 0.8:
            return tokens[int(self._rng.random() * len(tokens))]
        return self._rng.randbytes(1 + int(self._rng.random() * 4))

    def _insert(self, data: bytes) -> bytes:
        at = self._place(data)
        return data[:at] + self._token() + data[at:]

    def _overwrite(self, data: bytes) -> bytes:
        token, at = self._token(), self._place(data)
        return data[:at] + token + data[at + len(token) :]

    def _delete(self, data: bytes) -> bytes:
        at = self._place(data)
        return data[:at] + data[at + 1 + int(self._rng.random() * 4) :]

    def _truncate(self, data: bytes) -> bytes:
        return data[: self._place(data)]

    def _double_part(self, data: bytes) -> bytes:
        at = self._place(data)
        part = data[at : at + 1 + int(self._rng.random() * 32)]
        return data[:at] + part * (1 + int(self._rng.random() ** 4 * 60)) + data[at:]

    def _repaired(self, data: bytes) -> bytes:
        return self._kit.repair(data, self._rng)

    # Of reads.

    def _pause(self, reads: list[Read], at: int) -> None:
        pauses = self._kit.pauses
        reads[at] = pauses[int(self._rng.random() * len(pauses))], reads[at][1]

    def _double(self, reads: list[Read], at: int) -> None:
        reads[at:at] = [reads[at]] * (1 + int(self._rng.random() ** 4 * 20))

    def _drop(self, reads: list[Read], at: int) -> None:
        del reads[at]

    def _swap(self, reads: list[Read], at: int) -> None:
        other = int(self._rng.random() * len(reads))
        reads[at], reads[other] = reads[other], reads[at]

    def _split(self, reads: list[Read], at: int) -> None:
        pause, data = reads[at]
        cut = self._place(data)
        reads[at : at + 1] = [(pause, data[:cut]), (0.0, data[cut:])]

    def _join(self, reads: list[Read], at: int) -> None:
        if at + 1 < len(reads):
            reads[at : at + 2] = [(reads[at][0], reads[at][1] + reads[at + 1][1])]

    def _splice(self, reads: list[Read], at: int, other: Input) -> None:
        rng = self._rng
        if not other:
            return
        begin = int(rng.random() * len(other))
        part = other[begin : begin + 1 + int(rng.random() * 4)]
        if rng.random() < 0.3:  # within a read
            pause, data = reads[at]
            cut = self._place(data)
            reads[at] = pause, data[:cut] + part[0][1] + data[cut:]
        else:
            reads[at:at] = part
