# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""CAN buses that can be had without hardware: filters, counts and losses; the rest is contract."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import os
import socket
import time
from types import SimpleNamespace
from typing import Any

import can
from can.interfaces import slcan
from can.interfaces.udp_multicast.utils import pack_message
import pytest

from bridge_core.j1939 import CanFrame
from bridge_core.transports import TransportError
from bridge_core.transports.can import CanTransport
from bridge_core.transports.can_errors import KINDS, kinds_of
from stage.can_rig import CanBus, error_frame, message, receive, wait_frames
from stage.multicast_rig import in_network_namespace
from stage.port_rig import readable
from stage.rig import Pty, wait_for
from stage.run_delay import RunDelay

pytestmark = pytest.mark.usefixtures('patient_writer')  # their age: test_can_queue.py
LAST = CanFrame(0x18FFFFFE, b'last')  # sent behind others: once it is there, so are they


@pytest.fixture(params=[pytest.param('can_bus', marks=pytest.mark.real_can), 'virtual'])
def bus(request: pytest.FixtureRequest, can_bus: CanBus) -> Iterator[CanBus]:
    result = can_bus if request.param == 'can_bus' else CanBus('virtual', request.node.name)
    yield result
    result.close()


def counted(transport: CanTransport) -> dict[str, Any]:
    return {name: value for name, value in transport.counts().items() if value}


def arrives(peer: can.BusABC, transport: CanTransport) -> list[CanFrame]:
    """Send LAST, and return what has arrived before it."""
    peer.send(message(LAST.identifier, LAST.data))
    frames: list[CanFrame] = []

    def is_there() -> bool:
        frames.extend(transport.receive())
        return LAST in frames

    wait_for(is_there, 5.0, lambda: f'the last of {frames}')
    return frames[: frames.index(LAST)]


def test_identical_frame_of_another_sender_is_not_taken_for_our_own(bus: CanBus) -> None:
    peer, transport = bus.endpoint(), bus.transport()
    ours = CanFrame(0x0CFDD633, bytes(8))
    assert transport.send(ours)
    receive(peer, 0x0CFDD633)
    peer.send(message(0x0CFDD633, bytes(8)))
    assert wait_frames(transport, 1) == [ours]


def test_filters_pass_what_was_asked_for_and_nothing_else(bus: CanBus) -> None:
    peer = bus.endpoint()
    transport = bus.transport([(0x18EF00FF, 0x1FFF00FF), (LAST.identifier, 0x1FFFFFFF)])
    for identifier in (0x18EF33FF, 0x18EF33FE, 0x18EE33FF, 0x18EF34FF, 0x1CEF34FF):
        peer.send(message(identifier))
    peer.send(can.Message(arbitration_id=0xFF, is_extended_id=False))
    assert arrives(peer, transport) == [CanFrame(0x18EF33FF, b''), CanFrame(0x18EF34FF, b'')]


def test_what_is_no_extended_data_frame_is_counted_and_not_handed_up(bus: CanBus) -> None:
    peer, transport = bus.endpoint(fd=True), bus.transport()
    peer.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=b'x'))
    peer.send(can.Message(arbitration_id=0x18FEF533, is_remote_frame=True, dlc=3))
    peer.send(can.Message(arbitration_id=0x18FEF533, is_fd=True, data=bytes(12)))
    assert arrives(peer, transport) == []
    assert counted(transport) == {'standard frames': 1, 'remote frames': 1, 'CAN FD frames': 1}


def test_error_frames_are_counted_by_kind_in_spite_of_filters(bus: CanBus) -> None:
    peer, transport = bus.endpoint(), bus.transport([(LAST.identifier, 0x1FFFFFFF)])
    peer.send(error_frame(0x20))
    peer.send(error_frame(0x04, controller=0x20))
    assert arrives(peer, transport) == []
    assert counted(transport) == {
        'error frames': 2,
        'frames not acknowledged': 1,
        'error passive': 1,
    }


@pytest.mark.parametrize(
    ('error', 'text', 'kinds'),
    [
        (error_frame(0x40), 'bus off; check bit rate, wiring and termination', ['bus off']),
        (
            error_frame(0x04, controller=0x01),
            'frames were lost, and may have said stop',
            ['receive overflows'],
        ),
    ],
)
def test_bus_off_and_lost_frames_are_a_lost_port_that_can_be_opened_again(
    bus: CanBus, error: can.Message, text: str, kinds: list[str]
) -> None:
    peer, transport = bus.endpoint(), bus.transport()
    peer.send(error)
    wait_for(lambda: readable(transport), 5.0, 'the error frame')
    with pytest.raises(TransportError, match=text):
        transport.receive()
    transport.open()
    assert arrives(peer, transport) == []
    assert counted(transport) == {'error frames': 1, **dict.fromkeys(kinds, 1)}


@pytest.mark.parametrize(
    ('make', 'text'),
    [
        (lambda: CanTransport('socket_can', 'can0'), "interface 'socket_can' is unknown"),
        (lambda: CanTransport('socketcan', ''), 'channel is empty'),
        (lambda: CanTransport('socketcan', 'can0', bitrate=250_000), 'bitrate cannot be set for'),
        (lambda: CanTransport('virtual', 'x', bitrate=250_000), 'bitrate cannot be set for'),
        (lambda: CanTransport('udp_multicast', 'can0'), "'can0' is no IPv4 multicast address"),
        (lambda: CanTransport('udp_multicast', '10.0.0.1'), 'is no IPv4 multicast address'),
        (lambda: CanTransport('udp_multicast', '239.1.2.3:0'), 'is no IPv4 multicast address'),
        (lambda: CanTransport('udp_multicast', '239.1.2.3:x'), 'is no IPv4 multicast address'),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(make: Callable[[], Any], text: str) -> None:
    with pytest.raises(ValueError, match=text) as caught:
        make()
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('interface', 'channel', 'text'),
    [
        ('socketcan', 'nocan7', 'there is no CAN interface nocan7; plug it in, or set channel'),
        ('socketcan', 'lo', r'cannot open lo: (there is no CAN|this kernel has no CAN)'),
        ('slcan', '/dev/nothing', 'cannot open slcan /dev/nothing: No such file or directory'),
        ('pcan', 'PCAN_USBBUS1', 'cannot open pcan PCAN_USBBUS1: '),
    ],
)
def test_interface_that_is_not_there_is_told_and_nothing_of_python_can(
    interface: str, channel: str, text: str, capfd: pytest.CaptureFixture[str]
) -> None:
    transport = CanTransport(interface, channel)
    for _ in range(2):
        with pytest.raises(TransportError, match=text):
            transport.open()
    assert transport.fileno() == -1
    assert interface != 'socketcan' or capfd.readouterr() == ('', '')


@pytest.mark.parametrize(
    ('identifier', 'data', 'kinds'),
    [
        (0x001, '', ['transmit timeouts']),
        (0x002, '', ['arbitrations lost']),
        (0x008, '0000800800000000', ['protocol errors']),
        (0x010, '0000000000000000', ['transceiver errors']),
        (0x020, '0000000000000000', ['frames not acknowledged']),
        (0x040, '0000000000000000', ['bus off']),
        (0x080, '0000000000000000', ['bus errors']),
        (0x100, '0000000000000000', ['controller restarts']),
        (0x004, '0001000000000000', ['receive overflows']),
        (0x004, '0002000000000000', ['transmit overflows']),
        (0x004, '0004000000000000', ['error warnings']),
        (0x004, '0008000000000000', ['error warnings']),
        (0x004, '0010000000000000', ['error passive']),
        (0x004, '0020000000000000', ['error passive']),
        (0x004, '0040000000000000', []),  # active again
        (0x004, '00', []),
        (0x001, '0020000000000000', ['transmit timeouts']),  # byte 1 is not the controller's
        (0x0A8, '0000000000000000', ['protocol errors', 'frames not acknowledged', 'bus errors']),
        (0x200, '0000000000001122', []),  # counters alone
    ],
)
def test_error_frame_is_taken_apart(identifier: int, data: str, kinds: list[str]) -> None:
    assert kinds_of(identifier, bytes.fromhex(data)) == kinds
    assert set(kinds) <= set(KINDS)


# Each simulated bus has troubles of its own.


def test_datagram_that_is_no_frame_is_counted(can_bus: CanBus) -> None:
    if can_bus.interface != 'udp_multicast':
        pytest.skip('datagrams are on udp_multicast only')
    group, port = can_bus.channel.split(':')
    peer, transport = can_bus.endpoint(), can_bus.transport()
    too_long = pack_message(can.Message(arbitration_id=1 << 29, is_extended_id=True, check=False))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        for datagram in (b'', b'\xff\x00 no msgpack', b'\x81\xa1x\x01', too_long):
            sender.sendto(datagram, (group, int(port)))
    assert arrives(peer, transport) == []
    assert counted(transport) == {'impossible frames': 4}


def test_without_any_network_the_simulated_bus_is_on_loopback() -> None:
    heard: list[CanFrame] = []

    def talk() -> None:
        one, other = (CanTransport('udp_multicast', '239.255.42.21') for _ in range(2))
        one.open()
        other.open()
        one.send(LAST)
        heard.extend(wait_frames(other, 1))
        one.close()
        other.close()

    in_network_namespace(talk)
    assert heard == [LAST]


def test_serial_adapter_gets_the_bit_rate_carries_frames_and_may_be_unplugged(pty: Pty) -> None:
    transport = CanTransport('slcan', str(pty.path), bitrate=250_000)
    transport.open()
    pty.wait_received(b'S5\r')  # 250 kbit/s
    pty.wait_received(b'O\r')  # on the bus
    pty.write(b'T18FEF53320102\r')
    assert wait_frames(transport, 1) == [CanFrame(0x18FEF533, b'\x01\x02')]
    assert transport.send(CanFrame(0x0CFDD633, b'\xfe\xdc'))
    pty.wait_received(b'T0CFDD6332FEDC\r')
    pty.unplug()
    with pytest.raises(TransportError, match=r'slcan .*device'):
        wait_frames(transport, 1)
    transport.close()


def test_what_a_serial_adapter_says_while_it_opens_is_forgotten(
    pty: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It goes on where one was killed that had it open, and to open it takes 2 s."""
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        pty.write(b'T18FEF53320102\r')

    monkeypatch.setattr(slcan, 'time', SimpleNamespace(sleep=sleep, time=time.time))
    transport = CanTransport('slcan', str(pty.path), bitrate=250_000)
    transport.open()
    assert slept == [2.0]
    pty.write(b'T18FEF53320304\r')
    assert wait_frames(transport, 1) == [CanFrame(0x18FEF533, b'\x03\x04')]
    transport.close()


def test_adapter_that_says_more_than_can_be_read_is_a_lost_bus(pty: Pty) -> None:
    """What waits in the kernel grows old there, and what finds no room may have said stop."""
    transport = CanTransport('slcan', str(pty.path))
    transport.open()
    frame = b'T18FEF53320102\r'
    unsent = b''

    def is_lost() -> bool:
        nonlocal unsent
        unsent = unsent or 100 * frame
        with contextlib.suppress(BlockingIOError):
            unsent = unsent[os.write(pty.master, unsent) :]
        try:
            transport.receive()
        except TransportError as error:
            return 'frames were lost, and may have said stop' in str(error)
        return False

    wait_for(is_lost, 20.0, 'a lost bus', idle=lambda _: None)
    transport.close()


@pytest.mark.parametrize('interface', ['slcan', 'robotell', 'seeedstudio', 'serial'])
def test_serial_adapter_is_for_one_program(pty: Pty, interface: str) -> None:
    first = CanTransport(interface, str(pty.path))
    second = CanTransport(interface, str(pty.path) + '@115200' * (interface == 'slcan'))
    first.open()
    for _ in range(2):
        with pytest.raises(TransportError, match=rf'open {interface} .*: in use by another'):
            second.open()
    if interface == 'slcan':
        pty.write(b'T18FEF53320102\r')
        assert wait_frames(first, 1) == [CanFrame(0x18FEF533, b'\x01\x02')]
    first.close()
    second.open()
    second.close()


def test_line_that_a_serial_adapter_cuts_short_is_a_lost_port(pty: Pty) -> None:
    transport = CanTransport('slcan', str(pty.path))
    transport.open()
    pty.write(b'T0CFD\r')
    with pytest.raises(TransportError, match=r'slcan .*index out of range'):
        wait_frames(transport, 1)
    with pytest.raises(TransportError, match='cannot send'):
        transport.send(LAST)
    transport.close()


def test_serial_adapter_that_takes_nothing_never_blocks_us(pty: Pty) -> None:
    transport = CanTransport('slcan', str(pty.path))
    transport.open()
    sent = sum(transport.send(LAST) for _ in range(5000))
    assert 0 < sent < 5000
    before, delay = time.monotonic(), RunDelay([])
    transport.close()
    assert time.monotonic() - before < 2.0 + delay.seconds()


def test_flood_that_nobody_reads_is_counted_and_loses_the_bus() -> None:
    """What was thrown away may have said stop."""
    bus = CanBus('virtual', 'flood')
    peer, transport = bus.endpoint(), bus.transport()
    for number in range(1500):
        peer.send(message(number))
    peer.send(message(LAST.identifier, LAST.data))
    lost = 1501 - 1024
    wait_for(lambda: counted(transport) == {'receive overflows': lost}, 5.0, 'the flood')
    with pytest.raises(TransportError, match='frames were lost, and may have said stop'):
        transport.receive()
    transport.open()
    assert arrives(peer, transport) == []
    bus.close()


def test_frame_that_cannot_be_is_counted() -> None:
    bus = CanBus('virtual', 'impossible')
    peer, transport = bus.endpoint(), bus.transport()
    peer.send(can.Message(arbitration_id=1 << 29, is_extended_id=True, check=False))
    assert arrives(peer, transport) == []
    assert counted(transport) == {'impossible frames': 1}
    bus.close()
