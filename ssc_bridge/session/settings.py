"""How a session is to behave, checked when it is made, and whether it fits the line."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
import math

from ssc_bridge.protocol import BAUD
from ssc_bridge.protocol import BITS_PER_BYTE
from ssc_bridge.protocol import CommandState
from ssc_bridge.protocol import Configuration
from ssc_bridge.protocol import MAX_INPUTS
from ssc_bridge.protocol import MAX_PULSE_US
from ssc_bridge.protocol import MEASURING
from ssc_bridge.protocol import MessageType
from ssc_bridge.protocol import OVERHEAD
from ssc_bridge.protocol import PULSE_CHANNELS

# The messages that can be polled again and again, in the order of ``poll_rates``.
REPEATED = (
    MessageType.STATUS,
    MessageType.CHANNEL_SOURCE,
    MessageType.PULSE_OUTPUTS,
    MessageType.PULSE_INPUTS,
    MessageType.AUX_INPUTS,
)
_RANGES = {
    'link_timeout': (0.05, 5.0),
    'command_rate': (1.0, 200.0),
    'command_timeout': (0.02, 5.0),
    'first_nibble': (0, 1),
}
_RATES = (0.0, 100.0)


def _check(name: str, value: float, low: float, high: float) -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise ValueError(f'{name} must be {low:g} to {high:g}, not {value}')


def _check_different(name: str, values: Sequence[object]) -> None:
    if len(set(values)) < len(values):
        raise ValueError(f'{name}: {list(values)} must all differ')


@dataclass(frozen=True, slots=True)
class AxisInput:
    """An axis of Joy. :param channel: pulse input, 1 to 16."""

    name: str
    channel: int

    def __post_init__(self) -> None:
        _check(f'calibration.{self.name}.channel', self.channel, 1, MAX_INPUTS)


@dataclass(frozen=True, slots=True)
class ButtonInput:
    """
    A button of Joy: the number of thresholds that the pulse is above.

    :param channel: pulse input, 1 to 16. :param thresholds_us: rising, one or more, µs.
    :param reversed: count those that it is not above.
    """

    name: str
    channel: int
    thresholds_us: tuple[int, ...] = (1500,)
    reversed: bool = False

    def __post_init__(self) -> None:
        _check(f'button.{self.name}.channel', self.channel, 1, MAX_INPUTS)
        if not self.thresholds_us or list(self.thresholds_us) != sorted(set(self.thresholds_us)):
            raise ValueError(
                f'button.{self.name}.thresholds_us = {list(self.thresholds_us)}: one or more '
                'numbers, each greater than the one before, are needed'
            )

    def value(self, us: int) -> int:
        """Return 0 to the number of thresholds."""
        above = sum(us > threshold for threshold in self.thresholds_us)
        return len(self.thresholds_us) - above if self.reversed else above


class Failsafe(Enum):
    """What an output does while nobody may or does command it."""

    PULSE = 'pulse'  # a pulse width of its own
    HOLD = 'hold'  # the last pulse width
    RELEASE = 'release'  # no pulse, and nothing is sent once that holds for all outputs


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """
    A pulse output and what is allowed there, µs.

    :param channel: 1 to 24. :param min_us: at position -1; ``centre_us``: at 0; ``max_us``: at 1.
        No other pulse is ever sent but 0, which is no pulse.
    :param reversed: position -1 is at ``max_us``. :param rate_us_per_s: greatest change of a
        command; a failsafe acts at once. :param failsafe_us: for Failsafe.PULSE.
    """

    name: str
    channel: int
    min_us: int = 1000
    centre_us: int = 1500
    max_us: int = 2000
    reversed: bool = False
    rate_us_per_s: float = math.inf
    failsafe: Failsafe = Failsafe.RELEASE
    failsafe_us: int = 1500

    def __post_init__(self) -> None:
        _check(f'servo.{self.name}.channel', self.channel, 1, PULSE_CHANNELS)
        if not 0 < self.min_us <= self.centre_us <= self.max_us <= MAX_PULSE_US:
            limits = f'{self.min_us}, {self.centre_us}, {self.max_us}'
            raise ValueError(
                f'servo.{self.name}: min_us, centre_us, max_us = {limits}: rising numbers from 1 '
                f'to {MAX_PULSE_US} are needed'
            )
        if not self.rate_us_per_s > 0.0:
            raise ValueError(f'servo.{self.name}.rate_us_per_s must be above 0')
        if self.failsafe is Failsafe.PULSE and not self.min_us <= self.failsafe_us <= self.max_us:
            raise ValueError(
                f'servo.{self.name}.failsafe_us = {self.failsafe_us}: must be within min_us and '
                f'max_us, {self.min_us} to {self.max_us}'
            )

    def pulse(self, position: float) -> float:
        """Return the pulse of a position, -1 to 1, in µs; not limited."""
        position = -position if self.reversed else position
        end = self.max_us if position > 0.0 else self.min_us
        return self.centre_us + abs(position) * (end - self.centre_us)

    def limited(self, us: float) -> float:
        """Return the nearest pulse that is allowed; 0, no pulse, always is."""
        return min(max(us, self.min_us), self.max_us) if us else 0.0


def _check_channels(servos: Sequence[Servo]) -> None:
    users: dict[int, str] = {}
    for servo in servos:
        other = users.setdefault(servo.channel, servo.name)
        if other != servo.name:
            raise ValueError(f'servo.{servo.name}.channel = {servo.channel}: is that of {other}')


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """
    What a session needs to know.

    :param link_timeout: s without a status message that count as lost; the same for the others.
    :param poll_rates: Hz, in the order of REPEATED: a message that does not come by itself this
        often is asked for; 0: never.
    :param message_rates: Hz, likewise, as set in the device's own menu; for the line's budget.
    :param command_rate: Hz of pulse commands.
    :param command_timeout: s, for commands and e-stop input alike.
    :param estop_states: states of the command channel that are a stop.
    :param axes: of Joy, in this order; so ``buttons``.
    :param plausible_us: least and greatest pulse of an input that is believed.
    :param tolerate_faulty_axes: let the sound controls count although others are faulty.
    :param servos: outputs with a name; ``failsafe`` (no PULSE) is for all others.
    :param keep_aux_outputs: leave the auxiliary outputs alone at a stop, and obey during one.
    :param lockout_on_start: lock the configuration menus out as soon as the device is there.
    :param first_nibble: what stands for pulse input 1 in message 11, 0 or 1; for texts only.
    :param baud: bit/s of the line, for its budget only.
    :raises ValueError: for what cannot be.
    """

    link_timeout: float = 0.25
    poll_rates: tuple[float, ...] = (20.0, 5.0, 10.0, 50.0, 10.0)
    message_rates: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    command_rate: float = 50.0
    command_timeout: float = 0.25
    estop_states: frozenset[CommandState] = frozenset({CommandState.NO_SIGNAL})
    axes: tuple[AxisInput, ...] = ()
    buttons: tuple[ButtonInput, ...] = ()
    plausible_us: tuple[int, int] = (700, 2300)
    tolerate_faulty_axes: bool = False
    servos: tuple[Servo, ...] = ()
    failsafe: Failsafe = Failsafe.RELEASE
    keep_aux_outputs: bool = False
    lockout_on_start: bool = False
    first_nibble: int = 0
    baud: int = BAUD

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            _check(name, getattr(self, name), low, high)
        for name in ('poll_rates', 'message_rates'):
            self._check_rates(name)
        polled = self.poll_rates[0]
        if polled and 2.0 / polled > self.link_timeout:
            raise ValueError(
                f'poll_rates: status at {polled:g} Hz is too rare for a link_timeout of '
                f'{self.link_timeout:g} s: one lost message must not be a stop'
            )
        if not self.plausible_us[0] < self.plausible_us[1]:
            raise ValueError(f'plausible_us = {list(self.plausible_us)}: least and greatest')
        axes, buttons = [axis.name for axis in self.axes], [b.name for b in self.buttons]
        _check_different('axes, buttons', axes + buttons)
        _check_different('servos', [servo.name for servo in self.servos])
        _check_channels(self.servos)
        if self.failsafe is Failsafe.PULSE:
            raise ValueError('failsafe: a pulse needs an output with a name, see servos')

    def _check_rates(self, name: str) -> None:
        rates = getattr(self, name)
        if len(rates) != len(REPEATED):
            raise ValueError(f'{name}: {len(REPEATED)} rates, for messages 10 to 14, are needed')
        for rate in rates:
            _check(name, rate, *_RATES)

    def line_warnings(self, configuration: Configuration) -> list[str]:
        """Say which direction asks more of the line than it carries (3.4)."""
        received = zip(_sizes(configuration), self.poll_rates, self.message_rates, strict=True)
        polls = (OVERHEAD * rate for rate in self.poll_rates)
        command = (OVERHEAD + 2 * configuration.outputs) * self.command_rate
        return [
            *self._budget('from', (size * max(rates) for size, *rates in received)),
            *self._budget('to', (command, *polls)),
        ]

    def _budget(self, which: str, bytes_per_second: Iterable[float]) -> list[str]:
        bits = BITS_PER_BYTE * sum(bytes_per_second)
        if bits <= self.baud:
            return []
        return [
            f'messages {which} the SSC need {bits:.0f} bit/s, the line has {self.baud}: lower '
            'poll_rates, command_rate or the rates in the menu of the SSC'
        ]


def _sizes(configuration: Configuration) -> tuple[int, ...]:
    """Return the bytes of the frames of REPEATED."""
    outputs, inputs = configuration.outputs, configuration.inputs
    words = sum(isinstance(function, MEASURING) for function in configuration.aux)
    payloads = (2, outputs, 2 * outputs, 2 * inputs, 2 + 2 * words)
    return tuple(OVERHEAD + payload for payload in payloads)
