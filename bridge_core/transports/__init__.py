"""
Moving bytes or CAN frames, and nothing else: what they mean is the session's business.

A transport is opened by the link thread, gives a file descriptor to wait on, and is closed and
opened again for ever. ``close`` may be called twice.
"""

from collections.abc import Sequence
from typing import Protocol
from typing import TypeVar

# What one port carries: bytes, or bridge_core.j1939.CanFrame.
FrameT = TypeVar('FrameT')


class TransportError(Exception):
    """The port cannot be opened, is gone, or takes no more bytes; the text says what to do."""


class Transport(Protocol[FrameT]):
    """One port of one device."""

    name: str  # what the user calls the port, for messages

    def open(self) -> None:
        """Open the port and forget what was received before. :raises TransportError: cannot."""

    def close(self) -> None:
        """Close the port; what is queued may leave if that takes but an instant."""

    def fileno(self) -> int:
        """Return the descriptor that becomes readable when something was received or was lost."""

    def receive(self) -> Sequence[FrameT]:
        """Return what is there, without waiting. :raises TransportError: the port is gone."""

    def counts(self) -> dict[str, int | str]:
        """Return what was received and not handed up, by kind; shown in the link's diagnostic."""

    def send(self, frame: FrameT) -> bool:
        """
        Queue one frame; return False if the line is busy with earlier ones and it was dropped.

        :raises TransportError: the port is gone, or took nothing within its deadline.
        """
