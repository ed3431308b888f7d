# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The three ways to join a VSC: packet protocol (7), CAN (8) and HID (9).

What is received becomes messages, and messages become what is sent. What they mean is the same on
all three, and the session's business.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import math
from typing import Any, ClassVar

from bridge_core.framing import Decoder
from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.protocol.can import (
    CanDecoder,
    CanIds,
    encode_frame,
    FROM_VSC,
    SEGMENT_SIZE,
    SEGMENTS,
    segments_of,
)
from fort_vsc_bridge.protocol.frames import Message, MessageType, Received
from fort_vsc_bridge.protocol.hid import HidDecoder
from fort_vsc_bridge.protocol.messages import UserFeedback, UserFeedbackName
from fort_vsc_bridge.protocol.serial import SerialDecoder
from fort_vsc_bridge.protocol.values import Key

Frame = bytes | CanFrame  # as the wire has it

_WORDS = {
    MessageType.HOST_HEARTBEAT: 'a software e-stop',
    MessageType.USER_FEEDBACK: 'values, settings or rumble',
    MessageType.USER_FEEDBACK_NAME: 'names or text',
    MessageType.USER_FEEDBACK_GET: 'a question for a value',
    MessageType.MESSAGE_CONTROL: 'a message control',
}


@dataclass(frozen=True)
class Wire:
    """What differs from wire to wire; it keeps nothing of what was received."""

    NAME: ClassVar[str]
    # What can be sent, and the seconds between two frames of a type.
    PERIODS: ClassVar[Mapping[MessageType, float]]
    INTERVAL: ClassVar[float]  # seconds between two signs of life of the device, as delivered
    SIGN_OF_LIFE: ClassVar[str]
    # What to do: no sign of life; the same, yet data comes, but nothing that is sound; or joystick
    # messages come; they do not, but the rest.
    SILENCE: ClassVar[str]
    GARBLED: ClassVar[str] = ''
    DAMAGED: ClassVar[str] = 'check cable, shield, ground and bit rate'  # much of what comes is
    JOYSTICK_ONLY: ClassVar[str] = ''
    NO_JOYSTICK: ClassVar[str] = ''
    NO_REMOTE_STATUS: ClassVar[str]  # what to do where no remote status message comes

    @property
    def queues(self) -> bool:
        """Whether the line may hold back what comes. USB, RS232 and CAN do not."""
        return False

    @property
    def most_heartbeats(self) -> float:
        """How many one VSC sends in a second; infinite where no other one can be on the line."""
        return math.inf

    def carries(self, kind: MessageType) -> bool:
        """Tell whether a message of this type can be sent."""
        return kind in self.PERIODS

    def require(self, kind: MessageType) -> None:
        """Let a type pass that can be sent. :raises ValueError: naming the transport."""
        if not self.carries(kind):
            raise ValueError(f'transport {self.NAME} cannot carry {_WORDS[kind]}')

    def check(self, message: Message) -> None:
        """Let a message pass that fits this wire. :raises ValueError: naming the transport."""
        self.require(message.TYPE)

    def decoder(self, timeout: float) -> Decoder[Any, Received]:
        """
        Return what turns what the transport received at once into messages.

        :param timeout: seconds after which a part of a message that others complete is missing.
        """
        raise NotImplementedError

    def frames(self, message: Message) -> list[Frame]:
        """Return what carries a message, in the order of sending."""
        raise NotImplementedError


@dataclass(frozen=True)
class SerialWire(Wire):
    """
    The packet protocol over USB or RS232: bytes in any split.

    :param network: it goes over one, by a serial server.
    """

    NAME = 'serial'
    # Table 17. It gives no rate for message control, which is written to EEPROM: no faster than
    # the others.
    PERIODS = {
        MessageType.HOST_HEARTBEAT: 0.05,
        MessageType.USER_FEEDBACK: 0.05,
        MessageType.USER_FEEDBACK_NAME: 0.25,
        MessageType.USER_FEEDBACK_GET: 0.05,
        MessageType.MESSAGE_CONTROL: 0.25,
        # No rate is known. An unlock goes before a question of the same moment.
        MessageType.SETUP_UNLOCK: 0.25,
        MessageType.SETUP_STRING_GET: 0.25,
    }
    INTERVAL = 0.05
    SIGN_OF_LIFE = 'heartbeat from the VSC'
    SILENCE = 'check power and serial cable of the VSC'
    GARBLED = 'check baud, and that port is the VSC, as bytes come, but no frame'
    JOYSTICK_ONLY = 'enable its heartbeat message, as joystick messages do come'
    NO_JOYSTICK = 'set device.joystick_interval_ms'
    NO_REMOTE_STATUS = 'set device.remote_status_interval_ms once, with configure_device'

    network: bool = False

    @property
    def queues(self) -> bool:
        """Whether the line may hold back what comes, as a network may."""
        return self.network

    def decoder(self, timeout: float) -> Decoder[Any, Received]:
        """Return the parser of the stream; every message is whole there."""
        del timeout
        return SerialDecoder()

    def frames(self, message: Message) -> list[Frame]:
        """Return one frame."""
        return [message.to_bytes()]


@dataclass(frozen=True)
class CanWire(Wire):
    """
    CAN-J1939: one frame at a time.

    :param ids: identifiers of the messages. :param heartbeat_rate: Hz, of one VSC.
    """

    NAME = 'can'
    PERIODS = {  # table 34; of a string, between two segments
        MessageType.USER_FEEDBACK: 0.1,
        MessageType.USER_FEEDBACK_NAME: 0.1,
    }
    INTERVAL = 0.1
    SIGN_OF_LIFE = 'heartbeat from the VSC'
    SILENCE = "check the VSC's power, the CAN wiring, the bit rate and can.heartbeat"
    DAMAGED = 'look for another device with these identifiers, or another firmware'
    JOYSTICK_ONLY = 'compare can.heartbeat with the VSC, as joystick messages do come'
    NO_JOYSTICK = 'compare can.left_basic and so on with the VSC'
    NO_REMOTE_STATUS = 'compare can.remote_status with the VSC'

    ids: CanIds = field(default_factory=CanIds)
    heartbeat_rate: float = 10.0

    @property
    def most_heartbeats(self) -> float:
        """How many one VSC sends in a second."""
        return self.heartbeat_rate

    @property
    def filters(self) -> list[tuple[int, int]]:
        """Identifier and mask of every frame that this wire wants to be given."""
        return [(self.ids.by_name[name], 0x1FFFFFFF) for name in FROM_VSC]

    def check(self, message: Message) -> None:
        """Let pass what fits: 18 characters, and no key 85 (table 42)."""
        super().check(message)
        size = SEGMENTS * SEGMENT_SIZE
        if isinstance(message, UserFeedbackName) and len(message.name) > size:
            raise ValueError(f'transport can carries {size} characters at most: {message.name!r}')
        if isinstance(message, UserFeedback) and message.key == Key.USER_ESTOP_TIMEOUT:
            raise ValueError(f'transport can has no key {message.key}')

    def decoder(self, timeout: float) -> Decoder[Any, Received]:
        """Return what puts joystick frames together."""
        return CanDecoder(self.ids, timeout)

    def frames(self, message: Message) -> list[Frame]:
        """Return one frame, or the three of a string."""
        if isinstance(message, UserFeedbackName):
            return [encode_frame('feedback_string', s, self.ids) for s in segments_of(message)]
        assert isinstance(message, UserFeedback)
        return [encode_frame('feedback_value', message, self.ids)]


@dataclass(frozen=True)
class HidWire(Wire):
    """USB HID of the VSC: one report at a time, and nothing to send."""

    NAME = 'hid'
    PERIODS = {}
    INTERVAL = 0.0625
    SIGN_OF_LIFE = 'report from the VSC'
    SILENCE = "check the VSC's power and USB cable, and that port is its hidraw device"
    NO_REMOTE_STATUS = 'take another transport for it'
    GARBLED = 'check that port is the hidraw device of the VSC, as reports of another come'
    DAMAGED = 'check that port is the hidraw device of the VSC'

    def decoder(self, timeout: float) -> Decoder[Any, Received]:
        """Return what reads a report."""
        del timeout
        return HidDecoder()
