"""Polls and their responses, J1939 NAMEs, and configuration requests."""

from __future__ import annotations

from dataclasses import dataclass
import struct

from akron_can_bridge.protocol.flags import Fault
from akron_can_bridge.protocol.flags import FLAG_NAMES
from akron_can_bridge.protocol.flags import Vista
from akron_can_bridge.protocol.frames import Bare
from akron_can_bridge.protocol.frames import FIELD_REQUEST_PGN
from akron_can_bridge.protocol.frames import MessageType
from akron_can_bridge.protocol.frames import NAME_PGN
from akron_can_bridge.protocol.frames import Sendable
from akron_can_bridge.protocol.frames import Writable
from akron_can_bridge.protocol.values import check_range
from akron_can_bridge.protocol.values import Version

AKRON_BRASS = 326  # manufacturer code in a NAME

_FAULTS = struct.Struct('>IH')  # fault bits, pCode error code
_FIRMWARE = struct.Struct('>6B')  # fixed boot, bootloader, system: major and minor each
_PCODE = struct.Struct('>HHBB')  # style, subtype, major, minor
_CONFIG = struct.Struct('>IBB')  # config type, major, minor
_VISTA_POSITION = struct.Struct('>HH')  # rotation, elevation
assert (_FAULTS.size, _FIRMWARE.size, _PCODE.size, _CONFIG.size) == (6, 6, 6, 6)
_FAULT_BITS, _VISTA_BITS = (sum(FLAG_NAMES[kind]) for kind in (Fault, Vista))
# The numbers of type 21, counted like Vista's bits.
_VOLTAGE_SHIFT, _X_SHIFT, _Y_SHIFT, _TEN_BITS = 46, 22, 6, 0x3FF


@dataclass(frozen=True, slots=True)
class FieldRequest(Sendable):
    """PGN 59904. Akron Brass devices answer one for NAME_PGN, then announce their PIN."""

    PGN = FIELD_REQUEST_PGN
    LENGTHS = range(3, 4)
    pgn: int = NAME_PGN

    def __post_init__(self) -> None:
        check_range('the PGN', self.pgn, 0, 0xFFFFFF)

    @classmethod
    def _from_payload(cls, payload: bytes) -> FieldRequest:
        return cls(int.from_bytes(payload, 'little'))

    def _to_payload(self) -> bytes:
        return self.pgn.to_bytes(3, 'little')


# Name and bits of a NAME's fields, from its lowest bit on.
_NAME_FIELDS = (
    *(('identity', 21), ('manufacturer', 11), ('ecu_instance', 3), ('function_instance', 5)),
    *(('function', 8), ('reserved', 1), ('vehicle_system', 7), ('system_instance', 4)),
    *(('industry_group', 3), ('arbitrary_address_capable', 1)),
)
assert sum(bits for _, bits in _NAME_FIELDS) == 64


@dataclass(frozen=True, slots=True)
class Name(Sendable):
    """
    PGN 60928, J1939-81: who claims the address that this comes from; a lower ``value`` wins.

    :param identity: 21 bits; of an Akron Brass device the low bits of PIN digits 7-15.
    :param manufacturer: 11 bits, see AKRON_BRASS.
    """

    PGN = NAME_PGN
    LENGTHS = range(8, 9)
    identity: int
    manufacturer: int
    ecu_instance: int = 0
    function_instance: int = 0
    function: int = 0
    vehicle_system: int = 0
    system_instance: int = 0
    industry_group: int = 0
    arbitrary_address_capable: bool = False
    reserved: int = 0  # kept, since it counts in a contention

    def __post_init__(self) -> None:
        for name, bits in _NAME_FIELDS:
            check_range(name, getattr(self, name), 0, (1 << bits) - 1)

    @property
    def value(self) -> int:
        """The 64 bits; an integer, little-endian on the wire."""
        value = place = 0
        for name, bits in _NAME_FIELDS:
            value |= getattr(self, name) << place
            place += bits
        return value

    @classmethod
    def _from_payload(cls, payload: bytes) -> Name:
        value = int.from_bytes(payload, 'little')
        fields: dict[str, int] = {}
        for name, bits in _NAME_FIELDS:
            fields[name] = value & (1 << bits) - 1
            value >>= bits
        capable = bool(fields.pop('arbitrary_address_capable'))
        return cls(**fields, arbitrary_address_capable=capable)

    def _to_payload(self) -> bytes:
        return self.value.to_bytes(8, 'little')


@dataclass(frozen=True, slots=True)
class FaultPoll(Bare):
    """Type 02, answered by a FaultStatus."""

    TYPE = MessageType.FAULT


@dataclass(frozen=True, slots=True)
class FaultStatus(Writable):
    """Type 02. :param pcode: error code, the Error Flash Code of the device; see pcode_name."""

    TYPE = MessageType.FAULT
    LENGTHS = range(7, 8)
    faults: Fault
    pcode: int

    def __post_init__(self) -> None:
        check_range('the pCode error code', self.pcode, 0, 0xFFFF)

    @classmethod
    def _from_payload(cls, payload: bytes) -> FaultStatus:
        bits, pcode = _FAULTS.unpack(payload)
        return cls(Fault(bits & _FAULT_BITS), pcode)

    def _to_payload(self) -> bytes:
        return _FAULTS.pack(self.faults, self.pcode)


@dataclass(frozen=True, slots=True)
class FirmwarePoll(Bare):
    """Type 03, answered by a FirmwareVersion."""

    TYPE = MessageType.FIRMWARE_VERSION


@dataclass(frozen=True, slots=True)
class FirmwareVersion(Writable):
    """Type 03."""

    TYPE = MessageType.FIRMWARE_VERSION
    LENGTHS = range(7, 8)
    fixed_boot: Version
    bootloader: Version
    system: Version

    def __post_init__(self) -> None:
        _check_versions(self.fixed_boot, self.bootloader, self.system)

    @classmethod
    def _from_payload(cls, payload: bytes) -> FirmwareVersion:
        numbers = _FIRMWARE.unpack(payload)
        return cls(*(Version(*numbers[place : place + 2]) for place in (0, 2, 4)))

    def _to_payload(self) -> bytes:
        return _FIRMWARE.pack(*self.fixed_boot, *self.bootloader, *self.system)


@dataclass(frozen=True, slots=True)
class PcodePoll(Bare):
    """Type 04, answered by a PcodeVersion."""

    TYPE = MessageType.PCODE_VERSION


@dataclass(frozen=True, slots=True)
class PcodeVersion(Writable):
    """Type 04. :param style: of the monitor, 3356 is a Trident. :param subtype: 16 bits."""

    TYPE = MessageType.PCODE_VERSION
    LENGTHS = range(7, 8)
    style: int
    subtype: int
    version: Version

    def __post_init__(self) -> None:
        check_range('the style number', self.style, 0, 0xFFFF)
        check_range('the subtype number', self.subtype, 0, 0xFFFF)
        _check_versions(self.version)

    @classmethod
    def _from_payload(cls, payload: bytes) -> PcodeVersion:
        style, subtype, *version = _PCODE.unpack(payload)
        return cls(style, subtype, Version(*version))

    def _to_payload(self) -> bytes:
        return _PCODE.pack(self.style, self.subtype, *self.version)


@dataclass(frozen=True, slots=True)
class ConfigPoll(Bare):
    """Type 05, answered by a ConfigVersion."""

    TYPE = MessageType.CONFIG_VERSION


@dataclass(frozen=True, slots=True)
class ConfigVersion(Writable):
    """Type 05. :param config_type: 32 bits, shown in decimal."""

    TYPE = MessageType.CONFIG_VERSION
    LENGTHS = range(7, 8)
    config_type: int
    version: Version

    def __post_init__(self) -> None:
        check_range('the config type', self.config_type, 0, 0xFFFFFFFF)
        _check_versions(self.version)

    @classmethod
    def _from_payload(cls, payload: bytes) -> ConfigVersion:
        config_type, *version = _CONFIG.unpack(payload)
        return cls(config_type, Version(*version))

    def _to_payload(self) -> bytes:
        return _CONFIG.pack(self.config_type, *self.version)


def _check_versions(*versions: Version) -> None:
    for number in (number for version in versions for number in version):
        check_range('a version number', number, 0, 0xFF)


@dataclass(frozen=True, slots=True)
class VistaPoll(Bare):
    """Type 21, answered by a VistaData and a VistaPosition."""

    TYPE = MessageType.VISTA


@dataclass(frozen=True, slots=True)
class VistaData(Writable):
    """
    Type 21. The manual gives the numbers no unit: 0 to 1023, as they come.

    :param joystick_x: magnitude; its direction is among the bits, as for ``joystick_y``.
    """

    TYPE = MessageType.VISTA
    LENGTHS = range(8, 9)
    system_voltage: int
    joystick_x: int
    joystick_y: int
    bits: Vista

    def __post_init__(self) -> None:
        check_range('the system voltage', self.system_voltage, 0, _TEN_BITS)
        check_range('the joystick X position', self.joystick_x, 0, _TEN_BITS)
        check_range('the joystick Y position', self.joystick_y, 0, _TEN_BITS)

    @classmethod
    def _from_payload(cls, payload: bytes) -> VistaData:
        word = int.from_bytes(payload, 'big')
        shifts = (_VOLTAGE_SHIFT, _X_SHIFT, _Y_SHIFT)
        voltage, x, y = (word >> shift & _TEN_BITS for shift in shifts)
        return cls(voltage, x, y, Vista(word & _VISTA_BITS))

    def _to_payload(self) -> bytes:
        numbers = self.system_voltage << _VOLTAGE_SHIFT | self.joystick_x << _X_SHIFT
        return (numbers | self.joystick_y << _Y_SHIFT | self.bits).to_bytes(7, 'big')


@dataclass(frozen=True, slots=True)
class VistaPosition(Writable):
    """Type 22: 16 bits each, in a scale that the manual does not give."""

    TYPE = MessageType.VISTA_POSITION
    LENGTHS = range(5, 6)
    rotation: int
    elevation: int

    def __post_init__(self) -> None:
        check_range('the rotation position', self.rotation, 0, 0xFFFF)
        check_range('the elevation position', self.elevation, 0, 0xFFFF)

    @classmethod
    def _from_payload(cls, payload: bytes) -> VistaPosition:
        return cls(*_VISTA_POSITION.unpack(payload))

    def _to_payload(self) -> bytes:
        return _VISTA_POSITION.pack(self.rotation, self.elevation)


@dataclass(frozen=True, slots=True)
class ZeroPositions(Bare):
    """Type 41: the request, and from the unit its acknowledgement."""

    TYPE = MessageType.ZERO_POSITIONS


@dataclass(frozen=True, slots=True)
class ResetController(Bare):
    """Type 45: the request; nothing acknowledges it but the announcement after the restart."""

    TYPE = MessageType.RESET_CONTROLLER


@dataclass(frozen=True, slots=True)
class EnterSetup(Bare):
    """Type 46: the request, and from the unit its acknowledgement."""

    TYPE = MessageType.ENTER_SETUP
