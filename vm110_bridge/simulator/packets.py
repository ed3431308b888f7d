# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The simulated base unit's packets.

Built by its own few lines and the plain definition of the CRC (manual 3.3), so that a slip in the
codec of the bridge cannot hide in both.
"""

from __future__ import annotations

import struct

_REFLECTED = {'mpeg2': False, 'iso_hdlc': True}


def _shifted(crc: int) -> int:
    """Return a CRC after eight bits of the division by the polynomial."""
    for _ in range(8):
        crc = (crc << 1 ^ 0x04C11DB7 if crc & 0x80000000 else crc << 1) & 0xFFFFFFFF
    return crc


_STEPS = tuple(_shifted(byte << 24) for byte in range(256))
_MIRRORED = tuple(int(f'{byte:08b}'[::-1], 2) for byte in range(256))


def crc32(data: bytes, kind: str) -> int:
    """Return the CRC of 3.3, byte by byte. :param kind: 'mpeg2' or 'iso_hdlc'."""
    reflected = _REFLECTED[kind]
    crc = 0xFFFFFFFF
    for byte in data:
        crc = _STEPS[crc >> 24 ^ (_MIRRORED[byte] if reflected else byte)] ^ crc << 8 & 0xFFFFFFFF
    return int(f'{crc:032b}'[::-1], 2) ^ 0xFFFFFFFF if reflected else crc


def build_packet(
    kind: str, payload: bytes, serial: int, origin: int = 0, crc: str = 'mpeg2', revision: int = 0
) -> bytes:
    """Return a datagram laid out by section 3."""
    head = kind.encode() + struct.pack('<HHHHI', revision, origin, serial, len(payload), 0)
    return head + payload + struct.pack('<I', crc32(head + payload, crc))


def build_vrpi(
    *,
    bu_state: int = 0x11,
    links: tuple[int, int, int] = (1, 0, 1),
    unarmed: int = 0,
    ru: int = 0x1234,
    ru_state: int = 3,
    battery: int = 80,
    rssi: int = 90,
    flags: tuple[int, int, int] = (0, 0, 0),
    joysticks: tuple[int, ...] = (0, 0, 0, 0),
    switches: tuple[int, ...] = (0,) * 8,
    encoder: tuple[int, int] = (0, 0),
) -> bytes:
    """
    Return a VRPI's payload laid out by 4.1: as of an armed and enabled remote, if not said else.

    :param links: EG, EC, C. :param flags: cable, docked, disabled. :param encoder: value, switch.
    """
    head = struct.pack('<6BH', bu_state, 1, unarmed, *links, ru)
    remote = struct.pack('<6B', ru_state, battery, rssi, *flags)
    return head + remote + struct.pack('<12h2B6x', *joysticks, *switches, *encoder)
