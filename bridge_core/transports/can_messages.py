# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Between python-can's messages and ours, for the buses that python-can carries."""

from __future__ import annotations

import logging

import can

from bridge_core.j1939 import CanFrame
from bridge_core.transports.can_port import RawFrame

# python-can logs at each try what we say once, in better words; without a handler of its own
# that would land on stderr.
logging.getLogger('can').addHandler(logging.NullHandler())


def raw_frame(message: can.Message) -> RawFrame:
    """Return a message as a frame of any kind."""
    return RawFrame(
        message.arbitration_id,
        bytes(message.data),
        is_extended=message.is_extended_id,
        is_remote=message.is_remote_frame,
        is_error=message.is_error_frame,
        is_fd=message.is_fd,
    )


def message_of(frame: CanFrame) -> can.Message:
    """Return a frame of ours as a message."""
    return can.Message(arbitration_id=frame.identifier, data=frame.data, is_extended_id=True)
