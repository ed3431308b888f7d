# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A bad line, one direction of it: chunks get lost, flipped or late. No port, no clock.

A chunk is what the device sends at once (a frame), or what one read of the port brought.
"""

from collections import deque
import math
import random


class FaultyLine:
    """
    Carries chunks of bytes, faultless until told otherwise.

    ``drop`` and ``corrupt`` are probabilities of 0 to 1 for each chunk; ``drop_next`` and
    ``corrupt_next`` count chunks that are hit for certain; ``delay`` is in seconds.

    :param chance: where probabilities and the flipped bits come from; seeded, it repeats itself.
    """

    def __init__(self, chance: random.Random) -> None:
        self.dropped = self.corrupted = 0
        self._chance = chance
        self._waiting: deque[tuple[float, bytes]] = deque()  # due, chunk
        self.clear()

    def clear(self) -> None:
        """Be faultless again; what is on its way still comes late."""
        self.drop = self.corrupt = self.delay = 0.0
        self.drop_next = self.corrupt_next = 0

    def forget(self) -> None:
        """Lose what is on its way, as a pulled plug does."""
        self._waiting.clear()

    def put(self, chunk: bytes, now: float) -> None:
        """Take a chunk at one end."""
        if not chunk:
            return
        if self.drop_next or self._chance.random() < self.drop:
            self.drop_next = max(0, self.drop_next - 1)
            self.dropped += 1
            return
        if self.corrupt_next or self._chance.random() < self.corrupt:
            self.corrupt_next = max(0, self.corrupt_next - 1)
            self.corrupted += 1
            chunk = self._flip(chunk)
        # Never before what was sent earlier: a serial line keeps the order.
        due = now + self.delay
        self._waiting.append((max(due, self._waiting[-1][0]) if self._waiting else due, chunk))

    def take(self, now: float) -> list[bytes]:
        """Return the chunks that arrive at the other end, in order."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now:
            arrived.append(self._waiting.popleft()[1])
        return arrived

    def deadline(self) -> float:
        """Return when the next chunk arrives; infinite if none is on its way."""
        return self._waiting[0][0] if self._waiting else math.inf

    def describe(self) -> dict[str, float]:
        """Return the faults that are set, and what they did."""
        names = ('drop', 'drop_next', 'corrupt', 'corrupt_next', 'delay', 'dropped', 'corrupted')
        return {name: value for name in names if (value := getattr(self, name))}

    def _flip(self, chunk: bytes) -> bytes:
        place = self._chance.randrange(8 * len(chunk))
        flipped = bytearray(chunk)
        flipped[place // 8] ^= 1 << place % 8
        return bytes(flipped)
