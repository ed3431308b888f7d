# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One simulated auxiliary channel (3.2.3, 4.2.1.5, 4.2.1.6, 4.2.2.2)."""

from __future__ import annotations

from typing import Any

FUNCTIONS = ('digital in', 'timer', 'accumulator', 'digital out', 'pulse out')
_OVER_RANGE, _RUNNING, _COUNTS = 0x8000, 0x4000, 0x3FFF


class Auxiliary:
    """
    A channel with a function.

    :param word: its configuration, as in message 15.
    """

    def __init__(self, word: int = 0) -> None:
        self.high_us = self.low_us = 0  # of the signal at the pin; 0 and 0: none
        self.level = True  # of the pin without a signal: weakly pulled up
        self.configure(word)

    def configure(self, word: int) -> None:
        """Start with a function; what comes to the pin from outside stays."""
        self.function = word & 0x0F
        self._bit_7, self._bit_8 = bool(word & 0x80), bool(word & 0x100)
        self.time_base_us = 1 << (word >> 4 & 7)
        self.out_level = bool(word & 0x10)
        self.pulse = self.period = self.shots = 0  # counts, counts, pulses
        self._pulses = 0.0
        self._counted_at: float | None = None

    @property
    def measures(self) -> bool:
        """It has a word in message 14."""
        return self.function in (1, 2)

    @property
    def pin(self) -> bool:
        """The level of the pin."""
        return self.out_level if self.function == 3 else self.level

    def count(self, now: float) -> None:
        """Accumulate the pulses of the signal."""
        cycle_us = self.high_us + self.low_us
        if cycle_us and self._counted_at is not None:
            self._pulses += (now - self._counted_at) * 1e6 / cycle_us
        self._counted_at = now

    def add(self, pulses: int) -> None:
        """Let pulses come at once."""
        self._pulses += pulses

    def word(self, now: float) -> int:
        """Return its word of message 14; what is accumulated starts anew."""
        self.count(now)
        counts = self._measured() if self.function == 1 else int(self._pulses)
        running = _RUNNING * (self.high_us + self.low_us + counts > 0)
        if self.function == 2:
            self._pulses -= counts
        return running | (counts if counts <= _COUNTS else _OVER_RANGE | _COUNTS)

    def _measured(self) -> int:
        """Return the counts from the start edge to the stop edge."""
        start_rising, stop_rising = self._bit_8, self._bit_7
        if start_rising == stop_rising:
            return (self.high_us + self.low_us) // self.time_base_us
        return (self.high_us if start_rising else self.low_us) // self.time_base_us

    def set_counts(self, counts: int, *, period: bool) -> None:
        """Obey a value of message 21."""
        if self.function != 4:
            return
        if period:
            self.period = counts
        else:
            self.pulse = counts
            self.shots += self._bit_8

    def describe(self) -> dict[str, Any]:
        """Return what can be seen, as plain values."""
        name = FUNCTIONS[self.function] if self.function < len(FUNCTIONS) else 'unknown'
        seen: dict[str, Any] = {'function': name, 'pin': self.pin}
        if self.measures:
            seen |= {'high_us': self.high_us, 'low_us': self.low_us}
        if self.function == 4:
            pulse, period = self.pulse * self.time_base_us, self.period * self.time_base_us
            seen |= {'pulse_us': pulse, 'period_us': period, 'shots': self.shots}
        return seen
