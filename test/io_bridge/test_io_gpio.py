# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The lines of a chip, by a stand-in for gpiod's request of lines."""

from __future__ import annotations

from collections import deque
import os
from types import SimpleNamespace
from typing import Any

import gpiod
from gpiod.line import Bias, Direction, Edge, Value
import pytest

from bridge_core.transports import TransportError
from bridge_core.waiting import ready
from io_bridge.ports import GpioTransport
from io_bridge.protocol import gpio_frame, GpioWire, Inputs

INPUTS, OUTPUTS = (17, 27, 22), (5, 6)
_Type = gpiod.EdgeEvent.Type


class Chip:
    """Lines in the place of gpiod's LineRequest; ``fd`` is readable while edges wait."""

    def __init__(self) -> None:
        self.fd, self._write = os.pipe()
        self.levels = dict.fromkeys(INPUTS, True)
        self.set: dict[int, Value] = {}
        self.edges: deque[Any] = deque()
        self.count = 0
        self.config: Any = None
        self.gone = False
        self.released = 0

    def request(self, path: str, *, consumer: str, config: Any) -> Chip:
        if self.gone:
            raise FileNotFoundError(2, 'No such file or directory')
        self.config = config
        return self

    def change(self, line: int, level: bool) -> None:
        self.levels[line] = level
        self.count += 1
        kind = _Type.RISING_EDGE if level else _Type.FALLING_EDGE
        edge = SimpleNamespace(
            line_offset=line, event_type=kind, global_seqno=self.count, Type=_Type
        )
        self.edges.append(edge)
        os.write(self._write, b'\0')

    def drop(self) -> None:
        self.edges.popleft()
        os.read(self.fd, 1)

    def unplug(self) -> None:
        self.gone = True
        os.write(self._write, b'\0')

    def read_edge_events(self) -> list[Any]:
        if self.gone:
            raise OSError(19, 'No such device')
        edges = [*self.edges]
        self.edges.clear()
        os.read(self.fd, len(edges))
        return edges

    def get_values(self, lines: Any) -> list[Value]:
        return [Value.ACTIVE if self.levels[line] else Value.INACTIVE for line in lines]

    def set_values(self, values: dict[int, Value]) -> None:
        self.set |= values

    def release(self) -> None:
        self.released += 1


@pytest.fixture
def chip(monkeypatch: pytest.MonkeyPatch) -> Chip:
    result = Chip()
    monkeypatch.setattr(gpiod, 'request_lines', result.request)
    return result


def opened() -> GpioTransport:
    port = GpioTransport('/dev/gpiochip0', INPUTS, OUTPUTS, bias='pull-up', active_low=True)
    assert port.fileno() == -1
    port.open()
    return port


def bits(number: int, *values: bool) -> bytes:
    return gpio_frame(b'I', number, values)


def test_lines_are_asked_for_as_the_parameters_say(chip: Chip) -> None:
    port = opened()
    given, taken = chip.config[INPUTS], chip.config[OUTPUTS]
    assert (given.direction, given.edge_detection) == (Direction.INPUT, Edge.BOTH)
    assert (given.bias, given.active_low) == (Bias.PULL_UP, True)
    assert (taken.direction, taken.output_value) == (Direction.OUTPUT, Value.INACTIVE)
    port.close()
    port.close()
    assert chip.released == 1


def test_question_is_answered_and_outputs_are_set(chip: Chip) -> None:
    port = opened()
    chip.levels[27] = False
    assert not ready([port.fileno()], 0.0)
    assert port.send(gpio_frame(b'R', 9))
    assert ready([port.fileno()], 0.0)
    assert port.receive() == [bits(9, True, False, True)]
    port.send(gpio_frame(b'W', 10, (True, False)))
    assert port.receive() == [gpio_frame(b'W', 10)]
    assert chip.set == {5: Value.ACTIVE, 6: Value.INACTIVE}
    assert not ready([port.fileno()], 0.0)


def test_pulse_between_two_readings_comes_as_its_edges(chip: Chip) -> None:
    port = opened()
    chip.change(17, False)
    chip.change(17, True)
    assert ready([port.fileno()], 0.0)
    assert port.receive() == [bits(0, False, True, True), bits(0, True, True, True)]
    chip.change(22, False)
    chip.change(22, True)
    port.send(gpio_frame(b'R', 3))  # what happened before comes before it
    chip.change(27, False)  # and what happens then, behind
    assert port.receive() == [
        bits(0, True, True, False),
        bits(0, True, True, True),
        bits(3, True, True, True),
        bits(0, True, False, True),
    ]


def test_pulse_that_ended_before_the_kernel_looked_at_the_line_is_one(chip: Chip) -> None:
    port = opened()
    chip.change(17, True)
    assert port.receive() == [bits(0, False, True, True), bits(0, True, True, True)]
    chip.levels[27] = False
    port.send(gpio_frame(b'R', 3))
    chip.change(27, False)  # its edge comes after it was read
    assert port.receive() == [bits(3, True, False, True), bits(0, True, False, True)]


def test_edges_without_end_delay_no_stop(chip: Chip, monkeypatch: pytest.MonkeyPatch) -> None:
    read = chip.read_edge_events

    def read_and_more() -> list[Any]:
        edges = read()
        for level in (True, False) * 16:
            chip.change(17, level)
        return edges

    monkeypatch.setattr(chip, 'read_edge_events', read_and_more)
    port = opened()
    chip.change(17, False)
    assert port.receive()[0] == bits(0, False, True, True)
    assert ready([port.fileno()], 0.0)


def test_edges_that_the_kernel_dropped_are_a_stop(chip: Chip) -> None:
    port = opened()
    chip.change(17, False)
    chip.change(17, True)
    chip.drop()
    assert port.receive() == [bits(0), bits(0, True, True, True)]


def test_chip_that_is_gone_is_a_lost_port(chip: Chip) -> None:
    port = opened()
    chip.unplug()
    for act in (port.receive, lambda: port.send(gpio_frame(b'R', 1))):
        with pytest.raises(TransportError, match='/dev/gpiochip0: gone'):
            act()
    with pytest.raises(TransportError, match='check port and lines'):
        port.open()
    assert port.fileno() == -1


def test_question_among_answers_is_none_and_counted() -> None:
    stream = GpioWire(INPUTS).parser()
    assert stream.feed(gpio_frame(b'R', 7) + bits(7, True), 0.0) == [
        Inputs((True, False, False), 7)
    ]
    assert stream.counters.malformed == 1
