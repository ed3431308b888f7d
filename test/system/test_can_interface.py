# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A real CAN interface of the kernel that goes down, vanishes, fills up or leaves the bus.

Runs where the kernel has SocketCAN and we may make interfaces, which is inside user-mode-linux
(test_uml.py).
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import fcntl
import os
import select
import struct
import subprocess
import termios
import threading
import time
import tty
from typing import Any

import pytest

from bridge_core.j1939 import CanFrame
from bridge_core.transports import TransportError
from bridge_core.transports.can import CanTransport
from bridge_core.transports.can_port import READS
from stage.can_rig import (
    activate,
    CanBus,
    CanSession,
    message,
    receive,
    VARIABLE,
    VirtualInterface,
    wait_frames,
)
from stage.link_rig import Bench
from stage.multicast_rig import run_ip
from stage.rig import wait_for

pytestmark = [
    pytest.mark.real_can,
    pytest.mark.skipif(
        os.environ.get(VARIABLE) != 'socketcan',
        reason='makes CAN interfaces; runs inside user-mode-linux',
    ),
]
FRAME = CanFrame(0x0CFDD633, bytes(8))


@pytest.fixture
def interface(can_bus: CanBus) -> VirtualInterface:
    assert isinstance(can_bus, VirtualInterface)
    return can_bus


@pytest.fixture
def session(bench: Bench) -> Iterator[CanSession]:
    session = CanSession()
    bench.session = session
    yield session
    bench.link.stop()


def wait_lost(transport: CanTransport) -> TransportError:
    """Return why the transport is lost; select must have told that it is."""
    wait_for(lambda: select.select([transport.fileno()], [], [], 0)[0], 5.0, 'a sign')
    with pytest.raises(TransportError) as caught:
        transport.receive()
    return caught.value


# The transport alone.


def test_interface_that_goes_down_is_lost_with_words_how_to_bring_it_up(
    interface: VirtualInterface,
) -> None:
    transport = interface.transport()
    interface.down()
    text = f'the interface is down; `ip link set {interface.channel} up type can bitrate 250000'
    assert text in str(wait_lost(transport))
    with pytest.raises(TransportError, match=r'cannot open .*: the interface is down'):
        transport.open()
    interface.up()
    transport.open()
    interface.endpoint().send(message(1, b'again'))
    assert wait_frames(transport, 1) == [CanFrame(1, b'again')]


def test_deleted_interface_is_lost_and_found_when_made_again(interface: VirtualInterface) -> None:
    transport = interface.transport()
    interface.delete()
    assert f'there is no CAN interface {interface.channel}' in str(wait_lost(transport))
    with pytest.raises(TransportError, match=f'there is no CAN interface {interface.channel}'):
        transport.open()
    interface.create()
    transport.open()
    interface.endpoint().send(message(1, b'new'))
    assert wait_frames(transport, 1) == [CanFrame(1, b'new')]


def test_confirmation_that_waits_unread_is_no_reason_to_drop_a_stop(
    interface: VirtualInterface,
) -> None:
    peer, transport = interface.endpoint(), interface.transport()
    assert transport.send(CanFrame(1, b'motion'))
    receive(peer, 1)
    peer.send(message(2, b'other'))
    begin = time.monotonic()
    wait_for(lambda: time.monotonic() > begin + 0.05, 5.0, 'a pause of ours')
    assert transport.send(CanFrame(1, b'stop'))
    receive(peer, 1)
    assert select.select([transport.fileno()], [], [], 0)[0]
    assert transport.receive() == [CanFrame(2, b'other')]


@pytest.mark.parametrize(
    ('loss', 'text'), [('down', 'interface is down'), ('delete', 'interface')]
)
def test_sending_to_an_interface_that_is_gone_says_so(
    interface: VirtualInterface, loss: str, text: str
) -> None:
    transport = interface.transport()
    getattr(interface, loss)()
    for _ in range(2):  # a pending error of the socket comes out once only
        with pytest.raises(TransportError, match=f'cannot send, .*{text}'):
            transport.send(FRAME)


def test_queue_that_is_full_drops_frames_and_goes_on_when_there_is_room(
    interface: VirtualInterface,
) -> None:
    peer, transport = interface.endpoint(), interface.transport()
    # It holds frames back, and no more than 400 bytes of them: then the kernel says ENOBUFS.
    queue = ('dev', interface.channel, 'root', 'plug')
    subprocess.run(['tc', 'qdisc', 'add', *queue, 'limit', '400'], check=True)
    sent = [transport.send(FRAME) for _ in range(100)]
    assert sent[0] is True
    assert sent[-1] is False
    assert transport.receive() == []
    subprocess.run(['tc', 'qdisc', 'delete', *queue], check=True)
    # Frames that never reached the bus are taken for old for half a second.
    wait_for(lambda: transport.send(CanFrame(1, b'room')), 5.0, 'a frame that is sent')
    assert receive(peer, 1) == CanFrame(1, b'room')


def test_socket_that_takes_no_more_drops_frames_without_waiting(
    interface: VirtualInterface,
) -> None:
    transport = interface.transport()
    queue = ('dev', interface.channel, 'root', 'plug')
    subprocess.run(['tc', 'qdisc', 'add', *queue, 'limit', '100000000'], check=True)
    begin = time.monotonic()
    wait_for(lambda: not all(transport.send(FRAME) for _ in range(100)), 20.0, 'a full socket')
    assert time.monotonic() - begin < 20.0
    subprocess.run(['tc', 'qdisc', 'delete', *queue], check=True)
    wait_for(lambda: transport.send(FRAME), 5.0, 'room')


def test_frames_that_the_kernel_has_lost_are_a_lost_port(interface: VirtualInterface) -> None:
    """They may have said stop; the socket holds some hundred, and the next one tells."""
    peer, transport = interface.endpoint(), interface.transport()
    for number in range(2000):
        peer.send(message(number))
    assert len(list(iter(transport.receive, []))) * READS < 2000
    peer.send(message(1))
    with pytest.raises(TransportError, match='frames were lost, and may have said stop'):
        list(iter(transport.receive, []))
    transport.open()
    peer.send(message(1, b'again'))
    assert wait_frames(transport, 1) == [CanFrame(1, b'again')]


def test_kernel_filters_keep_foreign_traffic_from_waking_us(interface: VirtualInterface) -> None:
    peer, transport = interface.endpoint(), interface.transport([(1, 0x1FFFFFFF)])
    witness = interface.transport()
    for _ in range(50):
        peer.send(message(2))
    wait_frames(witness, 50)
    assert not select.select([transport.fileno()], [], [], 0)[0]
    peer.send(message(1))
    assert wait_frames(transport, 1) == [CanFrame(1, b'')]


# With a link around it.


def test_link_tells_the_loss_sleeps_and_comes_back(
    interface: VirtualInterface, bench: Bench, session: CanSession
) -> None:
    transport = activate(bench, interface)
    peer = interface.endpoint()
    peer.send(message(1))
    wait_for(lambda: not session.estop, 5.0, 'health')
    interface.down()
    wait_for(lambda: not bench.status.is_open, 5.0, 'the loss')
    assert session.estop
    assert bench.steps_within(1.0) < 1.0 / 0.02 + 60
    assert len([line for line in bench.owner.log if line.startswith('bad')]) <= 2, bench.owner.log
    interface.up()
    wait_for(lambda: bench.status.is_open, 5.0, 'the bus')
    assert bench.status.opens == 2
    interface.endpoint().send(message(2, b'back'))
    wait_for(lambda: CanFrame(2, b'back') in session.heard, 5.0, 'frames')
    assert transport.fileno() >= 0


# A controller with states, as a serial adapter that the kernel drives (drivers/net/can/slcan).


class Controller:
    """The kernel's slcan driver on a pseudo-terminal; we are the adapter."""

    _LINE_DISCIPLINE = 17  # N_SLCAN, linux/tty.h
    _GET_NAME = 0x8910  # SIOCGIFNAME, linux/sockios.h

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        fcntl.ioctl(self._slave, termios.TIOCSETD, struct.pack('i', self._LINE_DISCIPLINE))
        answer = fcntl.ioctl(self._slave, self._GET_NAME, bytes(16))
        self.name = answer.rstrip(b'\0').decode()
        # The driver waits until what it writes was read.
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        run_ip('link', 'set', self.name, 'type', 'can', 'bitrate', '250000')
        run_ip('link', 'set', self.name, 'up')

    def say(self, line: str) -> None:
        os.write(self._master, f'{line}\r'.encode())

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while os.read(self._master, 4096):
                pass

    def close(self) -> None:
        run_ip('link', 'set', self.name, 'down')
        os.close(self._slave)
        self._reader.join(5.0)
        os.close(self._master)


@pytest.fixture
def controller(can_bus: CanBus) -> Iterator[Controller]:
    result = Controller()
    yield result
    result.close()


def opened(name: str) -> CanTransport:
    transport = CanTransport('socketcan', name)
    transport.open()
    return transport


def counts_of(transport: CanTransport, name: str) -> Any:
    assert transport.receive() == []
    return transport.counts()[name]


def test_driver_tells_warnings_and_error_passive(controller: Controller) -> None:
    transport = opened(controller.name)
    controller.say('sw100000')  # state, 3 digits of receive errors, 3 of transmit errors
    wait_for(lambda: counts_of(transport, 'error warnings'), 5.0, 'a warning')
    controller.say('sp130000')
    wait_for(lambda: counts_of(transport, 'error passive'), 5.0, 'error passive')
    assert transport.counts()['bus off'] == 0
    transport.close()


def test_controller_off_the_bus_is_lost_until_it_is_brought_up_again(
    controller: Controller,
) -> None:
    transport = opened(controller.name)
    controller.say('sb000255')
    wait_lost(transport)
    with pytest.raises(TransportError, match=f'bus off; .*ip link set {controller.name} down'):
        transport.open()
    run_ip('link', 'set', controller.name, 'down')
    run_ip('link', 'set', controller.name, 'up')
    transport.open()
    controller.say('T18FEF53320102')
    assert wait_frames(transport, 1) == [CanFrame(0x18FEF533, b'\x01\x02')]
    transport.close()
