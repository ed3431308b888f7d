# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session needs to know, checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from akron_can_bridge.parameters import Cause, PARAMETERS, UNIVERSAL
from akron_can_bridge.protocol import AUTOMATIC_SWITCHES, JOYSTICK_ADDRESSES, OSCILLATE_SWITCH
from bridge_core.settings import CheckedSettings, table_of

_TABLE = table_of(PARAMETERS)


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedSettings):
    """
    What a session needs to know; the fields are parameters.

    :param allowed_joysticks: without the 0 that stands for none. :param estop_on: as causes.
    :param button_switches: the switch of each button, 0 for none.
    :raises ValueError: for what cannot be, such as ``joy_source`` being ourselves.
    """

    TABLE = _TABLE
    source_address: int = _TABLE['source_address'].default
    device_pin: str = _TABLE['device_pin'].default
    device_type: int = _TABLE['device_type'].default
    unit_address: int = _TABLE['unit_address'].default
    coast_time: float = _TABLE['coast_time'].default
    button_switches: tuple[int, ...] = ()
    automatic_motion: bool = _TABLE['automatic_motion'].default
    pause_on_stop: bool = _TABLE['pause_on_stop'].default
    extended: bool = _TABLE['extended'].default
    soe_permissive: bool = _TABLE['soe_permissive'].default
    joy_source: int = _TABLE['joy_source'].default
    allowed_joysticks: frozenset[int] = frozenset()
    estop_on: frozenset[Cause] = frozenset(Cause)
    link_timeout: float = _TABLE['link_timeout'].default
    command_timeout: float = _TABLE['command_timeout'].default
    estop_in_timeout: float = _TABLE['estop_in_timeout'].default
    answer_timeout: float = _TABLE['answer_timeout'].default
    vista_rate: float = _TABLE['vista_rate'].default
    tolerate_faulty_axes: bool = _TABLE['tolerate_faulty_axes'].default

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.allowed_joysticks <= set(JOYSTICK_ADDRESSES):
            raise ValueError(f'allowed_joysticks cannot be {sorted(self.allowed_joysticks)}')
        own = f'0x{self.source_address:X} is our own source_address'
        if self.source_address == self.joy_source:
            raise ValueError(f'joy_source = {self.joy_source}: {own}')
        if self.source_address in self.allowed_joysticks:
            raise ValueError(f'allowed_joysticks = {sorted(self.allowed_joysticks)}: {own}')
        if self.unit_address and not self.unit_type:
            raise ValueError('unit_address needs a device_type or device_pin')
        if self.unit_address in JOYSTICK_ADDRESSES:
            raise ValueError(f'unit_address {self.unit_address:02X} is a joystick')
        automatic = sorted(AUTOMATIC_SWITCHES & set(self.button_switches))
        if automatic and not self.automatic_motion:
            raise ValueError(
                f'button_switches has {automatic}, which start motion that a neutral stick does '
                'not end; leave them out, or set automatic_motion'
            )
        if self.pause_on_stop and OSCILLATE_SWITCH not in self.button_switches:
            raise ValueError(
                f'pause_on_stop needs {OSCILLATE_SWITCH} in button_switches: it pauses only what '
                '~/cmd_joy began'
            )
        if self.pause_on_stop and self.unit_type not in (0, UNIVERSAL):
            raise ValueError('pause_on_stop needs type 81, which a 6032 alone sends')
        if max(self.button_switches, default=0) > 12 and not self.extended:
            raise ValueError('button_switches beyond 12 need extended')

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Settings:
        """Return what the parameters say. :raises ValueError: what cannot be."""
        return cls(
            allowed_joysticks=frozenset(values['allowed_joysticks']) - {0},
            button_switches=tuple(values['button_switches']),
            estop_on=frozenset(map(Cause, values['estop_on'])),
            **cls.named(values),
        )

    @property
    def unit_type(self) -> int:
        """The first four digits of the wanted unit's PIN; 0: those of any controller."""
        return int(self.device_pin[:4]) if self.device_pin else self.device_type
