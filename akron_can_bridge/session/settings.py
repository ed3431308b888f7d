"""How a session is to behave, checked when it is made."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
import math

from akron_can_bridge.protocol import AXIS_USAGE
from akron_can_bridge.protocol import is_pin
from akron_can_bridge.protocol import JOYSTICK_ADDRESSES

CONTROLLERS = tuple(AXIS_USAGE)  # those that obey joysticks (Appendix B) and send type 83
MINI_UNIVERSAL = 1033
UNIT_TYPES = (*CONTROLLERS, MINI_UNIVERSAL)

_RANGES = {
    'link_timeout': (0.15, 5.0),
    'command_timeout': (0.04, 2.0),
    'estop_in_timeout': (0.04, 2.0),
    'answer_timeout': (0.2, 10.0),
    'vista_rate': (0.0, 10.0),
}


class Cause(Enum):
    """What can make ``estop`` true; the values are those of the parameter ``estop_on``."""

    LINK = 'link'
    ENABLE = 'enable'
    MOTOR_FAULT = 'motor_fault'
    FOREIGN_JOYSTICK = 'foreign_joystick'


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """
    What a session needs to know.

    :param source_address: which joystick we are, 33 to 38 hex; the lower one overrides (App. B).
    :param device_pin: the unit's 15-digit PIN; empty: the first one of ``device_type``.
    :param device_type: the first four digits of the PIN, such as 1032; 0: any controller.
    :param extended: also send 64983, for Point Aim targets and switches 13 to 16.
    :param soe_permissive: send A1, the permission to move in SOE mode.
    :param joy_source: the joystick on the bus that is told as Sticks; 0: none.
    :param allowed_joysticks: addresses whose joystick frames are wanted on the bus.
    :param estop_on: the causes that count.
    :param link_timeout: seconds without a frame of the unit that count as lost.
    :param command_timeout: seconds after which a command is stale.
    :param estop_in_timeout: seconds after which the e-stop input is stale.
    :param answer_timeout: seconds that the unit may take to answer a request.
    :param vista_rate: Hz of Vista data polls; 0: none.
    :param tolerate_faulty_axes: let the bus joystick's sound controls count.
    :raises ValueError: for a value out of range, or ``joy_source`` being ourselves.
    """

    source_address: int = 0x38
    device_pin: str = ''
    device_type: int = 1032
    extended: bool = False
    soe_permissive: bool = False
    joy_source: int = 0
    allowed_joysticks: frozenset[int] = frozenset()
    estop_on: frozenset[Cause] = frozenset(Cause)
    link_timeout: float = 0.3
    command_timeout: float = 0.15
    estop_in_timeout: float = 0.25
    answer_timeout: float = 1.0
    vista_rate: float = 0.0
    tolerate_faulty_axes: bool = False

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise ValueError(f'{name} must be {low:g} to {high:g}, not {value}')
        for name in ('source_address', 'joy_source'):
            check_joystick(name, getattr(self, name), none=name == 'joy_source')
        for address in self.allowed_joysticks:
            check_joystick('allowed_joysticks', address)
        if self.source_address in (self.joy_source, *self.allowed_joysticks):
            raise ValueError('joy_source and allowed_joysticks cannot be our source_address')
        check_unit(self.device_pin, self.device_type)

    @property
    def unit_type(self) -> int:
        """The first four digits of the wanted unit's PIN; 0: those of any controller."""
        return int(self.device_pin[:4]) if self.device_pin else self.device_type


def check_joystick(name: str, address: int, *, none: bool = False) -> None:
    """Let a joystick's address pass, and 0 if ``none``. :raises ValueError: for any other."""
    if address in JOYSTICK_ADDRESSES or (none and address == 0):
        return
    raise ValueError(f'{name} must be 0x33 to 0x38{" or 0" if none else ""}, not {address}')


def check_unit(pin: str, device_type: int) -> None:
    """Let a PIN and a type pass. :raises ValueError: for one that no unit can have."""
    known = ', '.join(map(str, UNIT_TYPES))
    if pin and not (is_pin(pin) and int(pin[:4]) in UNIT_TYPES):
        raise ValueError(
            f"device_pin must be 15 characters such as '1032AE100801035' that begin with one of "
            f'{known}, not {pin!r}'
        )
    if device_type not in (0, *UNIT_TYPES):
        raise ValueError(f'device_type must be 0 or one of {known}, not {device_type}')
