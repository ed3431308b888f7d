# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Captures for tests of decode: the golden frames, and pcap files written as their formats say."""

from __future__ import annotations

from collections.abc import Iterable
import json
import struct
from typing import Any

from rugged_teleop.decode.captures import opened
from rugged_teleop.decode.protocols import entries_of, Entry
from stage.rig import ROOT


def vectors(name: str) -> Any:
    return json.loads((ROOT / 'test' / 'vectors' / f'{name}.json').read_text(encoding='utf-8'))


def frames(vector: Iterable[dict[str, Any]]) -> list[bytes]:
    return [bytes.fromhex(each['hex']) for each in vector]


# By protocol, frames of the manuals.
STREAMS = {
    'fort_serial': frames(vectors('fort_vsc')['serial']),
    'ssc': frames(vectors('ssc')['frames']),
    'esi_status': frames(vectors('esi')['status_derived']),
    'esi_command': frames(vectors('esi')['command']),
    'vm110': frames(vectors('vm110')['packets']),
}
CAN = [(int(each['id'], 16), bytes.fromhex(each['data'])) for each in vectors('akron')['frames']]


def decoded(path: Any, protocol: str = '', kind: str = '') -> list[Entry]:
    with opened(str(path), kind) as capture:
        return list(entries_of(capture, protocol))


# Networks


def udp(payload: bytes) -> bytes:
    """Return an IPv4 packet; nothing here looks at its checksums."""
    head = struct.pack('>HHHH', 5825, 5825, 8 + len(payload), 0)
    size = 20 + len(head) + len(payload)
    addresses = bytes((192, 168, 1, 7, 239, 255, 42, 20))
    return struct.pack('>BBHHHBBH', 0x45, 0, size, 0, 0, 1, 17, 0) + addresses + head + payload


def ethernet(packet: bytes, kind: bytes = b'\x08\x00') -> bytes:
    return bytes(12) + kind + packet


def pcap_file(
    packets: Iterable[tuple[float, bytes]], link: int = 1, order: str = '<', parts: int = 1_000_000
) -> bytes:
    magic = 0xA1B2C3D4 if parts == 1_000_000 else 0xA1B23C4D
    return struct.pack(order + 'IHHiIII', magic, 2, 4, 0, 0, 65535, link) + b''.join(
        pcap_record(at, packet, order, parts) for at, packet in packets
    )


def pcap_record(at: float, packet: bytes, order: str = '<', parts: int = 1_000_000) -> bytes:
    second, part = int(at), round(at % 1 * parts)
    return struct.pack(order + '4I', second, part, len(packet), len(packet)) + packet


def block(kind: int, body: bytes, order: str = '<') -> bytes:
    """Return a block of pcapng."""
    body += bytes(-len(body) % 4)
    size = struct.pack(order + 'I', len(body) + 12)
    return struct.pack(order + 'I', kind) + size + body + size


def pcapng_file(
    packets: Iterable[tuple[int, bytes]], link: int = 1, order: str = '<', options: bytes = b''
) -> bytes:
    """:param packets: ticks of the interface's clock, and bytes."""
    section = block(0x0A0D0D0A, struct.pack(order + 'IHHq', 0x1A2B3C4D, 1, 0, -1), order)
    interface = block(1, struct.pack(order + 'HHI', link, 0, 65535) + options, order)
    return section + interface + b''.join(pcapng_packet(*packet, order) for packet in packets)


def pcapng_packet(ticks: int, packet: bytes, order: str = '<') -> bytes:
    size = len(packet)
    head = struct.pack(order + '5I', 0, ticks >> 32, ticks & 0xFFFFFFFF, size, size)
    return block(6, head + packet, order)
