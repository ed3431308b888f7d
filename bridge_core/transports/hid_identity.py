# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Who a hidraw device is, and what its reports look like, as the kernel tells (linux/hidraw.h).

A report has no check that would tell one device's from another's: nine bytes of a keyboard make a
valid report of any other device with nine bytes.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
import fcntl
import struct

_DESCRIPTOR_SIZE = 0x80044801  # HIDIOCGRDESCSIZE: int
_DESCRIPTOR = 0x90044802  # HIDIOCGRDESC: u32 size, 4096 bytes
_INFO = 0x80084803  # HIDIOCGRAWINFO: u32 bus type, s16 vendor, s16 product
_NAME = 0x81004804  # HIDIOCGRAWNAME(256)
_INFO_LAYOUT = struct.Struct('=IHH')
_LARGEST_DESCRIPTOR = 4096  # bytes
_LARGEST_NAME = 256  # bytes

# Prefixes of items without their two bits of size (HID 1.11, section 6.2.2).
_INPUT, _REPORT_SIZE, _REPORT_ID, _REPORT_COUNT = 0x80, 0x74, 0x84, 0x94
_PUSH, _POP = 0xA4, 0xB4
_LONG_ITEM = 0xFE


@dataclass(frozen=True, slots=True)
class HidIdentity:
    """
    A device on hidraw.

    :param device: vendor and product in hexadecimal, such as '2a99:d002'.
    :param name: as it calls itself. :param sizes: bits of its input reports by number; 0: none.
    """

    device: str
    name: str
    sizes: dict[int, int]

    def __str__(self) -> str:
        return f'{self.device} {self.name}'.rstrip()


def identity_of(fd: int) -> HidIdentity:
    """Ask the kernel. :raises OSError: it is no hidraw device, or does not answer."""
    _, vendor, product = _INFO_LAYOUT.unpack(fcntl.ioctl(fd, _INFO, bytes(_INFO_LAYOUT.size)))
    name = fcntl.ioctl(fd, _NAME, bytes(_LARGEST_NAME)).split(b'\0')[0]
    (size,) = struct.unpack('=I', fcntl.ioctl(fd, _DESCRIPTOR_SIZE, bytes(4)))
    asked = bytearray(struct.pack('=I', size) + bytes(_LARGEST_DESCRIPTOR))
    fcntl.ioctl(fd, _DESCRIPTOR, asked)
    words = ''.join(c for c in name.decode('utf-8', 'replace') if c.isprintable())
    return HidIdentity(
        f'{vendor:04x}:{product:04x}', words, report_sizes(bytes(asked[4 : 4 + size]))
    )


def report_sizes(descriptor: bytes) -> dict[int, int]:
    """Return the bits of each input report by its number; 0 where reports have no number."""
    sizes: defaultdict[int, int] = defaultdict(int)
    size = count = number = at = 0
    pushed = []
    while at < len(descriptor):
        prefix = descriptor[at]
        if prefix == _LONG_ITEM:
            at += 3 + (descriptor[at + 1] if at + 1 < len(descriptor) else 0)
            continue
        length = (0, 1, 2, 4)[prefix & 3]
        value = int.from_bytes(descriptor[at + 1 : at + 1 + length], 'little')
        kind = prefix & 0xFC
        if kind == _REPORT_SIZE:
            size = value
        elif kind == _REPORT_COUNT:
            count = value
        elif kind == _REPORT_ID:
            number = value
        elif kind == _PUSH:
            pushed.append((size, count, number))
        elif kind == _POP and pushed:
            size, count, number = pushed.pop()
        elif kind == _INPUT:
            sizes[number] += size * count
        at += 1 + length
    return dict(sizes)
