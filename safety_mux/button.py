# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Buttons: of a reset, and those of an operator that are pressed instead of his deadman.

A reset by a button, as ISO 13849-1 has a manual reset: pressed, and released again.

The topic says all the time whether the button is pressed. The release counts, after a press that
was neither too short (a bounce, a disturbance) nor too long (a button that sticks, or was taped
down), and of which nothing was missed.
"""

from collections.abc import Sequence
import math

from bridge_core.reasons import Coded
from bridge_core.watchdog import in_words, Watchdog

SHORTEST, LONGEST = 0.1, 2.0  # s
TIMEOUT = 0.25  # s
_NEW = 10.0  # s; a button that has been pressed for longer is a switch


class ResetButton:
    """Follows one button by its messages."""

    __slots__ = ('_fault', '_heard_at', '_pressed', '_since', '_watchdog', 'free_at')

    def __init__(self) -> None:
        self._watchdog = Watchdog(TIMEOUT)
        self._pressed = False
        self._heard_at = -math.inf
        self.free_at = -math.inf  # the last message before the newest press
        self._since = 0.0  # of that press
        self._fault = ''  # why that one does not count

    def hear(self, pressed: bool, now: float, trouble: str = '') -> str | None:
        """
        Take a message; return None, or at a release why it is no reset, empty if it is one.

        :param trouble: why no press counts at this moment; empty: nothing is in the way.
        """
        if not self._watchdog.heard:
            trouble = 'was pressed when it was first heard'
        elif self._watchdog.expired(now):
            trouble = f'was stale meanwhile: {self._watchdog.describe(now)}'
        self._watchdog.feed(now)
        before, self._pressed = self._pressed, pressed
        if pressed and not before:
            self.free_at, self._since, self._fault = self._heard_at, now, ''
        self._heard_at = now
        self._fault = self._fault or trouble
        if pressed or not before:
            return None
        held = now - self._since
        if self._fault or SHORTEST <= held <= LONGEST:
            return self._fault
        limits = f'{in_words(SHORTEST)} to {in_words(LONGEST)}'
        return f'was held for {in_words(held)}; {limits} count'

    def problem(self, now: float) -> Coded | None:
        """Return why it could not reset now, in words; None if it could."""
        if self._watchdog.expired(now):
            condition = 'stale' if self._watchdog.heard else 'silent'
            return Coded('mux.button.quiet', f'is {condition}: {self._watchdog.describe(now)}')
        held = now - self._since
        if self._pressed and not held <= LONGEST:
            text = f'has been held for {in_words(held)}: release it'
            return Coded('mux.button.held', text, held_s=held)
        return None


class Presses:
    """
    Follows the buttons of one operator, to say which are pressed instead of the deadman.

    ``refused`` counts the presses of the deadman that gave no control, however short.

    :param deadman: indices of its buttons. :param pressed_at: least value of a pressed one.
    """

    __slots__ = ('_deadman', '_is_new', '_pressed_at', '_since', 'refused')

    def __init__(self, deadman: Sequence[int], pressed_at: int) -> None:
        self._deadman = deadman
        self._pressed_at = pressed_at
        self._since: dict[int, float] = {}
        self._is_new = False  # the deadman was pressed since the last decision
        self.refused = 0

    def hear(self, buttons: Sequence[int], now: float) -> None:
        """Take a message."""
        was_held = self._is_held
        pressed = (n for n, value in enumerate(buttons) if value >= self._pressed_at)
        self._since = {n: self._since.get(n, now) for n in pressed}
        self._is_new |= self._is_held and not was_held

    def decided(self, has_control: bool) -> None:
        """Note what was decided since the last message."""
        self.refused += self._is_new and not has_control
        self._is_new = False

    @property
    def _is_held(self) -> bool:
        return all(n in self._since for n in self._deadman)

    def instead(self, now: float) -> str:
        """Say what was pressed lately, and what would count; empty if that is pressed, too."""
        new = [n for n, at in self._since.items() if now - at < _NEW]
        if not new or self._is_held:
            return ''
        return f'buttons pressed: {_listed(new)}; its deadman: {_listed(self._deadman)}'


def _listed(buttons: Sequence[int]) -> str:
    return ' and '.join(map(str, buttons))
