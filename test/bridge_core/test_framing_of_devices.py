# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parsers of all devices: messages, counters and what they make of any cut of a stream."""

from __future__ import annotations

from dataclasses import fields, replace
import itertools
import math
import pickle
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.checksums import crc16_ccitt_false
import esi_drive_bridge.protocol as esi
import fort_vsc_bridge.protocol as fort
import ssc_bridge.protocol as ssc
from stage import ssc_rig

DUAL, PADDED = esi.Layout.DUAL, esi.Layout.PADDED


def _status(*axes: tuple[int, int, int]) -> esi.Status:
    return esi.Status(
        tuple(esi.AxisStatus(esi.AxisState(s), f, esi.MotorError(e)) for s, f, e in axes)
    )


def _vsc_frame(kind: int, payload: bytes) -> bytes:
    return fort.PACKETS.build(kind, payload)


def _mode_3() -> bytes:
    """Return a sound command packet whose contents cannot be."""
    body = b'\x0c\0\0' * 2
    return esi.HEADER + body + crc16_ccitt_false(body).to_bytes(2, 'little')


# What makes a parser, sound frames, and bytes that its headers and heads are made of.
LINES: dict[str, tuple[Any, list[bytes], bytes]] = {
    'fort_vsc': (
        fort.parser,
        [
            fort.Joystick().to_bytes(),
            _vsc_frame(0x10, bytes(range(14))),
            _vsc_frame(0x10, b'\x10\x01\x10\x0e' * 3 + b'\x10\x01'),  # heads in the payload
            fort.Heartbeat(fort.Mode.OPERATIONAL, 0, 0).to_bytes(),
            _vsc_frame(0x20, b'\x33\x77\xff\xff\xff\xff'),
            _vsc_frame(0x22, b'\xc8' + bytes(5)),  # 200 %: contents that cannot be
            _vsc_frame(0x12, b'\x01$GPGGA,092750.00,5321.68,N,00630.33,W,1,8,1.03,61.7,M'),
            _vsc_frame(0x12, b'\xff\xff'),
            _vsc_frame(0x31, b'\x63' + b'\x07' * 20),
            _vsc_frame(0x77, b'unknown'),
        ],
        b'\x10\x01\x10\x0e\x12\xf8\x20\x06',
    ),
    'esi_drive dual': (
        lambda: esi.status_parser(DUAL),
        [
            _status((0, 0, 0), (0, 0, 0)).to_bytes(DUAL),
            _status((0x7F, -32768, 0xFF), (0x3F, 32767, 0x80)).to_bytes(DUAL),
            _status((1, -3856, 0), (1, -3856, 0)).to_bytes(DUAL),  # F0 F0 in the body
        ],
        b'\xf0\xf0\xf0\x01',
    ),
    'esi_drive single': (
        lambda: esi.status_parser(PADDED),
        [_status((1, 5, 0)).to_bytes(PADDED), _status((1, 5, 0), (0, 1, 1)).to_bytes(DUAL)],
        b'\xf0\xf0\xf0\x01',
    ),
    'esi_drive commands': (
        lambda: esi.command_parser(DUAL),
        [
            esi.Command((esi.AxisCommand(True, False, esi.Mode.POSITION, 7),) * 2).to_bytes(DUAL),
            _mode_3(),
        ],
        b'\xf0\xf0\xf0\x01',
    ),
    'ssc': (
        ssc.parser,
        [
            ssc_rig.status(),
            ssc_rig.configuration(),
            ssc_rig.build_frame(13, ssc_rig.words([1500] * ssc_rig.INPUTS)),
            ssc_rig.build_frame(13, b''),
            ssc_rig.build_frame(77, b'unknown'),
        ],
        b'\x81\xa1\x0a\x02\x0d\x10',
    ),
}
every_line = pytest.mark.parametrize('name', LINES)


def _flipped(frame: bytes, at: int, bit: int) -> bytes:
    changed = bytearray(frame)
    changed[at % len(frame)] ^= 1 << bit
    return bytes(changed)


def _pieces(frames: list[bytes], heads: bytes) -> st.SearchStrategy[bytes]:
    good = st.sampled_from(frames)
    cut = st.builds(lambda frame, end: frame[:end], good, st.integers(1, 60))
    flipped = st.builds(_flipped, good, st.integers(0, 300), st.integers(0, 7))
    noise = st.binary(max_size=8) | st.lists(st.sampled_from(list(heads)), max_size=12).map(bytes)
    return st.lists(good | good | cut | flipped | noise, max_size=12).map(b''.join)


PIECES = {name: _pieces(frames, heads) for name, (_, frames, heads) in LINES.items()}


@every_line
@given(data=st.data())
def test_whole_reads_give_what_single_bytes_give(name: str, data: st.DataObject) -> None:
    make = LINES[name][0]
    stream = data.draw(PIECES[name])
    whole, single, cut = make(), make(), make()
    found = whole.feed(stream, 1.0)
    assert found == [m for at in range(len(stream)) for m in single.feed(stream[at : at + 1], 1)]
    places = data.draw(st.lists(st.integers(0, len(stream)), max_size=4))
    edges = [0, *sorted(places), len(stream)]
    assert found == [m for a, b in itertools.pairwise(edges) for m in cut.feed(stream[a:b], 1.0)]
    assert whole.counters == single.counters == cut.counters


def _drained(parser: Any, stream: bytes) -> list[Any]:
    """Return what comes of a stream once the line is idle behind it."""
    found: list[Any] = parser.feed(stream, 1.0)
    while parser.deadline < math.inf:
        found += parser.poll(parser.deadline)
    return found


def _sound(name: str) -> list[tuple[bytes, Any]]:
    """Return the frames that are messages, and which."""
    make, frames, _ = LINES[name]
    return [(frame, message) for frame in frames for message in _drained(make(), frame)]


@every_line
def test_damaged_frame_costs_itself_alone(name: str) -> None:
    make, sound = LINES[name][0], _sound(name)
    for number, (frame, _) in enumerate(sound):
        stream = [each for each, _ in sound]
        for bit in range(8 * len(frame)):
            stream[number] = _flipped(frame, bit // 8, bit % 8)
            others = [message for n, (_, message) in enumerate(sound) if n != number]
            assert _drained(make(), b''.join(stream)) == others, (frame.hex(), bit)


@every_line
def test_cut_frame_and_corrupt_head_keep_the_next_frame(name: str) -> None:
    make, sound = LINES[name][0], _sound(name)
    good, message = sound[0]
    for frame, _ in sound:
        for size in range(1, len(frame)):
            assert _drained(make(), frame[:size] + good)[-1:] == [message], size
        for at, byte in itertools.product(range(4), range(256)):
            corrupt = frame[:at] + bytes((byte,)) + frame[at + 1 :]
            assert _drained(make(), corrupt + good)[-1:] == [message], (frame.hex(), at, byte)


@every_line
@given(data=st.data())
def test_garbage_before_and_between_hides_no_frame(name: str, data: st.DataObject) -> None:
    make, _, heads = LINES[name]
    noise = st.binary(max_size=30) | st.sampled_from([heads[:1], heads[:2], heads[:4]])
    sound = _sound(name)
    stream = b''.join(data.draw(noise) + frame for frame, _ in sound)
    messages = [message for _, message in sound]
    assert [each for each in _drained(make(), stream) if each in messages] == messages


@given(data=st.data())
def test_search_for_unexpected_lengths_finds_the_same_in_any_cut(data: st.DataObject) -> None:
    """A sound frame whose length is not its type's is told once, whatever stands around it."""
    _, frames, heads = LINES['fort_vsc']
    odd = [_vsc_frame(0x20, bytes(8)), _vsc_frame(0x10, bytes(12)), _vsc_frame(0x12, b'')]
    inside = [_vsc_frame(0x12, b'\x01' + frame) for frame in odd]
    stream = data.draw(_pieces([*frames, *odd, *inside], heads))
    whole, single = fort.SerialWire().decoder(0.1), fort.SerialWire().decoder(0.1)
    got = whole.feed(stream, 1.0)
    one_by_one = [m for n in range(len(stream)) for m in single.feed(stream[n : n + 1], 1.0)]

    def rejected(messages: list[Any]) -> list[Any]:
        return [m for m in messages if isinstance(m, fort.Rejected)]

    assert rejected(got) == rejected(one_by_one)
    assert [m for m in got if m not in rejected(got)] == [
        m for m in one_by_one if m not in rejected(one_by_one)
    ]
    assert whole.counters == single.counters


@every_line
def test_messages_that_were_read_are_like_those_that_were_made(name: str) -> None:
    make, frames, _ = LINES[name]
    for message in make().feed(b''.join(frames), 1.0):
        again = pickle.loads(pickle.dumps(message))
        assert (again, type(again), hash(again)) == (message, type(message), hash(message))
        assert replace(message) == message  # which checks its values
        for field in fields(message):
            with pytest.raises(AttributeError):
                setattr(message, field.name, None)
