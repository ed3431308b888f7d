# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The RU's encoder: 8 bits that wrap (manual 4.1), as a position that does not."""

from __future__ import annotations


class Encoder:
    """
    Counts turns of the remote whose movements are allowed, and of no other.

    What is turned while nothing may move, and the jump from one remote's counter to another's, do
    not count.
    """

    def __init__(self) -> None:
        self.position = 0
        self._ru = 0
        self._last = 0
        self._reported = False

    def rest(self) -> None:
        """Count from where it stands next time: the link was lost."""
        self._ru = 0

    def read(self, value: int, ru: int) -> bool:
        """
        Follow the counter; tell whether the position changed, or is the first to be reported.

        :param value: 0-255. :param ru: the enabled remote's ID; 0 for none.
        """
        turned = 0
        if ru and ru == self._ru:
            turned = (value - self._last + 0x80 & 0xFF) - 0x80  # the shorter way round
        self._ru, self._last = ru, value
        self.position += turned
        news = bool(turned or (ru and not self._reported))
        self._reported = self._reported or news
        return news
