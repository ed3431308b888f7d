"""Status messages that come unasked, types 01, 81 to 85, A1, FD and FF, and the ASCII pipe FE."""

from __future__ import annotations

from dataclasses import dataclass
import math
import re
import struct

from akron_can_bridge.protocol.flags import FLAG_NAMES
from akron_can_bridge.protocol.flags import Input
from akron_can_bridge.protocol.flags import MiniOutput
from akron_can_bridge.protocol.flags import Output
from akron_can_bridge.protocol.flags import Permission
from akron_can_bridge.protocol.frames import Message
from akron_can_bridge.protocol.frames import MessageType
from akron_can_bridge.protocol.frames import Sendable
from akron_can_bridge.protocol.frames import Writable
from akron_can_bridge.protocol.values import check_range
from akron_can_bridge.protocol.values import HARD_STOP_NAMES
from akron_can_bridge.protocol.values import pack_statuses
from akron_can_bridge.protocol.values import Position
from akron_can_bridge.protocol.values import Status
from akron_can_bridge.protocol.values import unpack_statuses

PERMISSIVE_PERIOD = 0.1  # A1
PERMISSIVE_TIMEOUT = 0.3

_POSITION_LIMIT = struct.Struct('>HH3s')  # rotation, elevation; hard stops, error, calibration
_SOFT_LIMITS = struct.Struct('>hhB')  # low, high in 0.1 degree; oscillation in the top bit
_OUTPUTS = struct.Struct('>H')
_INPUTS = struct.Struct('>B')
_PERMISSIVE = struct.Struct('>xB')  # reserved, permissions
assert (_POSITION_LIMIT.size, _SOFT_LIMITS.size) == (7, 5)
_OSCILLATING = 0x80
_RISER = 0x0300
_RISER_SHIFT = 8
_PIN = re.compile(r'[0-9]{4}[!-~]{2}[0-9]{9}')
_PIN_TOP_BIT = 1 << 29
_OUTPUT_BITS, _MINI_BITS, _INPUT_BITS, _PERMISSION_BITS = (
    sum(FLAG_NAMES[kind]) for kind in (Output, MiniOutput, Input, Permission)
)


@dataclass(frozen=True, slots=True)
class PositionLimit(Writable):
    """
    Type 01, every 100 ms from 6032, 6040 and 6042.

    :param hard_stops: ON where an axis is at its end, in the order of HARD_STOP_NAMES.
    :param operational_error: ON: poll the faults. :param calibration: ON: calibrated.
    """

    TYPE = MessageType.POSITION_LIMIT
    LENGTHS = range(8, 9)
    rotation: Position
    elevation: Position
    hard_stops: tuple[Status, ...]
    operational_error: Status
    calibration: Status

    def __post_init__(self) -> None:
        if len(self.hard_stops) != len(HARD_STOP_NAMES):
            raise ValueError(f'{len(HARD_STOP_NAMES)} hard stops, not {len(self.hard_stops)}')
        pack_statuses((*self.hard_stops, self.operational_error, self.calibration))

    @classmethod
    def _from_payload(cls, payload: bytes) -> PositionLimit:
        rotation, elevation, rest = _POSITION_LIMIT.unpack(payload)
        *stops, error, calibration = unpack_statuses(rest)
        positions = (Position.from_word(rotation), Position.from_word(elevation))
        return cls(*positions, tuple(stops), error, calibration)

    def _to_payload(self) -> bytes:
        rest = pack_statuses((*self.hard_stops, self.operational_error, self.calibration))
        words = (self.rotation.to_word(), self.elevation.to_word())
        return _POSITION_LIMIT.pack(*words, rest.to_bytes(3, 'big'))


def _tenths(what: str, degrees: float) -> int:
    """Return an angle in 0.1 degree. :raises ValueError: it does not fit 16 bits."""
    if not math.isfinite(degrees):
        raise ValueError(f'{what} must be a number of degrees, not {degrees}')
    tenths = round(degrees * 10)
    check_range(f'{what} (0.1 degree)', tenths, -0x8000, 0x7FFF)
    return tenths


@dataclass(frozen=True, slots=True)
class RotationSoftLimits(Writable):
    """Type 81, every 100 ms from a 6032 with position feedback; left is negative."""

    TYPE = MessageType.ROTATION_SOFT_LIMITS
    LENGTHS = range(6, 7)
    left_deg: float
    right_deg: float
    oscillating: bool = False  # then these are the limits of the oscillation

    def __post_init__(self) -> None:
        self._to_payload()

    @classmethod
    def _from_payload(cls, payload: bytes) -> RotationSoftLimits:
        left, right, oscillation = _SOFT_LIMITS.unpack(payload)
        return cls(left / 10, right / 10, bool(oscillation & _OSCILLATING))

    def _to_payload(self) -> bytes:
        limits = (_tenths('the left limit', self.left_deg), _tenths('right', self.right_deg))
        return _SOFT_LIMITS.pack(*limits, _OSCILLATING if self.oscillating else 0)


@dataclass(frozen=True, slots=True)
class ElevationSoftLimits(Writable):
    """Type 82, every 100 ms from a 6032 with position feedback; down is negative."""

    TYPE = MessageType.ELEVATION_SOFT_LIMITS
    LENGTHS = range(6, 7)
    down_deg: float
    up_deg: float

    def __post_init__(self) -> None:
        self._to_payload()

    @classmethod
    def _from_payload(cls, payload: bytes) -> ElevationSoftLimits:
        down, up, _unused = _SOFT_LIMITS.unpack(payload)
        return cls(down / 10, up / 10)

    def _to_payload(self) -> bytes:
        limits = (_tenths('the down limit', self.down_deg), _tenths('up', self.up_deg))
        return _SOFT_LIMITS.pack(*limits, 0)


@dataclass(frozen=True, slots=True)
class DigitalOutputs(Writable):
    """Type 83, every 100 ms. :param riser: electric riser command bits, 0 to 3."""

    TYPE = MessageType.DIGITAL_OUTPUTS
    LENGTHS = range(3, 4)
    outputs: Output
    riser: int = 0

    def __post_init__(self) -> None:
        check_range('the riser command', self.riser, 0, 3)

    @classmethod
    def _from_payload(cls, payload: bytes) -> DigitalOutputs:
        (word,) = _OUTPUTS.unpack(payload)
        return cls(Output(word & _OUTPUT_BITS), (word & _RISER) >> _RISER_SHIFT)

    def _to_payload(self) -> bytes:
        return _OUTPUTS.pack(self.outputs | self.riser << _RISER_SHIFT)


@dataclass(frozen=True, slots=True)
class MiniOutputs(Writable):
    """Type 84, every 100 ms from a 6033 Mini Universal."""

    TYPE = MessageType.MINI_OUTPUTS
    LENGTHS = range(3, 4)
    outputs: MiniOutput

    @classmethod
    def _from_payload(cls, payload: bytes) -> MiniOutputs:
        (word,) = _OUTPUTS.unpack(payload)
        return cls(MiniOutput(word & _MINI_BITS))

    def _to_payload(self) -> bytes:
        return _OUTPUTS.pack(self.outputs)


@dataclass(frozen=True, slots=True)
class DigitalInputs(Writable):
    """Type 85, every 100 ms from a 6039 CAN I/O module."""

    TYPE = MessageType.DIGITAL_INPUTS
    LENGTHS = range(2, 3)
    inputs: Input

    @classmethod
    def _from_payload(cls, payload: bytes) -> DigitalInputs:
        (byte,) = _INPUTS.unpack(payload)
        return cls(Input(byte & _INPUT_BITS))

    def _to_payload(self) -> bytes:
        return _INPUTS.pack(self.inputs)


@dataclass(frozen=True, slots=True)
class SoePermissive(Sendable):
    """Type A1, every 100 ms to a unit in SOE mode, which stops 300 ms after the last one."""

    TYPE = MessageType.SOE_PERMISSIVE
    LENGTHS = range(3, 4)
    permitted: Permission

    @classmethod
    def _from_payload(cls, payload: bytes) -> SoePermissive:
        (byte,) = _PERMISSIVE.unpack(payload)
        return cls(Permission(byte & _PERMISSION_BITS))

    def _to_payload(self) -> bytes:
        return _PERMISSIVE.pack(self.permitted)


def is_pin(text: str) -> bool:
    """Tell whether this is 4 digits up to 4095, 2 characters and 9 digits."""
    return _PIN.fullmatch(text) is not None and int(text[:4]) <= 0xFFF


@dataclass(frozen=True, slots=True)
class AddressAnnouncement(Writable):
    """
    Type FF: who claimed the address that this comes from (Appendix A).

    The manual gives PIN digits 7-15 30 bits, but does not count the highest one in its example,
    where it is set. So that bit is kept apart, and ``matches`` knows both readings.

    :param pin: 15 characters: device type, two ASCII characters, nine digits below 2**29.
    """

    TYPE = MessageType.ADDRESS_ANNOUNCEMENT
    LENGTHS = range(8, 9)
    pin: str
    top_bit: bool = False

    def __post_init__(self) -> None:
        if not is_pin(self.pin):
            raise ValueError(f'a PIN is such as 1032AE100801035, not {self.pin!r}')
        check_range('digits 7-15 of a PIN', int(self.pin[6:]), 0, _PIN_TOP_BIT - 1)

    @property
    def device_type(self) -> int:
        """The key of DEVICE_TYPES."""
        return int(self.pin[:4])

    @property
    def identity(self) -> int:
        """The identity number in the NAME of the same device."""
        return int(self.pin[6:]) & 0x1FFFFF

    def matches(self, pin: str) -> bool:
        """Tell whether the device has this PIN, be the highest bit counted or not."""
        counted = int(self.pin[6:]) + (_PIN_TOP_BIT if self.top_bit else 0)
        return pin in (self.pin, f'{self.pin[:6]}{counted:09}')

    @classmethod
    def _from_payload(cls, payload: bytes) -> AddressAnnouncement:
        word = int.from_bytes(payload, 'big')  # 7 bits digit 5, 7 digit 6, 12 and 30 of digits
        letters = chr(word >> 49) + chr(word >> 42 & 0x7F)
        digits = word & (_PIN_TOP_BIT - 1)
        return cls(f'{word >> 30 & 0xFFF:04}{letters}{digits:09}', bool(word & _PIN_TOP_BIT))

    def _to_payload(self) -> bytes:
        letters = ord(self.pin[4]) << 49 | ord(self.pin[5]) << 42
        digits = int(self.pin[6:]) | (_PIN_TOP_BIT if self.top_bit else 0)
        return (letters | self.device_type << 30 | digits).to_bytes(7, 'big')


@dataclass(frozen=True, slots=True)
class DiagnosticData(Message):
    """Type FD, for the maker's diagnostic program: never sent by us. :param content: 1-6 bytes."""

    TYPE = MessageType.DIAGNOSTIC_DATA
    LENGTHS = range(3, 9)
    record_type: int
    content: bytes

    @classmethod
    def _from_payload(cls, payload: bytes) -> DiagnosticData:
        return cls(payload[0], payload[1:])


@dataclass(frozen=True, slots=True)
class AsciiPipe(Message):
    """Type FE, not available for integrator use. :param characters: 1 to 7 bytes."""

    TYPE = MessageType.ASCII_PIPE
    LENGTHS = range(2, 9)
    characters: bytes

    @property
    def text(self) -> str:
        """The characters, with an escape for what is not ASCII."""
        return self.characters.decode('ascii', 'backslashreplace')

    @classmethod
    def _from_payload(cls, payload: bytes) -> AsciiPipe:
        return cls(payload)


@dataclass(frozen=True, slots=True)
class AsciiPipeAcknowledgement(Message):
    """Type FE without characters: the previous ones were received."""

    TYPE = MessageType.ASCII_PIPE
    LENGTHS = range(1, 2)

    @classmethod
    def _from_payload(cls, payload: bytes) -> AsciiPipeAcknowledgement:
        del payload
        return cls()
