# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Captures of a network, in both formats, both byte orders, and damaged."""

from __future__ import annotations

from pathlib import Path
import struct

from hypothesis import given, HealthCheck, settings, strategies as st
import pytest

from stage.captures import (
    block,
    decoded,
    ethernet,
    pcap_file,
    pcap_record,
    pcapng_file,
    pcapng_packet,
    STREAMS,
    udp,
)
from stage.rig import ROOT

VRPI, BLOCKED, COMMAND = STREAMS['vm110']
PACKETS = [(1700000000.25, VRPI), (1700000000.375, BLOCKED), (1700000001.0, COMMAND)]
NAMES = ['PeriodicInput', 'PeriodicInput', 'CommandInput']
HEADERS = {  # by link type, what stands before IPv4
    0: struct.pack('<I', 2),
    1: bytes(12) + b'\x08\x00',
    101: b'',
    113: bytes(14) + b'\x08\x00',
    276: b'\x08\x00' + bytes(18),
}
each_link = pytest.mark.parametrize('link', HEADERS)
each_order = pytest.mark.parametrize('order', ['<', '>'])


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / 'capture'


@each_link
@each_order
@pytest.mark.parametrize('parts', [1_000_000, 1_000_000_000])
def test_datagrams_of_pcap(link: int, order: str, parts: int, path: Path) -> None:
    packets = [(at, HEADERS[link] + udp(payload)) for at, payload in PACKETS]
    path.write_bytes(pcap_file(packets, link, order, parts))
    entries = decoded(path)
    assert [entry.name for entry in entries] == NAMES
    assert [entry.at for entry in entries] == [at for at, _ in PACKETS]
    assert {entry.source for entry in entries} == {'192.168.1.7:5825 > 239.255.42.20:5825'}
    assert entries[0].offset == 24


@each_link
@each_order
def test_datagrams_of_pcapng(link: int, order: str, path: Path) -> None:
    packets = [(round(at * 1e6), HEADERS[link] + udp(payload)) for at, payload in PACKETS]
    path.write_bytes(pcapng_file(packets, link, order))
    entries = decoded(path)
    assert [entry.name for entry in entries] == NAMES
    assert [entry.at for entry in entries] == [at for at, _ in PACKETS]


@pytest.mark.parametrize(('option', 'parts'), [(9, 10**9), (0x80 | 10, 1024)])
def test_clock_of_an_interface_is_its_own(option: int, parts: int, path: Path) -> None:
    options = struct.pack('<HH4s', 1, 3, b'abc') + struct.pack('<HHB3x', 9, 1, option)
    path.write_bytes(pcapng_file([(5 * parts // 2, ethernet(udp(VRPI)))], options=options))
    assert [entry.at for entry in decoded(path)] == [2.5]


def test_packet_of_an_old_tool_has_no_time(path: Path) -> None:
    packet = ethernet(udp(VRPI))
    path.write_bytes(pcapng_file([]) + block(3, struct.pack('<I', len(packet)) + packet))
    assert [(entry.name, entry.at) for entry in decoded(path)] == [('PeriodicInput', None)]


def test_vlan_is_looked_through(path: Path) -> None:
    tagged = ethernet(b'\x00\x05\x08\x00' + udp(VRPI), b'\x81\x00')
    path.write_bytes(pcap_file([(1.0, tagged)]))
    assert [entry.name for entry in decoded(path)] == ['PeriodicInput']


def test_frames_of_can(path: Path) -> None:
    words = [0x80000000 | 0x0CFDE801, 0x20000004, 0x123]
    frames = [struct.pack('>IB3x', word, 6) + bytes.fromhex('090000000000') for word in words]
    path.write_bytes(pcap_file([(1.0, frame) for frame in frames], 227))
    names = [(entry.name, entry.identifier) for entry in decoded(path)]
    assert names == [('heartbeat', 0x0CFDE801), ('error frame', 4), ('standard frame', 0x123)]


def test_rest_of_a_short_head_of_can_says_nothing() -> None:
    """Real captures do not clear it; a stop among them was shown as CAN FD."""
    entries = decoded(ROOT / 'test' / 'recordings' / 'can_head_not_cleared.pcap')
    assert [entry.name for entry in entries] == ['heartbeat'] * 4
    assert [entry.fields()['estop'] for entry in entries] == [[], [], ['SRC (remote)'], []]


@pytest.mark.parametrize(
    ('size', 'flags', 'data', 'name'),
    [
        *((8, 0xFF, 8, 'other'), (8, 0x04, 64, 'CAN FD frame'), (12, 0, 64, 'CAN FD frame')),
        *((8, 0, 3, 'damage'), (9, 0, 8, 'damage')),
    ],
)
def test_size_of_its_record_tells_can_fd(
    size: int, flags: int, data: int, name: str, path: Path
) -> None:
    frame = struct.pack('>IBBBB', 0x98EFFF80, size, flags, 0xA5, 0x5A) + bytes(data)
    path.write_bytes(pcap_file([(1.0, frame)], 227))
    assert [entry.name for entry in decoded(path)] == [name]


@each_order
@pytest.mark.parametrize('ng', [False, True])
@pytest.mark.parametrize('link', [113, 276])
def test_frames_of_can_in_cooked_captures(link: int, ng: bool, order: str, path: Path) -> None:
    """There an identifier has the byte order of the computer that captured."""
    head = struct.pack('>HH10xH', 0, 280, 0x0C)  # 280: ARPHRD_CAN
    if link == 276:
        head = struct.pack('>HHIH10x', 0x0C, 0, 7, 280)
    frame = struct.pack(order + 'IB3x', 0x8CFDE801, 6) + bytes.fromhex('0900000000000000')
    packets = [(1.0, head + frame)]
    if ng:
        data = pcapng_file([(1000000, head + frame)], link, order)
    else:
        data = pcap_file(packets, link, order)
    path.write_bytes(data)
    (entry,) = decoded(path)
    assert (entry.name, entry.source) == ('heartbeat', 'interface 7' if link == 276 else '')


def test_other_traffic_is_neither_shown_nor_damage(path: Path) -> None:
    tcp = bytearray(udp(b'hello'))
    tcp[9] = 6
    fragment = bytearray(udp(VRPI))
    fragment[6:8] = b'\x20\x00'
    others = [ethernet(b'\x00' * 28, b'\x08\x06'), ethernet(bytes(tcp)), ethernet(udp(b'mdns'))]
    path.write_bytes(pcap_file([(1.0, each) for each in (*others, ethernet(bytes(fragment)))]))
    entries = decoded(path)
    assert [(entry.protocol, entry.damaged) for entry in entries] == [('', False)] * 4


def test_damaged_datagram_is_reported(path: Path) -> None:
    broken = bytes((*VRPI[:30], VRPI[30] ^ 1, *VRPI[31:]))
    path.write_bytes(pcap_file([(1.0, ethernet(udp(broken))), (2.0, ethernet(udp(VRPI)))]))
    bad, good = decoded(path)
    assert (bad.damaged, bad.offset, bad.at, good.name) == (True, 24, 1.0, 'PeriodicInput')
    assert 'wrong CRC' in bad.content


@pytest.mark.parametrize('ng', [False, True])
def test_datagram_that_the_capture_has_cut_is_said_to_be(ng: bool, path: Path) -> None:
    packet = ethernet(udp(VRPI))
    cut = packet[:-10]
    if ng:
        head = struct.pack('<5I', 0, 0, 0, len(cut), len(packet))
        path.write_bytes(pcapng_file([]) + block(6, head + cut))
    else:
        record = struct.pack('<4I', 1, 0, len(cut), len(packet)) + cut
        path.write_bytes(pcap_file([]) + record)
    (bad,) = decoded(path)
    assert bad.content == 'cut short by the capture'


def test_damaged_record_costs_only_itself(path: Path) -> None:
    packet = ethernet(udp(VRPI))
    record = pcap_record(1700000000.0, packet)
    for broken in (
        record[:4] + b'\xff\xff\xff\xff' + record[8:],  # microseconds that cannot be
        record[:8] + b'\xff\xff\xff\x7f' + record[12:],  # a length that cannot be
        record[5:],
        b'noise',
    ):
        path.write_bytes(pcap_file([(1700000000.0, packet)]) + broken + record * 2)
        entries = decoded(path)
        assert [entry.damaged for entry in entries] == [False, True, False, False], broken
        assert entries[1].offset == 24 + len(record)
        assert entries[1].size == len(broken)


def test_damaged_block_costs_only_itself(path: Path) -> None:
    packet = ethernet(udp(VRPI))
    whole = pcapng_packet(0, packet)
    head = pcapng_file([(0, packet)])
    for broken in (whole[:-1] + b'\x01', whole[:4] + b'\x07' + whole[5:], whole[3:], b'noise'):
        path.write_bytes(head + broken + whole * 2)
        entries = decoded(path)
        assert [entry.damaged for entry in entries] == [False, True, False, False], broken
        assert (entries[1].offset, entries[1].size) == (len(head), len(broken))


def test_packet_of_an_interface_that_is_not_described_is_damage(path: Path) -> None:
    section = block(0x0A0D0D0A, struct.pack('<IHHq', 0x1A2B3C4D, 1, 0, -1))
    path.write_bytes(section + pcapng_packet(0, ethernet(udp(VRPI))))
    (bad,) = decoded(path)
    assert bad.content == 'interface 0 is not described'


@pytest.mark.parametrize('ng', [False, True])
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_no_bytes_make_it_fail(ng: bool, path: Path, data: st.DataObject) -> None:
    packets = [(at, ethernet(udp(payload))) for at, payload in PACKETS]
    whole = bytearray(
        pcapng_file([(round(at * 1e6), packet) for at, packet in packets])
        if ng
        else pcap_file(packets)
    )
    for place in data.draw(st.lists(st.integers(4, len(whole) - 1), max_size=5)):
        whole[place] = data.draw(st.integers(0, 255))
    end = data.draw(st.integers(4, len(whole)))
    path.write_bytes(bytes(whole[:end]))
    for entry in decoded(path):
        assert 0 <= entry.offset <= end


def test_packet_that_ends_within_its_addresses_costs_only_itself(path: Path) -> None:
    short = udp(VRPI)[:14]
    path.write_bytes(pcap_file([(1.0, short), (2.0, udp(VRPI))], link=101))
    assert [(entry.damaged, entry.at) for entry in decoded(path)] == [(True, 1.0), (False, 2.0)]


def test_file_that_is_no_pcap_is_refused_where_it_is_called_one(path: Path) -> None:
    path.write_bytes(b'no capture')
    with pytest.raises(ValueError, match='does not begin as a pcap file does'):
        decoded(path, kind='pcap')
