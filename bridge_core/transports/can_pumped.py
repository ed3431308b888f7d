# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A bus of python-can that may block: one thread reads from it, another writes to it.

Adapters on a serial line (slcan, robotell, seeedstudio, serial) say which one it is, so that as
little waits in the kernel as for a serial device; of the others nobody knows what waits.
"""

from __future__ import annotations

from collections import Counter, deque
import contextlib
import errno
import fcntl
import math
import os
import threading
from typing import Any

import can

from bridge_core import clock
from bridge_core.j1939 import CanFrame
from bridge_core.transports import exclusive, TransportError
from bridge_core.transports.can_errors import RECEIVE_OVERFLOWS
from bridge_core.transports.can_messages import message_of, raw_frame
from bridge_core.transports.can_port import (
    Filters,
    LostFramesError,
    OLD,
    passes,
    RawFrame,
    READS,
    RECEIVE_QUEUE_LIMIT,
)
from bridge_core.transports.line import Line, STALL_TIMEOUT, STALLED

_SERIAL = ('slcan', 'robotell', 'seeedstudio', 'serial')  # each has a line of its own
_SEND_QUEUE_LIMIT = 16  # frames: 8 ms of a bus at 250 kbit/s, and more would delay a stop
_RECV_TIMEOUT = 0.05  # s; the reader thread ends within it
_CLOSE_TIMEOUT = 0.2  # s
_LINE_FRAME = 27  # bytes, of a frame of 8 as slcan writes it, the longest
# Half of what the kernel keeps for a tty. While more waits, frames grow old there, however fast
# they are read, and those that find no room are lost.
_UNREAD_LIMIT = 2048  # bytes
_BEHIND_LIMIT = 0.2  # s, for which that may be so
_LOOK_PERIOD = 0.001  # s, between two looks at a line that is busy

# Writers that did not end with their ports, by channel: they hold a serial adapter's lock.
_stuck_writers: dict[str, threading.Thread] = {}


class PumpedPort:
    """
    One such bus.

    :param options: for can.Bus. :param counts: gets the number of receive overflows.
    :raises TransportError: another program has locked the serial adapter, or we still have it.
    """

    def __init__(self, options: dict[str, Any], filters: Filters, counts: Counter[str]) -> None:
        tty = None
        with contextlib.ExitStack() as held:
            if options.get('interface') in _SERIAL:
                tty = _lock_tty(options['channel'], held)
            self._bus = can.Bus(**options, ignore_config=True)
            with contextlib.ExitStack() as undo:
                undo.callback(self._bus.shutdown)
                if tty is not None:
                    exclusive.take(tty)
                    held.callback(exclusive.give_back, tty)  # ours, not that of who refused us
                if hasattr(self._bus, 'flush'):  # slcan, which takes 2 s to open
                    self._bus.flush()
                undo.pop_all()
            self._held = held.pop_all()  # for as long as the writer thread lives
        self._channel = options.get('channel', '')
        self._filters = filters  # python-can's own would drop error frames
        self._counts = counts
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._lock = threading.Lock()
        self._to_send = threading.Condition(self._lock)
        self._received: deque[RawFrame] = deque()
        self._outgoing: deque[tuple[float, CanFrame]] = deque()
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

    def read(self) -> list[RawFrame]:
        """
        Return the received frames; once there are none, raise the error that ended a thread.

        :raises LostFramesError: at once.
        """
        with self._lock:
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self._wake_fd)
            count = min(READS, len(self._received))
            frames = [self._received.popleft() for _ in range(count)]
            if self._received or self._failure:
                self._wake()
        if self._failure is not None and (
            not frames or isinstance(self._failure, LostFramesError)
        ):
            raise self._failure
        return frames

    def write(self, frame: CanFrame) -> bool:
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
            self._outgoing.append((clock.now(), frame))
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
        behind, before = 0.0, clock.now()
        try:
            while not self._closing:
                message = self._bus.recv(_RECV_TIMEOUT)
                if message is not None and passes(frame := raw_frame(message), self._filters):
                    self._put(frame)
                now = clock.now()
                took, before = now - before, now
                late = self._line.unread() > _UNREAD_LIMIT
                behind = behind + took if late else max(0.0, behind - took)
                if behind > _BEHIND_LIMIT:
                    raise LostFramesError
        except Exception as error:  # any error of a driver ends the port
            self._fail(error)

    def _outward(self) -> None:
        try:
            while (frame := self._next()) is not None:
                self._sending_since = clock.now()
                self._line.wrote(_LINE_FRAME)
                self._bus.send(message_of(frame))
                self._sending_since = math.inf
        except Exception as error:
            self._fail(error)
            with self._to_send:
                self._to_send.wait_for(lambda: self._closing)
        self._reader.join()
        with contextlib.suppress(Exception):  # closing what is already gone
            self._bus.shutdown()
        self._held.close()

    def _next(self) -> CanFrame | None:
        """Wait for a frame to send, and for a line to take it; None: there will be none."""
        with self._to_send:
            while not self._count_waiting() or self._line.busy_since() < math.inf:
                if self._closing and not self._outgoing:
                    return None
                self._to_send.wait(_LOOK_PERIOD if self._outgoing else None)
            return self._outgoing.popleft()[1]

    def _count_waiting(self) -> int:
        """Return how many frames wait to be sent, without old ones; the lock is held."""
        limit = _CLOSE_TIMEOUT if self._closing else OLD  # what leaves last is wanted
        while self._outgoing and clock.now() >= self._outgoing[0][0] + limit:
            self._outgoing.popleft()
            self._counts['frames too old to send'] += 1
        return len(self._outgoing)

    def _put(self, frame: RawFrame) -> None:
        with self._lock:
            if len(self._received) >= RECEIVE_QUEUE_LIMIT:
                self._received.popleft()
                self._counts[RECEIVE_OVERFLOWS] += 1
                self._failure = self._failure or LostFramesError()
            self._received.append(frame)
            self._wake()

    def _fail(self, error: Exception) -> None:
        if not isinstance(error, can.CanError | OSError | LostFramesError):
            # drivers raise many kinds
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


def _lock_tty(channel: str, held: contextlib.ExitStack) -> int | None:
    """Keep others that lock, or ask, out of a serial adapter; None: it has no tty here."""
    name = channel.partition('@')[0]
    try:
        if '://' in name:
            held.enter_context(exclusive.claim(name))
            return None
        flags = os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC
        tty = os.open(name, flags)
        held.callback(os.close, tty)
        fcntl.flock(tty, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if exclusive.is_exclusive(tty):
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EBUSY, errno.EADDRINUSE):
            raise
        writer = _stuck_writers.get(channel)
        if writer is not None and writer.is_alive():
            text = 'unplug the adapter and plug it in; its driver waits for it to take a frame'
        else:
            text = 'in use by another program; close that one'
        raise TransportError(text) from error
    return tty
