# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device's side of the line: a Modbus RTU unit, by pymodbus."""

from __future__ import annotations

from argparse import ArgumentParser
import math
from typing import Any

from bridge_core.options import whole_within
from bridge_core.simulation import Commands, help_text, obey, Simulated, switch, within

LINES = 16
_WATCHDOG = 1.0  # s without a question until all outputs are off
_ILLEGAL_ADDRESS = 2


class Simulator:
    """
    A box of 16 inputs and 16 coils; its e-stop closes inputs 0 and 1.

    :param unit: its address. :raises ValueError: pymodbus is not installed.
    """

    def __init__(self, unit: int = 1) -> None:
        try:
            from pymodbus.framer import FramerRTU
            from pymodbus.pdu import DecodePDU
        except ImportError as error:
            raise ValueError(f'install pymodbus: {error}') from error
        self.inputs = [True, True, *[False] * (LINES - 2)]
        self.coils = [False] * LINES
        self.mute = False
        self._unit = unit
        self._framer = FramerRTU(DecodePDU(is_server=True))
        self._buffer = b''
        self._answers: list[bytes] = []
        self._off_at = math.inf

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes of the host."""
        self._buffer += data
        while self._buffer:
            used, question = self._framer.handleFrame(self._buffer, self._unit, 0)
            self._buffer = self._buffer[used:]
            if question is None:
                if not used:
                    self._buffer = self._buffer[-64:]
                    break
            elif not self.mute:
                self._off_at = now + _WATCHDOG
                self._answers.append(self._framer.buildFrame(self._answer(question)))

    def _answer(self, question: Any) -> Any:
        from pymodbus.pdu import ExceptionResponse
        from pymodbus.pdu.bit_message import (
            ReadDiscreteInputsRequest,
            ReadDiscreteInputsResponse,
            WriteMultipleCoilsRequest,
            WriteMultipleCoilsResponse,
        )

        first, end = question.address, question.address + question.count
        answer: Any = ExceptionResponse(question.function_code, _ILLEGAL_ADDRESS)
        if end <= LINES and isinstance(question, ReadDiscreteInputsRequest):
            answer = ReadDiscreteInputsResponse(bits=self.inputs[first:end])
        elif end <= LINES and isinstance(question, WriteMultipleCoilsRequest):
            self.coils[first:end] = question.bits[: question.count]
            answer = WriteMultipleCoilsResponse(address=first, count=question.count)
        answer.dev_id = self._unit
        return answer

    def poll(self, now: float) -> list[bytes]:
        """Return the answers."""
        if now >= self._off_at:
            self.coils, self._off_at = [False] * LINES, math.inf
        answers, self._answers = self._answers, []
        return answers

    def deadline(self) -> float:
        """Return when the outputs go off."""
        return -math.inf if self._answers else self._off_at

    def apply(self, text: str) -> None:
        """Obey one line. :raises ValueError: with the usage."""
        obey(self, self.commands, text)

    def describe(self) -> dict[str, Any]:
        """Return what can be seen."""
        return {
            name: ''.join('01'[each] for each in lines)
            for name, lines in (('inputs', self.inputs), ('coils', self.coils))
        }

    def _set_estop(self, state: str) -> None:
        """Press (on) or release the e-stop: inputs 0 and 1 open or close."""
        self.inputs[:2] = [not switch(state)] * 2

    def _set_input(self, line: str, state: str) -> None:
        """Close (on) or open what is on one input."""
        self.inputs[int(within(line, 0, LINES - 1))] = switch(state)

    def _set_mute(self, state: str) -> None:
        """Answer nothing."""
        self.mute = switch(state)

    def _reboot(self) -> None:
        """Come back with all outputs off."""
        self.coils, self._buffer = [False] * LINES, b''

    commands: Commands = {
        'estop': ('on|off', _set_estop),
        'input': ('0..15 on|off', _set_input),
        'mute': ('on|off', _set_mute),
        'reboot': ('', _reboot),
    }


def _options(box: ArgumentParser) -> None:
    box.add_argument('--unit', type=whole_within(1, 247), default=1, help='its address')


SIMULATORS = {
    'io': Simulated(
        make=lambda options: Simulator(options.unit),
        help=help_text(Simulator.commands),
        options=_options,
    ),
}
