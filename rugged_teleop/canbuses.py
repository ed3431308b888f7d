"""A simulated device on a CAN bus, where a bridge finds it as the real one."""

from __future__ import annotations

import socket
import struct

from bridge_core.j1939 import CanFrame
from rugged_teleop.ports import Chunk
from rugged_teleop.ports import Device
from rugged_teleop.ports import TransportDevice

INTERFACE = 'udp_multicast'  # a bus of several processes on one machine
_GROUP = '239.255.42.21'
CHANNEL = f'{_GROUP}:43113'
# As the kernel writes an identifier: flags in the three bits above it (linux/can.h). A line that
# flips one of them leaves no data frame.
_IDENTIFIER = struct.Struct('>I')
_EXTENDED, _FLAGS = 0x80000000, 0xE0000000


class CanBusDevice(TransportDevice):
    """
    A simulated device on a CAN bus; its ``receive`` and ``poll`` take and give CanFrames.

    Several may share one bus. In records a frame is its identifier as four bytes, the highest bit
    set, and its data; see ``unpack``.

    :param interface: python-can's name of a kind of interface. :param channel: which one.
    :param seed: makes the line's faults repeat themselves. None: they differ from run to run.
    :raises OSError: the bus cannot be joined. :raises ValueError: for what cannot be.
    """

    def __init__(
        self,
        device: Device,
        channel: str,
        *,
        interface: str = INTERFACE,
        seed: int | None = None,
    ) -> None:
        # Late: who simulates nothing on CAN need not have python-can, nor wait for its import.
        from bridge_core.transports.can import CanTransport

        self.interface, self.channel = interface, channel
        transport = CanTransport(interface, channel)
        super().__init__(device, transport, transport.name, seed=seed)

    def _pack(self, frame: CanFrame) -> bytes:
        return pack(frame)

    def _unpack(self, data: bytes) -> CanFrame | None:
        return unpack(data)


def pack(frame: CanFrame) -> bytes:
    """Return a frame as lines and records carry it."""
    return _IDENTIFIER.pack(frame.identifier | _EXTENDED) + frame.data


def unpack(data: bytes) -> CanFrame | None:
    """Return the frame again; None if it is no extended data frame any more."""
    (identifier,) = _IDENTIFIER.unpack_from(data)
    if identifier & _FLAGS != _EXTENDED:
        return None
    return CanFrame(identifier & ~_FLAGS, data[_IDENTIFIER.size :])


def frames(chunks: list[Chunk]) -> list[CanFrame]:
    """Return the frames among what a device has recorded."""
    return [frame for chunk in chunks if (frame := unpack(chunk.data)) is not None]


def free_channel() -> str:
    """Return a channel of INTERFACE that nobody on this machine has at the moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('', 0))
        return f'{_GROUP}:{probe.getsockname()[1]}'
