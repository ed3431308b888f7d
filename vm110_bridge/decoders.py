# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How tools read captures of a VM-110's network."""

from __future__ import annotations

from collections.abc import Callable
import struct
from typing import Any

from bridge_core.decoding import (
    DatagramDecoder,
    Decoders,
    message_name,
    Plain,
    StreamDecoder,
)
from bridge_core.framing import FrameError, FrameFormat, StreamParser, Unknown
import vm110_bridge.protocol as vm110

_SIZE = struct.Struct('<H')
_BEGINNINGS = tuple(kind.value for kind in vm110.PacketId)


def _parser() -> StreamParser[Any]:
    """Return a parser of datagrams that were written one after the other."""
    return StreamParser(FrameFormat(b'VR', vm110.HEAD_SIZE, vm110.MAX_FRAME, _size, _read))


def _size(head: bytes) -> int:
    """:raises FrameError: no packet of EG-Link begins so."""
    if not head.startswith(_BEGINNINGS):
        raise FrameError(f'no such packet: {head[:4]!r}')
    return vm110.MIN_FRAME + int(_SIZE.unpack_from(head, 10)[0])


def _read(datagram: bytes) -> vm110.Packet | Unknown:
    """Read a datagram, by either reading of the CRC. :raises FrameError: it is unsound."""
    frame = vm110.Frame.from_bytes(datagram, None)
    message = vm110.decode(frame)
    if isinstance(message, Unknown):
        return message
    return vm110.Packet(message, frame.serial, frame.origin, frame.crc)


def _named(content: vm110.Packet | Unknown) -> str:
    return message_name(content if isinstance(content, Unknown) else content.message)


def _stops(content: vm110.Packet | Unknown) -> bool | None:
    """Tell whether a VRPI is a stop; a state that the manual does not list is one, too."""
    message = None if isinstance(content, Unknown) else content.message
    if not isinstance(message, vm110.PeriodicInput):
        return None
    is_clear = message.bu_state in (vm110.BuState.DISARMED, vm110.BuState.ARMED)
    return not is_clear or message.ru_state >= vm110.RuState.STOPPED


def _packet(value: vm110.Packet, plain: Callable[[Any], Any]) -> dict[str, Any]:
    head = {'serial': value.serial, 'origin': value.origin, 'crc': plain(value.crc)}
    return {**plain(value.message), **head}


DECODERS = Decoders(
    protocols=(
        StreamDecoder(name='vm110', parser=_parser, by_device=False, named=_named, stops=_stops),
        DatagramDecoder(
            name='vm110',
            beginnings=_BEGINNINGS,
            read=_read,
            named=_named,
            checks=lambda datagram: [crc.value for crc in vm110.Crc if crc.is_good(datagram)],
        ),
    ),
    plain=Plain(
        values={vm110.Packet: _packet},
        names={
            (vm110.PeriodicInput, 'joysticks'): vm110.AXIS_NAMES,
            (vm110.PeriodicInput, 'switches'): vm110.SWITCH_NAMES,
        },
    ),
)
