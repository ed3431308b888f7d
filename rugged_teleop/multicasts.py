# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated device on an IPv4 multicast group, where a bridge finds it as the real one."""

from __future__ import annotations

from collections.abc import Collection
import contextlib
import errno
import random
import socket

from bridge_core.transports.multicast import MulticastTransport
from rugged_teleop.domains import FIRST_PORT, PORTS
from rugged_teleop.ports import Device, TransportDevice

LOOPBACK = '127.0.0.1'
GROUP = '239.255.42.20'  # this and the port: the VM-110's, as delivered (manual 2.2)
INPUT_PORT = 5825
PORT_OFFSET = 2  # from the port that the bridge receives at to the one that it sends to
_FIRST_EPHEMERAL = 32768  # Linux's default
_UNUSED_OFFSETS = range(2, 8)  # in a domain's block of ports; 0, 1 and those from 10 on are used


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


def free_port(given: Collection[int] = ()) -> int:
    """
    Return a port that, with the one 2 higher, nobody on this machine has at the moment.

    It is one that the system gives to nobody who asks for any, and that DDS leaves out.

    :param given: ports that are somebody's, who has not opened them yet.
    """
    blocks = range(FIRST_PORT, _FIRST_EPHEMERAL - PORTS, PORTS)
    candidates = [block + offset for block in blocks for offset in _UNUSED_OFFSETS]
    random.shuffle(candidates)
    for port in candidates:
        if port in given or port + PORT_OFFSET in given:
            continue
        with contextlib.ExitStack() as sockets, contextlib.suppress(OSError):
            for each in (port, port + PORT_OFFSET):
                found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                sockets.enter_context(found).bind(('', each))
            return port
    raise OSError(errno.EADDRINUSE, 'no free UDP port was found')
