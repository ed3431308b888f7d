# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checksums of the devices' wire formats, each on a routine of the standard library.

==================  =========================================  ==========================
name                definition                                 used by
==================  =========================================  ==========================
fletcher16          two 8-bit sums, modulo 256                 FORT VSC (7.6), SSC (4)
crc16_ccitt_false   poly 0x1021, start 0xFFFF, not reflected   ESI drive (4.1.3)
crc32_mpeg2         poly 0x04C11DB7, start 0xFFFFFFFF, not     VM-110 (3.3), one reading
                    reflected, not inverted at the end
crc32_iso_hdlc      the same, reflected, inverted at the end   VM-110 (3.3), the other
==================  =========================================  ==========================
"""

import binascii
import zlib

# zlib.adler32 sums modulo 65521, which equals the plain sums as long as neither reaches it.
# With both sums carried in below 256, 21 bytes of 0xFF give 255 * (1 + 21 + 231) = 64515.
_FLETCHER_CHUNK = 21
_PLAIN_CHUNK = 256  # bytes whose plain sum stays below 65521

# Each byte with its bits reversed. The standard library has only reflected CRCs; over bit-reversed
# data, and with the result bit-reversed, they equal those that are not reflected.
_MIRROR = bytes(int(f'{byte:08b}'[::-1], 2) for byte in range(256))


def fletcher16(data: bytes) -> int:
    """
    Return ``sum2 << 8 | sum1``: sum1 is the plain sum of the bytes, sum2 the sum of all sum1.

    Both are modulo 256. Source: FORT VSC manual 7.6 (figure 16).
    """
    sums = 0
    while len(data) > _FLETCHER_CHUNK:
        sums = zlib.adler32(data[:_FLETCHER_CHUNK], sums) & 0x00FF00FF
        data = data[_FLETCHER_CHUNK:]
    sums = zlib.adler32(data, sums)
    return sums >> 8 & 0xFF00 | sums & 0xFF


def is_fletcher16(data: bytes, sums: int) -> bool:
    """Tell whether these are the sums of data; the plain sum alone rules out most noise."""
    if len(data) > _FLETCHER_CHUNK:
        plain = zlib.adler32(data[:_PLAIN_CHUNK], 0) + sum(data[_PLAIN_CHUNK:])
        return not (plain ^ sums) & 0xFF and fletcher16(data) == sums
    both = zlib.adler32(data, 0)
    return (both >> 8 & 0xFF00 | both & 0xFF) == sums


def crc16_ccitt_false(data: bytes) -> int:
    """Return CRC-16/CCITT-FALSE; ``b'123456789'`` gives 0x29B1. Source: ESI manual 4.1.3."""
    return binascii.crc_hqx(data, 0xFFFF)


def crc32_mpeg2(data: bytes) -> int:
    """Return CRC-32/MPEG-2; ``b'123456789'`` gives 0x0376E6E7. Source: VM-110 manual 3.3."""
    mirrored = zlib.crc32(data.translate(_MIRROR)) ^ 0xFFFFFFFF
    return int.from_bytes(mirrored.to_bytes(4, 'big').translate(_MIRROR), 'little')


def crc32_iso_hdlc(data: bytes) -> int:
    """Return Ethernet's CRC-32; ``b'123456789'`` gives 0xCBF43926. Source: VM-110 manual 3.3."""
    return zlib.crc32(data)
