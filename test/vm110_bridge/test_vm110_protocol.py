# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VM-110's packets: golden bytes, and every way in which a network can spoil them."""

import json
import struct
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.framing import FrameError
from stage.rig import ROOT
from vm110_bridge.protocol import (
    AcknowledgeInput,
    AcknowledgeOutput,
    build_frame,
    burst,
    BuState,
    CommandInput,
    CommandOutput,
    Crc,
    decode,
    Disabled,
    Frame,
    LinkStatus,
    Message,
    PacketDecoder,
    PeriodicInput,
    PeriodicOutput,
    RuState,
    state_name,
    Unknown,
)
from vm110_bridge.simulator import build_packet  # the CRC's plain definition, not our codec

VECTORS = json.loads((ROOT / 'test' / 'vectors' / 'vm110.json').read_text())
PACKETS = VECTORS['packets']
GOLDEN = [bytes.fromhex(vector['hex']) for vector in PACKETS]
STATES = {'armed': BuState.ARMED, 'blocked': BuState.BLOCKED}


def golden_message(vector: dict[str, Any]) -> Message:
    """Build the message that a vector describes in words; what it leaves out is in 4.1's order."""
    if vector['is'] == 'VRCI':
        return CommandInput(vector['command_id'], bytes.fromhex(vector['data']))
    common: dict[str, Any] = {
        'bu_state': STATES[vector['bu_state']],
        'eg_link': LinkStatus.OPERATIONAL,
        'c_link': LinkStatus.OPERATIONAL,
    }
    if 'armed_ru' not in vector:
        return PeriodicInput(vlaps=3, unarmed_rus=1, **common)
    return PeriodicInput(
        vlaps=1,
        armed_ru=vector['armed_ru'],
        ru_state=RuState.ENABLED,
        ru_battery=0x4D,
        ru_rssi=0x5A,
        joysticks=tuple(vector['joysticks']),
        switches=tuple(vector['switches']),
        encoder=vector['encoder'],
        encoder_switch=vector['encoder_switch'],
        **common,
    )


@pytest.mark.parametrize('vector', PACKETS, ids=lambda vector: f'{vector["is"]}-{vector["crc"]}')
def test_golden_packet(vector: dict[str, Any]) -> None:
    data, crc = bytes.fromhex(vector['hex']), Crc(vector['crc'])
    frame = Frame.from_bytes(data, crc)
    assert frame.kind == vector['is'].encode()
    if 'serial' in vector:
        assert frame.serial == vector['serial']
    assert frame.origin == vector.get('origin', 7)
    message = decode(frame)
    if vector.get('bu_state') == 'blocked':  # the vector tells but this much of it
        assert isinstance(message, PeriodicInput)
        assert message.bu_state is BuState.BLOCKED
        assert message.armed_ru == 0
        assert message.joysticks == (0, 0, 0, 0)
    else:
        assert message == golden_message(vector)
    assert isinstance(message, PeriodicInput | CommandInput)
    assert build_frame(message, frame.serial, crc, frame.origin) == data


def test_layouts_worked_out_by_hand() -> None:
    assert PeriodicOutput(3, b'\xaa\xbb').to_bytes() == b'\x03\x00\xaa\xbb'
    assert CommandOutput(0x0201, bytes(range(16))).to_bytes() == b'\x01\x02' + bytes(4) + bytes(
        range(16)
    )
    assert AcknowledgeOutput(0x0201).to_bytes() == b'\x01\x02'
    frame = build_frame(AcknowledgeOutput(0x0201), 0x0403, Crc.MPEG2)
    head = b'VRAO' + bytes((0, 0, 0, 0, 3, 4, 2, 0, 0, 0, 0, 0))
    assert frame[:-4] == head + b'\x01\x02'


# -- what a network does --------------------------------------------------------------------------

CONTENTS = {b'VRPI': 46, b'VRCI': 22, b'VRAI': 2, b'VRPO': 2, b'VRCO': 22, b'VRAO': 2}


@pytest.mark.parametrize(
    ('kind', 'extra'),
    [
        (kind, extra)
        for kind in sorted(CONTENTS)
        for extra in (-2, -1, 1, 2)
        if kind != b'VRPO' or extra < 0  # of which any size up to 490 is right
    ],
)
def test_payload_of_another_size_is_malformed(kind: bytes, extra: int) -> None:
    payload = bytes(CONTENTS[kind] + extra)
    frame = Frame.from_bytes(build_packet(kind.decode(), payload, 0), Crc.MPEG2)
    with pytest.raises(FrameError):
        decode(frame)


def test_every_flipped_bit_is_found() -> None:
    reader = PacketDecoder(Crc.MPEG2)
    for bit in range(8 * len(GOLDEN[0])):
        flipped = bytearray(GOLDEN[0])
        flipped[bit // 8] ^= 1 << bit % 8
        assert reader.feed(bytes(flipped), 0.0) == []
    assert reader.counters.checksum_errors == 8 * len(GOLDEN[0])
    assert reader.feed(GOLDEN[0], 0.0) != []


def test_every_truncation_and_every_tail_is_refused() -> None:
    reader = PacketDecoder(Crc.MPEG2)
    for size in range(len(GOLDEN[0])):
        assert reader.feed(GOLDEN[0][:size], 0.0) == []
    for extra in (1, 2, 446, 447, 2000):
        assert reader.feed(GOLDEN[0] + bytes(extra), 0.0) == []
    assert reader.counters.malformed == 20 + 2  # shorter than any packet, longer than any


def test_size_that_does_not_match_is_malformed_though_the_crc_is_good() -> None:
    body = bytearray(GOLDEN[0][:-4])
    body[10] = 45
    reader = PacketDecoder(Crc.MPEG2)
    assert reader.feed(bytes(body) + struct.pack('<I', Crc.MPEG2.of(bytes(body))), 0.0) == []
    assert (reader.counters.frames, reader.counters.malformed) == (1, 1)


def test_frame_by_itself_names_what_is_wrong_with_it() -> None:
    for size in (19, 513):
        with pytest.raises(FrameError, match=rf'^{size} bytes, but a packet has 20-512$'):
            Frame.from_bytes(bytes(size), None)
    with pytest.raises(FrameError, match=r'^revision 1 is not 0$'):
        Frame.from_bytes(build_packet('VRPI', bytes(46), 0, revision=1), None)
    whole = Frame(b'VRPO', 0, bytes(492))
    assert whole.origin == 0  # the machine controller's
    assert Frame.from_bytes(whole.to_bytes(), None) == whole
    assert len(whole.to_bytes()) == 512


def test_unknown_id_is_sound_but_unknown() -> None:
    reader, data = PacketDecoder(Crc.MPEG2), build_packet('VRXI', b'abc', 9)
    assert decode(Frame.from_bytes(data, Crc.MPEG2)) == Unknown(0x56525849)
    assert reader.feed(data, 0.0) == []
    assert (reader.counters.frames, reader.counters.unknown_types) == (1, 1)


def test_periodic_input_of_nobody_is_all_zero() -> None:
    assert PeriodicInput().to_bytes() == bytes(46)
    assert PeriodicInput.from_bytes(bytes(46)) == PeriodicInput()


def test_spare_bytes_mean_nothing() -> None:
    payload = GOLDEN[0][16:-4][:40] + b'\xff' * 6
    assert PeriodicInput.from_bytes(payload) == PeriodicInput.from_bytes(GOLDEN[0][16:-4])


# -- the CRC's two readings -----------------------------------------------------------------------


@pytest.mark.parametrize('crc', Crc)
def test_open_parser_reads_the_first_periodic_input_of_either_reading(crc: Crc) -> None:
    reader = PacketDecoder()
    (packet,) = reader.feed(build_packet('VRPI', bytes(46), 5, 7, crc.value), 0.0)
    assert (packet.crc, packet.serial, packet.origin) == (crc, 5, 7)


@pytest.mark.parametrize('kind', ['VRCI', 'VRAI', 'VRPO', 'VRXX'])
def test_open_parser_reads_nothing_else(kind: str) -> None:
    reader = PacketDecoder()
    assert reader.feed(build_packet(kind, bytes(22), 5, 7), 0.0) == []
    assert reader.before_lock == 1


@pytest.mark.parametrize(('crc', 'other'), [tuple(Crc), tuple(Crc)[::-1]])
def test_locked_parser_refuses_the_other_reading(crc: Crc, other: Crc) -> None:
    reader = PacketDecoder()
    reader.lock(crc)
    assert reader.feed(build_packet('VRPI', bytes(46), 5, 7, other.value), 0.0) == []
    assert (reader.other_crc, reader.counters.checksum_errors) == (1, 1)
    assert reader.feed(build_packet('VRPI', bytes(46), 5, 7, crc.value), 0.0) != []


# -- values ---------------------------------------------------------------------------------------


@pytest.mark.parametrize('value', range(256))
def test_unknown_states_equal_no_known_one(value: int) -> None:
    payload = bytes((value,)) + bytes(7) + bytes((value,)) + bytes(37)
    message = PeriodicInput.from_bytes(payload)
    assert message.bu_state == value
    assert isinstance(message.bu_state, BuState) == (value in (0, 1, 2, 3, 4, 0x10, 0x11))
    assert isinstance(message.ru_state, RuState) == (value < 5)
    assert message.to_bytes() == payload


@pytest.mark.parametrize('value', [0, 1, 2, 255])
def test_anything_but_zero_is_true(value: int) -> None:
    cable, docked = (
        PeriodicInput.from_bytes(bytes(place) + bytes((value,)) + bytes(45 - place))
        for place in (11, 12)
    )
    assert (cable.ru_cable, cable.ru_docked) == (value > 0, False)
    assert (docked.ru_cable, docked.ru_docked) == (False, value > 0)


def test_states_in_the_manuals_words() -> None:
    assert state_name(BuState.EXTERNAL_LINK_ERROR) == 'External link error'
    assert state_name(LinkStatus.NO_LINK) == 'No link'
    assert state_name(Disabled.TILTING) == 'Tilting'
    assert state_name(0x33) == 'Unknown (0x33)'
    assert state_name(None) == 'None'


def test_field_takes_whole_numbers_only() -> None:
    with pytest.raises(ValueError, match='the command ID must be a whole number'):
        AcknowledgeOutput(5.0)  # type: ignore[arg-type]


def test_joystick_out_of_range_is_named() -> None:
    message = PeriodicInput(joysticks=(1000, -1001, 0, 32767))
    assert message.faulty == ('joystick_2 out of range (-1001)', 'joystick_4 out of range (32767)')


@pytest.mark.parametrize(
    ('size', 'lengths'),
    [
        (0, [0]),
        (1, [1]),
        (488, [488]),
        (489, [488, 1]),
        (976, [488, 488]),
        (1000, [488, 488, 24]),
    ],
)
def test_bursts_are_full_but_for_the_last_packet(size: int, lengths: list[int]) -> None:
    data = bytes(n % 251 for n in range(size))
    packets = burst(data)
    assert [len(packet.data) for packet in packets] == lengths
    assert [packet.packet_number for packet in packets] == list(range(len(lengths)))
    assert b''.join(packet.data for packet in packets) == data
    assert [packet.packet_number for packet in burst(data, 1)] == list(range(1, len(lengths) + 1))


@pytest.mark.parametrize(
    ('kind', 'arguments'),
    [
        (PeriodicOutput, {'packet_number': 0x10000}),
        (PeriodicOutput, {'packet_number': 0, 'data': bytes(489)}),
        (CommandOutput, {'command_id': -1, 'data': bytes(16)}),
        (CommandOutput, {'command_id': 0, 'data': bytes(15)}),
        (CommandOutput, {'command_id': 0x10000, 'data': bytes(16)}),
        (AcknowledgeOutput, {'command_id': 0x10000}),
        (Frame, {'kind': b'VR', 'serial': 0, 'payload': b''}),
        (Frame, {'kind': b'VRPI', 'serial': 0x10000, 'payload': b''}),
        (Frame, {'kind': b'VRPI', 'serial': 0, 'payload': b'', 'origin': 0x10000}),
        (Frame, {'kind': b'VRPI', 'serial': 0, 'payload': bytes(493)}),
    ],
)
def test_own_bad_value_is_refused_when_it_is_made(
    kind: type[Any], arguments: dict[str, Any]
) -> None:
    with pytest.raises(ValueError, match=r'\w'):
        kind(**arguments)


U8, U16, I16 = st.integers(0, 255), st.integers(0, 0xFFFF), st.integers(-0x8000, 0x7FFF)
MESSAGES = st.one_of(
    st.builds(
        PeriodicInput,
        bu_state=st.sampled_from(BuState) | st.integers(0x12, 0xFF),
        vlaps=U8,
        unarmed_rus=U8,
        eg_link=st.sampled_from(LinkStatus),
        armed_ru=U16,
        ru_state=st.sampled_from(RuState),
        ru_battery=U8,
        ru_cable=st.booleans(),
        ru_disabled=st.sampled_from(Disabled),
        joysticks=st.tuples(*[I16] * 4),
        switches=st.tuples(*[I16] * 8),
        encoder=U8,
        encoder_switch=st.booleans(),
    ),
    st.builds(PeriodicOutput, U16, st.binary(max_size=488)),
    *(
        st.builds(kind, U16, st.binary(min_size=16, max_size=16))
        for kind in (CommandInput, CommandOutput)
    ),
    *(st.builds(kind, U16) for kind in (AcknowledgeInput, AcknowledgeOutput)),
)


@given(MESSAGES, U16, U16, st.sampled_from(Crc))
def test_round_trip(message: Message, serial: int, origin: int, crc: Crc) -> None:
    frame = Frame.from_bytes(build_frame(message, serial, crc, origin), crc)
    assert (decode(frame), frame.serial, frame.origin) == (message, serial, origin)


@given(st.binary(max_size=600), st.sampled_from([None, *Crc]))
def test_any_datagram_raises_nothing(data: bytes, crc: Crc | None) -> None:
    reader = PacketDecoder(crc)
    assert reader.feed(data, 0.0) == []
    wrong = reader.counters.malformed + reader.counters.checksum_errors + reader.before_lock
    assert (wrong, reader.counters.bytes) == (1, len(data))
