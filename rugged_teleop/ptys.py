# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated device on a pseudo-terminal, where a bridge finds it as it finds a serial port."""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path
import tty

from rugged_teleop.ports import Device, DevicePort

_READ_SIZE = 4096


def _refuse_living(path: Path) -> None:
    """:raises OSError: this link is that of a simulated device that is alive."""
    from rugged_teleop.doctor.ports import device_of  # late: all nodes' parameters come with it

    device = device_of(os.readlink(path))
    if device is not None:
        raise OSError(errno.EBUSY, f'is the port of {device}; name another path', str(path))


class PtyDevice(DevicePort):
    """
    A simulated device on a pseudo-terminal.

    :param path: becomes a link to the port; gone while unplugged.
    :param seed: makes the line's faults repeat themselves. None: they differ from run to run.
    :raises OSError: the link cannot be made, or ``path`` is something else already.
    """

    def __init__(self, device: Device, path: Path, *, seed: int | None = None) -> None:
        self.path = path
        self._master = self._slave = -1
        super().__init__(device, str(path), seed=seed)

    def _plug(self) -> None:
        master, slave = os.openpty()
        try:
            tty.setraw(slave)
            os.set_blocking(master, False)
            name = os.ttyname(slave)
            if self.path.is_symlink() and os.readlink(self.path).startswith('/dev/pts/'):
                _refuse_living(self.path)
                self.path.unlink()  # left by a simulator that was killed
            self.path.symlink_to(name)
        except OSError:
            os.close(master)
            os.close(slave)
            raise
        # Our own slave stays open: without one, reading the master fails while no host has it.
        self._master, self._slave, self._tty = master, slave, name

    def _unplug_port(self) -> None:
        """Go as a USB adapter goes: first the name, then whoever has it open gets an error."""
        with contextlib.suppress(OSError):  # somebody else took the name away
            if os.readlink(self.path) == self._tty:
                self.path.unlink()
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1

    def _descriptor(self) -> int:
        return self._master

    def _read_port(self) -> list[bytes]:
        try:
            return [os.read(self._master, _READ_SIZE)]
        except BlockingIOError:
            return []

    def _write_port(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0
