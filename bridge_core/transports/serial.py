# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Serial ports: local ones and pyserial's URLs (``socket://``, ``rfc2217://``, ``loop://``).

pyserial opens and configures the port; its descriptor is then read directly, which takes less
time. ``rfc2217://`` and ``loop://`` have no descriptor to wait on, so two threads carry their
bytes to a socket pair.
"""

import contextlib
import errno
import io
import math
import os
import socket
import termios
import threading
from typing import Any

import serial

from bridge_core import clock
from bridge_core.reasons import Coded, passed_on
from bridge_core.transports import exclusive, TransportError
from bridge_core.transports.line import Line, STALL_TIMEOUT, STALLED
from bridge_core.transports.serial_identity import identity_of
from bridge_core.waiting import writable

_HINTS = {
    errno.ENOENT: Coded(
        'port.missing', 'no such port; plug the device in, or set the parameter port'
    ),
    errno.EISDIR: Coded('port.wrong', 'a folder; set the parameter port'),
    errno.ENOTTY: Coded('port.wrong', 'no serial port; set the parameter port'),
    errno.EACCES: Coded(
        'port.no_permission', 'no permission; add your user to the group dialout and log in again'
    ),
    **dict.fromkeys(
        (errno.EAGAIN, errno.EBUSY, errno.EADDRINUSE),
        Coded('port.in_use', 'in use by another program; close that one'),
    ),
    **dict.fromkeys(
        (errno.EIO, errno.ENXIO, errno.ENODEV),
        Coded('port.dead', 'the device does not answer; is it plugged in?'),
    ),
}
_FINISH_TIMEOUT = 0.05  # s
_READ_TIMEOUT = 0.5  # s, after which a thread that reads a URL port looks whether there is one
_WRITE_TIMEOUT = 0.05  # s, after which a line that takes nothing counts as stalled


class SerialTransport:
    """
    A serial port, 8 data bits, no parity, 1 stop bit, locked against other programs.

    :param port: a device such as ``/dev/ttyUSB0``, or a pyserial URL.
    :param baud: bits per second.
    """

    def __init__(self, port: str, baud: int) -> None:
        self.name = port
        self.device = ''  # who is there, in words
        self._baud = baud
        self._serial: Any = None
        self._pump: _Pump | None = None
        self._claim = contextlib.ExitStack()  # of a serial server
        self._fd = self._taken = -1
        self._line = Line()  # whose backlog counts

    @property
    def is_pumped(self) -> bool:
        """Tell whether threads carry what comes, and more may wait before them."""
        return self._pump is not None

    def counts(self) -> dict[str, int | str]:
        """Return who is there: no input is dropped."""
        return {'device': self.device} if self.device else {}

    def open(self) -> None:
        """Open and lock the port. :raises TransportError: with the reason and what to do."""
        self.close()
        try:
            self._claim = exclusive.claim(self.name)
            with exclusive.refused_if_taken(self.name):
                self._serial = self._open_serial()
            self._prepare(self._serial)
            self.device = str(identity_of(self.name))
        except (OSError, ValueError, NotImplementedError, termios.error) as error:
            self.close()
            raise TransportError(_explain_open(self.name, error)) from error

    def _open_serial(self) -> Any:
        # rfc2217:// accepts no write_timeout, so it is not used at all.
        local, url = {'timeout': 0, 'exclusive': True}, {'timeout': _READ_TIMEOUT}
        options: dict[str, Any] = url if '://' in self.name else local
        return serial.serial_for_url(self.name, baudrate=self._baud, **options)

    def _prepare(self, port: Any) -> None:
        """Get the descriptor, configure it and discard earlier input."""
        try:
            line = self._fd = port.fileno()
        except io.UnsupportedOperation:
            self._pump = _Pump(port)
            self._fd, line = self._pump.fileno(), self._pump.line
        self._line = Line(line)
        if self._line.is_tty:
            exclusive.take(line)
            self._taken = line
            _set_low_latency(port)
            _set_vmin(line)
            termios.tcflush(line, termios.TCIOFLUSH)

    def close(self) -> None:
        """Close the port; queued output gets the time that it needs, and 50 ms more."""
        port, pump, line = self._serial, self._pump, self._line
        taken, self._taken = self._taken, -1
        self._claim.close()
        self._serial, self._pump, self._fd, self._line = None, None, -1, Line()
        if pump is not None:
            pump.close()
        elif '://' in self.name and port is not None:
            # pyserial sleeps in close; the kernel sends what was written.
            threading.Thread(target=_quietly, args=(port.close,), daemon=True).start()
        elif port is not None:
            line.drain(self._baud)
            if taken >= 0:
                _quietly(exclusive.give_back, taken)
            _quietly(port.close)

    def fileno(self) -> int:
        """Return the descriptor to wait on; -1 while closed."""
        return self._fd

    def receive(self) -> list[bytes]:
        """Return the bytes that have arrived. :raises TransportError: the port is gone."""
        return read_port(self._fd, self.name)

    def send(self, frame: bytes) -> bool:
        """Queue a frame, or drop it while the line is busy. :raises TransportError: gone."""
        try:
            if self._is_busy():
                return False
            self._write(frame)
            self._line.wrote(len(frame))
        except OSError as error:
            raise TransportError(f'{self.name}: cannot write ({error.strerror})') from error
        return True

    def _is_busy(self) -> bool:
        """Return whether too many bytes wait to be sent. :raises TransportError: it stalled."""
        since = self._line.busy_since()
        if clock.now() - since > STALL_TIMEOUT:
            raise TransportError(f'{self.name}: {STALLED}')
        return since < math.inf

    def _write(self, data: bytes) -> None:
        end = clock.now() + _WRITE_TIMEOUT
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                left = end - clock.now()
                if left <= 0 or not writable(self._fd, left):
                    raise TransportError(
                        f'{self.name}: took no bytes for {_WRITE_TIMEOUT * 1e3:.0f} ms'
                    ) from None


def read_port(fd: int, name: str) -> list[bytes]:
    """Return what has arrived, nothing too. :raises TransportError: the port is gone."""
    try:
        data = os.read(fd, 4096)
    except BlockingIOError:
        return []
    except OSError as error:
        raise TransportError(f'{name}: unplugged ({error.strerror})') from error
    if not data:  # end of file: the other end is gone
        raise TransportError(f'{name}: unplugged')
    return [data]


def _explain_open(name: str, error: Exception) -> str:
    # Where pyserial cannot configure a port, the number is in the termios.error below.
    numbers = (getattr(error, 'errno', None), *getattr(error.__context__, 'args', ()))
    hint = next((_HINTS[each] for each in numbers if each in _HINTS), str(error))
    if 'Could not exclusively lock' in str(error):
        hint = _HINTS[errno.EBUSY]
    return passed_on(hint, f'cannot open {name}: {hint}', 'port.closed')


def _set_low_latency(port: Any) -> None:
    """Ask the driver to pass bytes on at once (an FTDI chip holds them for up to 16 ms)."""
    with contextlib.suppress(OSError, ValueError, NotImplementedError):
        port.set_low_latency_mode(True)  # ptys and CDC-ACM do not have it, nor need it


def _set_vmin(fd: int) -> None:
    """Make an empty port raise EAGAIN; pyserial's 0 bytes would look like a lost port."""
    attributes = termios.tcgetattr(fd)
    attributes[6][termios.VMIN] = 1
    termios.tcsetattr(fd, termios.TCSANOW, attributes)


def _quietly(function, *args) -> None:  # type: ignore[no-untyped-def]
    with contextlib.suppress(OSError):  # closing what is already gone
        function(*args)


class _Pump:
    """
    Carries bytes between a URL port and one end of a socket pair; the other end is ours.

    ``line`` is the connection below an ``rfc2217://`` port, whose send buffer has no bound that
    matters here; -1 for a port that has none.
    """

    def __init__(self, port: Any) -> None:
        self._port = port
        self._ours, self._theirs = socket.socketpair()
        self._ours.setblocking(False)
        # A small buffer: queued commands arrive too late.
        self._ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
        connection = getattr(port, '_socket', None)  # pyserial has no public name for it
        self.line = -1 if connection is None else os.dup(connection.fileno())
        self._reader = threading.Thread(target=self._inward, daemon=True)
        self._writer = threading.Thread(target=self._outward, daemon=True)
        self._reader.start()
        self._writer.start()

    def fileno(self) -> int:
        return self._ours.fileno()

    def close(self) -> None:
        """Close both; queued output gets 50 ms to leave, as the process may end behind this."""
        _quietly(self._ours.shutdown, socket.SHUT_RDWR)
        self._ours.close()
        self._writer.join(_FINISH_TIMEOUT)
        threading.Thread(target=self._finish, daemon=True).start()  # it may take a while

    def _finish(self) -> None:
        if self.line >= 0:
            os.close(self.line)
        _quietly(self._port.close)

    # Drivers raise many kinds of error from a lost or closed port; each ends the thread.

    def _inward(self) -> None:
        with contextlib.suppress(Exception):
            while self._ours.fileno() >= 0:
                self._theirs.sendall(self._port.read(max(1, self._port.in_waiting)))
        _quietly(self._theirs.shutdown, socket.SHUT_RDWR)

    def _outward(self) -> None:
        with contextlib.suppress(Exception):
            while data := self._theirs.recv(4096):
                self._port.write(data)
        _quietly(self._theirs.shutdown, socket.SHUT_RDWR)
