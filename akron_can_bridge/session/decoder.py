# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From frames to messages: those that concern one session, each with its sender."""

from __future__ import annotations

from collections.abc import Callable

from akron_can_bridge.protocol import (
    BASIC_JOYSTICK_PGN,
    EXTENDED_JOYSTICK_PGN,
    FIELD_REQUEST_PGN,
    Message,
    NAME_PGN,
    PROPRIETARY_PGN,
    read,
)
from bridge_core.framing import Decoder, FrameError, Unknown
from bridge_core.j1939 import CanFrame, J1939Id
from bridge_core.watchdog import Watchdog

_MISFIT_MEMORY = 1.0  # s for which a message that cannot be is told of
JOYSTICK_PGNS = (BASIC_JOYSTICK_PGN, EXTENDED_JOYSTICK_PGN)
# All that a session takes, as (identifier, mask); the priority does not count.
FILTERS = (
    *((pgn << 8, 0x03FFFF00) for pgn in JOYSTICK_PGNS),
    (NAME_PGN << 8, 0x03FF0000),
    (FIELD_REQUEST_PGN << 8, 0x03FF0000),
    (PROPRIETARY_PGN << 8, 0x03FF0000),
)

# The frame, its identifier taken apart, and what it says. None: a joystick's, but not sound; a
# unit may be less strict than we are.
Received = tuple[CanFrame, J1939Id, Message | None]


class FrameDecoder(Decoder[CanFrame, Received]):
    """
    Decodes what concerns a session, and counts what does not.

    :param concerns: whether it does, by identifier and data.
    :param believed: whether it is its sender's fault if such a message cannot be: PGN EF00 is
        every maker's own.
    """

    def __init__(
        self,
        concerns: Callable[[J1939Id, bytes], bool],
        believed: Callable[[J1939Id], bool],
    ) -> None:
        super().__init__()
        self.other_frames = 0  # none of our business
        self._misfit = ''  # what the unit sent last that cannot be
        self._misfit_heard = Watchdog(_MISFIT_MEMORY)
        self._concerns = concerns
        self._believed = believed

    def feed(self, data: CanFrame, now: float) -> list[Received]:
        """Return the message of a frame, if there is one."""
        self.counters.frames += 1
        self.counters.bytes += len(data.data)
        sender = J1939Id.from_identifier(data.identifier)
        if not self._concerns(sender, data.data):
            self.other_frames += 1
            return []
        try:
            message = read(sender.pgn, data.data)
        except FrameError as error:
            if self._believed(sender):
                self.counters.malformed += 1
                if sender.pgn == PROPRIETARY_PGN:
                    self._misfit = str(error)
                    self._misfit_heard.feed(now)
            else:
                self.other_frames += 1
            return [(data, sender, None)] if sender.pgn in JOYSTICK_PGNS else []
        if isinstance(message, Unknown):
            self.counters.unknown_types += 1
            return []
        return [(data, sender, message)]

    def misfit(self, now: float) -> str:
        """Say what is wrong with a message of the unit; empty: not lately."""
        return '' if self._misfit_heard.expired(now) else self._misfit
