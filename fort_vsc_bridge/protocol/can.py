# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
CAN-J1939 protocol of the VSC: manual section 8. Extended frames, multi-byte values little-endian.

The identifiers are table 34's; the maker's tool can change them. No address is ever claimed.

==========  ========  ================  ====  ====================================================
identifier  from VSC  message           size  data
==========  ========  ================  ====  ====================================================
0CFDD633    ~16 Hz    left_basic        8     X word, Y word, FF, buttons, FF, FF
0CFDD733    ~16 Hz    left_extended     8     Z word, six FF
0CFDD834    ~16 Hz    right_basic       8     as left_basic
0CFDD934    ~16 Hz    right_extended    8     as left_extended
0CFDE801    10 Hz     heartbeat         6     mode, autonomy mode, E-stop indication (uint32)
0CFDE861    1 Hz      remote_status     8     battery %, charging, strength at VSC, at SRC, 4 spare
0CFDE900    to VSC    feedback_value    5     key 0-99, value (int32)
0CFDEA00    to VSC    feedback_string   8     key 0-99, segment 0-2, 6 characters
==========  ========  ================  ====  ====================================================

Words and buttons are those of the packet protocol (8.3, 8.4). The bytes that are FF tell the VSC's
joystick frames from those of others: 0CFDD633 is also what an Akron joystick at address 33 sends.
Frames that are zero throughout pass too: unless Operational the VSC zeroes all values (6.1), and
the manual does not say whether those bytes are values. Longer data than the size is taken without
its end: on J1939 many senders fill up to 8 bytes.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
import struct
from typing import Any

from bridge_core.framing import Decoder, FrameError
from bridge_core.j1939 import CanFrame
from bridge_core.numerals import check_range
from fort_vsc_bridge.protocol.frames import Message, Received, Rejected
from fort_vsc_bridge.protocol.messages import (
    Heartbeat,
    Joystick,
    RemoteStatus,
    UserFeedback,
    UserFeedbackName,
)
from fort_vsc_bridge.protocol.values import (
    AXES,
    Axis,
    Button,
    InputState,
    Mode,
    pack_pad,
    PADS,
)

SEGMENTS = 3  # of a string (8.2.8)
SEGMENT_SIZE = 6  # characters
MAX_IDENTIFIER = 0x1FFFFFFF

_FOREIGN = (
    'take the other sender of can.{name} (0x{identifier:08X}) off this bus, an Akron joystick or '
    "node? Or change the VSC's identifiers: its frames are refused"
)
_BASIC = struct.Struct('<2H2BH')  # X, Y; not used, buttons, not used
_EXTENDED = struct.Struct('<H6s')  # Z; not used
_SEGMENT = struct.Struct(f'<2B{SEGMENT_SIZE}s')  # key, segment, characters padded with zero
_UNUSED = 0xFF
_ALL_UNUSED = b'\xff' * 6
assert (_BASIC.size, _EXTENDED.size, _SEGMENT.size) == (8, 8, 8)


class ForeignFrameError(FrameError):
    """A joystick frame is not the VSC's: bytes that the VSC always sends as FF are not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CanIds:
    """
    The identifiers of the eight messages, 29 bits each.

    :raises ValueError: for more bits, or one identifier for two messages.
    """

    left_basic: int = 0x0CFDD633
    left_extended: int = 0x0CFDD733
    right_basic: int = 0x0CFDD834
    right_extended: int = 0x0CFDD934
    heartbeat: int = 0x0CFDE801
    remote_status: int = 0x0CFDE861
    feedback_value: int = 0x0CFDE900
    feedback_string: int = 0x0CFDEA00

    def __post_init__(self) -> None:
        names: dict[int, str] = {}
        for name, identifier in self.by_name.items():
            check_range(name, identifier, 0, MAX_IDENTIFIER)
            if identifier in names:
                other = names[identifier]
                raise ValueError(f'{name} must not be that of {other}: 0x{identifier:08X}')
            names[identifier] = name

    @property
    def by_name(self) -> dict[str, int]:
        """Every message's name and identifier."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


FROM_VSC = (
    *('left_basic', 'left_extended', 'right_basic', 'right_extended'),
    *('heartbeat', 'remote_status'),
)


@dataclass(frozen=True, slots=True)
class BasicJoystick:
    """One side's thumb stick and pad (8.2.1, 8.2.3). :param buttons: down, right, up, left."""

    x: Axis
    y: Axis
    buttons: tuple[Button, ...]

    @classmethod
    def from_payload(cls, data: bytes) -> BasicJoystick:
        """Read 8 bytes of data. :raises ForeignFrameError: they are not the VSC's."""
        x, y, unused, pad, spare = _BASIC.unpack(data)
        if spare << 8 | unused != 0xFFFFFF and any(data):
            raise ForeignFrameError
        return cls(AXES[x], AXES[y], PADS[pad])

    def to_payload(self) -> bytes:
        """Return 8 bytes of data."""
        words = (self.x.to_word(), self.y.to_word())
        return _BASIC.pack(*words, _UNUSED, pack_pad(self.buttons), 0xFFFF)


@dataclass(frozen=True, slots=True)
class ExtendedJoystick:
    """One side's finger stick (8.2.2, 8.2.4)."""

    z: Axis

    @classmethod
    def from_payload(cls, data: bytes) -> ExtendedJoystick:
        """Read 8 bytes of data. :raises ForeignFrameError: they are not the VSC's."""
        z, unused = _EXTENDED.unpack(data)
        if unused != _ALL_UNUSED and any(data):
            raise ForeignFrameError
        return cls(AXES[z])

    def to_payload(self) -> bytes:
        """Return 8 bytes of data."""
        return _EXTENDED.pack(self.z.to_word(), _ALL_UNUSED)


@dataclass(frozen=True, slots=True)
class StringSegment:
    """
    A third of a name or a line of text (8.2.8).

    :param key: 0-99. :param segment: 0-2. :param text: up to 6 printable ASCII characters.
    """

    key: int
    segment: int
    text: str

    def __post_init__(self) -> None:
        check_range('a feedback key', self.key, 0, 99)
        check_range('a segment', self.segment, 0, SEGMENTS - 1)
        sound = self.text.isascii() and self.text.isprintable()
        if not sound or len(self.text) > SEGMENT_SIZE:
            raise ValueError(f'not up to {SEGMENT_SIZE} printable characters: {self.text!r}')

    @classmethod
    def from_payload(cls, data: bytes) -> StringSegment:
        """Read 8 bytes of data. :raises ValueError: key, segment or characters that cannot be."""
        key, segment, text = _SEGMENT.unpack(data)
        return cls(key, segment, text.rstrip(b'\x00').decode('ascii'))

    def to_payload(self) -> bytes:
        """Return 8 bytes of data."""
        return _SEGMENT.pack(self.key, self.segment, self.text.encode('ascii'))


CanMessage = (
    BasicJoystick | ExtendedJoystick | Heartbeat | RemoteStatus | UserFeedback | StringSegment
)
# By name: what reads it, bytes of payload, bytes of data; the spare ones between are zero.
_LAYOUTS: dict[str, tuple[Any, int, int]] = {
    'left_basic': (BasicJoystick, 8, 8),
    'left_extended': (ExtendedJoystick, 8, 8),
    'right_basic': (BasicJoystick, 8, 8),
    'right_extended': (ExtendedJoystick, 8, 8),
    'heartbeat': (Heartbeat, 6, 6),
    'remote_status': (RemoteStatus, 6, 8),
    'feedback_value': (UserFeedback, 5, 5),
    'feedback_string': (StringSegment, 8, 8),
}


def decode_data(name: str, data: bytes) -> CanMessage:
    """Read the data of the message of this name. :raises FrameError: too short, or unsound."""
    kind, payload_size, size = _LAYOUTS[name]
    if len(data) < size:
        raise FrameError(f'{name} has {size} bytes, not {len(data)}')
    try:
        message: CanMessage = kind.from_payload(data[:payload_size])
    except ForeignFrameError:
        raise
    except ValueError as error:
        raise FrameError(f'{name}: {error}') from error
    return message


def encode_frame(name: str, message: CanMessage, ids: CanIds) -> CanFrame:
    """Return the frame that carries this message under this name."""
    _, _, size = _LAYOUTS[name]
    return CanFrame(ids.by_name[name], message.to_payload().ljust(size, b'\x00'))


def segments_of(message: UserFeedbackName) -> list[StringSegment]:
    """Return a string as the three segments that the VSC puts together, in order."""
    return [
        StringSegment(message.key, number, message.name[start : start + SEGMENT_SIZE])
        for number, start in enumerate(range(0, SEGMENTS * SEGMENT_SIZE, SEGMENT_SIZE))
    ]


class CanDecoder(Decoder[CanFrame, Received]):
    """
    Takes one frame at a time; a joystick frame gives all sticks as known by then.

    :param timeout: seconds after which one of the four joystick frames counts as missing while
        others come: its controls are not available then.
    """

    def __init__(self, ids: CanIds, timeout: float) -> None:
        super().__init__()
        self._names = {ids.by_name[name]: name for name in FROM_VSC}
        self._sticks = _Sticks(timeout)
        self._operational = False

    def reset(self) -> None:
        """Forget the sticks, and the mode."""
        self._sticks.forget_frames()
        self._operational = False

    def feed(self, data: CanFrame, now: float) -> list[Received]:
        """Return the message in a frame."""
        self.counters.frames += 1
        self.counters.bytes += len(data.data)
        name = self._names.get(data.identifier)
        if name is None:
            self.counters.unknown_types += 1
            return []
        try:
            message = decode_data(name, data.data)
        except ForeignFrameError:
            self.counters.malformed += 1
            return [Rejected(_FOREIGN.format(name=name, identifier=data.identifier))]
        except FrameError:
            self.counters.malformed += 1
            return []
        if isinstance(message, BasicJoystick | ExtendedJoystick):
            zeroed = not any(data.data[place] for place in _VALUES[type(message)])
            return self._sticks.put_together(name, message, now, zeroed=zeroed)
        assert isinstance(message, Message)  # a StringSegment is not among FROM_VSC
        if isinstance(message, Heartbeat):
            was, self._operational = self._operational, message.mode == Mode.OPERATIONAL
            if self._operational and not was:  # no frame of before a stop counts behind it
                self._sticks.forget_frames()
        return [message]


_VALUES = {BasicJoystick: (0, 1, 2, 3, 5), ExtendedJoystick: (0, 1)}  # bytes that are not FF
_NO_AXIS = Axis(None, InputState.UNAVAILABLE)
_NO_PAD = (Button(None, InputState.UNAVAILABLE),) * 4
_MISSING: dict[str, Any] = {
    'left_basic': BasicJoystick(_NO_AXIS, _NO_AXIS, _NO_PAD),
    'left_extended': ExtendedJoystick(_NO_AXIS),
    'right_basic': BasicJoystick(_NO_AXIS, _NO_AXIS, _NO_PAD),
    'right_extended': ExtendedJoystick(_NO_AXIS),
}
_BROKEN = Axis(None, InputState.ERROR)
# Zeros are not the remote's: they let go of no button.
_ZEROED = BasicJoystick(_BROKEN, _BROKEN, (Button(None, InputState.ERROR),) * 4)


class _Sticks:
    """
    Puts the four joystick frames of CAN together.

    Every frame counts at once, with the newest of the others. One that does not come any more is
    not at its last position: it is not available. Four that are zero are neutral, as on serial;
    one among others is broken throughout. That is how a pause begins and ends, for a while.
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._heard: dict[str, tuple[float, BasicJoystick | ExtendedJoystick, bool]] = {}
        self._since = 0.0  # when the first frame came after a silence
        self._alike_at = 0.0  # when all were zero last, or none

    def forget_frames(self) -> None:
        self._heard.clear()

    def put_together(
        self, name: str, message: BasicJoystick | ExtendedJoystick, now: float, *, zeroed: bool
    ) -> list[Received]:
        """Return all sticks; nothing while the others still have time to come."""
        self._heard = {
            part: heard
            for part, heard in self._heard.items()
            if 0.0 <= now - heard[0] < self._timeout
        }
        if not self._heard:
            self._since = now
        if zeroed and isinstance(message, BasicJoystick):
            message = _ZEROED
        self._heard[name] = (now, message, zeroed)
        zeros = {part[2] for part in self._heard.values()}
        if len(zeros) == 1:
            self._alike_at = now
        whole = len(self._heard) == len(_MISSING)
        if not whole and now - self._since < self._timeout:
            return []
        if whole and zeros == {True}:
            return [Joystick(zeroed=True)]
        parts = {**_MISSING, **{part: heard[1] for part, heard in self._heard.items()}}
        left, right = parts['left_basic'], parts['right_basic']
        axes = (
            *(left.x, left.y, parts['left_extended'].z),
            *(right.x, right.y, parts['right_extended'].z),
        )
        pausing = len(zeros) > 1 and now - self._alike_at < self._timeout
        return [Joystick(axes, left.buttons + right.buttons, pausing=pausing)]
