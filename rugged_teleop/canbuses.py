"""A simulated device on a CAN bus, where a bridge finds it as the real one."""

from __future__ import annotations

import socket
import struct

from bridge_core.j1939 import CanFrame
from bridge_core.transports import TransportError
from bridge_core.transports.can import CanTransport
from rugged_teleop.ports import Chunk
from rugged_teleop.ports import Device
from rugged_teleop.ports import DevicePort

INTERFACE = 'udp_multicast'  # a bus of several processes on one machine
_GROUP = '239.255.42.21'
CHANNEL = f'{_GROUP}:43113'
# As the kernel writes an identifier: flags in the three bits above it (linux/can.h). A line that
# flips one of them leaves no data frame.
_IDENTIFIER = struct.Struct('>I')
_EXTENDED, _FLAGS = 0x80000000, 0xE0000000


class CanBusDevice(DevicePort):
    """
    A simulated device on a CAN bus; its ``receive`` and ``poll`` take and give CanFrames.

    Several may share one bus. Unplugged it has left the bus. A bus that is lost unplugs it too.
    In records a frame is its identifier as four bytes, the highest bit set, and its data; see
    ``unpack``.

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
        self.interface, self.channel = interface, channel
        self._port = CanTransport(interface, channel)
        super().__init__(device, self._port.name, seed=seed)

    def _plug(self) -> None:
        try:
            self._port.open()
        except TransportError as error:
            raise OSError(str(error)) from error

    def _unplug_port(self) -> None:
        self._port.close()

    def _descriptor(self) -> int:
        return self._port.fileno()

    def _read_port(self) -> list[bytes]:
        try:
            return [pack(frame) for frame in self._port.receive()]
        except TransportError:
            self._unplug()
            return []

    def _write_port(self, data: bytes) -> int:
        frame = unpack(data)
        try:
            return len(data) if frame is None or self._port.send(frame) else 0
        except TransportError:
            self._unplug()
            return 0

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
