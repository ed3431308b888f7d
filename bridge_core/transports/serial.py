"""
Serial ports, local ones and pyserial's URLs (``socket://``, ``rfc2217://``, ``loop://``).

pyserial opens and configures the port; reading its descriptor directly is the faster half. Some
URL ports have no descriptor to wait on (``rfc2217://``, ``loop://``), so two threads carry their
bytes to a socket pair that has.
"""

import contextlib
import errno
import fcntl
import io
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
    errno.ENXIO: 'the device does not answer; is it plugged in?',
    errno.ENODEV: 'the device does not answer; is it plugged in?',
}
# Frames that wait in the kernel delay a stop behind them: 64 bytes are 5.6 ms at 115200 baud.
_BACKLOG_LIMIT = 64
_DRAIN_TIME = 0.05
# A line that stays busy for so long takes nothing any more (at 9600 baud 64 bytes need 0.07 s).
_STALL_TIME = 0.5
_SIOCOUTQNSD = 0x894B  # linux/sockios.h: like TIOCOUTQ, without what is sent but not acknowledged
_TCP_USER_TIMEOUT_MS = 2000


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
        self._pump: _Pump | None = None
        self._fd = -1
        self._backlog_request: int | None = None
        self._busy_since: float | None = None

    def counts(self) -> dict[str, int | str]:
        """Return nothing: every byte is handed up."""
        return {}

    def open(self) -> None:
        """Open and lock the port. :raises TransportError: with the reason and what to do."""
        self.close()
        try:
            self._serial = self._open_serial()
            self._prepare(self._serial)
        except (OSError, ValueError, NotImplementedError, termios.error) as error:
            self.close()
            raise TransportError(_explain_open(self.name, error)) from error

    def _open_serial(self) -> Any:
        # rfc2217:// refuses any write_timeout; ours holds for all.
        options: dict[str, Any] = {} if '://' in self.name else {'timeout': 0, 'exclusive': True}
        return serial.serial_for_url(self.name, baudrate=self._baud, **options)

    def _prepare(self, port: Any) -> None:
        """Get the descriptor, and rid of what came before the port was opened."""
        self._busy_since = self._backlog_request = None
        try:
            self._fd = port.fileno()
        except io.UnsupportedOperation:
            self._pump = _Pump(port)
            self._fd = self._pump.fileno()
            return
        if os.isatty(self._fd):
            self._backlog_request = termios.TIOCOUTQ
            self.low_latency = _set_low_latency(port)
            _set_vmin(self._fd)
            termios.tcflush(self._fd, termios.TCIOFLUSH)
        else:
            self._backlog_request = _SIOCOUTQNSD
            _set_prompt(self._fd)

    def close(self) -> None:
        """Close the port; what is queued gets 50 ms to leave."""
        port, pump, fd = self._serial, self._pump, self._fd
        self._serial, self._pump, self._fd = None, None, -1
        self._backlog_request = None
        if pump is not None:
            pump.close()
        elif '://' in self.name and port is not None:
            # pyserial sleeps in there; what was written leaves by itself.
            threading.Thread(target=_quietly, args=(port.close,), daemon=True).start()
        elif port is not None:
            if fd >= 0:
                _drain(fd)
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
            if self._is_busy():
                return False
            self._write(frame)
        except OSError as error:
            raise TransportError(f'{self.name}: cannot write ({error.strerror})') from error
        return True

    def _is_busy(self) -> bool:
        """Tell whether the line still has enough to do. :raises TransportError: it stalled."""
        request = self._backlog_request
        if request is None or _backlog(self._fd, request) <= _BACKLOG_LIMIT:
            self._busy_since = None
            return False
        now = time.monotonic()
        if self._busy_since is None:
            self._busy_since = now
        elif now - self._busy_since > _STALL_TIME:
            raise TransportError(f'{self.name}: took no bytes for {_STALL_TIME * 1e3:.0f} ms')
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


def _set_vmin(fd: int) -> None:
    """Have an empty port say "try again": pyserial leaves it at "0 bytes", as a lost one says."""
    attributes = termios.tcgetattr(fd)
    attributes[6][termios.VMIN] = 1
    termios.tcsetattr(fd, termios.TCSANOW, attributes)


def _set_prompt(fd: int) -> None:
    """Have a TCP connection send small frames at once, and notice a peer that is gone."""
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(fd)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _TCP_USER_TIMEOUT_MS)


def _backlog(fd: int, request: int = termios.TIOCOUTQ) -> int:
    """Return how many bytes wait in the kernel to be sent."""
    (count,) = struct.unpack('i', fcntl.ioctl(fd, request, b'\0' * 4))
    return int(count)


def _drain(fd: int) -> None:
    """Let queued bytes leave, but never wait for a dead line: closing would, for up to 30 s."""
    end = time.monotonic() + _DRAIN_TIME
    try:
        while _backlog(fd) and time.monotonic() < end:
            time.sleep(0.001)
        if _backlog(fd):  # on a pty a flush takes away what the other end has not read yet
            termios.tcflush(fd, termios.TCOFLUSH)
    except (OSError, termios.error):
        pass  # unplugged: there is nothing to drain


def _quietly(function, *args) -> None:  # type: ignore[no-untyped-def]
    with contextlib.suppress(OSError):  # closing what is already gone
        function(*args)


class _Pump:
    """Carries bytes between a URL port and one end of a socket pair; the other end is ours."""

    def __init__(self, port: Any) -> None:
        self._port = port
        self._ours, self._theirs = socket.socketpair()
        self._ours.setblocking(False)
        # Small buffers: commands that wait are commands that come too late.
        self._ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
        self._reader = threading.Thread(target=self._inward, daemon=True)
        self._writer = threading.Thread(target=self._outward, daemon=True)
        self._reader.start()
        self._writer.start()

    def fileno(self) -> int:
        return self._ours.fileno()

    def close(self) -> None:
        """Close both, without waiting; what is queued gets 50 ms to leave."""
        _quietly(self._ours.shutdown, socket.SHUT_RDWR)
        self._ours.close()
        threading.Thread(target=self._finish, daemon=True).start()

    def _finish(self) -> None:
        self._writer.join(_DRAIN_TIME)
        _quietly(self._port.close)

    # Whatever a driver raises from a port that was lost, or closed under it, is the end.

    def _inward(self) -> None:
        with contextlib.suppress(Exception):
            while data := self._port.read(max(1, self._port.in_waiting)):
                self._theirs.sendall(data)
        _quietly(self._theirs.shutdown, socket.SHUT_RDWR)

    def _outward(self) -> None:
        with contextlib.suppress(Exception):
            while data := self._theirs.recv(4096):
                self._port.write(data)
        _quietly(self._theirs.shutdown, socket.SHUT_RDWR)
