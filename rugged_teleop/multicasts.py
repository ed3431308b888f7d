"""A simulated device on an IPv4 multicast group, where a bridge finds it as the real one."""

from __future__ import annotations

import contextlib
import socket

from bridge_core.transports import TransportError
from bridge_core.transports.multicast import MulticastTransport
from rugged_teleop.ports import Device
from rugged_teleop.ports import DevicePort

LOOPBACK = '127.0.0.1'
GROUP = '239.255.42.20'  # this and the port: the VM-110's, as delivered (manual 2.2)
INPUT_PORT = 5825
PORT_OFFSET = 2  # from the port that the bridge receives at to the one that it sends to


class MulticastDevice(DevicePort):
    """
    A simulated device on a multicast group.

    Unplugged it has left the group. A network interface that vanishes unplugs it too.

    :param port: UDP port that the bridge receives at (its ``input_port``); the device receives at
        the one 2 higher.
    :param seed: makes the line's faults repeat themselves. None: they differ from run to run.
    :raises OSError: the group cannot be joined. :raises ValueError: an address that is none.
    """

    def __init__(
        self,
        device: Device,
        port: int,
        *,
        group: str = GROUP,
        interface_address: str = LOOPBACK,
        seed: int | None = None,
    ) -> None:
        self.port = port
        self._port = MulticastTransport(
            group, port + PORT_OFFSET, port, interface_address=interface_address
        )
        super().__init__(device, f'{group}:{port} at {interface_address}', seed=seed)

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
            return self._port.receive()
        except TransportError:
            self._unplug()
            return []

    def _write_port(self, data: bytes) -> int:
        try:
            return len(data) if self._port.send(data) else 0
        except TransportError:
            self._unplug()
            return 0


def free_port() -> int:
    """Return a port that, with the one 2 higher, nobody on this machine has at the moment."""
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first:
            first.bind(('', 0))
            port = int(first.getsockname()[1])
            second = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            with second, contextlib.suppress(OSError, OverflowError):
                second.bind(('', port + PORT_OFFSET))
                return port
