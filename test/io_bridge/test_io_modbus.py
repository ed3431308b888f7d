# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Modbus frames, from the specification's own examples and calculated by hand."""

from __future__ import annotations

import itertools
import logging
import math
from typing import Any

import pytest

from io_bridge.modbus import ModbusWire, parser, Read, Write
from io_bridge.protocol import Inputs, Refused, Written
from io_bridge.simulator import Simulator
from stage.io_rig import crc, inputs, rtu, UNIT

# Application Protocol V1.1b3, 6.2 and 6.11: discrete inputs 197 to 218, coils 20 to 29.
READ, READ_ANSWER = bytes.fromhex('02 00C4 0016'), bytes.fromhex('02 03 ACDB35')
WRITE, WRITE_ANSWER = bytes.fromhex('0F 0013 000A 02 CD01'), bytes.fromhex('0F 0013 000A')
VALUES = tuple(c == '1' for c in '001101011101101110101100')
COILS = tuple(c == '1' for c in '1011001110')
ANSWERS = [
    (READ_ANSWER, Inputs(VALUES, 0)),
    (WRITE_ANSWER, Written(0)),
    (bytes.fromhex('82 02'), Refused(True, 2, 0)),
    (bytes.fromhex('8F 04'), Refused(False, 4, 0)),
]


def framed(body: bytes, baud: int | None, number: int = 0x1501) -> bytes:
    if baud is None:
        return b'%b\0\0%b%c%b' % (
            number.to_bytes(2, 'big'),
            (len(body) + 1).to_bytes(2, 'big'),
            UNIT,
            body,
        )
    frame = bytes((UNIT,)) + body
    return frame + crc(frame)


def numbered(answer: Any, baud: int | None) -> Any:
    fields = {name: getattr(answer, name) for name in answer.__slots__}
    return type(answer)(**(fields | {'number': 0 if baud else 0x1501}))


def wire(baud: int | None) -> ModbusWire:
    return ModbusWire(UNIT, range(196, 218), range(19, 29), baud)


each_line = pytest.mark.parametrize('baud', [None, 19200])


@each_line
def test_questions_are_those_of_the_specification(baud: int | None) -> None:
    assert wire(baud).read(0x1501) == framed(READ, baud)
    assert wire(baud).write(COILS, 0x1501) == framed(WRITE, baud)
    assert [
        parser(rtu=baud is not None, answers=False).feed(framed(each, baud), 0.0)
        for each in (READ, WRITE)
    ] == [[Read(196, 22)], [Write(19, COILS)]]


@each_line
@pytest.mark.parametrize(('body', 'answer'), ANSWERS)
def test_answer_comes_out_whole_byte_by_byte_and_behind_garbage(
    body: bytes, answer: Any, baud: int | None
) -> None:
    frame, expected = framed(body, baud), numbered(answer, baud)
    assert wire(baud).parser().feed(frame, 0.0) == [expected]
    stream = wire(baud).parser()
    found = [each for n in range(len(frame)) for each in stream.feed(frame[n : n + 1], 0.0)]
    assert found == [expected]
    garbage = bytes.fromhex('01 02 FF 15') if baud else b'\xff' * 8
    stream = wire(baud).parser()
    assert stream.feed(garbage + frame, 0.0) + stream.poll(60.0) in ([expected], [])
    assert stream.feed(frame, 61.0) == [expected]


@each_line
@pytest.mark.parametrize(('body', 'answer'), ANSWERS)
def test_no_single_wrong_byte_changes_what_rtu_says_nor_the_head_of_tcp(
    body: bytes, answer: Any, baud: int | None
) -> None:
    frame = framed(body, baud)
    for at in range(len(frame) if baud else 8):
        for flip in (0x01, 0x80, 0xFF):
            broken = bytearray(frame)
            broken[at] ^= flip
            stream = wire(baud).parser()
            found = stream.feed(bytes(broken), 0.0) + stream.poll(60.0)
            if baud:
                assert found == []
            elif at >= 2:  # else it is of another question
                assert numbered(answer, baud) not in found


@pytest.mark.parametrize(
    ('baud', 'gap'),
    [(None, 0.0), (1200, 3.5 * 11 / 1200), (19200, 3.5 * 11 / 19200), (115200, 0.00175)],
)
def test_line_is_silent_between_two_frames_of_rtu(baud: int | None, gap: float) -> None:
    line = ModbusWire(UNIT, (7, 5), (), baud)
    assert (line.bits, line.numbered) == ({5: 0, 7: 2}, baud is None)
    assert line.gap == pytest.approx(gap)
    assert ('baud and 8N1' in line.silence) is (baud is not None)


def test_frame_on_a_slow_line_may_take_its_time() -> None:
    frame = inputs(True, True)
    for baud, found in ((1200, 1), (115200, 0)):
        stream = ModbusWire(UNIT, (0, 1), (), baud).parser()
        assert stream.feed(frame[:4], 5.0) == []
        stream.poll(5.1)
        assert len(stream.feed(frame[4:], 5.1)) == found


@pytest.mark.parametrize('count', [2, 25])
def test_corrupt_length_keeps_next_frame(count: int) -> None:
    size = -(-count // 8)
    frame = rtu(2, size, 3, *[0] * (size - 1))
    for length in {*range(256)} - {size}:
        stream = ModbusWire(UNIT, range(count), (), 19200).parser()
        assert stream.feed(frame[:2] + bytes((length,)) + frame[3:], 5.0) == []
        assert (stream.deadline < math.inf) is (len(frame) < 5 + length <= max(8, len(frame)))
        assert stream.feed(frame, 5.02) == [Inputs((True, True, *[False] * (8 * size - 2)), 0)]


@each_line
def test_echo_of_a_question_is_no_answer(baud: int | None) -> None:
    for first, count in itertools.product(range(0, 0xFF00, 0x55), (2, 20)):
        line = ModbusWire(UNIT, range(first, first + count), (), baud)
        stream = line.parser()
        assert stream.feed(line.read(7), 5.0) + stream.poll(60.0) == []


def test_answer_of_another_unit_is_none() -> None:
    frame = bytes((UNIT + 1, 2, 1, 3))
    assert wire(19200).parser().feed(frame + crc(frame), 0.0) == []
    assert wire(None).parser().feed(b'\0\1\0\0\0\4' + frame, 0.0) == []


@pytest.mark.parametrize(('body', 'found'), [((2, 1, 3), 1), ((2, 2, 3, 0), 0), ((2, 0), 0)])
@each_line
def test_answer_of_another_length_is_of_another_question(
    body: tuple[int, ...], found: int, baud: int | None
) -> None:
    stream = ModbusWire(UNIT, (0, 1), (), baud).parser()
    assert len(stream.feed(framed(bytes(body), baud), 0.0) + stream.poll(60.0)) == found


def test_frame_that_pymodbus_cannot_read_is_counted_and_not_logged() -> None:
    stream = ModbusWire(1, (0, 1), (), None).parser()
    assert stream.feed(bytes.fromhex('000100000003010f00'), 0.0) == []
    assert stream.counters.checksum_errors == 1
    assert not logging.getLogger('pymodbus').isEnabledFor(logging.CRITICAL)


@pytest.mark.parametrize('cut', [(), (3,), (1, 5, 7)])
def test_simulated_box_answers_what_it_is_asked(cut: tuple[int, ...]) -> None:
    box, now = Simulator(), 5.0
    line = ModbusWire(UNIT, (0, 1, 3), (2, 3), 19200)
    for asked, answer in (
        (line.read(1), inputs(True, True)),
        (line.write((True, False), 2), rtu(15, 0, 2, 0, 2)),
    ):
        for begin, end in itertools.pairwise([0, *cut, len(asked)]):
            box.receive(asked[begin:end], now)
        assert box.poll(now) == [answer]
    assert box.describe()['coils'] == '0010000000000000'
    box.apply('estop on')
    box.apply('input 3 on')
    box.receive(line.read(3), now)
    assert box.poll(now) == [inputs(False, False, False, True)]
    box.receive(ModbusWire(UNIT, (15, 16), (), 19200).read(4), now)
    assert box.poll(now) == [rtu(0x82, 2)]
    box.poll(box.deadline())  # nobody asks
    assert '1' not in box.describe()['coils']
