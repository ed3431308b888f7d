# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A CAN bus for tests, and whoever else is on it.

Take the fixture ``can_bus``; it gives every test a bus of its own:

    def test_it(can_bus: CanBus) -> None:
        node_parameters = {'interface': can_bus.interface, 'channel': can_bus.channel}
        peer = can_bus.endpoint()           # a python-can bus: send, recv(timeout)
        peer.send(message(0x18FEF533, b'...'))
        transport = can_bus.transport()     # a CanTransport, open

Both are closed when the test ends. The bus is python-can's ``udp_multicast``, which reaches other
processes and stays on this machine, or with ``RUGGED_TELEOP_CAN=socketcan`` a virtual interface of
the kernel. What such an interface changes has the mark ``real_can`` and runs there, inside
user-mode-linux (test_uml.py). That is slow, and has one processor: wait with ``wait_for``, whose
deadlines are longer there. A rig of several buses, or for a module, calls ``make_bus``.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import itertools
import os
import socket
import struct
import subprocess
import time
from typing import Any

import can
import pytest

from bridge_core.j1939 import CanFrame
from bridge_core.transports.can import CanTransport
from rugged_teleop.canbuses import channel_of, INTERFACE
from stage.link_rig import Bench, FakeSession, Output
from stage.multicast_rig import free_port, run_ip
from stage.rig import TIMEOUT_FACTOR, wait_for

VARIABLE = 'RUGGED_TELEOP_CAN'
_ANY_GROUP = '239.255.42.21'
_numbers = itertools.count(1)
HELLO = CanFrame(0x18EAFF33, b'\x00\xee\x00')


class CanBus:
    """One bus: ``interface`` and ``channel`` as nodes and python-can want them."""

    def __init__(self, interface: str, channel: str) -> None:
        self.interface, self.channel = interface, channel
        self._endpoints: list[can.BusABC] = []
        self._transports: list[CanTransport] = []

    def endpoint(self, **options: Any) -> can.BusABC:
        """Return another one on the bus, in python-can's own words. :param options: for can.Bus"""
        channel = self.channel
        if self.interface == INTERFACE:
            channel, port = channel.split(':')
            options = {'port': int(port), 'hop_limit': 0, **options}
        if self.interface == 'virtual':
            options.pop('fd', None)  # it carries such frames anyway
        bus = can.Bus(interface=self.interface, channel=channel, ignore_config=True, **options)
        self._endpoints.append(bus)
        return bus

    def transport(self, filters: Sequence[tuple[int, int]] = ()) -> CanTransport:
        """Return a transport of ours on the bus, open."""
        transport = CanTransport(self.interface, self.channel, filters=filters)
        transport.open()
        self._transports.append(transport)
        return transport

    def close(self) -> None:
        """Close all that was given out."""
        for port in self._transports:
            port.close()
        for bus in self._endpoints:
            bus.shutdown()


class VirtualInterface(CanBus):
    """A virtual CAN interface of the kernel, made by ``ip``, as root."""

    def __init__(self) -> None:
        super().__init__('socketcan', f'vcan{os.getpid()}n{next(_numbers)}')
        self.create()

    def create(self) -> None:
        """Make it, up."""
        run_ip('link', 'add', self.channel, 'type', 'vcan')
        self.up()

    def delete(self) -> None:
        """Take it away."""
        run_ip('link', 'delete', self.channel)

    def up(self) -> None:
        """Bring it up."""
        run_ip('link', 'set', self.channel, 'up')

    def down(self) -> None:
        """Take it down."""
        run_ip('link', 'set', self.channel, 'down')

    def close(self) -> None:
        """Take it away, if it is still there."""
        super().close()
        with contextlib.suppress(subprocess.CalledProcessError):
            self.delete()


def make_bus() -> CanBus:
    """Return a bus that nobody else uses, of the kind that the environment names."""
    if os.environ.get(VARIABLE) == 'socketcan':
        return VirtualInterface()
    if not _is_routed():
        pytest.skip('python-can finds no network for udp_multicast')
    return CanBus(INTERFACE, free_channel())


def message(identifier: int, data: bytes = b'') -> can.Message:
    """Return python-can's form of an extended data frame."""
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=True)


def error_frame(kind: int, controller: int = 0) -> can.Message:
    """Return what a driver reports (linux/can/error.h). :param controller: byte 1, for 0x04."""
    data = bytes((0, controller, 0, 0, 0, 0, 0, 0))
    return can.Message(arbitration_id=kind, data=data, is_error_frame=True, is_extended_id=False)


def frame(received: can.Message) -> CanFrame:
    """Return ours."""
    return CanFrame(received.arbitration_id, bytes(received.data))


def receive(bus: can.BusABC, identifier: int, timeout: float = 5.0) -> CanFrame:
    """Return the next frame with this identifier. :raises AssertionError: none within time."""
    timeout *= TIMEOUT_FACTOR
    end = time.monotonic() + timeout
    while (left := end - time.monotonic()) > 0:
        received = bus.recv(left)
        if received is not None and received.arbitration_id == identifier:
            return frame(received)
    raise AssertionError(f'no frame {identifier:08X} within {timeout} s')


def drain(bus: can.BusABC) -> list[CanFrame]:
    """Return all that is there."""
    frames = []
    while (received := bus.recv(0)) is not None:
        frames.append(frame(received))
    return frames


def wait_frames(transport: CanTransport, count: int) -> list[CanFrame]:
    """Return at least ``count`` frames."""
    frames: list[CanFrame] = []

    def enough() -> bool:
        frames.extend(transport.receive())
        return len(frames) >= count

    wait_for(enough, 5.0, lambda: f'{count} frames, not {frames}')
    return frames


def _is_routed() -> bool:
    """Tell whether some interface takes multicast: without any, python-can does not open."""
    member = struct.pack('4sI', socket.inet_aton(_ANY_GROUP), socket.INADDR_ANY)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        except OSError:
            return False
    return True


def free_channel() -> str:
    """Return a channel that no neighbour and no other test uses."""
    return channel_of(free_port())


class CanSession(FakeSession):
    """Keeps the frames that come; says HELLO on an open bus."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[CanFrame] = []

    def opened(self, now: float) -> Output:
        super().opened(now)
        return [], [HELLO]

    def receive(self, data: Any, now: float) -> Output:
        self.heard.append(data)
        return super().receive(b'x', now)

    def farewell(self, now: float) -> list[Any]:
        return [CanFrame(0x0CFDD633, bytes(8))]


def activate(bench: Bench, bus: CanBus) -> CanTransport:
    """Have a link open the bus; return its port."""
    transport = CanTransport(bus.interface, bus.channel)
    bench.transport = transport
    bench.activate()
    wait_for(lambda: bench.status.is_open, 5.0, 'an open bus')
    return transport
