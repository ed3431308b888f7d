"""A simulated device on an IPv4 multicast group, where a bridge finds it as the real one."""

from __future__ import annotations

import contextlib
import socket

from bridge_core.transports.multicast import MulticastTransport
from rugged_teleop.ports import Device
from rugged_teleop.ports import TransportDevice

LOOPBACK = '127.0.0.1'
GROUP = '239.255.42.20'  # this and the port: the VM-110's, as delivered (manual 2.2)
INPUT_PORT = 5825
PORT_OFFSET = 2  # from the port that the bridge receives at to the one that it sends to


class MulticastDevice(TransportDevice):
    """
    A simulated device on a multicast group.

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
        transport = MulticastTransport(
            group, port + PORT_OFFSET, port, interface_address=interface_address
        )
        name = f'{group}:{port} at {interface_address}'
        super().__init__(device, transport, name, seed=seed)


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
