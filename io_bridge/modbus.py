# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Modbus RTU and TCP: frames by pymodbus, found in a stream by the parser of bridge_core.

By the Modbus Application Protocol V1.1b3: function 2 (6.2) reads discrete inputs, function 15
(6.11) writes coils. Whoever imports this needs pymodbus.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import logging
import math
from typing import Any

from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import (
    ReadDiscreteInputsRequest,
    ReadDiscreteInputsResponse,
    WriteMultipleCoilsRequest,
    WriteMultipleCoilsResponse,
)

from bridge_core.framing import (
    BITS_PER_BYTE,
    ChecksumError,
    expiry,
    FrameError,
    FrameFormat,
    MessageT,
    StreamParser,
)
from io_bridge.protocol import Answer, Inputs, Refused, Written

# Noise is counted here; a wire waits for no terminal that a log line goes to.
logging.getLogger('pymodbus').setLevel(logging.CRITICAL + 1)
_READ, _WRITE = ReadDiscreteInputsRequest.function_code, WriteMultipleCoilsRequest.function_code
_MBAP = 6  # bytes before the unit: number, protocol, length (Messaging on TCP/IP V1.0b, 3.1.3)
_MAX_SIZE = 260
_RTU_ANSWER, _RTU_QUESTION = 3, 7  # bytes to the one that says how many follow
_CRC, _WRITTEN = 2, 6  # bytes; the latter of an answer that outputs were set
_SILENT_BYTES = 3.5  # between two frames of RTU (Modbus over Serial Line V1.02, 2.5.1.1)
_LEAST_SILENCE = 0.00175  # s


@dataclass(frozen=True, slots=True)
class Read:
    """A question, for captures."""

    first: int
    count: int


@dataclass(frozen=True, slots=True)
class Write:
    """A question, for captures."""

    first: int
    values: tuple[bool, ...]


class ModbusWire:
    """
    One unit on a serial line or behind a TCP connection.

    :param inputs: lines that are read, with all between them. :param outputs: without gaps.
    :param baud: of the line; none with TCP.
    """

    def __init__(
        self, unit: int, inputs: Sequence[int], outputs: Sequence[int], baud: int | None
    ) -> None:
        self._framing = Framing(rtu=baud is not None, answers=True)
        self._unit = unit
        first = min(inputs)
        self._question = ReadDiscreteInputsRequest(address=first, count=max(inputs) - first + 1)
        self._bytes = -(-self._question.count // 8)
        self._outputs = outputs
        self._baud = baud
        self.bits = {line: line - first for line in inputs}
        self.numbered = baud is None
        self.gap = 0.0
        if baud is not None:
            self.gap = max(_LEAST_SILENCE, _SILENT_BYTES * (BITS_PER_BYTE + 1) / baud)
        self.silence = 'check power and cable of the box, unit' + ', baud and 8N1' * bool(baud)

    def read(self, number: int) -> bytes:
        """Return the question for all inputs."""
        return self._framing.build(self._question, self._unit, number)

    def write(self, values: Sequence[bool], number: int) -> bytes:
        """Return what sets all outputs."""
        bits = [values[self._outputs.index(line)] for line in sorted(self._outputs)]
        order = WriteMultipleCoilsRequest(address=min(self._outputs), bits=bits)
        return self._framing.build(order, self._unit, number)

    def parser(self) -> StreamParser[Answer]:
        """Return what finds answers of this unit."""
        # None is longer: a corrupt length must not hide the answers behind it.
        size = max(_WRITTEN, _RTU_ANSWER + self._bytes) + (_CRC if self._baud else _MBAP)
        return self._framing.parser(self._own_answer, self._unit, self._baud, size)

    def _own_answer(self, pdu: ModbusPDU) -> Answer:
        answer = _answer(pdu)
        if isinstance(answer, Inputs):
            if len(answer.values) != 8 * self._bytes:
                raise ChecksumError(f'{len(answer.values)} inputs: of another question')
            if pdu.encode() == self._question.encode():  # from line 768 on it can be read so
                raise ChecksumError('the echo of the question')
        return answer


class Framing:
    """One direction of a line. :param answers: it is the one of the box, not of the host."""

    def __init__(self, *, rtu: bool, answers: bool) -> None:
        self._rtu, self._answers = rtu, answers
        self._decoder = DecodePDU(not answers)
        self._framer = (FramerRTU if rtu else FramerSocket)(self._decoder)
        self._head_size = (_RTU_ANSWER if answers else _RTU_QUESTION) if rtu else _MBAP + 2

    def build(self, message: ModbusPDU, unit: int, number: int) -> bytes:
        """Return the frame of a message."""
        message.dev_id, message.transaction_id = unit, number
        return self._framer.buildFrame(message)

    def parser(
        self,
        convert: Callable[[ModbusPDU], MessageT],
        unit: int | None = None,
        baud: int | None = None,
        max_size: int = _MAX_SIZE,
    ) -> StreamParser[MessageT]:
        """Return a parser. :param unit: None: of any. :param baud: of a serial line."""

        def decode(frame: bytes) -> MessageT:
            _, of, number, body = self._framer.decode(frame)
            message = self._decoder.decode(body) if unit in (None, of) else None
            if message is None or self.build(message, of, number) != frame:
                raise ChecksumError(frame.hex())
            return convert(message)

        header = bytes((unit,)) if self._rtu and unit is not None else b''
        form = FrameFormat(header, self._head_size, max_size, self._size_of, decode)
        return StreamParser(form, expire=expiry(max_size, baud or math.inf))

    def _size_of(self, head: bytes) -> int:
        message = head if self._rtu else head[_MBAP:]
        function = message[1] & 0x7F if self._answers else message[1]
        if function not in (_READ, _WRITE):
            raise FrameError(f'function {message[1]}')
        if not self._rtu:
            return _MBAP + int.from_bytes(head[4:6], 'big') if head[2:4] == b'\0\0' else 0
        kind = self._decoder.lookupPduClass(message)
        return kind.calculateRtuFrameSize(message) if kind else 0


def _answer(pdu: ModbusPDU) -> Answer:
    number = pdu.transaction_id
    if isinstance(pdu, ReadDiscreteInputsResponse):
        return Inputs(tuple(map(bool, pdu.bits)), number)
    if isinstance(pdu, WriteMultipleCoilsResponse):
        return Written(number)
    assert isinstance(pdu, ExceptionResponse)
    return Refused(pdu.function_code & 0x7F == _READ, pdu.exception_code, number)


def _question(pdu: ModbusPDU) -> Read | Write:
    if isinstance(pdu, ReadDiscreteInputsRequest):
        return Read(pdu.address, pdu.count)
    return Write(pdu.address, tuple(map(bool, pdu.bits)))


def parser(*, rtu: bool, answers: bool) -> StreamParser[Any]:
    """Return a parser of any unit, for captures."""
    return Framing(rtu=rtu, answers=answers).parser(_answer if answers else _question)
