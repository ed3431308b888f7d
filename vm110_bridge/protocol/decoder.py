# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From datagrams to messages, each checked once."""

from __future__ import annotations

from dataclasses import dataclass
import math

from bridge_core.framing import ChecksumError, Datagram, Decoder, FrameError, Unknown
from vm110_bridge.protocol.frames import (
    Crc,
    Frame,
    LayoutError,
    MAX_FRAME,
    Message,
    MIN_FRAME,
    PacketId,
)
from vm110_bridge.protocol.messages import AcknowledgeInput, CommandInput, decode, PeriodicInput

Input = PeriodicInput | CommandInput | AcknowledgeInput  # what a base unit sends


@dataclass(frozen=True, slots=True)
class Packet:
    """A message, what Frame says of it, and its sender, as 'address:port'."""

    message: Message
    serial: int
    origin: int
    crc: Crc
    source: str = ''


class PacketDecoder(Decoder[bytes, Packet]):
    """
    Reads datagrams, each of which holds one packet.

    :param crc: which reading of 3.3; None leaves it open until ``lock``. Until then only VRPI, of
        either reading, are read.
    """

    def __init__(self, crc: Crc | None = None) -> None:
        super().__init__()
        self.crc = crc
        self.before_lock = 0  # packets that could not be checked yet
        self.other_crc = 0  # packets that the other reading would let pass
        self.other_crc_at = -math.inf  # the last of them
        self.bad_crc_at = -math.inf  # the last that none would
        self.other_layout_at = -math.inf  # the last sound VRPI of another revision or size
        self.no_origin_at = -math.inf  # the last one, else sound, of origin 0

    def lock(self, crc: Crc) -> None:
        """Take this reading, and no other, from now on."""
        self.crc = crc

    def feed(self, data: bytes, now: float) -> list[Packet]:
        """Return the packet that a datagram holds; none if it is not sound."""
        self.counters.bytes += len(data)
        if not MIN_FRAME <= len(data) <= MAX_FRAME:
            self.counters.malformed += 1
        elif self.crc is None and not data.startswith(PacketId.PERIODIC_INPUT):
            self.before_lock += 1
        else:
            return self._decode(data, now)
        return []

    def _decode(self, data: bytes, now: float) -> list[Packet]:
        packets = []
        try:
            packet = _read(data, self.crc)
        except ChecksumError:
            self.counters.checksum_errors += 1
            if any(crc.is_good(data) for crc in Crc):
                self.other_crc += 1
                self.other_crc_at = now
            else:
                self.bad_crc_at = now
            return []
        except FrameError as error:
            self.counters.malformed += 1
            if data.startswith(PacketId.PERIODIC_INPUT):
                if isinstance(error, LayoutError):
                    self.other_layout_at = now
                else:
                    self.no_origin_at = now
        else:
            if isinstance(packet, Unknown):
                self.counters.unknown_types += 1
            else:
                packets.append(packet)
        self.counters.frames += 1
        return packets


def _read(data: bytes, crc: Crc | None) -> Packet | Unknown:
    frame = Frame.from_bytes(data, crc)
    message = decode(frame)
    if isinstance(message, Unknown):
        return message
    if isinstance(message, Input) and frame.origin == 0:
        raise FrameError('origin 0 is the machine controller (3.2), which sends no input')
    source = data.source if isinstance(data, Datagram) else ''
    return Packet(message, frame.serial, frame.origin, frame.crc, source)
