# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session needs to know, checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bridge_core.settings import CheckedSettings, table_of
from vm110_bridge.parameters import PARAMETERS

_TABLE = table_of(PARAMETERS)


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedSettings):
    """
    What a session needs to know; fields are parameters. :raises ValueError: out of range.

    :param led_switches: without the 0 that stands for none.
    """

    TABLE = _TABLE
    bu_id: int = _TABLE['bu_id'].default
    sender_ports: str = _TABLE['sender_ports'].default
    crc: str = _TABLE['crc'].default
    link_timeout: float = _TABLE['link_timeout'].default
    line_age_limit: float = _TABLE['line_age_limit'].default
    output_period: float = _TABLE['output_period'].default
    periodic_output_size: int = _TABLE['periodic_output_size'].default
    first_packet_number: int = _TABLE['first_packet_number'].default
    hold_output_timeout: float = _TABLE['hold_output_timeout'].default
    acknowledge: str = _TABLE['acknowledge'].default
    accept_unarmed_commands: bool = _TABLE['accept_unarmed_commands'].default
    command_timeout: float = _TABLE['command_timeout'].default
    tolerate_faulty_axes: bool = _TABLE['tolerate_faulty_axes'].default
    led_switches: frozenset[int] = frozenset()

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Settings:
        """Return what the parameters say. :raises ValueError: what cannot be."""
        leds = frozenset(values['led_switches']) - {0}
        return cls(led_switches=leds, **cls.named(values))
