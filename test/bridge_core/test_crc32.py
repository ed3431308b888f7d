# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VM-110's two CRCs, against the plain loops of their definitions."""

from collections.abc import Callable
import random

import pytest

from bridge_core.checksums import crc32_iso_hdlc, crc32_mpeg2

LENGTHS = range(601)  # a packet has 20 to 512 bytes


def plain_mpeg2(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ 0x04C11DB7 if crc & 0x80000000 else crc << 1) & 0xFFFFFFFF
    return crc


def plain_iso_hdlc(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xEDB88320 if crc & 1 else crc >> 1  # 0x04C11DB7, mirrored
    return crc ^ 0xFFFFFFFF


def test_every_length_up_to_600_equals_the_plain_loop() -> None:
    for length in LENGTHS:
        data = random.Random(length).randbytes(length)
        assert crc32_mpeg2(data) == plain_mpeg2(data), length
        assert crc32_iso_hdlc(data) == plain_iso_hdlc(data), length


def test_uniform_data_of_every_length_equals_the_plain_loop() -> None:
    for data in (byte * length for length in LENGTHS[::7] for byte in (b'\x00', b'\xff')):
        assert crc32_mpeg2(data) == plain_mpeg2(data)
        assert crc32_iso_hdlc(data) == plain_iso_hdlc(data)


def test_known_values() -> None:
    # The catalogue's check values of these two algorithms.
    assert crc32_mpeg2(b'123456789') == 0x0376E6E7
    assert crc32_iso_hdlc(b'123456789') == 0xCBF43926
    assert crc32_mpeg2(b'') == 0xFFFFFFFF
    assert crc32_iso_hdlc(b'') == 0


@pytest.mark.parametrize('crc', [crc32_mpeg2, crc32_iso_hdlc])
def test_any_flipped_bit_changes_it(crc: Callable[[bytes], int]) -> None:
    data = random.Random(1).randbytes(66)
    for bit in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        assert crc(bytes(flipped)) != crc(data)
