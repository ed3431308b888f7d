# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
UDP over IPv4 multicast: one datagram is one frame.

When an interface disappears, a receiver sees only silence: the kernel drops the group membership
without an error and does not restore it when the interface comes back. So this transport also
listens to the kernel's rtnetlink notifications; a port whose interface is gone, or has lost its
carrier, counts as unplugged, and reopening it joins the group again.
"""

from __future__ import annotations

from collections.abc import Collection
import contextlib
import errno
import fcntl
import ipaddress
import select
import socket
import struct

from bridge_core.framing import Datagram
from bridge_core.transports import TransportError

_READ_SIZE = 2048  # bytes; larger than any frame, so that an over-long one is detected
_READS = 64  # datagrams a call: bounds how long a flood delays a stop
_SIOCGIFFLAGS = 0x8913  # linux/sockios.h
IFF_UP, _IFF_RUNNING = 0x1, 0x40  # linux/if.h; the latter: the cable is in
_IP_MULTICAST_ALL = 49  # linux/in.h; 0: only groups that this socket has joined
_RTMGRP_LINK, _RTMGRP_IPV4_IFADDR = 0x1, 0x10  # linux/rtnetlink.h
_RTM_NEWADDR, _RTM_GETADDR = 20, 22
_NLM_F_REQUEST, _NLM_F_DUMP = 0x1, 0x300  # linux/netlink.h
_NLMSG = struct.Struct('IHHII')  # length, type, flags, sequence number, port
_IFA_LOCAL = 2  # linux/if_addr.h
BUSY = (errno.EAGAIN, errno.ENOBUFS)  # a line that takes nothing now


class MulticastTransport:
    """
    One multicast group: receives on one of its ports and sends to another.

    :param group: IPv4 multicast address. :param input_port: UDP port to receive on.
    :param output_port: UDP port to send to.
    :param ttl: 0-255 hops; 1 stays in the local network.
    :param interface_address: IPv4 address of the network interface; empty: by routing table.
    :param allowed_sources: IPv4 addresses of accepted senders; empty: all.
    :param needs_cable: False where nothing leaves this machine.
    :raises ValueError: for an invalid address.
    """

    def __init__(
        self,
        group: str,
        input_port: int,
        output_port: int,
        *,
        ttl: int = 1,
        interface_address: str = '',
        allowed_sources: Collection[str] = (),
        needs_cable: bool = True,
    ) -> None:
        if not ipaddress.IPv4Address(group).is_multicast:
            raise ValueError(f'{group} is not an IPv4 multicast address')
        self.name = f'{group}:{input_port}'
        if interface_address:
            self.name += f' at {ipaddress.IPv4Address(interface_address)}'
        self.foreign = 0  # datagrams from senders that are not allowed
        self.foreign_source = ''  # the last of these senders
        self._group = group
        self._input_port = input_port
        self._output = (group, output_port)
        self._ttl = ttl
        self._given_address = interface_address
        self._allowed = frozenset(str(ipaddress.IPv4Address(source)) for source in allowed_sources)
        self._flags = IFF_UP | (_IFF_RUNNING if needs_cable else 0)
        self._interface = (0, '')  # index and address
        self._input: socket.socket | None = None
        self._sender: socket.socket | None = None
        self._netlink: socket.socket | None = None
        self._epoll: select.epoll | None = None

    def counts(self) -> dict[str, int | str]:
        """Return the count of datagrams from senders that are not allowed."""
        return {
            'datagrams of other senders': self.foreign,
            'last other sender': self.foreign_source or 'none',
        }

    def open(self) -> None:
        """Join the group. :raises TransportError: with the reason and what to do."""
        self.close()
        try:
            address = self._given_address or self._routed_address()
            # Subscribe to changes before looking, so that none is missed in between.
            self._netlink = _open_netlink()
            self._interface = (_interface_of(address, self._flags), address)
            received = self._open_input(address)
            self._open_sender(address)
            self._epoll = select.epoll()
            self._epoll.register(received, select.EPOLLIN)
            self._epoll.register(self._netlink, select.EPOLLIN)
        except OSError as error:
            self.close()
            raise TransportError(f'cannot open {self.name}: {_explain(error)}') from error

    def close(self) -> None:
        """Leave the group."""
        ports = (self._epoll, self._input, self._sender, self._netlink)
        self._epoll = self._input = self._sender = self._netlink = None
        for port in ports:
            if port is not None:
                with contextlib.suppress(OSError):  # closing what is already gone
                    port.close()

    def fileno(self) -> int:
        """Return the descriptor to wait on; -1 while closed."""
        return -1 if self._epoll is None else self._epoll.fileno()

    def receive(self) -> list[bytes]:
        """Return the arrived Datagrams. :raises TransportError: the interface is gone."""
        if self._input is None:
            raise TransportError(f'{self.name}: not open')
        self._watch_interface()
        datagrams: list[bytes] = []
        try:
            for _ in range(_READS):
                data, source = self._input.recvfrom(_READ_SIZE)
                if self._is_allowed(source[0]):
                    datagrams.append(Datagram(data, '{}:{}'.format(*source)))
        except BlockingIOError:
            pass
        except OSError as error:
            raise TransportError(f'{self.name}: {_explain(error)}') from error
        return datagrams

    def send(self, frame: bytes) -> bool:
        """Send a datagram, or drop it if the buffer is full. :raises TransportError: gone."""
        if self._sender is None:
            raise TransportError(f'{self.name}: not open')
        try:
            self._sender.sendto(frame, self._output)
        except OSError as error:
            if error.errno in BUSY:
                return False
            raise TransportError(f'{self.name}: cannot send, {_explain(error)}') from error
        return True

    def _is_allowed(self, source: str) -> bool:
        if not self._allowed or source in self._allowed:
            return True
        self.foreign += 1
        self.foreign_source = source
        return False

    def _watch_interface(self) -> None:
        """Check the interface after a reported change. :raises TransportError: it is gone."""
        if self._netlink is None or not _drain(self._netlink):
            return
        index, address = self._interface
        try:
            same = _interface_of(address, self._flags) == index
        except OSError as error:
            raise TransportError(f'{self.name}: {_explain(error)}') from error
        if not same:
            raise TransportError(f'{self.name}: {address} has moved to another interface')

    def _routed_address(self) -> str:
        """Return the address of the interface that the routing table selects for the group."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(self._output)
            return str(probe.getsockname()[0])

    def _open_input(self, address: str) -> socket.socket:
        port = self._input = _udp_socket()
        port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        port.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        # Bound to the group, so that other groups and unicast on this port are not received.
        port.bind((self._group, self._input_port))
        member = socket.inet_aton(self._group) + socket.inet_aton(address)
        port.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        return port

    def _open_sender(self, address: str) -> None:
        port = self._sender = _udp_socket()
        interface = socket.inet_aton(address)
        port.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
        port.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, self._ttl)
        # Other processes on this host, such as a simulator, receive it too.
        port.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        port.bind((address, 0))


def _udp_socket() -> socket.socket:
    port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    port.setblocking(False)
    return port


def _open_netlink() -> socket.socket:
    """Return a socket that reports changes of interfaces and addresses."""
    netlink = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE)
    netlink.setblocking(False)
    netlink.bind((0, _RTMGRP_LINK | _RTMGRP_IPV4_IFADDR))
    return netlink


def _drain(netlink: socket.socket) -> bool:
    """Read all notifications; return whether there were any."""
    changed = False
    try:
        while netlink.recv(65536):
            changed = True
    except BlockingIOError:
        pass
    except OSError:  # its buffer overflowed: notifications were lost
        changed = True
    return changed


def _interface_of(address: str, flags: int) -> int:
    """Return the index of the interface with address and flags. :raises OSError: there is none."""
    wanted = socket.inet_aton(address)
    for index, found in addresses():
        if found == wanted and _has(index, flags):
            return index
    raise OSError(errno.ENODEV, f'no network interface with address {address} is up')


def _has(index: int, flags: int) -> bool:
    try:
        return not flags & ~interface_flags(socket.if_indextoname(index))
    except OSError:  # it has just disappeared
        return False


def interface_flags(name: str) -> int:
    """Return the flags of a network interface (linux/if.h). :raises OSError: there is none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        request = struct.pack('16s240x', name.encode())
        answer = fcntl.ioctl(probe, _SIOCGIFFLAGS, request)
    return int(struct.unpack_from('H', answer, 16)[0])


def addresses() -> list[tuple[int, bytes]]:
    """Return (index of the interface, address) for every IPv4 address of this machine."""
    found: list[tuple[int, bytes]] = []
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as netlink:
        netlink.settimeout(0.5)  # the kernel answers at once
        body = struct.pack('BBBBi', socket.AF_INET, 0, 0, 0, 0)
        flags = _NLM_F_REQUEST | _NLM_F_DUMP
        head = _NLMSG.pack(_NLMSG.size + len(body), _RTM_GETADDR, flags, 1, 0)
        netlink.send(head + body)
        while True:
            data = netlink.recv(65536)
            while len(data) >= _NLMSG.size:
                size, kind = _NLMSG.unpack_from(data)[:2]
                if kind != _RTM_NEWADDR:  # end of the list, or an error
                    return found
                found += _addresses_in(data[_NLMSG.size : size])
                data = data[max(size + 3 & ~3, _NLMSG.size) :]


def _addresses_in(message: bytes) -> list[tuple[int, bytes]]:
    """Return the addresses in one RTM_NEWADDR (linux/if_addr.h)."""
    (index,) = struct.unpack_from('i', message, 4)
    attributes, found = message[8:], []
    while len(attributes) >= 4:
        size, kind = struct.unpack_from('HH', attributes)
        if kind == _IFA_LOCAL:
            found.append((index, attributes[4:size]))
        attributes = attributes[max(size + 3 & ~3, 4) :]
    return found


def _explain(error: OSError) -> str:
    """Return the reason and what to do."""
    if error.errno == errno.ENODEV:
        return (
            'no such network interface, or it is down; check its cable and the parameter '
            'interface_address'
        )
    if error.errno in (errno.ENETUNREACH, errno.ENETDOWN, errno.EADDRNOTAVAIL):
        return (
            f'{error.strerror}; no network interface for it is up: check its cable, or set '
            'interface_address'
        )
    if error.errno == errno.EADDRINUSE:
        return 'another program uses this port without sharing it; close that one'
    return error.strerror or str(error)
