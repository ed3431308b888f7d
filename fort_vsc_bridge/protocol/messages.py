# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The messages, one class each: manual section 7.3."""

from __future__ import annotations

from dataclasses import dataclass
import re
import reprlib
import struct

from bridge_core.framing import StreamParser, Unknown
from bridge_core.numerals import check_range
from bridge_core.packets import decode_by
from fort_vsc_bridge.protocol.frames import Message, MessageType, PACKETS
from fort_vsc_bridge.protocol.values import (
    AUTONOMY_MODES,
    AutonomyMode,
    AXES,
    Axis,
    AXIS_NAMES,
    Button,
    BUTTON_NAMES,
    INT32,
    Mode,
    MODES,
    pack_pad,
    PADS,
    TEXT_KEYS,
)

_UNKNOWN_BATTERY = 0xFF  # not in the manual's 0 to 100
NAME_SIZE = 20  # characters of a name or a line of text (7.3.9)


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
    LAYOUT = struct.Struct('<6H2B')  # axis words; left pad, right pad
    axes: tuple[Axis, ...] = (Axis(0),) * len(AXIS_NAMES)
    buttons: tuple[Button, ...] = (Button(False),) * len(BUTTON_NAMES)
    zeroed: bool = False
    pausing: bool = False

    @classmethod
    def _from_payload(cls, payload: bytes) -> Joystick:
        if not any(payload):
            return cls(zeroed=True)
        *words, left, right = cls.LAYOUT.unpack(payload)
        return cls(tuple(AXES[word] for word in words), PADS[left] + PADS[right])

    def _to_payload(self) -> bytes:
        if self.zeroed:
            return bytes(self.LAYOUT.size)
        words = (axis.to_word() for axis in self.axes)
        return self.LAYOUT.pack(*words, pack_pad(self.buttons[:4]), pack_pad(self.buttons[4:]))


@dataclass(frozen=True, slots=True)
class Gps(Message):
    """
    Position of the SRC (type 0x12), about 1 Hz; the payload is as seen on devices.

    :param source: 0-255, meaning not published. :param sentence: NMEA 0183 in ASCII, as it came.
    """

    TYPE = MessageType.GPS
    source: int
    sentence: str

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
    LAYOUT = struct.Struct('<BBI')  # mode, autonomy mode, E-stop indication
    mode: Mode | int
    autonomy: AutonomyMode | int | None
    estop: int

    @classmethod
    def _from_payload(cls, payload: bytes) -> Heartbeat:
        mode, autonomy, estop = cls.LAYOUT.unpack(payload)
        return cls(MODES.get(mode, mode), AUTONOMY_MODES.get(autonomy, autonomy), estop)


@dataclass(frozen=True, slots=True)
class HostHeartbeat(Message):
    """Sign of life of the host (7.3.4), 20 Hz; ``estop`` asks for a stop. Not safety rated."""

    TYPE = MessageType.HOST_HEARTBEAT
    LAYOUT = struct.Struct('<?')
    estop: bool


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
    LAYOUT = struct.Struct('<B?2B2s')  # battery %, charging, strength VSC, SRC, reserved
    battery_percent: int | None
    charging: bool
    strength_vsc: int
    strength_src: int
    reserved: bytes = b'\x00\x00'

    def __post_init__(self) -> None:
        if self.battery_percent is not None:
            check_range('the battery level', self.battery_percent, 0, 100)

    @classmethod
    def _from_payload(cls, payload: bytes) -> RemoteStatus:
        battery, *rest = cls.LAYOUT.unpack(payload)
        return cls(None if battery == _UNKNOWN_BATTERY else battery, *rest)

    def _to_payload(self) -> bytes:
        battery = _UNKNOWN_BATTERY if self.battery_percent is None else self.battery_percent
        strengths = (self.strength_vsc, self.strength_src)
        return self.LAYOUT.pack(battery, self.charging, *strengths, self.reserved)


@dataclass(frozen=True, slots=True)
class MessageControl(Message):
    """
    Which message the VSC sends, and how often (7.3.5). Kept in EEPROM: never send it idly.

    :param message: type to modify, 0-255. :param interval_ms: 20-65535.
    """

    TYPE = MessageType.MESSAGE_CONTROL
    LAYOUT = struct.Struct('<B?H')  # message type, enabled, interval in ms
    message: int
    enabled: bool
    interval_ms: int

    def __post_init__(self) -> None:
        check_range('the message type', self.message, 0, 255)
        check_range('the interval (ms)', self.interval_ms, 20, 0xFFFF)


@dataclass(frozen=True, slots=True)
class UserFeedback(Message):
    """A key's value (7.3.6 to the VSC, 7.3.8 from it). :param key: 0-99. :param value: int32."""

    TYPE = MessageType.USER_FEEDBACK
    LAYOUT = struct.Struct('<Bi')
    key: int
    value: int

    def __post_init__(self) -> None:
        check_range('a feedback key', self.key, 0, 99)
        check_range('a feedback value', self.value, *INT32)


@dataclass(frozen=True, slots=True)
class UserFeedbackName(Message):
    """
    The name of a user value, or a line of text (7.3.9; the checksum is at offset 25, not 7).

    :param key: 0-99. :param name: up to 20 printable ASCII characters.
    """

    TYPE = MessageType.USER_FEEDBACK_NAME
    LAYOUT = struct.Struct(f'<B{NAME_SIZE}s')  # key, characters padded with zero
    key: int
    name: str

    def __post_init__(self) -> None:
        check_range('a feedback key', self.key, 0, 99)
        cited = reprlib.repr(self.name)
        if len(self.name) > NAME_SIZE:
            raise ValueError(f'a name has at most {NAME_SIZE} characters: {cited}')
        if not (self.name.isascii() and self.name.isprintable()):
            raise ValueError(f'a name has printable ASCII characters only: {cited}')

    @classmethod
    def _from_payload(cls, payload: bytes) -> UserFeedbackName:
        key, name = cls.LAYOUT.unpack(payload)
        return cls(key, name.rstrip(b'\x00').decode('ascii'))

    def _to_payload(self) -> bytes:
        return self.LAYOUT.pack(self.key, self.name.encode('ascii'))


def text_lines(text: str) -> list[UserFeedbackName]:
    """Return the four lines of the display. :raises ValueError: too many, or one is unsound."""
    lines = re.split('\r\n|\r|\n', text)
    if not lines[-1]:
        del lines[-1]  # a line's end is none between two
    if len(lines) > len(TEXT_KEYS):
        raise ValueError(f'the display has {len(TEXT_KEYS)} lines, not {len(lines)}')
    lines += [''] * (len(TEXT_KEYS) - len(lines))
    return [UserFeedbackName(key, line) for key, line in zip(TEXT_KEYS, lines, strict=True)]


@dataclass(frozen=True, slots=True)
class UserFeedbackGet(Message):
    """Ask for a key's value (7.3.7); the answer is a UserFeedback. :param key: 0-99."""

    TYPE = MessageType.USER_FEEDBACK_GET
    LAYOUT = struct.Struct('<B')
    key: int

    def __post_init__(self) -> None:
        check_range('a feedback key', self.key, 0, 99)


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
    LAYOUT = struct.Struct('<B')
    key: int


@dataclass(frozen=True, slots=True)
class SetupUnlock(Message):
    """Open the setup to questions, not in the manual."""

    TYPE = MessageType.SETUP_UNLOCK
    LAYOUT = struct.Struct('<H')
    code: int = 0xDEC0


_ALL: tuple[type[Message], ...] = (
    *(Joystick, Gps, Heartbeat, HostHeartbeat, RemoteStatus, MessageControl, UserFeedback),
    *(UserFeedbackName, UserFeedbackGet, SetupString, SetupStringGet, SetupUnlock),
)
MESSAGES: dict[int, type[Message]] = {kind.TYPE: kind for kind in _ALL}
assert all(of.LAYOUT.size in PACKETS.lengths[of.TYPE] for of in _ALL if hasattr(of, 'LAYOUT'))


decode_payload = decode_by(MESSAGES)


def decode(frame: bytes) -> Message | Unknown:
    """Read a whole frame of any type. :raises FrameError: if its frame or contents are unsound."""
    payload = PACKETS.payload_of(frame)
    return decode_payload(frame[2], payload)


def parser() -> StreamParser[Message]:
    """Return a parser for one direction of one link."""
    return PACKETS.parser(decode_payload)
