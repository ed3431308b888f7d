"""How a session is to behave, checked when it is made."""

from __future__ import annotations

from dataclasses import dataclass
import math

from vm110_bridge.protocol import Crc
from vm110_bridge.protocol import MAX_BURST_DATA

MAX_OUTPUT = 32 * MAX_BURST_DATA  # bytes of periodic data: a burst is sent in one go
_RANGES = {
    'bu_id': (0, 0xFFFF),
    'link_timeout': (0.15, 5.0),
    'output_period': (0.05, 0.2),
    'periodic_output_size': (0, MAX_OUTPUT),
    'first_packet_number': (0, 1),
    'hold_output_timeout': (0.05, 5.0),
    'command_timeout': (0.2, 60.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """
    What a session needs to know.

    :param bu_id: the base unit to listen to; 0: the first one heard, and no other from then on.
    :param crc: which reading of 3.3; None: that of the first VRPI.
    :param link_timeout: seconds without a VRPI that count as lost; one comes every 125 ms.
    :param output_period: seconds between two bursts of VRPO.
    :param periodic_output_size: bytes of periodic data as configured in the BU; 0: as given.
    :param first_packet_number: of a burst, 0 or 1; the manual does not say.
    :param hold_output_timeout: seconds after which hold_output, once in use, counts as true.
    :param explicit_acknowledge: send VRAO when command_done says so, not on delivery.
    :param accept_unarmed_commands: deliver commands although no remote is armed.
    :param command_timeout: seconds until a command to the RU's application is given up.
    :param tolerate_faulty_axes: let the sound controls count although others are faulty.
    :raises ValueError: for a value out of range.
    """

    bu_id: int = 0
    crc: Crc | None = None
    link_timeout: float = 0.5
    output_period: float = 0.1
    periodic_output_size: int = 0
    first_packet_number: int = 0
    hold_output_timeout: float = 0.25
    explicit_acknowledge: bool = False
    accept_unarmed_commands: bool = False
    command_timeout: float = 2.0
    tolerate_faulty_axes: bool = False

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise ValueError(f'{name} must be {low} to {high}, not {value}')
