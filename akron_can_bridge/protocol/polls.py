# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Polls and their responses, J1939 NAMEs, and configuration requests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from akron_can_bridge.protocol.fields import bit, Field, flags, two_bytes
from akron_can_bridge.protocol.flags import Fault, Vista
from akron_can_bridge.protocol.frames import (
    Bare,
    FIELD_REQUEST_PGN,
    MessageType,
    NAME_PGN,
    Sendable,
    Writable,
)
from akron_can_bridge.protocol.values import Version

AKRON_BRASS = 326  # manufacturer code in a NAME


@dataclass(frozen=True, slots=True)
class FieldRequest(Sendable):
    """PGN 59904. Akron Brass devices answer one for NAME_PGN, then announce their PIN."""

    PGN = FIELD_REQUEST_PGN
    ORDER = 'little'
    pgn: Annotated[int, Field(24, at=0)] = NAME_PGN


@dataclass(frozen=True, slots=True)
class Name(Sendable):
    """
    PGN 60928, J1939-81: who claims the address that this comes from; a lower ``value`` wins.

    :param identity: of an Akron Brass device the low bits of PIN digits 7-15.
    :param manufacturer: see AKRON_BRASS.
    """

    PGN = NAME_PGN
    ORDER = 'little'
    identity: Annotated[int, Field(21, at=0)]
    manufacturer: Annotated[int, Field(11, at=21)]
    ecu_instance: Annotated[int, Field(3, at=32)] = 0
    function_instance: Annotated[int, Field(5, at=35)] = 0
    function: Annotated[int, Field(8, at=40)] = 0
    vehicle_system: Annotated[int, Field(7, at=49)] = 0
    system_instance: Annotated[int, Field(4, at=56)] = 0
    industry_group: Annotated[int, Field(3, at=60)] = 0
    arbitrary_address_capable: Annotated[bool, bit(at=63)] = False
    reserved: Annotated[int, Field(1, at=48)] = 0  # kept, since it counts in a contention

    @property
    def value(self) -> int:
        """The 64 bits; an integer, little-endian on the wire."""
        return int.from_bytes(self.to_bytes(), 'little')


@dataclass(frozen=True, slots=True)
class FaultPoll(Bare):
    """Type 02, answered by a FaultStatus."""

    TYPE = MessageType.FAULT


@dataclass(frozen=True, slots=True)
class FaultStatus(Writable):
    """Type 02. :param pcode: error code, the Error Flash Code of the device; see pcode_name."""

    TYPE = MessageType.FAULT
    faults: Annotated[Fault, flags(Fault, 32, at=16)]
    pcode: Annotated[int, Field(16, at=0)]


@dataclass(frozen=True, slots=True)
class FirmwarePoll(Bare):
    """Type 03, answered by a FirmwareVersion."""

    TYPE = MessageType.FIRMWARE_VERSION


@dataclass(frozen=True, slots=True)
class FirmwareVersion(Writable):
    """Type 03."""

    TYPE = MessageType.FIRMWARE_VERSION
    fixed_boot: Annotated[Version, two_bytes(at=32)]
    bootloader: Annotated[Version, two_bytes(at=16)]
    system: Annotated[Version, two_bytes(at=0)]


@dataclass(frozen=True, slots=True)
class PcodePoll(Bare):
    """Type 04, answered by a PcodeVersion."""

    TYPE = MessageType.PCODE_VERSION


@dataclass(frozen=True, slots=True)
class PcodeVersion(Writable):
    """Type 04. :param style: of the monitor, 3356 is a Trident."""

    TYPE = MessageType.PCODE_VERSION
    style: Annotated[int, Field(16, at=32)]
    subtype: Annotated[int, Field(16, at=16)]
    version: Annotated[Version, two_bytes(at=0)]


@dataclass(frozen=True, slots=True)
class ConfigPoll(Bare):
    """Type 05, answered by a ConfigVersion."""

    TYPE = MessageType.CONFIG_VERSION


@dataclass(frozen=True, slots=True)
class ConfigVersion(Writable):
    """Type 05. :param config_type: shown in decimal."""

    TYPE = MessageType.CONFIG_VERSION
    config_type: Annotated[int, Field(32, at=16)]
    version: Annotated[Version, two_bytes(at=0)]


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
    system_voltage: Annotated[int, Field(10, at=46)]
    joystick_x: Annotated[int, Field(10, at=22)]
    joystick_y: Annotated[int, Field(10, at=6)]
    bits: Annotated[Vista, flags(Vista, 56)]


@dataclass(frozen=True, slots=True)
class VistaPosition(Writable):
    """Type 22: 16 bits each, in a scale that the manual does not give."""

    TYPE = MessageType.VISTA_POSITION
    rotation: Annotated[int, Field(16, at=16)]
    elevation: Annotated[int, Field(16, at=0)]


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
