# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parsers of what comes whole, a datagram, frame or report a read: each against a table."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

from akron_can_bridge.session.decoder import FrameDecoder
from assurance.fuzz import devices, sound
from assurance.fuzz.campaign import Target
from assurance.fuzz.mutate import Input, Kit
from assurance.fuzz.sessions import Device
from bridge_core.framing import Decoder
from fort_vsc_bridge.protocol import CanWire, HidWire, Rejected
from vm110_bridge.protocol import Crc, Packet, PacketDecoder

Rule = Callable[[bytes], bool]
_PAUSES = (0.0, 0.01, 0.02, 0.1, 0.3)  # s


class DecoderTarget(Target):
    """
    A decoder reads nothing that cannot be a message, and each that would end a stop.

    :param may: whether a read may be a message. :param must: whether it is one that counts.
    """

    def __init__(
        self,
        device: Device,
        name: str,
        make: Callable[[], Decoder[Any, Any]],
        may: Rule,
        must: Rule,
    ) -> None:
        self.name = name
        self.kit = Kit(device.seeds, device.tokens, _PAUSES, device.repair)
        self._frame_of = device.frame_of
        self._decoder = make()
        self._may, self._must = may, must
        self._now = 0.0

    def run(self, reads: Input) -> Hashable:
        """Feed and compare; return which messages there were."""
        decoder, seen = self._decoder, set()
        decoder.reset()
        for pause, data in reads:
            self._now += pause
            frame = self._frame_of(data)
            before = decoder.counters.bytes
            told = [_message_in(each) for each in decoder.feed(frame, self._now)]
            messages = [each for each in told if each is not None]
            assert decoder.counters.bytes - before == len(getattr(frame, 'data', frame)), 'bytes'
            assert not messages or self._may(data), f'no message: {data.hex(" ")}'
            assert messages or not self._must(data), f'a message: {data.hex(" ")}'
            assert not decoder.poll(self._now)
            seen |= {type(each).__name__ for each in messages}
        return frozenset(seen)

    def kept(self) -> Any:
        """Return what is remembered of frames."""
        return self._decoder


def _message_in(decoded: Any) -> Any:
    """Return what a decoder has read; None: only that it was wrong."""
    if isinstance(decoded, tuple):  # of an Akron unit, behind its frame and identifier
        return decoded[-1]
    if isinstance(decoded, Packet):
        return decoded.message
    return None if isinstance(decoded, Rejected) else decoded


# docs/devices/fort_vsc.md: the shortest data, by identifier.
_VSC_CAN = dict.fromkeys((0x0CFDD633, 0x0CFDD733, 0x0CFDD834, 0x0CFDD934, 0x0CFDE861), 8)
_VSC_CAN[0x0CFDE801] = 6


def _may_be_vsc_can(data: bytes) -> bool:
    frame = devices.can_frame(data)
    return len(frame.data) >= _VSC_CAN.get(frame.identifier, 9)


def _is_report(data: bytes) -> bool:
    return len(data) == 9


# docs/devices/vm110.md: bytes of payload; VRPO has up to 490 of data.
_VM110 = dict.fromkeys((b'VRCI', b'VRCO'), 22) | dict.fromkeys((b'VRAI', b'VRAO'), 2)
_VM110[b'VRPI'] = 46


def _may_be_vm110(data: bytes) -> bool:
    kind, size = data[:4], len(data) - 20
    from_nobody = kind[3:] == b'I' and not any(data[6:8])
    fits = size >= 2 if kind == b'VRPO' else size == _VM110.get(kind)
    return fits and not from_nobody and sound.is_sound_datagram(data, mirrored=False)


# docs/devices/akron.md: lengths of data, by PGN and by type on PGN EF00.
_AKRON_PGNS = {0xFDD6: (8,), 0xFDD7: (8,), 0xEA00: (3,), 0xEE00: (8,)}
_AKRON_TYPES = {
    **dict.fromkeys((0x41, 0x45, 0x46), (1,)),
    **dict.fromkeys((0x02, 0x03, 0x04, 0x05), (1, 7)),
    **dict.fromkeys((0x81, 0x82), (6,)),
    **dict.fromkeys((0x83, 0x84, 0xA1), (3,)),
    **dict.fromkeys((0x01, 0xFF), (8,)),
    0x21: (1, 8),
    0x22: (5,),
    0x85: (2,),
    0xFD: range(3, 9),
    0xFE: range(1, 9),
}


def _may_be_akron(data: bytes) -> bool:
    frame = devices.can_frame(data)
    pgn = frame.identifier >> 8 & 0x3FFFF
    if pgn & 0xFF00 < 0xF000:  # its low byte is an address
        pgn &= 0x3FF00
    if pgn == 0xEF00:
        return bool(frame.data) and len(frame.data) in _AKRON_TYPES.get(frame.data[0], ())
    return len(frame.data) in _AKRON_PGNS.get(pgn, ())


def _is_akron_outputs(data: bytes) -> bool:
    return _may_be_akron(data) and data[1] == 0xEF and data[4] == 0x83


def _all(*unused: object) -> bool:
    return True


DECODERS = (
    DecoderTarget(
        devices.VSC_CAN,
        'vsc can parser',
        lambda: CanWire().decoder(0.25),
        _may_be_vsc_can,
        lambda data: devices.VSC_CAN.releases([data], []),
    ),
    DecoderTarget(
        devices.VSC_HID, 'vsc hid parser', lambda: HidWire().decoder(0.25), _is_report, _is_report
    ),
    DecoderTarget(
        devices.VM110,
        'vm110 parser',
        lambda: PacketDecoder(Crc.MPEG2),
        _may_be_vm110,
        lambda data: data[:4] in _VM110 and _may_be_vm110(data),
    ),
    DecoderTarget(
        devices.AKRON,
        'akron parser',
        lambda: FrameDecoder(_all, _all),
        _may_be_akron,
        _is_akron_outputs,
    ),
)
