# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What goes over a port, for whoever wants to see it: each read and each frame, with its time.

The wire puts it into a socket and never waits: what does not fit is dropped and counted. The node
takes it out at the other end, in a thread that nothing else depends on.
"""

from __future__ import annotations

import socket
import struct
from typing import NamedTuple

from bridge_core.j1939 import CanFrame

_ROOM = 1 << 20  # bytes; the system may allow less
# Time, frames dropped so far, 1: sent, identifier on CAN plus 1; then the data.
_HEAD = struct.Struct('<dIBI')


class Chunk(NamedTuple):
    """
    What one read has returned, or one frame that was sent.

    :param at: seconds of ``clock.now``. :param dropped: how many are missing, since the start.
    :param identifier: of a CAN frame, else None.
    """

    at: float
    dropped: int
    sent: bool
    identifier: int | None
    data: bytes

    @classmethod
    def from_bytes(cls, data: bytes) -> Chunk:
        """Return what ``Tap`` has put in."""
        at, dropped, sent, identifier = _HEAD.unpack_from(data)
        return cls(at, dropped, bool(sent), identifier - 1 if identifier else None, data[17:])


class Tap:
    """The wire's end. :param descriptor: of a socket of packets; it is the caller's."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.fromfd(descriptor, socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._dropped = 0

    def note(self, sent: bool, frame: bytes | CanFrame, at: float) -> None:
        """Put in a frame, or count it as dropped. Never waits, raises nothing."""
        identifier, data = 0, frame
        if isinstance(frame, CanFrame):
            identifier, data = frame.identifier + 1, frame.data
        head = _HEAD.pack(at, self._dropped, sent, identifier)
        try:
            self._socket.send(head + bytes(data), socket.MSG_DONTWAIT)  # type: ignore[arg-type]
        except OSError:
            self._dropped = (self._dropped + 1) & 0xFFFFFFFF

    def close(self) -> None:
        """Let go of the socket."""
        self._socket.close()


def tap_pair() -> tuple[socket.socket, socket.socket]:
    """Return both ends: the one to read, and the one for the wire."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
    return ours, theirs
