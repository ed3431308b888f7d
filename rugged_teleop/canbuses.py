# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated device on a CAN bus, for a bridge to use in place of the real one."""

from __future__ import annotations

import struct

from bridge_core.j1939 import CanFrame
from rugged_teleop.multicasts import free_port
from rugged_teleop.ports import Chunk, Device, TransportDevice

INTERFACE = 'udp_multicast'  # a bus of several processes on one machine
_GROUP = '239.255.42.21'
CHANNEL = f'{_GROUP}:43113'
# As in linux/can.h: the three highest bits are flags. A frame in which a simulated fault flips one
# of them is no data frame any more.
_IDENTIFIER = struct.Struct('>I')
_EXTENDED, _FLAGS = 0x80000000, 0xE0000000


class CanBusDevice(TransportDevice):
    """
    A simulated device on a CAN bus; its ``receive`` and ``poll`` take and return CanFrames.

    Several may share one bus. Records hold a frame as bytes: its identifier (four bytes, the
    highest bit set), then its data; see ``unpack``.

    :param interface: kind of interface, as python-can names it. :param channel: which one.
    :param seed: makes the simulated faults reproducible. None: they differ from run to run.
    :raises OSError: the bus cannot be joined. :raises ValueError: a bad interface or channel.
    """

    def __init__(
        self,
        device: Device,
        channel: str,
        *,
        interface: str = INTERFACE,
        seed: int | None = None,
    ) -> None:
        # A lazy import: python-can is slow to import, and needed for CAN devices only.
        from bridge_core.transports.can import CanTransport

        self.interface, self.channel = interface, channel
        transport = CanTransport(interface, channel)
        super().__init__(device, transport, transport.name, seed=seed)

    def _pack(self, frame: CanFrame) -> bytes:
        return pack(frame)

    def _unpack(self, data: bytes) -> CanFrame | None:
        return unpack(data)


def pack(frame: CanFrame) -> bytes:
    """Return a frame as bytes, as in records."""
    return _IDENTIFIER.pack(frame.identifier | _EXTENDED) + frame.data


def unpack(data: bytes) -> CanFrame | None:
    """Return the frame; None if it is not an extended data frame."""
    (identifier,) = _IDENTIFIER.unpack_from(data)
    if identifier & _FLAGS != _EXTENDED:
        return None
    return CanFrame(identifier & ~_FLAGS, data[_IDENTIFIER.size :])


def frames(chunks: list[Chunk]) -> list[CanFrame]:
    """Return the frames in a device's records."""
    return [frame for chunk in chunks if (frame := unpack(chunk.data)) is not None]


def free_channel() -> str:
    """Return a channel of INTERFACE that is not in use on this machine; see ``free_port``."""
    return channel_of(free_port())


def channel_of(port: int) -> str:
    """Return the channel of INTERFACE at a UDP port."""
    return f'{_GROUP}:{port}'
