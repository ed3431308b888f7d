# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The checksums, against the plain loops of their definitions."""

from collections.abc import Callable
from functools import partial
import random

import pytest

from bridge_core.checksums import (
    crc16_ccitt_false,
    crc32_iso_hdlc,
    crc32_mpeg2,
    fletcher16,
    is_fletcher16,
)

LENGTHS = range(601)  # a packet of the VM-110, the longest, has 20 to 512 bytes
Check = Callable[[bytes], int]


def plain_fletcher16(data: bytes) -> int:
    sum1 = sum2 = 0
    for byte in data:
        sum1 = (sum1 + byte) % 256
        sum2 = (sum2 + sum1) % 256
    return sum2 << 8 | sum1


def plain_crc(width: int, polynomial: int, data: bytes) -> int:
    """Divide bit by bit, the highest one first, with all ones as the first remainder."""
    mask, crc = (1 << width) - 1, (1 << width) - 1
    for byte in data:
        crc ^= byte << width - 8
        for _ in range(8):
            crc = (crc << 1 ^ (polynomial if crc >> width - 1 else 0)) & mask
    return crc


def plain_iso_hdlc(data: bytes) -> int:
    mirrored = bytes(int(f'{byte:08b}'[::-1], 2) for byte in data)
    return int(f'{plain_mpeg2(mirrored):032b}'[::-1], 2) ^ 0xFFFFFFFF


plain_crc16 = partial(plain_crc, 16, 0x1021)
plain_mpeg2 = partial(plain_crc, 32, 0x04C11DB7)


def samples(length: int) -> list[bytes]:
    random_data = random.Random(length).randbytes(length)
    return [random_data, b'\xff' * length, b'\x00' * length, b'\xff' * (length // 2) + random_data]


@pytest.mark.parametrize(
    ('fast', 'plain', 'step'),
    [
        (fletcher16, plain_fletcher16, 1),
        (crc16_ccitt_false, plain_crc16, 1),
        (crc32_mpeg2, plain_mpeg2, 3),  # whose plain loops are slow
        (crc32_iso_hdlc, plain_iso_hdlc, 3),
    ],
)
def test_every_length_equals_the_plain_loop(fast: Check, plain: Check, step: int) -> None:
    for length in LENGTHS[::step]:
        for data in samples(length):
            assert fast(data) == plain(data), (length, data.hex())


def test_sums_are_right_exactly_if_they_are_those_of_the_plain_loop() -> None:
    for length in LENGTHS:
        for data in samples(length):
            sums = plain_fletcher16(data)
            assert is_fletcher16(data, sums)
            for wrong in (sums ^ 1, sums ^ 0x100, sums ^ 0x8000, sums ^ 0x80, ~sums & 0xFFFF):
                assert not is_fletcher16(data, wrong), (length, data.hex())


@pytest.mark.parametrize(
    ('check', 'data', 'value'),
    [
        # The catalogue's check values of these algorithms.
        (crc16_ccitt_false, b'123456789', 0x29B1),
        (crc32_mpeg2, b'123456789', 0x0376E6E7),
        (crc32_iso_hdlc, b'123456789', 0xCBF43926),
        (crc16_ccitt_false, b'', 0xFFFF),
        (crc32_mpeg2, b'', 0xFFFFFFFF),
        (crc32_iso_hdlc, b'', 0),
        (fletcher16, b'', 0),
        # Worked out by hand: sums 1, 3, 6 and sums of sums 1, 4, 10.
        (fletcher16, b'\x01\x02\x03', 0x0A06),
        (fletcher16, b'\xff\x02', 0x0001),  # 255 + 2 = 257, and 255 + 1 = 256: both wrap, at 256
        (fletcher16, b'\x00\xff', 0xFFFF),
    ],
)
def test_known_values(check: Check, data: bytes, value: int) -> None:
    assert check(data) == value
