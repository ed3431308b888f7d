"""
The three ways to join a VSC: packet protocol (7), CAN (8) and HID (9).

A wire turns what was received into messages, and messages into what is sent. What they mean is
the same on all of them, and the session's business.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any
from typing import ClassVar

from bridge_core.framing import Counters
from bridge_core.framing import FrameError
from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.protocol.can import BasicJoystick
from fort_vsc_bridge.protocol.can import CanIds
from fort_vsc_bridge.protocol.can import decode_data
from fort_vsc_bridge.protocol.can import encode_frame
from fort_vsc_bridge.protocol.can import ExtendedJoystick
from fort_vsc_bridge.protocol.can import FROM_VSC
from fort_vsc_bridge.protocol.can import SEGMENT_SIZE
from fort_vsc_bridge.protocol.can import SEGMENTS
from fort_vsc_bridge.protocol.can import segments_of
from fort_vsc_bridge.protocol.frames import Message
from fort_vsc_bridge.protocol.frames import MessageType
from fort_vsc_bridge.protocol.frames import parser
from fort_vsc_bridge.protocol.hid import InputReport
from fort_vsc_bridge.protocol.messages import decode
from fort_vsc_bridge.protocol.messages import Heartbeat
from fort_vsc_bridge.protocol.messages import Joystick
from fort_vsc_bridge.protocol.messages import Unknown
from fort_vsc_bridge.protocol.messages import UserFeedback
from fort_vsc_bridge.protocol.messages import UserFeedbackName
from fort_vsc_bridge.protocol.values import Axis
from fort_vsc_bridge.protocol.values import Button
from fort_vsc_bridge.protocol.values import InputState
from fort_vsc_bridge.protocol.values import Key
from fort_vsc_bridge.protocol.values import Mode

_WORDS = {
    MessageType.HOST_HEARTBEAT: 'a software e-stop',
    MessageType.USER_FEEDBACK: 'values, settings or rumble',
    MessageType.USER_FEEDBACK_NAME: 'names or text',
    MessageType.USER_FEEDBACK_GET: 'a question for a value',
    MessageType.MESSAGE_CONTROL: 'a message control',
}


class Wire:
    """
    What differs from wire to wire.

    ``feed`` takes what the transport received at once: bytes or a CAN frame. It raises nothing:
    what is wrong is counted.
    """

    NAME: ClassVar[str]
    # What can be sent, and the seconds between two frames of a type.
    PERIODS: ClassVar[Mapping[MessageType, float]]
    INTERVAL: ClassVar[float]  # seconds between two signs of life of the device, as delivered
    SIGN_OF_LIFE: ClassVar[str]
    # What to do: no sign of life; the same, yet joystick messages come; they do not, but the rest.
    SILENCE: ClassVar[str]
    JOYSTICK_ONLY: ClassVar[str] = ''
    NO_JOYSTICK: ClassVar[str] = ''

    def __init__(self) -> None:
        self.counters = Counters()

    @property
    def deadline(self) -> float:
        """The moment at which poll should be called; infinite while nothing is pending."""
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

    def reset(self) -> None:
        """Forget what was received in part: the port was opened or closed."""

    def feed(self, data: Any, now: float) -> list[Message]:
        """Return the messages that ``data`` completes, in order."""
        raise NotImplementedError

    def poll(self, now: float) -> list[Message]:
        """Return the messages that time completes."""
        del now
        return []

    def frames(self, message: Message) -> list[Any]:
        """Return what carries a message, in the order of sending."""
        raise NotImplementedError


class SerialWire(Wire):
    """The packet protocol over USB or RS232: bytes in any split."""

    NAME = 'serial'
    # Table 17. It gives no rate for message control, which is written to EEPROM: no faster than
    # the others.
    PERIODS = {
        MessageType.HOST_HEARTBEAT: 0.05,
        MessageType.USER_FEEDBACK: 0.05,
        MessageType.USER_FEEDBACK_NAME: 0.25,
        MessageType.USER_FEEDBACK_GET: 0.05,
        MessageType.MESSAGE_CONTROL: 0.25,
    }
    INTERVAL = 0.05
    SIGN_OF_LIFE = 'heartbeat from the VSC'
    SILENCE = 'check its power and the serial cable'
    JOYSTICK_ONLY = 'is its heartbeat message disabled?'
    NO_JOYSTICK = 'set device.joystick_interval_ms to have them sent'

    def __init__(self) -> None:
        super().__init__()
        self._parser = parser()
        self.counters = self._parser.counters

    @property
    def deadline(self) -> float:
        """When a partial frame expires."""
        return self._parser.deadline

    def reset(self) -> None:
        """Forget a partial frame."""
        self._parser.reset()

    def feed(self, data: bytes, now: float) -> list[Message]:
        """Return the messages in whole frames."""
        return self._decode(self._parser.feed(data, now))

    def poll(self, now: float) -> list[Message]:
        """Return what was hidden in a partial frame that has expired."""
        return self._decode(self._parser.poll(now))

    def frames(self, message: Message) -> list[Any]:
        """Return one frame."""
        return [message.to_bytes()]

    def _decode(self, frames: list[bytes]) -> list[Message]:
        messages = []
        for frame in frames:
            try:
                message = decode(frame)
            except FrameError:
                self.counters.malformed += 1
                continue
            if isinstance(message, Unknown):
                self.counters.unknown_types += 1
            else:
                messages.append(message)
        return messages


class CanWire(Wire):
    """
    CAN-J1939: one frame at a time.

    :param ids: identifiers of the messages. :param timeout: seconds after which one of the four
        joystick frames counts as missing while others come: its controls are not available then.
    """

    NAME = 'can'
    PERIODS = {  # table 34; of a string, between two segments
        MessageType.USER_FEEDBACK: 0.1,
        MessageType.USER_FEEDBACK_NAME: 0.1,
    }
    INTERVAL = 0.1
    SIGN_OF_LIFE = 'heartbeat from the VSC'
    SILENCE = 'check its power, the CAN wiring, the bit rate and can.heartbeat'
    JOYSTICK_ONLY = 'is can.heartbeat its identifier?'
    NO_JOYSTICK = 'are can.left_basic and so on their identifiers?'

    def __init__(self, ids: CanIds | None = None, timeout: float = 0.25) -> None:
        super().__init__()
        self.ids = ids or CanIds()
        self._names = {self.ids.by_name[name]: name for name in FROM_VSC}
        self._sticks = _Sticks(timeout)
        self._operational = False

    @property
    def filters(self) -> list[tuple[int, int]]:
        """Identifier and mask of every frame that this wire wants to be given."""
        return [(identifier, 0x1FFFFFFF) for identifier in self._names]

    def check(self, message: Message) -> None:
        """Let pass what fits: 18 characters, and no key 85 (table 42)."""
        super().check(message)
        size = SEGMENTS * SEGMENT_SIZE
        if isinstance(message, UserFeedbackName) and len(message.name) > size:
            raise ValueError(f'transport can carries {size} characters at most: {message.name!r}')
        if isinstance(message, UserFeedback) and message.key == Key.USER_ESTOP_TIMEOUT:
            raise ValueError(f'transport can has no key {message.key}')

    def reset(self) -> None:
        """Forget the sticks."""
        self._sticks.forget()

    def feed(self, data: CanFrame, now: float) -> list[Message]:
        """Return the message in a frame; a joystick frame gives all sticks as known by then."""
        self.counters.frames += 1
        self.counters.bytes += len(data.data)
        name = self._names.get(data.identifier)
        if name is None:
            self.counters.unknown_types += 1
            return []
        try:
            message = decode_data(name, data.data)
        except FrameError:
            self.counters.malformed += 1
            return []
        if isinstance(message, BasicJoystick | ExtendedJoystick):
            return self._sticks.take(name, message, now)
        assert isinstance(message, Message)  # a StringSegment is not among FROM_VSC
        if isinstance(message, Heartbeat):
            self._forget_sticks_of_before(message)
        return [message]

    def _forget_sticks_of_before(self, heartbeat: Heartbeat) -> None:
        """Let no joystick frame of before a stop count once Operational is entered anew."""
        was, self._operational = self._operational, heartbeat.mode == Mode.OPERATIONAL
        if self._operational and not was:
            self._sticks.forget()

    def frames(self, message: Message) -> list[Any]:
        """Return one frame, or the three of a string."""
        if isinstance(message, UserFeedbackName):
            return [encode_frame('feedback_string', s, self.ids) for s in segments_of(message)]
        assert isinstance(message, UserFeedback)
        return [encode_frame('feedback_value', message, self.ids)]


class HidWire(Wire):
    """USB HID: one report at a time, and nothing to send."""

    NAME = 'hid'
    PERIODS = {}
    INTERVAL = 0.0625
    SIGN_OF_LIFE = 'report from the remote'
    SILENCE = 'check its power, its USB cable, and that port is its hidraw device'

    def feed(self, data: bytes, now: float) -> list[Message]:
        """Return what a report means: a heartbeat first, so that sticks go by its state."""
        del now
        self.counters.bytes += len(data)
        try:
            report = InputReport.from_bytes(data)
        except FrameError:
            self.counters.malformed += 1
            return []
        self.counters.frames += 1
        return [report.heartbeat, report.joystick]


_PARTS = ('left_basic', 'left_extended', 'right_basic', 'right_extended')
_NO_AXIS = Axis(None, InputState.UNAVAILABLE)
_NO_BUTTON = Button(None, InputState.UNAVAILABLE)
_NO_BASIC = BasicJoystick(_NO_AXIS, _NO_AXIS, (_NO_BUTTON,) * 4)
_NO_EXTENDED = ExtendedJoystick(_NO_AXIS)


class _Sticks:
    """
    Puts the four joystick frames of CAN together.

    Every frame counts at once, with the newest of the others. One that does not come any more is
    not at its last position: it is not available.
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._heard: dict[str, tuple[float, BasicJoystick | ExtendedJoystick]] = {}
        self._since = 0.0  # when the first frame came after a silence

    def forget(self) -> None:
        self._heard.clear()

    def take(
        self, name: str, message: BasicJoystick | ExtendedJoystick, now: float
    ) -> list[Message]:
        """Return all sticks; nothing while the others still have time to come."""
        self._heard = {
            part: heard
            for part, heard in self._heard.items()
            if 0.0 <= now - heard[0] < self._timeout
        }
        if not self._heard:
            self._since = now
        self._heard[name] = (now, message)
        if len(self._heard) < len(_PARTS) and now - self._since < self._timeout:
            return []
        return [self._joystick()]

    def _joystick(self) -> Joystick:
        left, right = self._part('left_basic', _NO_BASIC), self._part('right_basic', _NO_BASIC)
        left_z = self._part('left_extended', _NO_EXTENDED).z
        right_z = self._part('right_extended', _NO_EXTENDED).z
        axes = (left.x, left.y, left_z, right.x, right.y, right_z)
        return Joystick(axes, left.buttons + right.buttons)

    def _part(self, name: str, missing: Any) -> Any:
        return self._heard[name][1] if name in self._heard else missing
