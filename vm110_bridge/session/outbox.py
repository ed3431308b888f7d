# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Commands to the RU's application, one at a time: manual sections 4.5, 4.6 and 5.1.4.

A command waits for the ones before it, but never for a BU that is not there: executed much later
than asked, it would be a surprise.
"""

from __future__ import annotations

from collections import deque
import math

from vm110_bridge.protocol import CommandOutput
from vm110_bridge.session.events import CommandResult

RESEND_PERIOD = 0.1
QUEUE_SIZE = 16  # beside the one that is outstanding

ACKNOWLEDGED = 'acknowledged'


class CommandOutbox:
    """
    The line of commands to the BU.

    :param timeout: seconds after which a command that was not acknowledged is given up.
    """

    def __init__(self, timeout: float) -> None:
        self.stray_acknowledgements = 0
        self._timeout = timeout
        self._outstanding: CommandOutput | None = None
        self._waiting: deque[CommandOutput] = deque()
        self._next_id: int | None = None
        self.sends_at = self.expires_at = math.inf  # the outstanding one's next moments

    @property
    def size(self) -> int:
        """Commands whose outcome is open."""
        return len(self._waiting) + (self._outstanding is not None)

    def add(self, data: bytes, now: float) -> int:
        """Queue a command; return its ID. :raises ValueError: not 16 bytes, or too many wait."""
        if len(self._waiting) >= QUEUE_SIZE:
            raise ValueError(f'{QUEUE_SIZE} commands wait already; send them more slowly')
        if self._next_id is None:
            # The BU may remember the IDs of this node's last life: begin somewhere else.
            self._next_id = int(now * 1e3) & 0xFFFF
        command = CommandOutput(self._next_id, data)
        self._next_id = (self._next_id + 1) & 0xFFFF
        self._waiting.append(command)
        self._advance(now)
        return command.command_id

    def acknowledged(self, command_id: int, now: float) -> list[CommandResult]:
        """Take a VRAI; return the outcome that it is."""
        if self._outstanding is None or self._outstanding.command_id != command_id:
            self.stray_acknowledgements += 1
            return []
        return [self._end(ACKNOWLEDGED, now)]

    def expire(self, now: float) -> list[CommandResult]:
        """Give up the command that was not acknowledged in time; return the outcome."""
        if now < self.expires_at:
            return []
        return [self._end(f'not acknowledged within {self._timeout:g} s', now)]

    def drop(self, reason: str) -> list[CommandResult]:
        """Give up all of them; return the outcomes."""
        commands = [self._outstanding] if self._outstanding is not None else []
        commands += self._waiting
        self._waiting.clear()
        self._outstanding = None
        self.sends_at = self.expires_at = math.inf
        return [CommandResult(command.command_id, reason) for command in commands]

    def due(self, now: float) -> list[CommandOutput]:
        """Return what is to be sent now."""
        if self._outstanding is None or now < self.sends_at:
            return []
        return [self._outstanding]

    def sent(self, now: float) -> None:
        """Note that the outstanding command went out; it goes again unless it is acknowledged."""
        self.sends_at = now + RESEND_PERIOD

    def _end(self, outcome: str, now: float) -> CommandResult:
        assert self._outstanding is not None
        result = CommandResult(self._outstanding.command_id, outcome)
        self._outstanding = None
        self.sends_at = self.expires_at = math.inf
        self._advance(now)
        return result

    def _advance(self, now: float) -> None:
        """Make the next command the outstanding one."""
        if self._outstanding is None and self._waiting:
            self._outstanding = self._waiting.popleft()
            self.sends_at, self.expires_at = now, now + self._timeout
