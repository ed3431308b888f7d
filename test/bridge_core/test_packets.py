# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Packets of a format of its own: what is refused, and in which words."""

import re
import struct

import pytest

from bridge_core.checksums import fletcher16
from bridge_core.framing import ChecksumError, FrameError
from bridge_core.packets import Message, PacketFormat

PACKETS = PacketFormat(b'\x10\x20', max_length=4, lengths={1: (2, 3)}, summed_from=2)


class Level(Message):
    """A type with two bytes or three, of which the first two are its value, below 1000."""

    PACKETS = PACKETS
    TYPE = 1

    def __init__(self, value: int) -> None:
        if value >= 1000:
            raise ValueError('too high')
        self.value = value

    @classmethod
    def _from_payload(cls, payload: bytes) -> 'Level':
        return cls(struct.unpack_from('<H', payload)[0])

    def _to_payload(self) -> bytes:
        return struct.pack('<H', self.value)


PACKET = Level(0x0102).to_bytes()


def test_packet_is_header_type_length_payload_and_sums() -> None:
    # Sums of 01 02 02 01, modulo 256: 6, and 1 + 3 + 5 + 6.
    assert PACKET.hex(' ') == '10 20 01 02 02 01 06 0f'
    assert fletcher16(PACKET[2:-2]) == 0x0F06
    assert Level.from_bytes(PACKET).value == 0x0102
    assert Level.from_bytes(PACKETS.build(1, b'\x02\x01\xff')).value == 0x0102


@pytest.mark.parametrize(
    ('packet', 'error', 'words'),
    [
        (b'', FrameError, 'not a packet: '),
        (PACKET[:5], FrameError, 'not a packet: 10200102'),
        (b'\x10\x21' + PACKET[2:], FrameError, 'not a packet: 10210102'),
        (PACKETS.build(1, b'\0'), FrameError, 'type 0x01 cannot have 1 bytes'),
        (PACKETS.build(9, bytes(5)), FrameError, 'type 0x09 cannot have 5 bytes'),
        (PACKET + b'\0', FrameError, '9 bytes, but the length byte says 2'),
        (PACKET[:-1] + b'\0', ChecksumError, 'wrong checksum 0600'),
        (PACKETS.build(9, bytes(2)), FrameError, 'type 0x09 is not Level'),
        (PACKETS.build(1, b'\xff\xff'), FrameError, 'Level: too high'),
    ],
)
def test_packet_that_is_none_is_refused_with_the_reason(
    packet: bytes, error: type[FrameError], words: str
) -> None:
    with pytest.raises(FrameError, match=f'^{re.escape(words)}$') as caught:
        Level.from_bytes(packet)
    assert caught.type is error


@pytest.mark.parametrize('length', range(6))
def test_unknown_type_may_have_any_length_up_to_the_greatest(length: int) -> None:
    assert PACKETS.size_of(bytes((0x10, 0x20, 9, length))) == (length + 6 if length <= 4 else 0)


@pytest.mark.parametrize(('baud', 'seconds'), [(1000, 2 * 9 * 10 / 1000), (115200, 0.05)])
def test_partial_packet_has_twice_the_time_of_the_longest_one(baud: int, seconds: float) -> None:
    """One of three bytes, six about it: here a type of two lengths and a shorter one."""
    lengths = {1: (2, 3), 2: (1,)}
    packets = PacketFormat(b'\x10\x20', max_length=200, lengths=lengths, summed_from=2)
    parser = packets.parser(lambda kind, payload: payload, baud)
    parser.feed(PACKET[:3], 100.0)
    assert parser.deadline == pytest.approx(100.0 + seconds)
