# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The multicast port: who hears whom, and interfaces that vanish and come back."""

from collections.abc import Callable, Iterator
import contextlib
import errno
import functools
import socket
from typing import Any

import pytest

from bridge_core.transports import multicast, TransportError
from bridge_core.transports.multicast import MulticastTransport
from rugged_teleop.multicasts import GROUP, LOOPBACK
from stage.multicast_rig import free_port, in_network_namespace, run_ip
from stage.port_rig import readable
from stage.rig import wait_for

Ports = tuple[MulticastTransport, MulticastTransport]


def in_a_network_of_its_own(test: Callable[..., None]) -> Callable[..., None]:
    @functools.wraps(test)
    def run(**given: Any) -> None:
        in_network_namespace(lambda: test(**given))

    return run


def pair(port: int, address: str = LOOPBACK, **options: Any) -> Ports:
    """Return both ends, not yet open: ours, and the device's."""
    ours = MulticastTransport(GROUP, port, port + 2, interface_address=address, **options)
    return ours, MulticastTransport(GROUP, port + 2, port, interface_address=address)


@contextlib.contextmanager
def opened(*ports: MulticastTransport) -> Iterator[Any]:
    """Open them; close them in the end."""
    with contextlib.ExitStack() as stack:
        for each in ports:
            each.open()
            stack.callback(each.close)
        yield ports


@pytest.fixture
def ends() -> Iterator[Ports]:
    with opened(*pair(free_port())) as ports:
        yield ports


def heard(transport: MulticastTransport) -> list[bytes]:
    """Return the next datagrams. :raises AssertionError: none comes."""
    return wait_for(lambda: transport.receive() if readable(transport) else [], 2.0)


def test_datagrams_keep_their_bounds_both_ways(ends: Ports) -> None:
    ours, theirs = ends
    for size in (0, 1, 66, 512, 513, 1400, 9000):
        assert theirs.send(bytes(size))
        assert heard(ours) == [bytes(min(size, 2048))]  # one that is longer is told by its length
    assert ours.send(b'out')
    assert heard(theirs) == [b'out']


@pytest.mark.parametrize('option', [socket.SO_REUSEADDR, socket.SO_REUSEPORT])
def test_port_is_shared_with_a_program_that_knows_one_way_to_share(option: int) -> None:
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, option, 1)
        other.bind(('', port))
        with opened(pair(port)[0]):
            pass


def test_other_group_and_unicast_on_the_same_port_are_not_heard(ends: Ports) -> None:
    ours, theirs = ends
    port = int(ours.name.split(':')[1].split()[0])
    other = MulticastTransport('239.255.42.21', port, port, interface_address=LOOPBACK)
    with opened(other), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unicast:
        other.send(b'another group')
        unicast.sendto(b'unicast', (LOOPBACK, port))
        assert heard(other) == [b'another group']
        theirs.send(b'ours')
        assert heard(ours) == [b'ours']


def test_sources_that_are_not_allowed_are_counted_and_dropped() -> None:
    port = free_port()
    ends = pair(port, allowed_sources=['127.0.0.2', '127.0.0.3'])
    with opened(*ends) as (ours, theirs), socket.socket(type=socket.SOCK_DGRAM) as allowed:
        allowed.bind(('127.0.0.2', 0))
        address = socket.inet_aton('127.0.0.1')
        allowed.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, address)
        theirs.send(b'foreign')
        allowed.sendto(b'allowed', (GROUP, port))
        assert heard(ours) == [b'allowed']
        assert (ours.foreign, ours.foreign_source) == (1, LOOPBACK)


def test_interface_that_does_not_exist_is_named_with_what_to_do() -> None:
    ours = pair(free_port(), '192.0.2.99')[0]
    with pytest.raises(TransportError, match='interface_address'):
        ours.open()
    assert ours.fileno() == -1


@pytest.mark.parametrize(
    ('group', 'options'),
    [
        ('127.0.0.1', {}),
        ('nonsense', {}),
        (GROUP, {'interface_address': 'eth0'}),
        (GROUP, {'allowed_sources': ['somebody']}),
    ],
)
def test_bad_address_is_refused(group: str, options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r'\w'):
        MulticastTransport(group, 5825, 5827, **options)


def test_time_to_live_is_set() -> None:
    sender = pair(free_port(), ttl=3)[0]
    sender.open()
    with contextlib.closing(sender):
        assert sender._sender is not None
        ttl = sender._sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL)
    assert ttl == 3


class Broken:
    """A socket whose kernel says no."""

    def __init__(self, number: int) -> None:
        self._number = number

    def sendto(self, *_: Any) -> None:
        raise OSError(self._number, errno.errorcode[self._number])

    recvfrom = sendto

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ('number', 'is_lost'),
    [
        *((number, True) for number in (errno.ENODEV, errno.ENETDOWN, errno.ENETUNREACH)),
        *((errno.EPERM, True), (errno.EAGAIN, False), (errno.ENOBUFS, False)),
    ],
)
def test_refused_by_the_kernel_is_a_lost_port_and_a_busy_line_drops(
    ends: Ports, number: int, is_lost: bool
) -> None:
    ours = ends[0]
    ours._sender = Broken(number)  # type: ignore[assignment]
    if not is_lost:
        assert not ours.send(b'')
        return
    with pytest.raises(TransportError, match='cannot send'):
        ours.send(b'')
    ours._input = Broken(number)  # type: ignore[assignment]
    with pytest.raises(TransportError):
        ours.receive()


@in_a_network_of_its_own
def test_every_address_of_an_interface_is_found() -> None:
    add_cable()
    run_ip('address', 'add', '192.0.2.3/24', 'dev', 'near')
    for address in ('192.0.2.1', '192.0.2.3', LOOPBACK):
        with opened(pair(free_port(), address)[0]):
            pass


# -- interfaces that go and come ------------------------------------------------------------------


def add_cable() -> None:
    """Add a network interface with address 192.0.2.1, and plug it in."""
    run_ip('link', 'add', 'near', 'type', 'veth', 'peer', 'name', 'far')
    run_ip('address', 'add', '192.0.2.1/24', 'dev', 'near')
    run_ip('link', 'set', 'near', 'up')
    run_ip('link', 'set', 'far', 'up')
    wait_for(is_plugged, 5.0, 'the cable')


def is_plugged() -> bool:
    """Tell whether the kernel has seen so: that may take a second."""
    return multicast._has(socket.if_nametoindex('near'), 0x41)


@pytest.mark.parametrize(
    ('leave', 'come_back'),
    [
        ('link delete near', ''),
        ('link set near down', 'link set near up'),
        ('link set far down', 'link set far up'),
        ('address del 192.0.2.1/24 dev near', 'address add 192.0.2.1/24 dev near'),
    ],
    ids=['deleted', 'down', 'unplugged', 'without address'],
)
@in_a_network_of_its_own
def test_vanished_interface_is_noticed_without_sending_and_joined_again(
    leave: str, come_back: str
) -> None:
    add_cable()
    with opened(*pair(free_port(), '192.0.2.1')) as (ours, theirs):
        theirs.send(b'before')
        assert heard(ours) == [b'before']
        run_ip(*leave.split())

        def lost() -> bool:
            readable(ours)
            try:
                ours.receive()
            except TransportError as error:
                return 'interface' in str(error)
            return False

        wait_for(lost, 5.0, 'the loss of the interface')
        ours.close()
        with pytest.raises(TransportError, match='interface'):
            ours.open()
        run_ip(*come_back.split()) if come_back else add_cable()
        wait_for(is_plugged, 5.0, 'the cable')
        ours.open()
        theirs.close()
        theirs.open()
        theirs.send(b'after')
        assert heard(ours) == [b'after']


@in_a_network_of_its_own
def test_cable_is_of_no_matter_where_nothing_leaves_the_machine() -> None:
    add_cable()
    with opened(*pair(free_port(), '192.0.2.1', needs_cable=False)) as (ours, theirs):
        run_ip('link', 'set', 'far', 'down')
        wait_for(lambda: not is_plugged(), 5.0, 'the loss of the cable')
        assert ours.receive() == []
        theirs.send(b'beside us')
        assert heard(ours) == [b'beside us']
        ours.close()
        ours.open()


@in_a_network_of_its_own
def test_change_of_another_interface_is_no_loss() -> None:
    add_cable()
    with opened(pair(free_port())[0]) as (ours,):
        run_ip('link', 'delete', 'near')
        assert readable(ours, 2.0)
        assert ours.receive() == []


@in_a_network_of_its_own
def test_without_an_address_the_routing_table_decides() -> None:
    port = free_port()
    ours = MulticastTransport(GROUP, port, port + 2)
    with pytest.raises(TransportError, match='set interface_address'):
        ours.open()
    add_cable()
    run_ip('route', 'add', '239.0.0.0/8', 'dev', 'near')
    with opened(ours, pair(port, '192.0.2.1')[1]) as (_, theirs):
        theirs.send(b'routed')
        assert heard(ours) == [b'routed']


def test_lost_announcements_are_a_change(ends: Ports, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = ends[0]
    looked: list[str] = []

    def look(address: str, flags: int) -> int:
        looked.append(address)
        return 1

    ours._netlink = Deaf()  # type: ignore[assignment]
    monkeypatch.setattr(multicast, '_interface_of', look)
    with contextlib.suppress(TransportError):
        ours.receive()
    assert looked == [LOOPBACK]


class Deaf:
    def recv(self, size: int) -> bytes:
        raise OSError(errno.ENOBUFS, 'there were too many')

    def close(self) -> None:
        pass
