# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A CAN interface of the kernel (SocketCAN).

While nobody acknowledges, a controller repeats its first frame for ever, and what is queued behind
it goes out when the bus is back: old motion before a newer stop. The kernel lets nobody take back
what is queued, so hardly anything is: see Unconfirmed.
"""

from __future__ import annotations

from collections import deque
import contextlib
import errno
from functools import partial
import math
import os
from pathlib import Path
import socket
import struct

from bridge_core import clock
from bridge_core.j1939 import CanFrame
from bridge_core.transports.can_port import (
    BusOffError,
    Filters,
    LostFramesError,
    OLD,
    passes,
    RawFrame,
    READS,
    RECEIVE_QUEUE_LIMIT,
)
from bridge_core.transports.multicast import BUSY, IFF_UP, interface_flags
from bridge_core.waiting import writable

_LOST = 0.5  # s; after this long without a confirmation one more frame is tried
_AT_ONCE = 0.05  # s in which a live bus confirms that frame; what it was tried behind is lost
_SEND_BUFFER = 4096  # bytes, of which the kernel takes 768 a frame and doubles what is asked for
_FRAME = struct.Struct('=IB3x')  # linux/can.h: identifier and flags, length; then the data
_FD_FRAME_SIZE = 72
_FILTER = struct.Struct('=II')  # linux/can.h: identifier, mask
_SO_RXQ_OVFL = 40  # asm-generic/socket.h: have each message say how many were dropped before it
_ANCILLARY = socket.CMSG_SPACE(4)
_CAN_RAW_ERR_FILTER, _EVERY_ERROR = 2, 0x1FFFFFFF  # linux/can/raw.h
_EXTENDED, _REMOTE, _ERROR = 0x80000000, 0x40000000, 0x20000000


class Unconfirmed:
    """
    Frames of ours of which the driver has not said yet that they were on the bus.

    While the oldest has waited for too long no other is queued behind it, so that no more than it
    and its contemporaries go out late. Confirmations are lost when a queue is flushed or a
    controller restarts; hence a try every now and then.
    """

    def __init__(self) -> None:
        self._frames: deque[tuple[bytes, float]] = deque(maxlen=RECEIVE_QUEUE_LIMIT)
        self._refused_since = self._refused_at = -math.inf

    def may_send(self, now: float) -> bool:
        """Tell whether a frame that is sent at ``now`` will not wait behind an old one."""
        if not self._frames or now < self._frames[0][1] + OLD:
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
        self._socket = _open_socket(channel, filters)
        self._filters = filters
        self._unconfirmed = Unconfirmed()
        self._kept: list[RawFrame] = []  # read by write
        self._readable_fd = os.eventfd(1, os.EFD_CLOEXEC)

    def fileno(self) -> int:
        """Return the socket's descriptor, or one that is readable while a frame is kept."""
        return self._readable_fd if self._kept else self._socket.fileno()

    def read(self) -> list[RawFrame]:
        """Return what the kernel has let through, confirmations apart."""
        kept, self._kept = self._kept, []
        return kept + self._take()

    def _take(self) -> list[RawFrame]:
        frames: list[RawFrame] = []
        for _ in range(READS):
            try:
                data, beside, flags, _ = self._socket.recvmsg(
                    _FD_FRAME_SIZE, _ANCILLARY, socket.MSG_DONTWAIT
                )
            except BlockingIOError:
                break
            if any(kind == _SO_RXQ_OVFL for _, kind, _ in beside):
                raise LostFramesError
            frame = _unpack(data)
            if flags & socket.MSG_CONFIRM:
                self._unconfirmed.confirmed(_key(frame), clock.now())
            else:
                frames.append(frame)
        return frames

    def write(self, frame: CanFrame) -> bool:
        """Hand it to the kernel; drop it while its queue is full, or holds what is old."""
        if not self._unconfirmed.may_send(clock.now()):
            self._kept += self._take()  # after a pause of ours the confirmation is there, unread
        now = clock.now()
        taken = self._unconfirmed.may_send(now) and self._hand_over(frame)
        if taken:
            confirmed = passes(RawFrame(frame.identifier, frame.data), self._filters)
            self._unconfirmed.sent(_key(frame), now, is_confirmed=confirmed)
        else:
            self._unconfirmed.refused(now)
        return taken

    def _hand_over(self, frame: CanFrame) -> bool:
        if not writable(self._socket.fileno(), 0.0):
            return False
        head = _FRAME.pack(frame.identifier | _EXTENDED, len(frame.data))
        try:
            self._socket.send(head + frame.data.ljust(8, b'\0'), socket.MSG_DONTWAIT)
        except OSError as error:
            if error.errno in BUSY:
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
            self._socket.close()


def _check_interface(name: str) -> None:
    """:raises OSError: no such interface, or it is down. :raises BusOffError: it is bus off."""
    if not interface_flags(name) & IFF_UP:
        raise OSError(errno.ENETDOWN, os.strerror(errno.ENETDOWN))
    # Drivers drop the carrier at bus off; IFF_RUNNING follows up to a second later.
    with contextlib.suppress(OSError):
        if Path('/sys/class/net', name, 'carrier').read_text(encoding='ascii').strip() == '0':
            raise BusOffError


def _open_socket(channel: str, filters: Filters) -> socket.socket:
    """Join a bus; nothing of before comes, nor what the filters do not let through."""
    with contextlib.ExitStack() as undo:
        port = undo.enter_context(socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW))
        port.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        port.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        set_option = partial(port.setsockopt, socket.SOL_CAN_RAW)
        # Our own frames come back as confirmations, where the filters let them.
        set_option(socket.CAN_RAW_RECV_OWN_MSGS, 1)
        set_option(_CAN_RAW_ERR_FILTER, _EVERY_ERROR)
        with contextlib.suppress(OSError):  # CAN FD, only to be counted: such are not for us
            set_option(socket.CAN_RAW_FD_FRAMES, 1)
        if filters:
            words = ((id_ | _EXTENDED, mask | _EXTENDED) for id_, mask in filters)
            set_option(socket.CAN_RAW_FILTER, b''.join(_FILTER.pack(*pair) for pair in words))
        port.bind((channel,))
        undo.pop_all()
    return port


def _unpack(data: bytes) -> RawFrame:
    """Read a frame as the kernel has it."""
    identifier, length = _FRAME.unpack_from(data)
    is_remote = bool(identifier & _REMOTE)
    return RawFrame(
        identifier & 0x1FFFFFFF,
        b'' if is_remote else data[_FRAME.size : _FRAME.size + length],
        is_extended=bool(identifier & _EXTENDED),
        is_remote=is_remote,
        is_error=bool(identifier & _ERROR),
        is_fd=len(data) == _FD_FRAME_SIZE,
    )


def _key(frame: CanFrame | RawFrame) -> bytes:
    """Return what tells a frame of ours from another."""
    return frame.identifier.to_bytes(4, 'big') + frame.data
