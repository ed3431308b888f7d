"""
Serial ports, local ones and pyserial's URLs (``socket://``, ``rfc2217://``, ``loop://``).

pyserial opens and configures the port; reading its descriptor directly is the faster half. URL
ports have no descriptor to wait on, so two threads carry their bytes to a socket pair that has.
"""

import contextlib
import errno
import fcntl
import os
import select
import socket
import struct
import termios
import threading
import time
from typing import Any

import serial

from bridge_core.transports import TransportError

_HINTS = {
    errno.ENOENT: 'no such port; plug the device in, or set the parameter port',
    errno.EACCES: 'no permission; add your user to the group dialout and log in again',
    errno.EAGAIN: 'in use by another program; close that one',
    errno.EBUSY: 'in use by another program; close that one',
    errno.EIO: 'the device does not answer; is it plugged in?',
}
# Frames that wait in the kernel delay a stop behind them: 64 bytes are 5.6 ms at 115200 baud.
_BACKLOG_LIMIT = 64
_DRAIN_TIME = 0.05


class SerialTransport:
    """
    A serial port, 8 data bits, no parity, 1 stop bit, locked against other programs.

    :param port: a device such as ``/dev/ttyUSB0``, or a pyserial URL.
    :param baud: bits per second. :param write_timeout: seconds before a write counts as stalled.
    """

    def __init__(self, port: str, baud: int, *, write_timeout: float = 0.05) -> None:
        self.name = port
        self.low_latency = False
        self._baud = baud
        self._write_timeout = write_timeout
        self._serial: Any = None
        self._pump: socket.socket | None = None
        self._fd = -1

    def open(self) -> None:
        """Open and lock the port. :raises TransportError: with the reason and what to do."""
        self.close()
        is_url = '://' in self.name
        try:
            options: dict[str, Any] = {'timeout': 0, 'exclusive': True}
            if is_url:
                options = {'timeout': None, 'write_timeout': self._write_timeout}
            port: Any = serial.serial_for_url(self.name, baudrate=self._baud, **options)
            self._serial = port
            if is_url:
                self._pump = _start_pump(port)
                self._fd = self._pump.fileno()
            else:
                self._fd = port.fileno()
                self.low_latency = _set_low_latency(port)
                termios.tcflush(self._fd, termios.TCIOFLUSH)
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            self.close()
            raise TransportError(_explain_open(self.name, error)) from error

    def close(self) -> None:
        """Close the port; what is queued gets 50 ms to leave."""
        port, pump, fd = self._serial, self._pump, self._fd
        self._serial, self._pump, self._fd = None, None, -1
        if pump is not None:
            _quietly(pump.shutdown, socket.SHUT_RDWR)
            pump.close()
        elif port is not None and fd >= 0:
            _drain(fd)
        if port is not None:
            _quietly(port.close)

    def fileno(self) -> int:
        """Return the descriptor to wait on; -1 while closed."""
        return self._fd

    def receive(self) -> list[bytes]:
        """Return the bytes that are there. :raises TransportError: the port is gone."""
        try:
            data = os.read(self._fd, 4096)
        except BlockingIOError:
            return []
        except OSError as error:
            raise TransportError(f'{self.name}: unplugged ({error.strerror})') from error
        if not data:  # readable, yet nothing to read: the other end is gone
            raise TransportError(f'{self.name}: unplugged')
        return [data]

    def send(self, frame: bytes) -> bool:
        """Queue a frame, or drop it while the line is busy. :raises TransportError: gone."""
        try:
            if self._pump is None and _backlog(self._fd) > _BACKLOG_LIMIT:
                return False
            self._write(frame)
        except OSError as error:
            raise TransportError(f'{self.name}: cannot write ({error.strerror})') from error
        return True

    def _write(self, data: bytes) -> None:
        end = time.monotonic() + self._write_timeout
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                left = end - time.monotonic()
                if left <= 0 or not select.select([], [self._fd], [], left)[1]:
                    raise TransportError(
                        f'{self.name}: took no bytes for {self._write_timeout * 1e3:.0f} ms'
                    ) from None


def _explain_open(name: str, error: Exception) -> str:
    hint = _HINTS.get(getattr(error, 'errno', None) or 0, str(error))
    if 'Could not exclusively lock' in str(error):
        hint = _HINTS[errno.EBUSY]
    return f'cannot open {name}: {hint}'


def _set_low_latency(port: Any) -> bool:
    """Ask the driver not to sit on received bytes (an FTDI chip's default is 16 ms)."""
    try:
        port.set_low_latency_mode(True)
    except (OSError, ValueError, NotImplementedError):
        return False  # ptys and CDC-ACM have no such setting, and need none
    return True


def _backlog(fd: int) -> int:
    """Return how many bytes wait in the kernel to be sent."""
    (count,) = struct.unpack('i', fcntl.ioctl(fd, termios.TIOCOUTQ, b'\0' * 4))
    return int(count)


def _drain(fd: int) -> None:
    """Let queued bytes leave, but never wait for a dead line: closing would, for up to 30 s."""
    end = time.monotonic() + _DRAIN_TIME
    try:
        while _backlog(fd) and time.monotonic() < end:
            time.sleep(0.001)
        termios.tcflush(fd, termios.TCOFLUSH)
    except (OSError, termios.error):
        pass  # unplugged: there is nothing to drain


def _quietly(function, *args) -> None:  # type: ignore[no-untyped-def]
    with contextlib.suppress(OSError):  # closing what is already gone
        function(*args)


def _start_pump(port: Any) -> socket.socket:
    """Carry bytes between a URL port and one end of a socket pair; return the other end."""
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    # Small buffers: commands that wait are commands that come too late.
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)

    def inward() -> None:
        try:
            while data := port.read(max(1, port.in_waiting)):
                theirs.sendall(data)
        except (OSError, TypeError, AttributeError):
            pass  # pyserial raises these from a port that was closed under it
        _quietly(theirs.shutdown, socket.SHUT_RDWR)

    def outward() -> None:
        try:
            while data := theirs.recv(4096):
                port.write(data)
        except (OSError, TypeError, AttributeError):
            pass
        _quietly(theirs.shutdown, socket.SHUT_RDWR)

    def both() -> None:
        reader = threading.Thread(target=inward, daemon=True)
        reader.start()
        outward()
        _quietly(port.close)
        reader.join()
        theirs.close()

    threading.Thread(target=both, name=f'pump {port.portstr}', daemon=True).start()
    return ours
