# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Captures of a network: pcap and pcapng, for UDP over IPv4 and for CAN (SocketCAN).

pcap is a header of 24 bytes, then records: seconds, fraction, captured length, original length (32
bits each), packet. pcapng is blocks: type, size, content, size again; sizes are multiples of 4.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import ipaddress
import struct
from typing import BinaryIO, NamedTuple

from rugged_teleop.decode.pieces import can_piece, Damage, Piece

# By the first bytes: byte order, and parts of a second.
MAGIC = {
    b'\xa1\xb2\xc3\xd4': ('>', 1_000_000),
    b'\xd4\xc3\xb2\xa1': ('<', 1_000_000),
    b'\xa1\xb2\x3c\x4d': ('>', 1_000_000_000),
    b'\x4d\x3c\xb2\xa1': ('<', 1_000_000_000),
}
MAGIC_NG = b'\x0a\x0d\x0d\x0a'
_HEADER_SIZE, _RECORD_SIZE = 24, 16  # pcap
_LARGEST = 1 << 18  # bytes of a packet, as in libpcap
_LARGEST_BLOCK = 1 << 20
_READ = 1 << 16
_YEAR = 366 * 86400

_INTERFACE, _SIMPLE_PACKET, _PACKET = 1, 3, 6  # blocks of pcapng
_SECTION = int.from_bytes(MAGIC_NG, 'big')  # the same in both byte orders
_BLOCKS = (_INTERFACE, _SIMPLE_PACKET, _PACKET, _SECTION, 2, 4, 5, 10)  # 2 is obsolete
_RESOLUTION = 9  # option if_tsresol

_ETHERNET, _SLL, _SLL2, _LOOPBACK, _CAN = 1, 113, 276, 0, 227  # link types
_CLASSIC_SIZE = 16  # bytes, with the head, of classic CAN; at most
_ARPHRD_CAN, _P_CAN, _P_CANFD = 280, 0x0C, 0x0D  # Linux, if_arp.h and if_ether.h
_RAW_IP = (12, 14, 101, 228)
_IPV4, _VLANS = 0x0800, (0x8100, 0x88A8)
_UDP = 17
_NOT_UDP = 'packet without UDP over IPv4'


class _Cooked(NamedTuple):
    """Where a head of Linux cooked captures has the protocol and the kind of hardware."""

    kind: int
    hardware: int
    size: int

    def is_can(self, packet: bytes) -> bool:
        """Tell whether a frame of CAN is behind it."""
        (kind,) = struct.unpack_from('>H', packet, self.kind)
        (hardware,) = struct.unpack_from('>H', packet, self.hardware)
        return hardware == _ARPHRD_CAN and kind in (_P_CAN, _P_CANFD)


_COOKED = {_SLL: _Cooked(14, 2, 16), _SLL2: _Cooked(0, 8, 20)}


class _Window:
    """A file that can be looked into ahead."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._buffer = b''
        self._start = 0
        self.offset = 0

    def peek(self, size: int, ahead: int = 0) -> bytes:
        """Return up to ``size`` bytes, ``ahead`` of here; fewer at the end of the file."""
        end = ahead + size
        while len(self._buffer) - self._start < end:
            data = self._file.read(max(end, _READ))
            if not data:
                break
            self._buffer, self._start = self._buffer[self._start :] + data, 0
        return self._buffer[self._start + ahead : self._start + end]

    def skip(self, size: int) -> None:
        """Go on by bytes that were seen."""
        self._start += size
        self.offset += size


def pcap(file: BinaryIO) -> Iterator[Piece | Damage]:
    """Read a pcap file. :raises ValueError: it is none."""
    window = _Window(file)
    if window.peek(4) not in MAGIC:
        raise ValueError('does not begin as a pcap file does')
    order, parts = MAGIC[window.peek(4)]
    header = window.peek(_HEADER_SIZE)
    if len(header) < _HEADER_SIZE:
        yield Damage(0, len(header), 'cut short')
        return
    link = struct.unpack(order + 'I', header[20:])[0] & 0xFFFF
    window.skip(_HEADER_SIZE)
    records = _Records(window, struct.Struct(order + '4I'), parts)
    while found := records.next():
        if isinstance(found, Damage):
            yield found
        else:
            offset, at, packet = found
            yield _read_packet(link, packet, offset, at, order)


class _Records:
    """The records of a pcap file; after a damaged one those behind it."""

    def __init__(self, window: _Window, head: struct.Struct, parts: int) -> None:
        self._window = window
        self._head = head
        self._parts = parts
        self._second: int | None = None

    def next(self) -> tuple[int, float, bytes] | Damage | None:
        """Return a record's offset, time and packet, or what was skipped; None at the end."""
        offset = self._window.offset
        if not self._window.peek(1):
            return None
        head = self._plausible(0)
        if head is None:
            return self._search()
        second, part, size, _ = head
        packet = self._window.peek(size, _RECORD_SIZE)
        self._window.skip(_RECORD_SIZE + len(packet))
        if len(packet) < size:
            return Damage(offset, _RECORD_SIZE + len(packet), 'cut short at the end of the file')
        self._second = second
        return offset, second + part / self._parts, packet

    def _plausible(self, ahead: int) -> tuple[int, int, int, int] | None:
        """Return the head of the record there, if it can be one."""
        data = self._window.peek(_RECORD_SIZE, ahead)
        if len(data) < _RECORD_SIZE:
            return None
        second, part, size, original = self._head.unpack(data)
        near = self._second is None or abs(second - self._second) < _YEAR
        possible = 0 < size <= original <= _LARGEST
        return (second, part, size, original) if near and possible and part < self._parts else None

    def _search(self) -> Damage:
        """Skip to the next two records in a row, or to the one that ends the file."""
        offset = self._window.offset
        while self._window.peek(1):
            self._window.skip(1)
            head = self._plausible(0)
            if head is not None and self._is_followed(head[2]):
                break
        return Damage(offset, self._window.offset - offset, 'not a record of a packet')

    def _is_followed(self, size: int) -> bool:
        """Tell whether a record, or the end of the file, is behind one with so large a packet."""
        at_end = len(self._window.peek(size + 1, _RECORD_SIZE)) == size
        return at_end or self._plausible(_RECORD_SIZE + size) is not None


# pcapng


@dataclass(frozen=True, slots=True)
class _Interface:
    link: int
    parts: int = 1_000_000  # of a second


class _Section:
    """Byte order and interfaces, which every section of a file has anew."""

    def __init__(self, order: str) -> None:
        self.order = order
        self.interfaces: list[_Interface] = []

    def read(self, kind: int, body: bytes, offset: int) -> Piece | Damage | None:
        """Read a block. :raises struct.error: it is shorter than its type demands."""
        if kind == _INTERFACE:
            self.interfaces.append(self._interface(body))
        elif kind == _PACKET:
            number, high, low, size, _ = struct.unpack_from(self.order + '5I', body)
            return self._packet(number, high << 32 | low, body[20:][:size], size, offset)
        elif kind == _SIMPLE_PACKET:
            (size,) = struct.unpack_from(self.order + 'I', body)
            return self._packet(0, None, body[4:][:size], min(size, len(body) - 4), offset)
        return None

    def _packet(
        self, number: int, ticks: int | None, packet: bytes, size: int, offset: int
    ) -> Piece | Damage:
        if number >= len(self.interfaces):
            return Damage(offset, len(packet), f'interface {number} is not described')
        if len(packet) < size:
            return Damage(offset, len(packet), 'shorter than its length says')
        interface = self.interfaces[number]
        at = None if ticks is None else ticks / interface.parts
        return _read_packet(interface.link, packet, offset, at, self.order)

    def _interface(self, body: bytes) -> _Interface:
        (link,) = struct.unpack_from(self.order + 'H', body)
        place = 8
        while place + 4 <= len(body):
            code, size = struct.unpack_from(self.order + '2H', body, place)
            if code == _RESOLUTION and size == 1:
                power = body[place + 4]
                return _Interface(link, 2 ** (power & 0x7F) if power & 0x80 else 10**power)
            place += 4 + (size + 3) // 4 * 4
        return _Interface(link)


def pcapng(file: BinaryIO) -> Iterator[Piece | Damage]:
    """Read a pcapng file."""
    window, section = _Window(file), _Section('<')
    while head := window.peek(12):
        offset = window.offset
        if head.startswith(MAGIC_NG) and len(head) == 12:
            section = _Section('<' if head[8:] == b'\x4d\x3c\x2b\x1a' else '>')
        block = _block(window, section.order)
        if block is None:
            yield _skip_to_block(window, section.order)
            continue
        kind, size = block
        body = window.peek(size - 12, 8)
        window.skip(size)
        try:
            found = section.read(kind, body, offset)
        except struct.error:
            found = Damage(offset, size, 'shorter than its type demands')
        if found is not None:
            yield found


def _block(window: _Window, order: str) -> tuple[int, int] | None:
    """Return type and size of the block that stands here; None: there is none."""
    head = window.peek(8)
    if len(head) < 8:
        return None
    kind, size = struct.unpack(order + '2I', head)
    if kind not in _BLOCKS or size % 4 or not 12 <= size <= _LARGEST_BLOCK:
        return None
    return (kind, size) if window.peek(4, size - 4) == head[4:] else None


def _skip_to_block(window: _Window, order: str) -> Damage:
    offset = window.offset
    while window.peek(1):
        window.skip(1)
        if window.peek(4) == MAGIC_NG or _block(window, order) is not None:
            break
    return Damage(offset, window.offset - offset, 'not a block')


# Packets


def _read_packet(
    link: int, packet: bytes, offset: int, at: float | None, order: str
) -> Piece | Damage:
    """:param order: of the bytes of the computer that captured."""
    try:
        if link == _CAN:
            return _can_frame(packet, offset, at)
        cooked = _COOKED.get(link)
        if cooked is not None and cooked.is_can(packet):
            # Unlike in a capture of CAN alone, the identifier is as the computer had it.
            number = int.from_bytes(packet[4:8], 'big')
            source = f'interface {number}' if link == _SLL2 else ''
            return _can_frame(packet[cooked.size :], offset, at, order, source)
        start = _ip_start(link, packet)
        if start is None:
            return Piece(offset, b'', at, form=_NOT_UDP)
        return _datagram(packet[start:], offset, at)
    except (struct.error, IndexError, ipaddress.AddressValueError):
        return Damage(offset, len(packet), 'shorter than its headers say', packet, at)


def _can_frame(
    packet: bytes, offset: int, at: float | None, order: str = '>', source: str = ''
) -> Piece | Damage:
    word, size = struct.unpack_from(order + 'IB', packet)
    data = packet[8:][:size]
    if len(data) < size:
        return Damage(offset, len(packet), 'shorter than its length says', packet, at)
    return can_piece(
        offset,
        word & 0x1FFFFFFF,
        data,
        at=at,
        source=source,
        extended=bool(word & 0x80000000),
        error=bool(word & 0x20000000),
        remote=bool(word & 0x40000000),
        # Nothing else tells: of classic CAN not all that captures clears the rest of the head.
        fd=len(packet) > _CLASSIC_SIZE,
    )


def _ip_start(link: int, packet: bytes) -> int | None:
    """Return where IPv4 begins; None: it is something else."""
    if link in _RAW_IP:
        return 0 if packet[0] >> 4 == 4 else None
    if link == _LOOPBACK:
        return 4 if 2 in (packet[0], packet[3]) else None  # AF_INET, in either byte order
    if link == _ETHERNET:
        place, start = 12, 14
        while int.from_bytes(packet[place : place + 2], 'big') in _VLANS:
            place, start = place + 4, start + 4
    elif cooked := _COOKED.get(link):
        place, start = cooked.kind, cooked.size
    else:
        return None
    (kind,) = struct.unpack_from('>H', packet, place)
    return start if kind == _IPV4 else None


def _datagram(ip: bytes, offset: int, at: float | None) -> Piece:
    size, fragment, kind = struct.unpack_from('>2xH2xHxB', ip)
    start = (ip[0] & 0x0F) * 4
    if kind != _UDP or fragment & 0x3FFF:
        return Piece(offset, b'', at, form=_NOT_UDP)
    sender, receiver = (ipaddress.IPv4Address(ip[place : place + 4]) for place in (12, 16))
    source_port, port, length = struct.unpack_from('>3H', ip, start)
    source = f'{sender}:{source_port} > {receiver}:{port}'
    data = ip[start + 8 : start + length]
    is_whole = len(ip) >= size and len(data) == length - 8
    return Piece(offset, data, at, source, form='' if is_whole else 'cut short by the capture')
