# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which device a serial port's name stands for.

The kernel numbers ttyUSB and ttyACM in the order in which devices are found, so two may be
exchanged after a reboot. What tells them apart is in sysfs, and in the links that udev makes.
"""

from __future__ import annotations

from dataclasses import dataclass
import os
from pathlib import Path
import re

SYS, DEV = Path('/sys'), Path('/dev')
_NUMBERED = re.compile(r'/dev/tty(USB|ACM)\d+')


@dataclass(frozen=True, slots=True)
class Identity:
    """
    What is known of the device at a port.

    :param text: empty: nothing, as of a pty, a port of the mainboard or one behind a network.
    :param link: a name that stays with it: by serial number where it has one, else by its plug.
    :param is_numbered: the name of the port may be another device's after a reboot.
    """

    text: str = ''
    link: str = ''
    is_numbered: bool = False

    @property
    def remedy(self) -> str:
        """What to do about the number; empty: nothing."""
        if not self.is_numbered:
            return ''
        name = self.link or 'a name that a udev rule gives by its plug'
        return f'set port to {name}: after a reboot this number may be of another device'

    def __str__(self) -> str:
        return '; '.join(filter(None, (self.text, self.remedy)))


def identity_of(port: str) -> Identity:
    """Return who is at a port, by its name; nothing is opened."""
    device = os.path.realpath(port)
    usb = _usb_device(SYS / 'class/tty' / os.path.basename(device) / 'device')
    if '://' in port or usb is None:
        return Identity()
    vendor, product, serial = (_read(usb / name) for name in ('idVendor', 'idProduct', 'serial'))
    number = f'serial number {serial}' if serial else 'without a serial number'
    links = [*_links('by-id', device)] * bool(serial) + [*_links('by-path', device)]
    return Identity(
        f'USB {vendor}:{product} {_read(usb / "product")}, {number}, at USB plug {usb.name}',
        links[0] if links else '',
        _NUMBERED.fullmatch(port) is not None,
    )


def _usb_device(tty: Path) -> Path | None:
    real = Path(os.path.realpath(tty))
    return next((each for each in (real, *real.parents) if (each / 'idVendor').is_file()), None)


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding='ascii', errors='replace').strip()
    except OSError:  # it has none, or has just left
        return ''


def _links(kind: str, device: str) -> list[str]:
    found = (DEV / 'serial' / kind).glob('*')
    return sorted(str(link) for link in found if os.path.realpath(link) == device)
