# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What waits for a bus on which nobody acknowledges: hardly anything, and never old motion.

The part with the mark real_can runs inside user-mode-linux (test_uml.py).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
import contextlib
import ctypes
import errno
import os
import queue
import select
import socket
import struct
import subprocess
import termios
import threading
import time
from typing import Any

import can
from hypothesis import given, strategies as st
import pytest

from bridge_core import clock
from bridge_core.j1939 import CanFrame
from bridge_core.transports import can_socket, TransportError
from bridge_core.transports.can import CanTransport
from bridge_core.transports.can_pumped import PumpedPort
from bridge_core.transports.can_socket import Unconfirmed
from bridge_core.transports.line import Line
from stage.can_rig import drain, error_frame, message, VARIABLE, VirtualInterface
from stage.rig import holds_for, Pty, wait_for

MOTION = CanFrame(0x0CFDD638, bytes.fromhex('107D010000000000'))
NEUTRAL = CanFrame(0x0CFDD638, bytes.fromhex('0100010000000000'))


# The account alone.


# s after the first, what is sent, confirmed (+) or asked (?): may something be sent then?
ACCOUNTS = {
    'nothing is sent behind a frame that waits too long': [
        *((0.0, '1', True), (0.014, '?', True), (0.015, '?', False), (0.499, '?', False)),
        (0.499, '+1', True),
    ],
    'lost confirmations are got over by a try': [
        *((0.0, '1', True), (0.0, '2', True), (0.5, '?', True), (0.5, '3', False)),
        *((0.6, '?', False), (0.501, '+3', True), (0.6, '?', True)),
    ],
    "somebody else's confirmation changes nothing": [
        *((0.0, '1', True), (0.001, '+2', True), (0.1, '?', False)),
    ],
    'old frames that leave one by one are not taken for lost': [
        *((0.0, '1', True), (0.5, '1', False), (1.0, '1', False)),
        *((1.3, '+1', False), (1.4, '+1', False), (1.5, '+1', True)),
    ],
}


@pytest.mark.parametrize('name', ACCOUNTS)
def test_account_of_what_waits(name: str) -> None:
    waiting = Unconfirmed()
    for after, what, may in ACCOUNTS[name]:
        now = 10.0 + after
        if what[0] == '+':
            waiting.confirmed(what[1:].encode(), now)
        elif what != '?':
            waiting.sent(what.encode(), now)
        assert waiting.may_send(now) is may, (after, what)


@given(
    frames=st.lists(st.sampled_from((b'motion', b'neutral', b'other')), min_size=80, max_size=80),
    one_frame=st.booleans(),
    lost=st.sets(st.integers(0, 39)),
)
def test_confirmations_that_are_lost_cost_one_pause_of_half_a_second(
    frames: list[bytes], one_frame: bool, lost: set[int]
) -> None:
    waiting, taken, last = Unconfirmed(), [], 0.0
    for number, frame in enumerate(frames[:1] * 80 if one_frame else frames):
        now = number * 0.02
        if waiting.may_send(now):
            waiting.sent(frame, now)
            taken.append(now)
            if number in lost:
                last = now
            else:
                waiting.confirmed(frame, now + 0.001)
    assert [at for at in taken if at > last + 0.51] == [
        number * 0.02 for number in range(80) if number * 0.02 > last + 0.51
    ]


# A driver that blocks, as others than SocketCAN do.


class BlockedBus:
    """A bus of python-can whose ``send`` waits until it is let go."""

    def __init__(self) -> None:
        self.sending = threading.Event()
        self.let_go = threading.Event()
        self.sent: list[bytes] = []
        self.heard = queue.SimpleQueue[can.Message]()
        self.is_shut = False

    def send(self, frame: can.Message) -> None:
        self.sending.set()
        self.let_go.wait(20.0)
        self.sent.append(bytes(frame.data))

    def recv(self, timeout: float) -> can.Message | None:
        with contextlib.suppress(queue.Empty):
            return self.heard.get(timeout=timeout)
        return None

    def shutdown(self) -> None:
        self.is_shut = True


@pytest.mark.parametrize(('late', 'sent'), [(0.19, [b'motion', b'neutral']), (0.2, [b'motion'])])
def test_newest_frame_takes_the_place_of_old_ones_and_leaves_soon_or_never(
    monkeypatch: pytest.MonkeyPatch, late: float, sent: list[bytes]
) -> None:
    now, bus = 100.0, BlockedBus()
    monkeypatch.setattr(clock, 'now', lambda: now)
    monkeypatch.setattr(can, 'Bus', lambda **options: bus)
    port = PumpedPort({}, (), Counter())
    assert port.write(CanFrame(1, b'motion'))
    assert bus.sending.wait(5.0)
    assert all(port.write(CanFrame(1, b'motion')) for _ in range(16))
    assert not port.write(CanFrame(1, b'neutral'))
    now += 0.015
    assert port.write(CanFrame(1, b'neutral'))
    port.close()
    now += late
    bus.let_go.set()
    wait_for(lambda: bus.is_shut, 5.0, 'an end')
    assert bus.sent == sent


# A serial adapter whose driver takes more than its line gets rid of.


class LineBus(BlockedBus):
    """A bus on the serial line ``pty``, whose driver takes what it gets at once."""

    def __init__(self, pty: Pty) -> None:
        super().__init__()
        self.let_go.set()
        self._tty = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)

    def fileno(self) -> int:
        return self._tty

    def shutdown(self) -> None:
        os.close(self._tty)
        super().shutdown()


class Adapter:
    """A transport on a LineBus; ``backlog`` is what waits in its driver, as a pty has none."""

    def __init__(self, patch: pytest.MonkeyPatch, pty: Pty) -> None:
        self.now, self.backlog = 100.0, 0
        self.flushed: list[int] = []
        self.bus = LineBus(pty)
        patch.setattr(clock, 'now', lambda: self.now)
        patch.setattr(can, 'Bus', lambda **options: self.bus)
        patch.setattr(Line, 'backlog', lambda line: self.backlog)
        patch.setattr(termios, 'tcflush', lambda fd, queue: self.flushed.append(queue))
        self.transport = CanTransport('slcan', 'loop://')
        self.transport.open()

    def send(self, data: bytes) -> None:
        assert self.transport.send(CanFrame(1, data))

    def fill(self) -> None:
        """Let its driver keep what it gets from now on."""
        self.bus.sent.clear()
        self.backlog = 64
        for _ in range(3):  # of 27 bytes each
            self.send(b'taken')
        wait_for(lambda: len(self.bus.sent) == 3, 5.0, 'frames')
        self.bus.sent.clear()
        self.backlog = 65

    def too_old(self) -> int | str:
        return self.transport.counts().get('frames too old to send', 0)


@pytest.fixture
def adapter(monkeypatch: pytest.MonkeyPatch, pty: Pty) -> Iterator[Adapter]:
    adapter = Adapter(monkeypatch, pty)
    yield adapter
    adapter.backlog = 0
    adapter.transport.close()


def test_nothing_is_sent_behind_what_a_serial_adapter_does_not_take(adapter: Adapter) -> None:
    adapter.fill()
    for count in range(1, 6):
        adapter.send(b'motion')
        holds_for(lambda: not adapter.bus.sent, 0.03, 'nothing sent')
        adapter.now += 0.02
        wait_for(lambda count=count: adapter.too_old() == count, 5.0, 'an old frame')  # type: ignore[misc]
    adapter.send(b'neutral')
    adapter.backlog = 64
    wait_for(lambda: adapter.bus.sent, 5.0, 'a frame')
    assert adapter.bus.sent == [b'neutral']


def test_adapter_that_takes_nothing_for_half_a_second_is_lost_and_flushed(
    adapter: Adapter,
) -> None:
    adapter.fill()
    adapter.send(b'motion')
    adapter.now += 0.4
    adapter.backlog = 0
    wait_for(lambda: adapter.too_old() == 1, 5.0, 'an old frame')
    adapter.send(b'motion')
    wait_for(lambda: adapter.bus.sent, 5.0, 'a frame')
    adapter.fill()  # again: the time counts from here
    adapter.send(b'motion')
    adapter.now += 0.4
    adapter.send(b'motion')
    assert not adapter.flushed
    adapter.now += 0.11
    with pytest.raises(TransportError, match=r'^slcan .*: cannot send, took no bytes for 500 ms'):
        adapter.send(b'motion')
    assert adapter.flushed == [termios.TCOFLUSH]
    adapter.backlog = 0
    adapter.transport.close()
    wait_for(lambda: adapter.bus.is_shut, 5.0, 'an end')
    assert adapter.bus.sent == []


@pytest.mark.usefixtures('patient_writer')
def test_what_a_driver_does_not_send_within_50_ms_of_the_close_is_flushed(
    adapter: Adapter, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To close a tty takes up to 30 s while bytes wait, and they may be motion."""
    monkeypatch.setattr(clock, 'now', time.monotonic)
    adapter.fill()
    adapter.transport.close()
    assert adapter.flushed == [termios.TCOFLUSH]


def test_line_of_an_adapter_is_not_held_open(adapter: Adapter, pty: Pty) -> None:
    name = os.ttyname(adapter.bus.fileno())

    def users() -> int:
        paths = [f'/proc/self/fd/{each}' for each in os.listdir('/proc/self/fd')]
        return sum(os.path.exists(each) and os.readlink(each) == name for each in paths)

    assert users() == 3  # the pty's own, the bus, and the transport's
    adapter.transport.close()
    wait_for(lambda: users() == 1, 5.0, 'an end')


def opens(transport: CanTransport) -> bool:
    with contextlib.suppress(TransportError):
        transport.open()
    return transport.fileno() >= 0


@pytest.mark.usefixtures('patient_writer')
def test_serial_adapter_whose_driver_waits_is_not_said_to_be_in_use(
    monkeypatch: pytest.MonkeyPatch, pty: Pty
) -> None:
    bus = BlockedBus()
    monkeypatch.setattr(can, 'Bus', lambda **options: bus)
    transport = CanTransport('slcan', str(pty.path))
    transport.open()
    transport.send(MOTION)
    assert bus.sending.wait(5.0)
    transport.close()
    with pytest.raises(TransportError, match=r'cannot open slcan .*: unplug the adapter and plug'):
        transport.open()
    bus.let_go.set()
    wait_for(lambda: opens(transport), 5.0, 'an open port')
    transport.close()


def test_network_adapter_that_takes_nothing_is_lost_and_little_waits_for_it() -> None:
    with socket.create_server(('127.0.0.1', 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        transport = CanTransport('slcan', f'socket://127.0.0.1:{server.getsockname()[1]}')
        transport.open()
        errors: list[TransportError] = []

        def is_lost() -> bool:
            try:
                transport.send(MOTION)
            except TransportError as error:
                errors.append(error)
            return bool(errors)

        wait_for(is_lost, 20.0, 'an error from a port that takes nothing')
        assert 'took no bytes for 500 ms' in str(errors[0])
        port = transport._port
        assert isinstance(port, PumpedPort)
        assert 64 < port._line.backlog() <= 64 + 27
        transport.close()


# A port that takes nothing is lost if others are heard on the bus.


class Controller:
    """The kernel's socket: ``confirms`` what is sent, or has a queue that is ``full``."""

    def __init__(self) -> None:
        self.confirms = self.full = False
        self.beside: list[Any] = []  # what each message says beside its data
        self.waiting: list[can.Message] = []
        self._inbox: list[tuple[can.Message, int]] = []

    def close(self) -> None:
        pass

    def hear(self, frame: can.Message, flags: int = 0) -> None:
        self._inbox.append((frame, flags))

    def recvmsg(self, *_: Any) -> tuple[bytes, list[Any], int, None]:
        if self.confirms:
            for each in self.waiting:
                self.hear(each, socket.MSG_CONFIRM)
            self.waiting.clear()
        if not self._inbox:
            raise BlockingIOError
        frame, flags = self._inbox.pop(0)
        kind = 0x20000000 if frame.is_error_frame else 0x80000000
        head = struct.pack('=IB3x', frame.arbitration_id | kind, len(frame.data))
        return head + bytes(frame.data), self.beside, flags, None

    def fileno(self) -> int:
        return -1

    def send(self, data: bytes, flags: int) -> None:
        assert flags == socket.MSG_DONTWAIT
        if self.full:
            raise OSError(errno.ENOBUFS, 'full')
        head, length = struct.unpack('=IB3x', data[:8])
        assert head & 0x80000000
        assert len(data) == 16
        self.waiting.append(message(head & 0x1FFFFFFF, data[8 : 8 + length]))


class Talk:
    """A transport that sends each 20 ms, by a clock of its own."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self.controller = Controller()
        monkeypatch.setattr(clock, 'now', lambda: self.now)
        monkeypatch.setattr(can_socket, '_check_interface', lambda name: None)
        monkeypatch.setattr(can_socket, 'writable', lambda *_: True)
        monkeypatch.setattr(can_socket, '_open_socket', lambda *_: self.controller)
        self.transport = CanTransport('socketcan', 'can0')
        self.transport.open()

    def lasts(self, seconds: float, heard: can.Message | None) -> float:
        """Hear it before each frame, if any; return after how many seconds the port is lost."""
        begin = self.now
        while self.now < begin + seconds:
            self.now += 0.02
            if heard is not None:
                self.controller.hear(heard)
            self.transport.receive()
            try:
                self.transport.send(MOTION)
            except TransportError as error:
                assert str(error) == 'can0: took no frame for 1 s'  # noqa: PT017
                return self.now - begin
        return seconds


@pytest.fixture
def talk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Talk]:
    talk = Talk(monkeypatch)
    yield talk
    talk.transport.close()


OTHERS = message(2, b'others')


@pytest.mark.parametrize('full', [False, True])
def test_controller_that_hears_but_takes_nothing_is_lost(talk: Talk, full: bool) -> None:
    talk.controller.full = full
    assert 1.0 < talk.lasts(5.0, OTHERS) < 1.2
    talk.transport.open()
    assert 1.0 < talk.lasts(5.0, OTHERS) < 1.2


@pytest.mark.parametrize('full', [False, True])
@pytest.mark.parametrize('heard', [None, error_frame(0x20)])
def test_bus_on_which_nobody_acknowledges_is_not_lost(
    talk: Talk, full: bool, heard: can.Message | None
) -> None:
    talk.controller.full = full
    assert talk.lasts(5.0, heard) == 5.0


def test_controller_that_takes_frames_is_not_lost(talk: Talk) -> None:
    talk.controller.confirms = True
    assert talk.lasts(3.0, OTHERS) == 3.0
    for _ in range(3):
        talk.controller.confirms = False
        assert talk.lasts(0.9, OTHERS) == 0.9
        talk.controller.confirms = True
        assert talk.lasts(0.04, OTHERS) == 0.04


def test_bus_that_is_replugged_is_not_lost_before_its_first_confirmation(talk: Talk) -> None:
    talk.controller.confirms = True
    talk.lasts(1.0, OTHERS)
    talk.controller.confirms = False
    assert talk.lasts(3.0, None) == 3.0
    assert talk.lasts(0.4, OTHERS) == 0.4
    talk.controller.confirms = True
    assert talk.lasts(3.0, OTHERS) == 3.0


def test_frames_that_the_kernel_has_dropped_are_a_lost_port(talk: Talk) -> None:
    """They may have said stop; python-can has each message say its time."""
    talk.controller.beside = [(socket.SOL_SOCKET, 35, bytes(16))]
    talk.controller.hear(OTHERS)
    assert talk.transport.receive() == [CanFrame(2, b'others')]
    talk.controller.beside += [(socket.SOL_SOCKET, 40, struct.pack('I', 7))]  # SO_RXQ_OVFL
    talk.controller.hear(OTHERS)
    with pytest.raises(TransportError, match='frames were lost, and may have said stop'):
        talk.transport.receive()


@pytest.mark.parametrize('others', [True, False])
def test_blocked_driver_that_hears_is_lost(monkeypatch: pytest.MonkeyPatch, others: bool) -> None:
    now, bus = 100.0, BlockedBus()
    monkeypatch.setattr(clock, 'now', lambda: now)
    monkeypatch.setattr(can, 'Bus', lambda **options: bus)
    transport = CanTransport('virtual', 'blocked')
    transport.open()
    transport.send(MOTION)
    assert bus.sending.wait(5.0)
    for _ in range(12):
        now += 0.1
        if others:
            bus.heard.put(OTHERS)
            wait_for(transport.receive, 5.0, 'a frame')
        if now < 101.05:
            assert transport.send(NEUTRAL)
    if others:
        with pytest.raises(TransportError, match='took no frame for 1 s'):
            transport.send(NEUTRAL)
    else:
        now += 5.0
        assert transport.send(NEUTRAL)
    bus.let_go.set()
    transport.close()


# A real interface whose driver confirms what was sent, as those of controllers do.

on_an_interface = pytest.mark.skipif(
    os.environ.get(VARIABLE) != 'socketcan', reason='makes CAN interfaces'
)
_DELETE_MODULE, _FINIT_MODULE = 176, 313  # asm/unistd_64.h
_libc = ctypes.CDLL(None, use_errno=True)


def load_vcan(parameters: bytes) -> None:
    """Load the module anew. :raises OSError: that cannot be."""
    path = f'/usr/lib/uml/modules/{os.uname().release}/kernel/drivers/net/can/vcan.ko'
    descriptor = os.open(path, os.O_RDONLY)
    try:
        for call in ((_DELETE_MODULE, b'vcan', 0), (_FINIT_MODULE, descriptor, parameters, 0)):
            if _libc.syscall(*call):
                raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), path)
    finally:
        os.close(descriptor)


@pytest.fixture
def controller() -> Iterator[VirtualInterface]:
    """Give an interface that confirms a frame when it leaves the queue, not when it enters it."""
    load_vcan(b'echo=1')
    interface = VirtualInterface()
    try:
        yield interface
    finally:
        interface.close()
        load_vcan(b'')


def hold(interface: VirtualInterface) -> None:
    """Have everything wait in the queue, as with the cable out."""
    plug = ('dev', interface.channel, 'root', 'plug', 'limit', '1000000')
    subprocess.run(['tc', 'qdisc', 'replace', *plug], check=True)


def let_go(interface: VirtualInterface) -> None:
    plug = ('dev', interface.channel, 'root', 'plug', 'release_indefinite')
    subprocess.run(['tc', 'qdisc', 'change', *plug], check=True)


def every_20_ms(seconds: float, step: Callable[[], Any]) -> None:
    """Do it at the pace of joystick frames; after a late one, too, the next comes 20 ms later."""
    for _ in range(round(seconds / 0.02)):
        step()
        end = time.monotonic() + 0.02
        wait_for(lambda end=end: time.monotonic() >= end, 5.0, 'the slot')  # type: ignore[misc]


@on_an_interface
@pytest.mark.real_can
def test_replugged_bus_gets_the_newest_frame_after_one_old_one_at_most(
    monkeypatch: pytest.MonkeyPatch, controller: VirtualInterface
) -> None:
    now = 100.0  # its own: after 0.5 s another old one would be tried
    monkeypatch.setattr(clock, 'now', lambda: now)
    witness, transport = controller.endpoint(), controller.transport()

    def send(frame: CanFrame) -> None:
        nonlocal now
        now += 0.02
        while select.select([transport.fileno()], [], [], 0)[0]:
            assert transport.receive() == []  # a confirmation is no frame
        transport.send(frame)

    every_20_ms(0.3, lambda: send(MOTION))
    assert len(drain(witness)) >= 10  # a healthy bus carries them all
    hold(controller)
    every_20_ms(0.4, lambda: send(MOTION))
    every_20_ms(1.0, lambda: send(NEUTRAL))
    assert drain(witness) == []
    let_go(controller)
    every_20_ms(0.2, lambda: send(NEUTRAL))
    frames = drain(witness)
    assert frames.count(MOTION) <= 1
    assert frames[1:] == [NEUTRAL] * (len(frames) - 1)
    assert len(frames) >= 5
