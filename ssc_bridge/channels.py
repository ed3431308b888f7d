# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What joins the SSC's channels to axes and buttons of Joy, to servos, and to auxiliary values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
import math
from typing import Any, ClassVar, NamedTuple

from bridge_core.parameters import names_of, Parameter
from bridge_core.settings import CheckedSettings, table_of
from ssc_bridge.parameters import BUTTON, CALIBRATION, SERVO
from ssc_bridge.protocol import AuxFunction, MAX_PULSE_US, Measurement

_CALIBRATION, _BUTTON, _SERVO = table_of(CALIBRATION), table_of(BUTTON), table_of(SERVO)


class Failsafe(Enum):
    """What an output does while nobody may or does command it."""

    PULSE = 'pulse'  # a pulse width of its own
    HOLD = 'hold'  # the last pulse width
    RELEASE = 'release'  # no pulse, and nothing is sent once that holds for all outputs


_FAILSAFE = Failsafe(_SERVO['failsafe'].default)


class _Named(CheckedSettings):
    """The base of what a list names; checked by the parameters of its name."""

    GROUP: ClassVar[str]
    name: str

    @property
    def prefix(self) -> str:
        """Of the names of its parameters."""
        return f'{self.GROUP}.{self.name}'

    def __post_init__(self) -> None:
        for name, parameter in self._of_parameters().items():
            parameter.named(f'{self.prefix}.{name}').validate(getattr(self, name))

    def _check_rising(self, us: tuple[int, int, int], *, gap: int) -> None:
        """:raises ValueError: pulses are not ``gap`` µs apart or more, in their order."""
        if min(us[1] - us[0], us[2] - us[1]) < gap:
            pulses = ', '.join(map(str, us))
            raise ValueError(
                f'{self.prefix}: min_us, centre_us, max_us = {pulses}: rising numbers are needed'
            )


@dataclass(frozen=True)
class AxisInput(_Named):
    """
    An axis of Joy, and what its pulses mean; the fields but ``name`` are parameters.

    :raises ValueError: for what cannot be.
    """

    TABLE = _CALIBRATION
    GROUP = 'calibration'
    name: str
    channel: int
    min_us: int = _CALIBRATION['min_us'].default
    centre_us: int = _CALIBRATION['centre_us'].default
    max_us: int = _CALIBRATION['max_us'].default
    reversed: bool = False
    deadband: float = _CALIBRATION['deadband'].default

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_rising((self.min_us, self.centre_us, self.max_us), gap=1)


@dataclass(frozen=True)
class ButtonInput(_Named):
    """
    A button of Joy: the number of thresholds that the pulse is above.

    :param thresholds_us: rising, one or more, µs.
    :param reversed: count those that it is not above.
    """

    TABLE = _BUTTON
    GROUP = 'button'
    name: str
    channel: int
    thresholds_us: tuple[int, ...] = tuple(_BUTTON['thresholds_us'].default)
    reversed: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.thresholds_us or list(self.thresholds_us) != sorted(set(self.thresholds_us)):
            raise ValueError(
                f'{self.prefix}.thresholds_us = {list(self.thresholds_us)}: one or more numbers, '
                'each greater than the one before, are needed'
            )

    def value(self, us: int) -> int:
        """Return 0 to the number of thresholds."""
        above = sum(us > threshold for threshold in self.thresholds_us)
        return len(self.thresholds_us) - above if self.reversed else above


@dataclass(frozen=True, kw_only=True)
class Servo(_Named):
    """
    A pulse output and what is allowed there, µs; the fields but ``name`` are parameters.

    No pulse beyond ``min_us`` and ``max_us`` is ever sent but 0, which is no pulse.

    :param rate_us_per_s: greatest change of a command; infinite: any.
    """

    TABLE = {
        name: parameter
        for name, parameter in _SERVO.items()
        if name not in ('failsafe', 'rate_us_per_s')
    }
    GROUP = 'servo'
    name: str
    channel: int
    min_us: int = _SERVO['min_us'].default
    centre_us: int = _SERVO['centre_us'].default
    max_us: int = _SERVO['max_us'].default
    reversed: bool = False
    rate_us_per_s: float = math.inf
    failsafe: Failsafe = _FAILSAFE
    failsafe_us: int = _SERVO['failsafe_us'].default

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_rising((self.min_us, self.centre_us, self.max_us), gap=0)
        if not self.rate_us_per_s > 0.0:
            raise ValueError(f'{self.prefix}.rate_us_per_s must be above 0')
        if self.failsafe is Failsafe.PULSE and not self.min_us <= self.failsafe_us <= self.max_us:
            raise ValueError(
                f'{self.prefix}.failsafe_us = {self.failsafe_us}: must be within min_us and '
                f'max_us, {self.min_us} to {self.max_us}'
            )
        if self.failsafe is not Failsafe.PULSE and self.failsafe_us != type(self).failsafe_us:
            raise ValueError(
                f'{self.prefix}.failsafe_us = {self.failsafe_us}: is not used; only failsafe '
                "'pulse' needs it"
            )

    @classmethod
    def unnamed(cls, channel: int, failsafe: Failsafe) -> Servo:
        """Return an output that may do all that the device can."""
        name = f'output {channel}'
        return cls(name=name, channel=channel, min_us=1, max_us=MAX_PULSE_US, failsafe=failsafe)

    def pulse(self, position: float) -> float:
        """Return the pulse of a position, -1 to 1, in µs; not limited."""
        position = -position if self.reversed else position
        end = self.max_us if position > 0.0 else self.min_us
        return self.centre_us + abs(position) * (end - self.centre_us)

    def limited(self, us: float) -> float:
        """Return the nearest pulse that is allowed; 0, no pulse, always is."""
        return min(max(us, self.min_us), self.max_us) if us else 0.0


@dataclass(frozen=True, slots=True)
class AuxChannel:
    """
    One auxiliary channel.

    :param level: of its pin, true is high. :param measurement: of a timer or accumulator.
    :param total: pulses of an accumulator so far. :param overflowed: there were more.
    """

    function: AuxFunction
    level: bool
    measurement: Measurement | None = None
    total: int = 0
    overflowed: bool = False


class AuxRequest(NamedTuple):
    """
    What to set of an auxiliary output.

    :param number: 1 to 6. :param what: 'level', 'pulse' or 'period'.
    :param value: 1 or 0 for a level, else seconds.
    """

    number: int
    what: str
    value: float


def axes_of(values: Mapping[str, Any]) -> tuple[AxisInput, ...]:
    """Return the axes of Joy from the parameters. :raises ValueError: what cannot be."""
    return tuple(AxisInput(**group) for group in _groups(values, 'axes', CALIBRATION, AxisInput))


def buttons_of(values: Mapping[str, Any]) -> tuple[ButtonInput, ...]:
    """Return the buttons of Joy from the parameters. :raises ValueError: what cannot be."""
    return tuple(
        ButtonInput(**(group | {'thresholds_us': tuple(group['thresholds_us'])}))
        for group in _groups(values, 'buttons', BUTTON, ButtonInput)
    )


def servos_of(values: Mapping[str, Any]) -> tuple[Servo, ...]:
    """Return the outputs with a name from the parameters. :raises ValueError: what cannot be."""
    return tuple(
        Servo(**(group | {'failsafe': Failsafe(group['failsafe'])}))
        for group in _groups(values, 'servos', SERVO, Servo)
    )


def _groups(
    values: Mapping[str, Any], names: str, parameters: Sequence[Parameter], kind: type[_Named]
) -> Iterator[dict[str, Any]]:
    """Yield the parameters of each name in a list, by their last word, and the name itself."""
    for name in names_of(values, names):
        prefix = f'{kind.GROUP}.{name}'
        yield {'name': name} | {p.name: values[f'{prefix}.{p.name}'] for p in parameters}
