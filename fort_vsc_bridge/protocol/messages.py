# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The messages, one class each: manual section 7.3."""

from __future__ import annotations

from dataclasses import dataclass
import reprlib
import struct
from typing import Any

from bridge_core.framing import draft_of, StreamParser, Unknown
from fort_vsc_bridge.protocol.frames import MAX_LENGTH, Message, MessageType, PACKETS
from fort_vsc_bridge.protocol.values import (
    AUTONOMY_MODES,
    AutonomyMode,
    AXES,
    Axis,
    AXIS_NAMES,
    Button,
    BUTTON_NAMES,
    check_range,
    INT32,
    Mode,
    MODES,
    pack_pad,
    PADS,
)

_UNKNOWN_BATTERY = 0xFF  # not in the manual's 0 to 100
NAME_SIZE = 20  # characters of a name or a line of text (7.3.9)

_JOYSTICK = struct.Struct('<6H2B')  # axis words; left pad, right pad
_HEARTBEAT = struct.Struct('<BBI')  # mode, autonomy mode, E-stop indication
_REMOTE_STATUS = struct.Struct('<4B2s')  # battery %, charging, strength VSC, SRC, reserved
_MESSAGE_CONTROL = struct.Struct('<B?H')  # message type, enabled, interval in ms
_FEEDBACK = struct.Struct('<Bi')  # key, value
_NAME = struct.Struct(f'<B{NAME_SIZE}s')  # key, characters padded with zero
assert (_JOYSTICK.size, _HEARTBEAT.size, _REMOTE_STATUS.size) == (14, 6, 6)
_ZEROS = bytes(_JOYSTICK.size)
assert (_MESSAGE_CONTROL.size, _FEEDBACK.size, _NAME.size) == (4, 5, 21)


@dataclass(frozen=True, slots=True)
class Joystick(Message):
    """
    Sticks and buttons of the SRC (7.3.1, 7.4, 7.5), 50 Hz; zeroed unless Operational.

    A payload of zeros is neutral, but no remote's: a stick at rest says so (table 31). In
    Operational it comes where no SRC is paired (6.5).

    :param axes: 6, in the order of AXIS_NAMES. :param buttons: 8, in the order of BUTTON_NAMES.
    :param zeroed: a payload of zeros, whatever axes and buttons are.
    :param pausing: on CAN, some frames are of zeros and others not yet; their controls are broken.
    """

    TYPE = MessageType.JOYSTICK
    axes: tuple[Axis, ...] = (Axis(0),) * len(AXIS_NAMES)
    buttons: tuple[Button, ...] = (Button(False),) * len(BUTTON_NAMES)
    zeroed: bool = False
    pausing: bool = False

    def __post_init__(self) -> None:
        if len(self.axes) != 6 or len(self.buttons) != 8:
            count = f'{len(self.axes)} and {len(self.buttons)}'
            raise ValueError(f'a joystick message has 6 axes and 8 buttons, not {count}')

    @classmethod
    def from_payload(cls, payload: bytes) -> Any:
        """Read a payload of this type's length, all of which are sound."""
        if payload == _ZEROS:
            return cls(zeroed=True)
        left_x, left_y, left_z, right_x, right_y, right_z, left, right = _JOYSTICK.unpack(payload)
        message = _DraftJoystick()
        message.axes = (
            *(AXES[left_x], AXES[left_y], AXES[left_z]),
            *(AXES[right_x], AXES[right_y], AXES[right_z]),
        )
        message.buttons = PADS[left] + PADS[right]
        message.zeroed = message.pausing = False
        message.__class__ = cls
        return message

    def _to_payload(self) -> bytes:
        if self.zeroed:
            return _ZEROS
        words = (axis.to_word() for axis in self.axes)
        return _JOYSTICK.pack(*words, pack_pad(self.buttons[:4]), pack_pad(self.buttons[4:]))


@dataclass(frozen=True, slots=True)
class Gps(Message):
    """
    Position of the SRC (type 0x12), about 1 Hz; the payload is as seen on devices.

    :param source: 0-255, meaning not published. :param sentence: NMEA 0183 in ASCII, as it came.
    """

    TYPE = MessageType.GPS
    source: int
    sentence: str

    def __post_init__(self) -> None:
        check_range('the GPS source', self.source, 0, 255)
        if not self.sentence.isascii() or len(self.sentence) >= MAX_LENGTH:
            raise ValueError(f'not an ASCII sentence below {MAX_LENGTH} bytes: {self.sentence!r}')

    @classmethod
    def _from_payload(cls, payload: bytes) -> Gps:
        return cls(payload[0], payload[1:].decode('ascii'))

    def _to_payload(self) -> bytes:
        return bytes((self.source,)) + self.sentence.encode('ascii')


@dataclass(frozen=True, slots=True)
class Heartbeat(Message):
    """
    State of the VSC (7.3.2), 20 Hz. An unknown mode stays a plain int, equal to no known mode.

    :param autonomy: None where the wire does not tell it (HID); there is no frame for that.
    :param estop: E-stop indication, 32 bits; 0 = OK, see EStopBits and estop_sources.
    """

    TYPE = MessageType.HEARTBEAT
    mode: Mode | int
    autonomy: AutonomyMode | int | None
    estop: int

    def __post_init__(self) -> None:
        check_range('the mode', self.mode, 0, 255)
        if self.autonomy is not None:
            check_range('the autonomy mode', self.autonomy, 0, 255)
        check_range('the E-stop indication', self.estop, 0, 0xFFFFFFFF)

    @classmethod
    def from_payload(cls, payload: bytes) -> Any:
        """Read a payload of this type's length, all of which are sound."""
        mode, autonomy, estop = _HEARTBEAT.unpack(payload)
        message = _DraftHeartbeat()
        message.mode = MODES.get(mode, mode)
        message.autonomy = AUTONOMY_MODES.get(autonomy, autonomy)
        message.estop = estop
        message.__class__ = cls
        return message

    def _to_payload(self) -> bytes:
        return _HEARTBEAT.pack(self.mode, self.autonomy, self.estop)


@dataclass(frozen=True, slots=True)
class HostHeartbeat(Message):
    """Sign of life of the host (7.3.4), 20 Hz; ``estop`` asks for a stop. Not safety rated."""

    TYPE = MessageType.HOST_HEARTBEAT
    estop: bool

    @classmethod
    def _from_payload(cls, payload: bytes) -> HostHeartbeat:
        return cls(payload[0] > 0)

    def _to_payload(self) -> bytes:
        return bytes((bool(self.estop),))


@dataclass(frozen=True, slots=True)
class RemoteStatus(Message):
    """
    Battery and radio of the SRC (7.3.3), off by default.

    Kept by the VSC after the remote is lost: believe it only while the heartbeat's mode says that
    one is connected.

    :param battery_percent: 0-100; None: not known, 255 on the wire. :param strength_vsc: radio as
        perceived by the VSC, 0 low to 2 high. :param strength_src: by the SRC; reserved, and the
        same as yet. :param reserved: 2 bytes raw (RSSI on some firmware).
    """

    TYPE = MessageType.REMOTE_STATUS
    battery_percent: int | None
    charging: bool
    strength_vsc: int
    strength_src: int
    reserved: bytes = b'\x00\x00'

    def __post_init__(self) -> None:
        if self.battery_percent is not None:
            check_range('the battery level', self.battery_percent, 0, 100)
        check_range('the strength at the VSC', self.strength_vsc, 0, 255)
        check_range('the strength at the SRC', self.strength_src, 0, 255)
        if len(self.reserved) != 2:
            raise ValueError(f'need 2 reserved bytes, not {len(self.reserved)}')

    @classmethod
    def _from_payload(cls, payload: bytes) -> RemoteStatus:
        battery, charging, vsc, src, reserved = _REMOTE_STATUS.unpack(payload)
        level = None if battery == _UNKNOWN_BATTERY else battery
        return cls(level, charging > 0, vsc, src, reserved)

    def _to_payload(self) -> bytes:
        battery = _UNKNOWN_BATTERY if self.battery_percent is None else self.battery_percent
        strengths = (self.strength_vsc, self.strength_src)
        return _REMOTE_STATUS.pack(battery, self.charging, *strengths, self.reserved)


@dataclass(frozen=True, slots=True)
class MessageControl(Message):
    """
    Which message the VSC sends, and how often (7.3.5). Kept in EEPROM: never send it idly.

    :param message: type to modify, 0-255. :param interval_ms: 20-65535.
    """

    TYPE = MessageType.MESSAGE_CONTROL
    message: int
    enabled: bool
    interval_ms: int

    def __post_init__(self) -> None:
        check_range('the message type', self.message, 0, 255)
        check_range('the interval (ms)', self.interval_ms, 20, 0xFFFF)

    @classmethod
    def _from_payload(cls, payload: bytes) -> MessageControl:
        return cls(*_MESSAGE_CONTROL.unpack(payload))

    def _to_payload(self) -> bytes:
        return _MESSAGE_CONTROL.pack(self.message, self.enabled, self.interval_ms)


@dataclass(frozen=True, slots=True)
class UserFeedback(Message):
    """A key's value (7.3.6 to the VSC, 7.3.8 from it). :param key: 0-99. :param value: int32."""

    TYPE = MessageType.USER_FEEDBACK
    key: int
    value: int

    def __post_init__(self) -> None:
        check_range('a feedback key', self.key, 0, 99)
        check_range('a feedback value', self.value, *INT32)

    @classmethod
    def _from_payload(cls, payload: bytes) -> UserFeedback:
        return cls(*_FEEDBACK.unpack(payload))

    def _to_payload(self) -> bytes:
        return _FEEDBACK.pack(self.key, self.value)


@dataclass(frozen=True, slots=True)
class UserFeedbackName(Message):
    """
    The name of a user value, or a line of text (7.3.9; the checksum is at offset 25, not 7).

    :param key: 0-99. :param name: up to 20 printable ASCII characters.
    """

    TYPE = MessageType.USER_FEEDBACK_NAME
    key: int
    name: str

    def __post_init__(self) -> None:
        check_range('a feedback key', self.key, 0, 99)
        if len(self.name) > NAME_SIZE:
            raise ValueError(
                f'a name has at most {NAME_SIZE} characters: {reprlib.repr(self.name)}'
            )
        if not (self.name.isascii() and self.name.isprintable()):
            raise ValueError(
                f'a name has printable ASCII characters only: {reprlib.repr(self.name)}'
            )

    @classmethod
    def _from_payload(cls, payload: bytes) -> UserFeedbackName:
        key, name = _NAME.unpack(payload)
        return cls(key, name.rstrip(b'\x00').decode('ascii'))

    def _to_payload(self) -> bytes:
        return _NAME.pack(self.key, self.name.encode('ascii'))


@dataclass(frozen=True, slots=True)
class UserFeedbackGet(Message):
    """Ask for a key's value (7.3.7); the answer is a UserFeedback. :param key: 0-99."""

    TYPE = MessageType.USER_FEEDBACK_GET
    key: int

    def __post_init__(self) -> None:
        check_range('a feedback key', self.key, 0, 99)

    @classmethod
    def _from_payload(cls, payload: bytes) -> UserFeedbackGet:
        return cls(payload[0])

    def _to_payload(self) -> bytes:
        return bytes((self.key,))


@dataclass(frozen=True, slots=True)
class SetupString(Message):
    """A text of the VSC's setup, not in the manual. :param key: 0-255. :param text: as it came."""

    TYPE = MessageType.SETUP_STRING
    key: int
    text: bytes

    @classmethod
    def _from_payload(cls, payload: bytes) -> SetupString:
        return cls(payload[0], payload[1:])

    def _to_payload(self) -> bytes:
        return bytes((self.key,)) + self.text


@dataclass(frozen=True, slots=True)
class SetupStringGet(Message):
    """Ask for a text of the setup, not in the manual; the VSC has to be unlocked."""

    TYPE = MessageType.SETUP_STRING_GET
    key: int

    def __post_init__(self) -> None:
        check_range('a setup key', self.key, 0, 255)

    @classmethod
    def _from_payload(cls, payload: bytes) -> SetupStringGet:
        return cls(payload[0])

    def _to_payload(self) -> bytes:
        return bytes((self.key,))


@dataclass(frozen=True, slots=True)
class SetupUnlock(Message):
    """Open the setup to questions, not in the manual."""

    TYPE = MessageType.SETUP_UNLOCK
    code: int = 0xDEC0

    def __post_init__(self) -> None:
        check_range('the code', self.code, 0, 0xFFFF)

    @classmethod
    def _from_payload(cls, payload: bytes) -> SetupUnlock:
        return cls(int.from_bytes(payload, 'little'))

    def _to_payload(self) -> bytes:
        return self.code.to_bytes(2, 'little')


_DraftJoystick = draft_of(Joystick)
_DraftHeartbeat = draft_of(Heartbeat)
MESSAGES: dict[int, type[Message]] = {
    kind.TYPE: kind
    for kind in (
        Joystick,
        Gps,
        Heartbeat,
        HostHeartbeat,
        RemoteStatus,
        MessageControl,
        UserFeedback,
        UserFeedbackName,
        UserFeedbackGet,
        SetupString,
        SetupStringGet,
        SetupUnlock,
    )
}


def decode(frame: bytes) -> Message | Unknown:
    """Read a whole frame of any type. :raises FrameError: if its frame or contents are unsound."""
    payload = PACKETS.payload_of(frame)
    return _decode(frame[2], payload)


def parser() -> StreamParser[Message]:
    """Return a parser for one direction of one link."""
    return PACKETS.parser(_decode, {kind: of.from_payload for kind, of in MESSAGES.items()})


def _decode(kind: int, payload: bytes) -> Message | Unknown:
    message = MESSAGES.get(kind)
    return Unknown(kind) if message is None else message.from_payload(payload)
