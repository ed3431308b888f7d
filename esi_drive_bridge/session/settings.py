# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session needs to know, checked, and whether it fits the line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bridge_core.reasons import Coded
from bridge_core.settings import CheckedSettings, table_of
from esi_drive_bridge.axes import axes_of, Axis
from esi_drive_bridge.parameters import PARAMETERS
from esi_drive_bridge.protocol import BITS_PER_BYTE, Layout, layout_of

_TABLE = table_of(PARAMETERS)


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedSettings):
    """
    What a session needs to know; the fields without comment are parameters.

    :param axes: one or two; see Axis.
    :param layout: of the packets.
    :raises ValueError: for what cannot be.
    """

    TABLE = _TABLE
    axes: tuple[Axis, ...]
    layout: Layout
    axes_enable: str = _TABLE['axes_enable'].default
    baud: int = _TABLE['baud'].default
    command_rate: float = _TABLE['command_rate'].default
    command_timeout: float = _TABLE['command_timeout'].default
    link_timeout: float = _TABLE['link_timeout'].default
    enable_timeout: float = _TABLE['enable_timeout'].default
    clear_timeout: float = _TABLE['clear_timeout'].default
    status_rate: float = _TABLE['status_rate'].default
    joint_state_rate: float = _TABLE['joint_state_rate'].default

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.axes) != self.layout.axes:
            raise ValueError(f'layout {self.layout.value} has {self.layout.axes} axes')
        if self.is_each and len(self.axes) == 1:
            raise ValueError('axes_enable = each: two names are needed in joint_names, not 1')

    @property
    def is_each(self) -> bool:
        """Whether each axis is enabled, stopped and cleared by itself."""
        return self.axes_enable == 'each'

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Settings:
        """Return what the parameters say. :raises ValueError: what cannot be."""
        axes = axes_of(values)
        layout = layout_of(len(axes), values['single_axis_layout'])
        return cls(axes=axes, layout=layout, **cls.named(values))

    def line_warnings(self) -> tuple[Coded, ...]:
        """Say which direction asks more of the line than it carries (4.5.1)."""
        return (
            *_budget('commands', self.layout.command_size, self.command_rate, self.baud),
            *_budget('status packets', self.layout.status_size, self.status_rate, self.baud),
        )


def _budget(what: str, size: int, rate: float, baud: int) -> list[Coded]:
    bits = size * BITS_PER_BYTE * rate
    if bits <= baud:
        return []
    need = f'{what} of {size} bytes at {rate:.0f} Hz need {bits:.0f} bit/s, the line has {baud}'
    return [Coded('esi.line.full', f'raise baud in HiDS and here, or lower the rate: {need}')]
