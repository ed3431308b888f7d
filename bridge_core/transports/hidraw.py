# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Input reports of a USB HID device, from Linux's hidraw.

A hidraw device returns one report per read. It is asked who it is, and any other device than those
that are allowed is refused. A FIFO, a pty or a file can replace it where that is allowed, too, so
that no hardware is needed; these return a stream, which is split into reports. A read that is not
a whole number of reports shows that the stream is out of step: it is passed on unsplit, and the
session rejects it.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import errno
import os
import stat
import tty

from bridge_core.transports import TransportError
from bridge_core.transports.exclusive import PTY_MAJORS
from bridge_core.transports.hid_identity import HidIdentity, identity_of

STAND_IN = 'none'  # of the devices that are allowed: what has no identity
_HINTS = {
    errno.ENOENT: 'no such device; plug it in, or set the parameter port',
    errno.EACCES: 'no permission; install the udev rule, or add your user to the group dialout',
    errno.EISDIR: 'a folder; set the parameter port',
    errno.ENODEV: 'the device does not answer; is it plugged in?',
    errno.EIO: 'the device does not answer; is it plugged in?',
}
_READS = 64  # a call: as many as the kernel buffers; bounds how long a flood delays a stop
_READ_SIZE = 4096  # bytes; larger than any report, so that an over-long one is detected
_NAME_IT = 'set the parameter port, or name it in hid.devices'


class HidrawTransport:
    """
    One hidraw device, read only.

    :param path: such as /dev/hidraw0.
    :param report_size: bytes of a report; it has no report number.
    :param devices: those that are allowed, vendor and product in hexadecimal, such as '2a99:d002';
        STAND_IN among them allows a FIFO, a pty or a file, too.
    """

    def __init__(self, path: str, report_size: int, devices: Sequence[str]) -> None:
        self.name = path
        self._report_size = report_size
        self._devices = [device.lower() for device in devices]
        self._identity = 'none, a stand-in'
        self._fd = -1
        self._is_stream = False

    def counts(self) -> dict[str, int | str]:
        """Return who the device is; no input is dropped."""
        return {'HID device': self._identity}

    def open(self) -> None:
        """Open it and discard earlier reports. :raises TransportError: it cannot be opened."""
        self.close()
        try:
            self._fd = os.open(self.name, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
            self._prepare(os.fstat(self._fd))
        except OSError as error:
            self.close()
            hint = _HINTS.get(error.errno or 0, error.strerror)
            raise TransportError(f'cannot open {self.name}: {hint}') from error

    def _prepare(self, status: os.stat_result) -> None:
        terminal = os.isatty(self._fd)
        self._is_stream = terminal or not stat.S_ISCHR(status.st_mode)
        if stat.S_ISDIR(status.st_mode):
            raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
        if terminal:
            # A report has no checksum: bytes of another protocol could pass for reports.
            if os.major(status.st_rdev) not in PTY_MAJORS:
                raise OSError(errno.ENOTTY, 'a serial port, not hidraw; set the parameter port')
            tty.setraw(self._fd)
        if self._is_stream:
            self._allow_stand_in()
        else:
            self._allow(self._ask())
        if not stat.S_ISREG(status.st_mode):
            _discard(self._fd)

    def _allow_stand_in(self) -> None:
        if STAND_IN not in self._devices:
            raise OSError(errno.ENOTTY, f'no hidraw: it has no vendor and product; {_NAME_IT}')
        self._identity = 'none, a stand-in'

    def _ask(self) -> HidIdentity:
        try:
            return identity_of(self._fd)
        except OSError as error:
            text = f'no hidraw device: it does not tell vendor and product ({error.strerror})'
            raise OSError(errno.ENOTTY, f'{text}; set the parameter port') from error

    def _allow(self, found: HidIdentity) -> None:
        """Let a device pass that is named, and whose reports are those that are expected."""
        if found.device not in self._devices:
            wanted = ', '.join(self._devices)
            raise OSError(errno.ENOTTY, f'it is {found}, not one of {wanted}; {_NAME_IT}')
        if found.sizes != {0: 8 * self._report_size}:
            sizes = ', '.join(f'{bits} bits (number {n})' for n, bits in found.sizes.items())
            text = f'it is {found}, but its reports have {sizes or "nothing"}'
            raise OSError(errno.ENOTTY, f'{text}, not {8 * self._report_size} without a number')
        self._identity = str(found)

    def close(self) -> None:
        """Close it."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with contextlib.suppress(OSError):  # closing what is already gone
                os.close(fd)

    def fileno(self) -> int:
        """Return the descriptor to wait on; -1 while closed."""
        return self._fd

    def receive(self) -> list[bytes]:
        """Return the reports that have arrived. :raises TransportError: unplugged."""
        if self._fd < 0:
            raise TransportError(f'{self.name}: not open')
        if self._is_stream:
            return self._split(self._read(_READS * self._report_size))
        reports: list[bytes] = []
        while len(reports) < _READS and (report := self._read(_READ_SIZE)):
            reports.append(report)
        return reports

    def send(self, frame: bytes) -> bool:
        """Drop the frame: the device is read only."""
        del frame
        return False

    def _read(self, size: int) -> bytes:
        """Return what has arrived, maybe nothing. :raises TransportError: unplugged."""
        try:
            data = os.read(self._fd, size)
        except BlockingIOError:
            return b''
        except OSError as error:
            raise TransportError(f'{self.name}: unplugged ({error.strerror})') from error
        if not data:  # end of file: the other end is gone
            raise TransportError(f'{self.name}: unplugged')
        return data

    def _split(self, data: bytes) -> list[bytes]:
        size = self._report_size
        if len(data) % size:
            return [data]
        return [data[start : start + size] for start in range(0, len(data), size)]


def _discard(fd: int) -> None:
    """Discard pending input; bounded, as a writer may never pause."""
    with contextlib.suppress(BlockingIOError):
        for _ in range(_READS):
            if not os.read(fd, _READ_SIZE):
                break
