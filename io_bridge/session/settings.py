# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session needs to know, checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bridge_core.parameters import names_of
from bridge_core.settings import CheckedSettings, table_of
from io_bridge.parameters import PARAMETERS
from io_bridge.protocol import GpioWire, MAX_GPIO_LINES, Wire

_TABLE = table_of(PARAMETERS)


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedSettings):
    """
    What a session needs to know: parameters.

    :param estops: name and two lines each. :param keys: lines. :param speeds: one more than keys.
    :param outputs: name and line each.
    """

    TABLE = _TABLE
    estops: tuple[tuple[str, int, int], ...] = (('estop', 0, 1),)
    keys: tuple[int, ...] = ()
    speeds: tuple[float, ...] = (0.3, 1.0)
    outputs: tuple[tuple[str, int], ...] = ()
    transport: str = _TABLE['transport'].default
    baud: int = _TABLE['baud'].default
    unit: int = _TABLE['unit'].default
    poll_rate: float = _TABLE['poll_rate'].default
    answer_time: float = _TABLE['answer_time'].default
    link_timeout: float = _TABLE['link_timeout'].default
    estop_kind: str = _TABLE['estop_kind'].default
    discrepancy_time: float = _TABLE['discrepancy_time'].default
    debounce: float = _TABLE['debounce'].default
    reset_line: int = _TABLE['reset_line'].default
    horn_time: float = _TABLE['horn_time'].default

    @property
    def inputs(self) -> tuple[int, ...]:
        """All lines that are read."""
        pairs = [line for _, *lines in self.estops for line in lines]
        return (*pairs, *self.keys, *[self.reset_line] * (self.reset_line >= 0))

    @property
    def output_lines(self) -> tuple[int, ...]:
        """All lines that are set."""
        return tuple(line for _, line in self.outputs)

    def __post_init__(self) -> None:
        super().__post_init__()
        is_chip, used = self.transport == 'gpio', [*self.inputs, *self.output_lines]
        _require_unique('estop_lines, key_lines, reset_line', [*self.inputs])
        _require_unique('output_lines', used if is_chip else [*self.output_lines])
        _require_unique('estop_names', [name for name, *_ in self.estops])
        if self.keys and len(self.speeds) != len(self.keys) + 1:
            raise ValueError(
                f'key_speeds: {len(self.keys) + 1} are needed for {len(self.keys)} key_lines'
            )
        if self.keys and self.speeds[0] > min(self.speeds):
            raise ValueError('key_speeds: the first one must be the least: a cut wire chooses it')
        if self.link_timeout < 4.0 * self.answer_time or self.link_timeout < 3.0 / self.poll_rate:
            raise ValueError(
                f'link_timeout = {self.link_timeout:g}: has to be four times answer_time and '
                'three periods of poll_rate, or more'
            )
        if is_chip:
            if len(used) > MAX_GPIO_LINES:
                raise ValueError(f'estop_lines: {MAX_GPIO_LINES} lines in all are possible')
            return
        lines = sorted(self.output_lines)
        if lines and lines[-1] - lines[0] >= len(lines):
            raise ValueError(f'output_lines = {lines}: must be without gaps')
        if max(self.inputs) - min(self.inputs) >= 2000:
            raise ValueError('estop_lines: inputs must be within 2000 lines')

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Settings:
        """Return what the parameters say. :raises ValueError: what cannot be."""
        names, lines = names_of(values, 'estop_names'), values['estop_lines']
        if not names or len(lines) != 2 * len(names):
            raise ValueError(f'estop_lines = {lines}: two are needed for each of estop_names')
        keys = [] if values['key_lines'] == [-1] else values['key_lines']
        if -1 in keys:
            raise ValueError(f'key_lines = {keys}: -1 is no key switch, and stands alone')
        outputs = names_of(values, 'outputs')
        if outputs and len(outputs) != len(values['output_lines']):
            raise ValueError('output_lines: one is needed for each of outputs')
        return cls(
            estops=tuple(zip(names, lines[::2], lines[1::2], strict=True)),
            keys=tuple(keys),
            speeds=tuple(values['key_speeds']),
            outputs=tuple(zip(outputs, values['output_lines'], strict=False)),
            **cls.named(values),
        )

    def wire(self) -> Wire:
        """Return how the box is asked. :raises ValueError: what that needs is not installed."""
        if self.transport == 'gpio':
            return GpioWire(self.inputs)
        try:
            from io_bridge.modbus import ModbusWire
        except ImportError as error:
            raise ValueError(
                f'transport = {self.transport!r}: install pymodbus, as by pip install '
                f'"rugged_teleop[modbus]" ({error})'
            ) from error
        baud = self.baud if self.transport == 'rtu' else None
        return ModbusWire(self.unit, self.inputs, self.output_lines, baud)


def _require_unique(name: str, values: list[Any]) -> None:
    for value in values:
        if values.count(value) > 1:
            raise ValueError(f'{name}: {value!r} stands there twice')
