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
from typing import Protocol

import can

# Frames a call: bounds how long a stop waits while the bus is full.
READS = 64
RECEIVE_QUEUE_LIMIT = 1024  # frames
OLD = 0.015  # s; a frame that waits longer than this is not worth sending

Filters = Sequence[tuple[int, int]]  # (identifier, mask) of extended frames that pass; none: all


class BusOffError(Exception):
    """The controller has left the bus."""


class LostFramesError(Exception):
    """Frames were thrown away unread, and may have said stop."""


class CanPort(Protocol):
    """An open connection to a bus; raises python-can's errors and OSError."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def read(self) -> list[can.Message]:
        """Return what has arrived, READS messages at most, without waiting."""

    def write(self, message: can.Message) -> bool:
        """Send without waiting; return False if the port was busy and dropped it."""

    def stuck_since(self) -> float:
        """Return since when no frame of ours gets out; math.inf: they do, or nobody knows."""

    def close(self) -> None:
        """Leave the bus; queued frames may still go out."""


def passes(message: can.Message, filters: Filters) -> bool:
    """Filter as SocketCAN does in the kernel: error frames always pass."""
    if message.is_error_frame or not filters:
        return True
    return message.is_extended_id and any(
        not (message.arbitration_id ^ identifier) & mask for identifier, mask in filters
    )
