# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The frame around every payload: manual section 7.2, 7.3 and 7.6."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from bridge_core import packets

BAUD = 115200  # 8N1 (section 7)


class MessageType(IntEnum):
    """Table 17; those of the setup are in a fork of the vendor's driver only."""

    JOYSTICK = 0x10
    GPS = 0x12
    HEARTBEAT = 0x20
    HOST_HEARTBEAT = 0x21
    REMOTE_STATUS = 0x22
    MESSAGE_CONTROL = 0x23
    USER_FEEDBACK = 0x30
    USER_FEEDBACK_NAME = 0x31
    USER_FEEDBACK_GET = 0x32
    SETUP_STRING = 0xAC
    SETUP_STRING_GET = 0xAD
    SETUP_UNLOCK = 0xAE


MAX_LENGTH = 248  # largest payload in bytes, known or unknown type
PACKETS = packets.PacketFormat(
    header=b'\x10\x01',
    max_length=MAX_LENGTH,
    lengths={  # bytes of payload
        MessageType.JOYSTICK: (14,),
        MessageType.GPS: range(1, MAX_LENGTH + 1),
        MessageType.HEARTBEAT: (6,),
        MessageType.HOST_HEARTBEAT: (1,),
        MessageType.REMOTE_STATUS: (6,),
        MessageType.MESSAGE_CONTROL: (4,),
        MessageType.USER_FEEDBACK: (5,),
        MessageType.USER_FEEDBACK_NAME: (21,),
        MessageType.USER_FEEDBACK_GET: (1,),
        MessageType.SETUP_STRING: range(1, MAX_LENGTH + 1),
        MessageType.SETUP_STRING_GET: (1,),
        MessageType.SETUP_UNLOCK: (2,),
    },
    summed_from=0,
)


@dataclass(frozen=True, slots=True)
class Rejected:
    """A sound frame that cannot be the VSC's as the manual has it. :param text: what to do."""

    text: str


class Message(packets.Message):
    """A message of the packet protocol; CAN carries some of their payloads without a frame."""

    __slots__ = ()
    PACKETS = PACKETS
    TYPE: ClassVar[MessageType]


Received = Message | Rejected
