# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The frame around every payload: mBin, manual section 4.1."""

from __future__ import annotations

from enum import IntEnum

from bridge_core.packets import PacketFormat
from ssc_bridge.protocol.values import AUX_CHANNELS, MAX_INPUTS, PULSE_CHANNELS

BAUD = 115200  # fixed (3.4), 8N1
BITS_PER_BYTE = 10


class MessageType(IntEnum):
    """The message ID (4.2)."""

    STATUS = 10
    CHANNEL_SOURCE = 11
    PULSE_OUTPUTS = 12
    PULSE_INPUTS = 13
    AUX_INPUTS = 14
    CONFIGURATION = 15
    PULSE_COMMAND = 20
    AUX_OUTPUTS = 21
    LOCKOUT = 98


# The device's own messages; without a payload each is a poll for itself (4.2.1).
POLLED = tuple(kind for kind in MessageType if kind <= MessageType.CONFIGURATION)
REPEATED = POLLED[:-1]  # they may come by themselves, at a rate; the configuration never does

_PULSES = tuple(2 * channels for channels in range(1, PULSE_CHANNELS + 1))
_AUX = tuple(2 + 2 * channels for channels in range(AUX_CHANNELS + 1))
_LENGTHS: dict[int, tuple[int, ...]] = {  # bytes of payload
    MessageType.STATUS: (0, 2),
    MessageType.CHANNEL_SOURCE: tuple(range(PULSE_CHANNELS + 1)),
    MessageType.PULSE_OUTPUTS: (0, *_PULSES),
    MessageType.PULSE_INPUTS: (0, *_PULSES[:MAX_INPUTS]),
    MessageType.AUX_INPUTS: (0, *_AUX),
    MessageType.CONFIGURATION: (0, 14),
    MessageType.PULSE_COMMAND: _PULSES,
    MessageType.AUX_OUTPUTS: _AUX,
    MessageType.LOCKOUT: (0,),
}

PACKETS = PacketFormat(header=b'\x81\xa1', max_length=255, lengths=_LENGTHS, summed_from=2)
