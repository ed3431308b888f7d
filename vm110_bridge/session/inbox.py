# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Commands of the RU's application: manual sections 4.3, 4.4 and 5.1.3.

The BU repeats a command until it is acknowledged, for 2 s, then tells its application that it has
failed. So it is acknowledged once it was published to somebody, and not before. An acknowledgement
may be lost: a repeat is answered again, and handed on only the first time.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from vm110_bridge.protocol import CommandInput
from vm110_bridge.session.events import Command

# A command is known by its ID for longer than the BU repeats it, yet not for ever: a BU that was
# restarted begins to count anew.
MEMORY = 5.0


class _State(Enum):
    OFFERED = 'waiting to be published'
    WAITING = 'waiting to be done'
    DONE = 'done'
    REFUSED = 'refused'
    BEFORE = 'delivered already, but this base unit may be another'


@dataclass(slots=True)
class _Known:
    data: bytes
    heard_at: float
    state: _State


class CommandInbox:
    """
    What is known of the latest commands.

    :param explicit: acknowledge when ``done`` says so, not when it was published.
    """

    def __init__(self, *, explicit: bool) -> None:
        self.delivered = 0
        self.repeats = 0
        self.refused = 0  # from an unarmed remote
        self.unheard = 0  # found no listener; each repeat counts
        self._explicit = explicit
        self._known: dict[int, _Known] = {}  # the one that was heard last is last

    @property
    def waiting(self) -> int:
        """How many delivered commands wait for ``done``."""
        return sum(known.state is _State.WAITING for known in self._known.values())

    def take(self, command: CommandInput, now: float, *, allowed: bool) -> tuple[bool, bool]:
        """
        Return whether to publish it, and whether to acknowledge it.

        A command that was refused stays so: arming later must not set off what was asked before.

        :param allowed: it comes from an armed remote, or need not.
        """
        self._forget(now)
        known = self._known.pop(command.command_id, None)
        if known is not None and known.data == command.data:
            self.repeats += 1
            known.heard_at = now
            self._known[command.command_id] = known
            return False, known.state is _State.DONE
        state = _State.OFFERED if allowed else _State.REFUSED
        self._known[command.command_id] = _Known(command.data, now, state)
        self.refused += not allowed
        return allowed, False

    def published(self, command: Command, *, heard: bool) -> bool:
        """
        Note that a command was published; return whether to acknowledge it.

        :param heard: somebody listens. If not, its repeats are to be published, too.
        """
        known = self._known.get(command.command_id)
        if known is None or known.data != command.data or known.state is not _State.OFFERED:
            return False  # too late, or done already
        if not heard:
            self.unheard += 1
            del self._known[command.command_id]
            return False
        self.delivered += 1
        known.state = _State.WAITING if self._explicit else _State.DONE
        return not self._explicit

    def done(self, command_id: int, now: float) -> None:
        """Note that a command was carried out. :raises ValueError: no such one waits."""
        self._forget(now)
        known = self._known.get(command_id)
        if known is None or known.state is _State.REFUSED:
            raise ValueError(f'no command with ID {command_id} was delivered lately')
        known.state = _State.DONE

    def remember(self, delivered: Iterable[tuple[Command, float]]) -> None:
        """
        Take over what a session before this one has delivered, oldest first.

        It is neither delivered again nor acknowledged but by ``done``: this base unit may be
        another, whose operator has to be told that it was not carried out.
        """
        for command, at in delivered:
            self._known.pop(command.command_id, None)
            self._known[command.command_id] = _Known(command.data, at, _State.BEFORE)

    def doubt(self) -> None:
        """Take what was delivered as asked by another base unit, which this one may not be."""
        for known in self._known.values():
            if known.state is not _State.REFUSED:
                known.state = _State.BEFORE

    def restart(self) -> None:
        """Forget all: the BU counts anew."""
        self._known.clear()

    def _forget(self, now: float) -> None:
        while self._known:
            oldest = next(iter(self._known))
            if now - self._known[oldest].heard_at < MEMORY:
                return
            del self._known[oldest]
