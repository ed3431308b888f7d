# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Transports move bytes or CAN frames and do not interpret them.

A wire opens a transport, waits on its file descriptor, and reopens it whenever the port
is lost. ``close`` may be called twice.
"""

from collections.abc import Sequence
from typing import Protocol, TypeVar

# What one port carries: bytes, or bridge_core.j1939.CanFrame.
FrameT = TypeVar('FrameT')


class TransportError(Exception):
    """The port cannot be opened, is gone, or accepts no bytes; the text says what to do."""

    @property
    def reason(self) -> str:
        """The text, with its code if it has one."""
        return self.args[0] if self.args else ''


class Transport(Protocol[FrameT]):
    """One port of one device."""

    name: str  # the port as the user names it, for messages

    def open(self) -> None:
        """Open the port and discard earlier input. :raises TransportError: it cannot be opened."""

    def close(self) -> None:
        """Close the port; queued output gets a few milliseconds to leave."""

    def fileno(self) -> int:
        """Return the descriptor that becomes readable on input and when the port is lost."""

    def receive(self) -> Sequence[FrameT]:
        """Return what has arrived, without waiting. :raises TransportError: the port is gone."""

    def counts(self) -> dict[str, int | str]:
        """Return the counts of dropped input, by kind; shown in the link's diagnostic."""

    def send(self, frame: FrameT) -> bool:
        """
        Queue one frame; return False if it was dropped because earlier ones still wait.

        :raises TransportError: the port is gone, or accepted nothing within its timeout.
        """
