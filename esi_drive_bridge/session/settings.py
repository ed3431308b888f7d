"""What a session needs to know, checked, and whether it fits the line."""

from __future__ import annotations

from dataclasses import dataclass
import math

from esi_drive_bridge.protocol import BITS_PER_BYTE
from esi_drive_bridge.protocol import Layout
from esi_drive_bridge.protocol import MAX_COMMAND_RATE
from esi_drive_bridge.protocol import Mode


@dataclass(frozen=True, slots=True)
class Settings:
    """
    What a session needs to know.

    :param modes: one an axis.
    :param si_per_count: one an axis: the joint's rad/s, rad, N·m or A that one count of a command
        or feedback word is; sign, gear and scale included; see ``convert.Axis``.
    :param command_rate: Hz, 1 to 1000.
    :param command_timeout: s, for command, enable and e-stop input alike.
    :param status_timeout: s without a status packet after which ``estop`` is true.
    :param enable_timeout: s that the drive may take from the first enable packet to its answer.
    :param clear_timeout: s that clearing errors may take.
    :param baud: bit/s of the line, for its budget only.
    :param status_rate: Hz at which the drive is expected to send, for the budget only (4.5.1).
    :raises ValueError: for what cannot be.
    """

    layout: Layout
    modes: tuple[Mode, ...]
    si_per_count: tuple[float, ...]
    command_rate: float = 100.0
    command_timeout: float = 0.1
    status_timeout: float = 0.25
    enable_timeout: float = 1.0
    clear_timeout: float = 1.0
    baud: int = 115200
    status_rate: float = 1000.0

    def __post_init__(self) -> None:
        axes = self.layout.axes
        if not len(self.modes) == len(self.si_per_count) == axes:
            raise ValueError(f'modes and si_per_count need one entry for each of {axes} axes')
        if not all(math.isfinite(scale) and scale != 0.0 for scale in self.si_per_count):
            raise ValueError(f'si_per_count must be finite and not 0, not {self.si_per_count}')
        if not 1.0 <= self.command_rate <= MAX_COMMAND_RATE:
            raise ValueError(f'command_rate must be 1 to 1000 Hz, not {self.command_rate}')
        for name in ('command_timeout', 'status_timeout', 'enable_timeout', 'clear_timeout'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f'{name} must be above 0 s and finite, not {value}')

    def line_warnings(self) -> tuple[str, ...]:
        """Say which direction asks more of the line than it carries (4.5.1)."""
        return (
            *_budget('commands', self.layout.command_size, self.command_rate, self.baud),
            *_budget('status packets', self.layout.status_size, self.status_rate, self.baud),
        )


def _budget(what: str, size: int, rate: float, baud: int) -> list[str]:
    bits = size * BITS_PER_BYTE * rate
    if bits <= baud:
        return []
    text = f'{what} of {size} bytes at {rate:.0f} Hz need {bits:.0f} bit/s, the line has {baud}'
    return [f'{text}: raise baud in HiDS and here, or lower the rate']
