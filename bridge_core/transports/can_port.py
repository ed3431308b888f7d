# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the three kinds of CAN port have in common; CanTransport takes any of them.

SocketCAN (can_socket.py) has a descriptor to wait on, and filters in the kernel. ``udp_multicast``
(can_multicast.py) simulates a bus between processes. All other interfaces of python-can, such as
slcan or pcan, may block or have no descriptor, so two threads carry their frames (can_pumped.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from bridge_core.j1939 import CanFrame

# Frames a call: bounds how long a stop waits while the bus is full.
READS = 64
RECEIVE_QUEUE_LIMIT = 1024  # frames
OLD = 0.015  # s; a frame that waits longer than this is not worth sending

Filters = Sequence[tuple[int, int]]  # (identifier, mask) of extended frames that pass; none: all


class BusOffError(Exception):
    """The controller has left the bus."""


class LostFramesError(Exception):
    """Frames were thrown away unread, and may have said stop."""


@dataclass(frozen=True, slots=True)
class RawFrame:
    """A frame of any kind; simulated buses carry impossible ones, too."""

    identifier: int
    data: bytes
    is_extended: bool = True
    is_remote: bool = False
    is_error: bool = False
    is_fd: bool = False


class CanPort(Protocol):
    """An open connection to a bus; raises OSError, and those on python-can its errors."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def read(self) -> list[RawFrame]:
        """Return what has arrived, READS frames at most, without waiting."""

    def write(self, frame: CanFrame) -> bool:
        """Send without waiting; return False if the port was busy and dropped it."""

    def stuck_since(self) -> float:
        """Return since when no frame of ours gets out; math.inf: they do, or nobody knows."""

    def close(self) -> None:
        """Leave the bus; queued frames may still go out."""


def passes(frame: RawFrame, filters: Filters) -> bool:
    """Filter as SocketCAN does in the kernel: error frames always pass."""
    if frame.is_error or not filters:
        return True
    return frame.is_extended and any(
        not (frame.identifier ^ identifier) & mask for identifier, mask in filters
    )
