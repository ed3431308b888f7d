"""Checksums of the devices' wire formats, each on a routine of the standard library.

==================  =========================================  ==========================
name                definition                                 used by
==================  =========================================  ==========================
fletcher16          two 8-bit sums, modulo 256                 FORT VSC (7.6), SSC (4)
crc16_ccitt_false   poly 0x1021, start 0xFFFF, not reflected   ESI drive (4.1.3)
==================  =========================================  ==========================
"""

import binascii
import zlib

# zlib.adler32 sums modulo 65521, which equals the plain sums as long as neither reaches it.
# With both sums carried in below 256, 21 bytes of 0xFF give 255 * (1 + 21 + 231) = 64515.
_FLETCHER_CHUNK = 21


def fletcher16(data: bytes) -> int:
    """
    Return ``sum2 << 8 | sum1``: sum1 is the plain sum of the bytes, sum2 the sum of all sum1.

    Both are modulo 256. Source: FORT VSC manual 7.6 (figure 16).
    """
    sums = 0
    for start in range(0, len(data), _FLETCHER_CHUNK):
        sums = zlib.adler32(data[start : start + _FLETCHER_CHUNK], sums) & 0x00FF00FF
    return (sums >> 8 | sums) & 0xFFFF


def crc16_ccitt_false(data: bytes) -> int:
    """Return CRC-16/CCITT-FALSE; ``b'123456789'`` gives 0x29B1. Source: ESI manual 4.1.3."""
    return binascii.crc_hqx(data, 0xFFFF)
