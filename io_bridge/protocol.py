# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What is said to a box of inputs and outputs, and what it answers.

A question has a number of 1 to 65535, which its answer repeats, but for Modbus RTU. Frames of a
GPIO chip pass between the session and ports.py alone:

======  ====  ==================================================
offset  size  content
======  ====  ==================================================
0       1     R: read all, W: write outputs, I: inputs
1       2     number of the question; of inputs 0: an edge
3       8     a bit each line, in the order of the parameters
======  ====  ==================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import struct
from typing import Protocol

from bridge_core.framing import FrameError, FrameFormat, StreamParser

_GPIO = struct.Struct('>cHQ')
MAX_GPIO_LINES = 64
HORN = 'horn'
OUTPUTS = ('red', 'yellow', 'green', HORN)


@dataclass(frozen=True, slots=True)
class Inputs:
    """
    An answer, or an edge.

    :param values: on or off, by bit. :param number: of the question; None: an edge.
    """

    values: tuple[bool, ...]
    number: int | None


@dataclass(frozen=True, slots=True)
class Written:
    """An answer: the outputs were set."""

    number: int


@dataclass(frozen=True, slots=True)
class Refused:
    """An answer: an exception of Modbus. :param reads: it was to read. :param code: why."""

    reads: bool
    code: int
    number: int


Answer = Inputs | Written | Refused


class Wire(Protocol):
    """
    How a box is asked.

    :param bits: where each input's line stands in Inputs. :param numbered: answers have numbers.
    :param gap: s of silence before a question. :param silence: what to do where it is not heard.
    """

    bits: dict[int, int]
    numbered: bool
    gap: float
    silence: str

    def read(self, number: int) -> bytes:
        """Return the question for all inputs."""

    def write(self, values: Sequence[bool], number: int) -> bytes:
        """Return what sets all outputs, in the order of their parameter."""

    def parser(self) -> StreamParser[Answer]:
        """Return what finds answers in a stream."""


class GpioWire:
    """The lines of one GPIO chip. :param inputs: in the order of their bits."""

    numbered = True
    gap = 0.0
    silence = 'check port and lines'

    def __init__(self, inputs: Sequence[int]) -> None:
        self.bits = {line: bit for bit, line in enumerate(inputs)}

    def read(self, number: int) -> bytes:
        """Return the question for all inputs."""
        return gpio_frame(b'R', number)

    def write(self, values: Sequence[bool], number: int) -> bytes:
        """Return what sets all outputs."""
        return gpio_frame(b'W', number, values)

    def parser(self) -> StreamParser[Answer]:
        """Return what finds answers."""
        size = _GPIO.size
        return StreamParser(FrameFormat(b'', size, size, lambda _: size, self._answer))

    def _answer(self, frame: bytes) -> Answer:
        kind, number, values = gpio_values(frame, len(self.bits))
        if kind == b'W':
            return Written(number)
        if kind != b'I':
            raise FrameError(f'no answer: {frame.hex()}')
        return Inputs(values, number or None)


def gpio_frame(kind: bytes, number: int, values: Sequence[bool] = ()) -> bytes:
    """Return a frame for, or of, a chip."""
    return _GPIO.pack(kind, number, sum(value << bit for bit, value in enumerate(values)))


def gpio_values(frame: bytes, count: int) -> tuple[bytes, int, tuple[bool, ...]]:
    """Return kind, number and the first ``count`` values."""
    kind, number, bits = _GPIO.unpack(frame)
    return kind, number, tuple(bool(bits >> bit & 1) for bit in range(count))
