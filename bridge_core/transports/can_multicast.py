# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A simulated bus on UDP multicast, python-can's ``udp_multicast``; it never leaves this machine.

Only the wire format is python-can's: its own class returns our own frames to us, needs a network,
and may send joystick commands out into it.
"""

from __future__ import annotations

from collections import Counter
import math
import uuid

import can
from can.interfaces.udp_multicast import utils as multicast_wire

from bridge_core.j1939 import CanFrame
from bridge_core.transports import TransportError
from bridge_core.transports.can_channel import multicast_address
from bridge_core.transports.can_messages import message_of, raw_frame
from bridge_core.transports.can_port import Filters, passes, RawFrame
from bridge_core.transports.multicast import MulticastTransport


class MulticastPort:
    """
    One such bus.

    :param channel: IPv4 multicast address, optionally with ``:port``.
    :param counts: gets the number of impossible frames.
    :raises ValueError: for a bad channel. :raises TransportError: no network, not even loopback.
    """

    def __init__(self, channel: str, filters: Filters, counts: Counter[str]) -> None:
        self._filters = filters
        self._counts = counts
        self._token = uuid.uuid4().hex  # marks our own frames, which the group returns to us
        multicast_wire.pack_message(can.Message())  # raises if msgpack is missing
        self._udp = _open_multicast(*multicast_address(channel))

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._udp.fileno()

    def read(self) -> list[RawFrame]:
        """Return other senders' frames that pass the filters."""
        frames = (self._unpack(datagram) for datagram in self._udp.receive())
        return [frame for frame in frames if frame is not None]

    def write(self, frame: CanFrame) -> bool:
        """Send a datagram."""
        message = message_of(frame)
        message.channel = self._token
        return self._udp.send(multicast_wire.pack_message(message))

    def stuck_since(self) -> float:
        """Return that datagrams get out."""
        return math.inf

    def close(self) -> None:
        """Leave the group."""
        self._udp.close()

    def _unpack(self, datagram: bytes) -> RawFrame | None:
        try:
            message = multicast_wire.unpack_message(datagram, check=True)
        except Exception:  # msgpack and python-can raise many kinds
            self._counts['impossible frames'] += 1
            return None
        frame = raw_frame(message)
        if message.channel == self._token or not passes(frame, self._filters):
            return None
        return frame


def _open_multicast(group: str, port: int) -> MulticastTransport:
    """Open on the same interface as python-can, or on loopback if there is no network."""
    udp = MulticastTransport(group, port, port, ttl=0, needs_cable=False)
    try:
        udp.open()
    except TransportError:
        udp = MulticastTransport(group, port, port, ttl=0, interface_address='127.0.0.1')
        udp.open()
    return udp
