# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One e-stop with two channels: when it demands a stop, and why. Pure."""

from __future__ import annotations

import math

from bridge_core.reasons import Coded
from bridge_core.watchdog import in_words


class Contact:
    """
    Two channels of one button.

    Anything but two channels that say 'released' is a stop, at once. A stop ends when both have
    said so for ``debounce`` s. Channels that disagree for ``discrepancy_time`` s are a fault: it
    stays until both have said 'pressed'.

    :param antivalent: the second channel is open while the button is released.
    """

    def __init__(
        self, name: str, *, antivalent: bool, discrepancy_time: float, debounce: float
    ) -> None:
        self.name = name
        self._antivalent = antivalent
        self._discrepancy_time = discrepancy_time
        self._debounce = debounce
        self._released: tuple[bool, bool] | None = None  # each channel; None: not read
        self._disagree_since = math.inf
        self._released_at = math.inf
        self._faulty = False

    def take(self, first: bool, second: bool, now: float) -> None:
        """Take both channels, true where one is closed."""
        self._faulty = self.faulty(now)
        released = (first, second is not self._antivalent)
        if released == self._released:
            return
        agreed = self._released is None or self._released[0] is self._released[1]
        self._released = released
        if released == (False, False):
            self._faulty = False
        if released[0] is released[1]:
            self._disagree_since = math.inf
        elif agreed:
            self._disagree_since = now
        self._released_at = now if all(released) else math.inf

    def forget(self, now: float) -> None:
        """Forget what was read, but for a fault: a cable that is plugged in again ends none."""
        self._faulty = self.faulty(now)
        self._released, self._disagree_since, self._released_at = None, math.inf, math.inf

    def faulty(self, now: float) -> bool:
        """Tell whether its channels have disagreed for too long since both were pressed."""
        return self._faulty or now >= self._disagree_since + self._discrepancy_time

    def reason(self, now: float) -> Coded | None:
        """Return why it demands a stop, and what to do; None: it does not."""
        if self._released is None:
            return self._coded('unread', f'{self.name} was not read yet')
        if self._released == (False, False):
            text = f'release {self.name}: it is pressed, or both its wires are cut'
            return self._coded('pressed', text)
        if self.faulty(now):
            text = (
                f'press and release {self.name}, and check its contacts and wires: its channels '
                f'disagreed for {in_words(self._discrepancy_time)}'
            )
            return self._coded('discrepant', text)
        if not all(self._released):
            channel = 1 if self._released[1] else 2
            text = f'check the wires of {self.name}: channel {channel} alone says pressed'
            return self._coded('one_channel', text, channel=channel)
        if now < self._released_at + self._debounce:
            return self._coded('released', f'wait: {self.name} was released just now')
        return None

    def _coded(self, what: str, text: str, **fields: int) -> Coded:
        return Coded(f'io.estop.{what}', text, name=self.name, **fields)

    @property
    def moments(self) -> tuple[float, float]:
        """When time alone changes what it says."""
        return self._disagree_since + self._discrepancy_time, self._released_at + self._debounce
