# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The messages, one class each: manual section 4."""

from __future__ import annotations

from dataclasses import dataclass
import struct
from typing import TypeVar

from bridge_core.framing import Unknown
from bridge_core.numerals import check_range
from vm110_bridge.protocol.frames import Crc, Frame, Message, PacketId
from vm110_bridge.protocol.values import (
    AXIS_NAMES,
    BU_STATES,
    BuState,
    DISABLED,
    Disabled,
    LINK_STATUSES,
    LinkStatus,
    MAX_POSITION,
    RU_STATES,
    RuState,
    SWITCH_NAMES,
)

DATA_SIZE = 16  # bytes of a command
MAX_BURST_DATA = 488  # bytes of periodic data in one packet (4.2)

_PERIODIC_INPUT = struct.Struct(
    '<'
    '6B'  # BU state, VLAPs, unarmed RUs, EG-Link, EC-Link, C-Link status
    'H'  # armed RU
    '6B'  # RU state, battery %, C-Link RSSI %, cable, docked, disabled
    '4h'  # joysticks, -1000 to 1000
    '8h'  # switches
    '2B'  # encoder value, encoder switch
    '6x'  # spare
)
_NUMBER = struct.Struct('<H')  # packet number (4.2), or command ID (4.4, 4.6)
_COMMAND = struct.Struct(f'<H4x{DATA_SIZE}s')  # command ID, spare, data
assert (_PERIODIC_INPUT.size, _NUMBER.size, _COMMAND.size) == (46, 2, 22)


@dataclass(frozen=True, slots=True)
class PeriodicInput(Message):
    """
    VRPI (4.1): state of the system and of the armed RU; every 125 ms.

    A state that the manual does not list stays a plain int, equal to none that it does. All from
    ``ru_state`` on is 0 while no RU is armed.

    :param vlaps: 0-3. :param armed_ru: the RU's ID, 0 for none. :param ru_battery: %.
    :param ru_rssi: of C-Link, %. :param joysticks: 4, nominally -1000 to 1000, as they came.
    :param switches: 8, raw (-1 to 1000 by the fitted part). :param encoder: 0-255, wraps.
    """

    KIND = PacketId.PERIODIC_INPUT
    bu_state: BuState | int = BuState.INITIAL
    vlaps: int = 0
    unarmed_rus: int = 0
    eg_link: LinkStatus | int = LinkStatus.UNUSED
    ec_link: LinkStatus | int = LinkStatus.UNUSED
    c_link: LinkStatus | int = LinkStatus.UNUSED
    armed_ru: int = 0
    ru_state: RuState | int = RuState.INITIAL
    ru_battery: int = 0
    ru_rssi: int = 0
    ru_cable: bool = False
    ru_docked: bool = False
    ru_disabled: Disabled | int = Disabled.ENABLED
    joysticks: tuple[int, ...] = (0,) * len(AXIS_NAMES)
    switches: tuple[int, ...] = (0,) * len(SWITCH_NAMES)
    encoder: int = 0
    encoder_switch: bool = False

    @property
    def faulty(self) -> tuple[str, ...]:
        """Joysticks whose position cannot be (4.1.4), such as 'joystick_2 out of range (1203)'."""
        return tuple(
            f'{name} out of range ({value})'
            for name, value in zip(AXIS_NAMES, self.joysticks, strict=True)
            if abs(value) > MAX_POSITION
        )

    @classmethod
    def _from_payload(cls, payload: bytes) -> PeriodicInput:
        fields = _PERIODIC_INPUT.unpack(payload)
        bu_state, vlaps, unarmed, eg, ec, c_link, armed, state = fields[:8]
        battery, rssi, cable, docked, disabled = fields[8:13]
        return cls(
            bu_state=BU_STATES.get(bu_state, bu_state),
            vlaps=vlaps,
            unarmed_rus=unarmed,
            eg_link=LINK_STATUSES.get(eg, eg),
            ec_link=LINK_STATUSES.get(ec, ec),
            c_link=LINK_STATUSES.get(c_link, c_link),
            armed_ru=armed,
            ru_state=RU_STATES.get(state, state),
            ru_battery=battery,
            ru_rssi=rssi,
            ru_cable=cable > 0,
            ru_docked=docked > 0,
            ru_disabled=DISABLED.get(disabled, disabled),
            joysticks=fields[13:17],
            switches=fields[17:25],
            encoder=fields[25],
            encoder_switch=fields[26] > 0,
        )

    def _to_payload(self) -> bytes:
        links = (self.eg_link, self.ec_link, self.c_link)
        remote = (self.ru_state, self.ru_battery, self.ru_rssi, self.ru_cable, self.ru_docked)
        return _PERIODIC_INPUT.pack(
            *(self.bu_state, self.vlaps, self.unarmed_rus, *links, self.armed_ru),
            *(*remote, self.ru_disabled, *self.joysticks, *self.switches),
            *(self.encoder, self.encoder_switch),
        )


@dataclass(frozen=True, slots=True)
class PeriodicOutput(Message):
    """VRPO (4.2): one packet of a burst. :param data: up to 488 bytes for the RU's display."""

    KIND = PacketId.PERIODIC_OUTPUT
    packet_number: int
    data: bytes = b''

    def __post_init__(self) -> None:
        check_range('the packet number', self.packet_number, 0, 0xFFFF)
        if len(self.data) > MAX_BURST_DATA:
            raise ValueError(f'at most {MAX_BURST_DATA} bytes a packet, not {len(self.data)}')

    @classmethod
    def _from_payload(cls, payload: bytes) -> PeriodicOutput:
        return cls(_NUMBER.unpack(payload[:2])[0], payload[2:])

    def _to_payload(self) -> bytes:
        return _NUMBER.pack(self.packet_number) + self.data


def burst(data: bytes, first_number: int = 0) -> list[PeriodicOutput]:
    """
    Return the packets for this periodic data: one at least, all full but the last (4.2).

    :param first_number: number of the first packet; the manual does not say which it is.
    """
    starts = range(0, max(len(data), 1), MAX_BURST_DATA)
    return [
        PeriodicOutput(number, data[start : start + MAX_BURST_DATA])
        for number, start in enumerate(starts, first_number)
    ]


_C = TypeVar('_C', bound='_Command')
_A = TypeVar('_A', bound='_Acknowledge')


@dataclass(frozen=True, slots=True)
class _Command(Message):
    """A command in either direction. :param command_id: 0-65535. :param data: 16 bytes."""

    command_id: int
    data: bytes

    def __post_init__(self) -> None:
        check_range('the command ID', self.command_id, 0, 0xFFFF)
        if len(self.data) != DATA_SIZE:
            raise ValueError(f'a command has {DATA_SIZE} bytes, not {len(self.data)}')

    @classmethod
    def _from_payload(cls: type[_C], payload: bytes) -> _C:
        return cls(*_COMMAND.unpack(payload))

    def _to_payload(self) -> bytes:
        return _COMMAND.pack(self.command_id, self.data)


@dataclass(frozen=True, slots=True)
class _Acknowledge(Message):
    """A command's receipt in either direction. :param command_id: 0-65535."""

    command_id: int

    def __post_init__(self) -> None:
        check_range('the command ID', self.command_id, 0, 0xFFFF)

    @classmethod
    def _from_payload(cls: type[_A], payload: bytes) -> _A:
        return cls(*_NUMBER.unpack(payload))

    def _to_payload(self) -> bytes:
        return _NUMBER.pack(self.command_id)


class CommandInput(_Command):
    """VRCI (4.3): from the RU's application to the machine; repeated until acknowledged."""

    __slots__ = ()
    KIND = PacketId.COMMAND_INPUT


class AcknowledgeOutput(_Acknowledge):
    """VRAO (4.4): the machine has processed a VRCI."""

    __slots__ = ()
    KIND = PacketId.ACKNOWLEDGE_OUTPUT


class CommandOutput(_Command):
    """VRCO (4.5): from the machine to the RU's application; repeated until acknowledged."""

    __slots__ = ()
    KIND = PacketId.COMMAND_OUTPUT


class AcknowledgeInput(_Acknowledge):
    """VRAI (4.6): the RU's application has processed a VRCO."""

    __slots__ = ()
    KIND = PacketId.ACKNOWLEDGE_INPUT


MESSAGES: dict[bytes, type[Message]] = {
    kind.KIND.value: kind
    for kind in (
        PeriodicInput,
        CommandInput,
        AcknowledgeInput,
        PeriodicOutput,
        CommandOutput,
        AcknowledgeOutput,
    )
}


def decode(frame: Frame) -> Message | Unknown:
    """Read a packet's payload. :raises FrameError: if it is not as its ID says."""
    kind = MESSAGES.get(frame.kind)
    if kind is None:
        return Unknown(int.from_bytes(frame.kind, 'big'))
    return kind.from_bytes(frame.payload)


def build_frame(message: Message, serial: int, crc: Crc, origin: int = 0) -> bytes:
    """Return the datagram that carries a message."""
    return Frame(message.KIND.value, serial, message.to_bytes(), origin, crc).to_bytes()
