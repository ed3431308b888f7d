# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A box of inputs and outputs around a session, and Modbus frames written by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from io_bridge.protocol import Answer, gpio_frame, gpio_values
from io_bridge.session import Session, Settings
from io_bridge.session.turns import Question
from stage.session_rig import SessionBench

UNIT = 1
RELEASED, PRESSED = (True, True), (False, False)


def crc(data: bytes) -> bytes:
    """Return the CRC of Modbus over Serial Line V1.02, 6.2.2, bit by bit."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 * (value & 1)
    return value.to_bytes(2, 'little')


def rtu(*data: int) -> bytes:
    """Return a frame of the unit."""
    frame = bytes((UNIT, *data))
    return frame + crc(frame)


def inputs(*values: bool) -> bytes:
    """Return the answer to a question for inputs; up to 8."""
    return rtu(2, 1, sum(value << bit for bit, value in enumerate(values)))


def lines(*values: bool) -> bytes:
    """Return what a chip answers, to the question of an AskedSession."""
    return gpio_frame(b'I', 1, values)


class AskedSession(Session):
    """A session to which all that comes is the answer to a question that it asked just now."""

    def _take(self, message: Answer, now: float) -> None:
        self._turns.asked(Question(1, True, now))
        super()._take(message, now)


class Box(SessionBench[Session]):
    """
    A session on the lines of a chip, which answer at once; by Modbus RTU on a line of its own.

    :param lines: whether each input is on. ``orders`` keeps what outputs were set to, and when.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(Session(Settings(**{'transport': 'gpio', **options})))
        self.lines = [False] * len(self.session._settings.inputs)
        self.lines[:2] = RELEASED
        self.orders: list[tuple[float, tuple[bool, ...]]] = []
        self.mute = False
        self.late = 0.0  # s

    def set(self, *values: bool, wait: float = 0.0) -> list[Any]:
        """Set the first inputs, as the kernel reports it at once; return the events."""
        self.lines[: len(values)] = values
        return [*self.take(gpio_frame(b'I', 0, self.lines)), *self.run(wait)]

    def run(self, seconds: float) -> list[Any]:
        """Answer all that is asked for a while; return the events."""
        before, end = len(self.events), self.now + seconds
        while (due := max(self.session.deadline(), self.now)) <= end:
            self.now = due
            asked = len(self.sent)
            self.poll()
            for _, frame in self.sent[asked:]:
                self._answer(frame)
        self.now = end
        self.poll()
        return self.events[before:]

    def _answer(self, frame: bytes) -> None:
        kind, number, values = gpio_values(frame, len(self.session._settings.outputs))
        if kind == b'W':
            self.orders.append((self.now, values))
        if not self.mute:
            self.now += self.late
            answer = gpio_frame(b'W', number)
            if kind == b'R':
                answer = gpio_frame(b'I', number, self.lines)
            self.take(answer)


def values_of(parameters: Sequence[Any], **changes: Any) -> dict[str, Any]:
    """Return the parameters' defaults but for changes."""
    return {each.name: each.default for each in parameters} | changes
