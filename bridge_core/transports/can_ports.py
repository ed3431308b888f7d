# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The three kinds of CAN port, behind one interface for CanTransport.

SocketCAN has a descriptor to wait on, and filters in the kernel. ``udp_multicast`` is python-can's
simulated bus between processes. Only its wire format is used here: python-can's own class returns
our own frames to us, needs a network, and may send joystick commands out into it. All other
interfaces of python-can (slcan, virtual, pcan ...) may block or have no descriptor, so two threads
carry their frames. Those on a serial line (slcan, robotell, seeedstudio, serial) say which one it
is, so that as little waits in the kernel as for a serial device; of the others nobody knows.

While nobody acknowledges, a controller repeats its first frame for ever, and what is queued behind
it goes out when the bus is back: old motion before a newer stop. The kernel lets nobody take back
what is queued, so hardly anything is: see Unconfirmed.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
import contextlib
import errno
import fcntl
import math
import os
from pathlib import Path
import socket
import struct
import threading
from typing import Any, Protocol
import uuid

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.udp_multicast import utils as multicast_wire
from can.typechecking import CanFilters

from bridge_core import clock
from bridge_core.transports import exclusive, TransportError
from bridge_core.transports.can_channel import multicast_address
from bridge_core.transports.can_errors import RECEIVE_OVERFLOWS
from bridge_core.transports.line import Line, STALL_TIMEOUT, STALLED
from bridge_core.transports.multicast import MulticastTransport
from bridge_core.waiting import writable

# Frames a call: bounds how long a stop waits while the bus is full.
READS = 64
_BUSY = (None, errno.EAGAIN, errno.ENOBUFS)  # None: 'Transmit buffer full'
_SIOCGIFFLAGS = 0x8913  # linux/sockios.h
_IFF_UP = 0x1  # linux/if.h
_SEND_QUEUE_LIMIT = 16  # frames: 8 ms of a bus at 250 kbit/s, and more would delay a stop
_OLD = 0.015  # s; a frame that waits longer than this is not worth sending
_LOST = 0.5  # s; after this long without a confirmation one more frame is tried
_AT_ONCE = 0.05  # s in which a live bus confirms that frame; what it was tried behind is lost
_SEND_BUFFER = 4096  # bytes, of which the kernel takes 768 a frame and doubles what is asked for
_FRAME = struct.Struct('=IB3x')  # linux/can.h: identifier and flags, length; then the data
_FD_FRAME_SIZE = 72
_SO_RXQ_OVFL = 40  # asm-generic/socket.h: have each message say how many were dropped before it
_ANCILLARY = socket.CMSG_SPACE(16) + socket.CMSG_SPACE(4)  # python-can asks for a time, too
_EXTENDED, _REMOTE, _ERROR = 0x80000000, 0x40000000, 0x20000000
_RECEIVE_QUEUE_LIMIT = 1024
_RECV_TIMEOUT = 0.05  # s; the reader thread ends within it
_CLOSE_TIMEOUT = 0.2  # s
_LINE_FRAME = 27  # bytes, of a frame of 8 as slcan writes it, the longest
_LOOK_PERIOD = 0.001  # s, between two looks at a line that is busy

Filters = Sequence[tuple[int, int]]
# Writers that did not end with their ports, by channel: they hold a serial adapter's lock.
_stuck_writers: dict[str, threading.Thread] = {}


class BusOffError(Exception):
    """The controller has left the bus."""


class LostFramesError(Exception):
    """Frames were thrown away unread, and may have said stop."""


class CanPort(Protocol):
    """An open connection to a bus; raises python-can's errors and OSError."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def read(self) -> list[can.Message]:
        """Return what has arrived, READS messages at most, without waiting."""

    def write(self, message: can.Message) -> bool:
        """Send without waiting; return False if the port was busy and dropped it."""

    def stuck_since(self) -> float:
        """Return since when no frame of ours gets out; math.inf: they do, or nobody knows."""

    def close(self) -> None:
        """Leave the bus; queued frames may still go out."""


class Unconfirmed:
    """
    Frames of ours of which the driver has not said yet that they were on the bus.

    While the oldest has waited for too long no other is queued behind it, so that no more than it
    and its contemporaries go out late. Confirmations are lost when a queue is flushed or a
    controller restarts; hence a try every now and then.
    """

    def __init__(self) -> None:
        self._frames: deque[tuple[bytes, float]] = deque(maxlen=_RECEIVE_QUEUE_LIMIT)
        self._refused_since = self._refused_at = -math.inf

    def may_send(self, now: float) -> bool:
        """Tell whether a frame that is sent at ``now`` will not wait behind an old one."""
        if not self._frames or now < self._frames[0][1] + _OLD:
            return True
        return now >= self._frames[-1][1] + _LOST

    def sent(self, frame: bytes, now: float, *, is_confirmed: bool = True) -> None:
        """Note that it was handed to the kernel. :param is_confirmed: confirmed() will follow."""
        if is_confirmed:
            self._frames.append((frame, now))
        elif not self._frames:
            self._refused_at = -math.inf

    def refused(self, now: float) -> None:
        """Note that a frame was not sent."""
        if now > self._refused_at + _LOST:
            self._refused_since = now
        self._refused_at = now

    def stuck_since(self, now: float) -> float:
        """Return since when frames are refused and none is confirmed; math.inf: it is not so."""
        return self._refused_since if now <= self._refused_at + _LOST else math.inf

    def confirmed(self, frame: bytes, now: float) -> None:
        """Note that it was on the bus; what was sent before it will not be any more."""
        if any(waiting == frame for waiting, _ in self._frames):
            (_, oldest), (newest, tried) = self._frames[0], self._frames[-1]
            # Of equal frames it may be any: the one just tried, unless the bus has just come back.
            if frame == newest and tried >= oldest + _LOST and now < tried + _AT_ONCE:
                self._frames.clear()
            else:
                while self._frames.popleft()[0] != frame:
                    pass
            self._refused_at = -math.inf


class SocketCanPort:
    """
    A CAN interface of the kernel, such as can0.

    :raises OSError: it does not exist or is down. :raises BusOffError: it is bus off.
    """

    def __init__(self, channel: str, filters: Filters) -> None:
        _check_interface(channel)
        can_filters: CanFilters = [
            {'can_id': id_, 'can_mask': mask, 'extended': True} for id_, mask in filters
        ]
        # CAN FD is received only to be counted: such frames are not for us. Our own come back as
        # confirmations, where the filters let them.
        self._bus = SocketcanBus(
            channel, receive_own_messages=True, fd=True, can_filters=can_filters or None
        )
        self._socket = self._bus.socket
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        self._filters = filters
        self._unconfirmed = Unconfirmed()
        self._kept: list[can.Message] = []  # read by write
        self._readable_fd = os.eventfd(1, os.EFD_CLOEXEC)

    def fileno(self) -> int:
        """Return the socket's descriptor, or one that is readable while a message is kept."""
        return self._readable_fd if self._kept else self._bus.fileno()

    def read(self) -> list[can.Message]:
        """Return what the kernel has let through, confirmations apart."""
        kept, self._kept = self._kept, []
        return kept + self._take()

    def _take(self) -> list[can.Message]:
        messages: list[can.Message] = []
        for _ in range(READS):
            try:
                data, beside, flags, _ = self._socket.recvmsg(
                    _FD_FRAME_SIZE, _ANCILLARY, socket.MSG_DONTWAIT
                )
            except BlockingIOError:
                break
            if any(kind == _SO_RXQ_OVFL for _, kind, _ in beside):
                raise LostFramesError
            message = _unpack(data)
            if flags & socket.MSG_CONFIRM:
                self._unconfirmed.confirmed(_key(message), clock.now())
            else:
                messages.append(message)
        return messages

    def write(self, message: can.Message) -> bool:
        """Hand it to the kernel; drop it while its queue is full, or holds what is old."""
        if not self._unconfirmed.may_send(clock.now()):
            self._kept += self._take()  # after a pause of ours the confirmation is there, unread
        now = clock.now()
        taken = self._unconfirmed.may_send(now) and self._hand_over(message)
        if taken:
            confirmed = _passes(message, self._filters)
            self._unconfirmed.sent(_key(message), now, is_confirmed=confirmed)
        else:
            self._unconfirmed.refused(now)
        return taken

    def _hand_over(self, message: can.Message) -> bool:
        # Not by python-can, whose select() refuses descriptors above 1023.
        if not writable(self._socket.fileno(), 0.0):
            return False
        head = _FRAME.pack(message.arbitration_id | _EXTENDED, len(message.data))
        try:
            self._socket.send(head + message.data.ljust(8, b'\0'), socket.MSG_DONTWAIT)
        except OSError as error:
            if error.errno in _BUSY:
                return False
            raise
        return True

    def stuck_since(self) -> float:
        """Return since when the kernel has confirmed none of our frames, and we drop them."""
        return self._unconfirmed.stuck_since(clock.now())

    def close(self) -> None:
        """Close the socket."""
        os.close(self._readable_fd)
        with contextlib.suppress(OSError):  # closing what is already gone
            self._bus.shutdown()


class MulticastPort:
    """
    A simulated bus on UDP multicast, python-can's ``udp_multicast``; it never leaves this machine.

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

    def read(self) -> list[can.Message]:
        """Return other senders' frames that pass the filters."""
        messages = (self._unpack(datagram) for datagram in self._udp.receive())
        return [message for message in messages if message is not None]

    def write(self, message: can.Message) -> bool:
        """Send a datagram."""
        message.channel = self._token
        return self._udp.send(multicast_wire.pack_message(message))

    def stuck_since(self) -> float:
        """Return that datagrams get out."""
        return math.inf

    def close(self) -> None:
        """Leave the group."""
        self._udp.close()

    def _unpack(self, datagram: bytes) -> can.Message | None:
        try:
            message = multicast_wire.unpack_message(datagram, check=True)
        except Exception:  # msgpack and python-can raise many kinds
            self._counts['impossible frames'] += 1
            return None
        if message.channel == self._token or not _passes(message, self._filters):
            return None
        return message


class PumpedPort:
    """
    A python-can bus that may block: one thread reads from it, another writes to it.

    :param options: for can.Bus. :param counts: gets the number of receive overflows.
    :raises TransportError: another program has locked the serial adapter, or we still have it.
    """

    def __init__(self, options: dict[str, Any], filters: Filters, counts: Counter[str]) -> None:
        tty = None
        with contextlib.ExitStack() as held:
            if options.get('interface') == 'slcan':
                tty = _lock_tty(options['channel'], held)
            self._bus = can.Bus(**options, ignore_config=True)
            if tty is not None:
                try:
                    exclusive.take(tty)
                except OSError:
                    self._bus.shutdown()
                    raise
                held.callback(exclusive.give_back, tty)  # ours alone, not that of who refused us
            self._held = held.pop_all()  # for as long as the writer thread lives
        self._channel = options.get('channel', '')
        self._filters = filters  # python-can's own would drop error frames
        self._counts = counts
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._lock = threading.Lock()
        self._to_send = threading.Condition(self._lock)
        self._received: deque[can.Message] = deque()
        self._outgoing: deque[tuple[float, can.Message]] = deque()
        self._failure: Exception | None = None
        self._closing = False
        self._sending_since = math.inf
        self._line = _line_of(self._bus)
        self._reader = threading.Thread(target=self._inward, daemon=True)
        self._writer = threading.Thread(target=self._outward, daemon=True)
        self._reader.start()
        self._writer.start()

    def fileno(self) -> int:
        """Return the eventfd that the reader thread signals."""
        return self._wake_fd

    def read(self) -> list[can.Message]:
        """
        Return the received frames; once there are none, raise the error that ended a thread.

        :raises LostFramesError: at once.
        """
        with self._lock:
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self._wake_fd)
            count = min(READS, len(self._received))
            messages = [self._received.popleft() for _ in range(count)]
            if self._received or self._failure:
                self._wake()
        if self._failure is not None and (
            not messages or isinstance(self._failure, LostFramesError)
        ):
            raise self._failure
        return messages

    def write(self, message: can.Message) -> bool:
        """Pass it to the writer thread; drop it while its queue is full of what is not old."""
        if self._failure is not None:
            raise self._failure
        with self._to_send:
            if clock.now() - self._line.busy_since() > STALL_TIMEOUT:
                self._outgoing.clear()
                self._line.discard()
                raise can.CanOperationError(STALLED)
            if self._count_waiting() >= _SEND_QUEUE_LIMIT:
                return False
            self._outgoing.append((clock.now(), message))
            self._to_send.notify()
        return True

    def stuck_since(self) -> float:
        """Return since when the writer thread waits for the driver."""
        return self._sending_since

    def close(self) -> None:
        """End the threads; the writer first sends what is not old, then closes the bus."""
        with self._to_send:
            self._closing = True
            os.close(self._wake_fd)
            self._to_send.notify()
        self._writer.join(_CLOSE_TIMEOUT)  # so that a reopen finds the port free
        with self._to_send:
            line, self._line = self._line, Line()
        if self._writer.is_alive():
            _stuck_writers[self._channel] = self._writer
            line.discard()
            with contextlib.suppress(Exception):  # only pyserial's need this to be woken
                self._bus.serialPortOrig.cancel_write()  # type: ignore[attr-defined]
        line.drain()
        if line.fd >= 0:
            os.close(line.fd)

    def _inward(self) -> None:
        try:
            while not self._closing:
                message = self._bus.recv(_RECV_TIMEOUT)
                if message is not None and _passes(message, self._filters):
                    self._put(message)
        except Exception as error:  # any error of a driver ends the port
            self._fail(error)

    def _outward(self) -> None:
        try:
            while (message := self._next()) is not None:
                self._sending_since = clock.now()
                self._line.wrote(_LINE_FRAME)
                self._bus.send(message)
                self._sending_since = math.inf
        except Exception as error:
            self._fail(error)
            with self._to_send:
                self._to_send.wait_for(lambda: self._closing)
        self._reader.join()
        with contextlib.suppress(Exception):  # closing what is already gone
            self._bus.shutdown()
        self._held.close()

    def _next(self) -> can.Message | None:
        """Wait for a frame to send, and for a line to take it; None: there will be none."""
        with self._to_send:
            while not self._count_waiting() or self._line.busy_since() < math.inf:
                if self._closing and not self._outgoing:
                    return None
                self._to_send.wait(_LOOK_PERIOD if self._outgoing else None)
            return self._outgoing.popleft()[1]

    def _count_waiting(self) -> int:
        """Return how many frames wait to be sent, without old ones; the lock is held."""
        limit = _CLOSE_TIMEOUT if self._closing else _OLD  # what leaves last is wanted
        while self._outgoing and clock.now() >= self._outgoing[0][0] + limit:
            self._outgoing.popleft()
            self._counts['frames too old to send'] += 1
        return len(self._outgoing)

    def _put(self, message: can.Message) -> None:
        with self._lock:
            if len(self._received) >= _RECEIVE_QUEUE_LIMIT:
                self._received.popleft()
                self._counts[RECEIVE_OVERFLOWS] += 1
                self._failure = self._failure or LostFramesError()
            self._received.append(message)
            self._wake()

    def _fail(self, error: Exception) -> None:
        if not isinstance(error, can.CanError | OSError):  # drivers raise many kinds
            error = can.CanOperationError(repr(error))
        with self._lock:
            self._failure = self._failure or error
            self._wake()

    def _wake(self) -> None:
        if not self._closing:  # after close the number may belong to another file
            os.eventfd_write(self._wake_fd, 1)


def _line_of(bus: can.BusABC) -> Line:
    """Return the serial line or TCP connection of an adapter, with a descriptor of its own."""
    with contextlib.suppress(Exception):  # drivers raise many kinds where there is none
        Line(bus.fileno()).backlog()
        return Line(os.dup(bus.fileno()))
    return Line()


def _open_multicast(group: str, port: int) -> MulticastTransport:
    """Open on the same interface as python-can, or on loopback if there is no network."""
    udp = MulticastTransport(group, port, port, ttl=0, needs_cable=False)
    try:
        udp.open()
    except TransportError:
        udp = MulticastTransport(group, port, port, ttl=0, interface_address='127.0.0.1')
        udp.open()
    return udp


def _lock_tty(channel: str, held: contextlib.ExitStack) -> int | None:
    """Keep others that lock out of a serial adapter; pyserial's URLs have no lock."""
    if '://' in channel:
        return None
    try:
        flags = os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC
        tty = os.open(channel.split('@')[0], flags)
        held.callback(os.close, tty)
        fcntl.flock(tty, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if exclusive.is_exclusive(tty):
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EBUSY):
            raise
        writer = _stuck_writers.get(channel)
        if writer is not None and writer.is_alive():
            text = 'unplug the adapter and plug it in; its driver waits for it to take a frame'
        else:
            text = 'in use by another program; close that one'
        raise TransportError(text) from error
    return tty


def _check_interface(name: str) -> None:
    """:raises OSError: no such interface, or it is down. :raises BusOffError: it is bus off."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        request = struct.pack('16s240x', name.encode())
        (flags,) = struct.unpack_from('H', fcntl.ioctl(probe, _SIOCGIFFLAGS, request), 16)
    if not flags & _IFF_UP:
        raise OSError(errno.ENETDOWN, os.strerror(errno.ENETDOWN))
    # Drivers drop the carrier at bus off; IFF_RUNNING follows up to a second later.
    with contextlib.suppress(OSError):
        if Path('/sys/class/net', name, 'carrier').read_text(encoding='ascii').strip() == '0':
            raise BusOffError


def _unpack(data: bytes) -> can.Message:
    """Read a frame as the kernel has it."""
    identifier, length = _FRAME.unpack_from(data)
    return can.Message(
        arbitration_id=identifier & 0x1FFFFFFF,
        is_extended_id=bool(identifier & _EXTENDED),
        is_remote_frame=bool(identifier & _REMOTE),
        is_error_frame=bool(identifier & _ERROR),
        is_fd=len(data) == _FD_FRAME_SIZE,
        dlc=length,
        data=data[_FRAME.size : _FRAME.size + length],
    )


def _key(message: can.Message) -> bytes:
    """Return what tells a frame of ours from another."""
    return message.arbitration_id.to_bytes(4, 'big') + bytes(message.data)


def _passes(message: can.Message, filters: Filters) -> bool:
    """Filter as SocketCAN does in the kernel: error frames always pass."""
    if message.is_error_frame or not filters:
        return True
    return message.is_extended_id and any(
        not (message.arbitration_id ^ identifier) & mask for identifier, mask in filters
    )
