# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session needs to know, checked, and whether it fits the line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bridge_core.parameters import names_of
from bridge_core.reasons import Coded
from bridge_core.settings import CheckedSettings, table_of
from ssc_bridge.channels import (
    axes_of,
    AxisInput,
    ButtonInput,
    buttons_of,
    Failsafe,
    Servo,
    servos_of,
)
from ssc_bridge.parameters import GENERAL
from ssc_bridge.protocol import BITS_PER_BYTE, CommandState, Configuration, MEASURING, OVERHEAD

_TABLE = table_of(GENERAL)
_STATES = {state.text: state for state in CommandState}
_FAILSAFE = Failsafe(_TABLE['failsafe'].default)
_OFTEN = 4.0  # Hz: outputs are looked for, for 0.3 s, before they are commanded
_LISTS = ('poll_rates', 'message_rates', 'plausible_us')


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedSettings):
    """
    What a session needs to know; the fields are parameters.

    :param axes: of Joy, in this order; so ``buttons``.
    :param servos: outputs with a name; ``failsafe`` (no PULSE) is for all others.
    :raises ValueError: for what cannot be.
    """

    TABLE = {name: parameter for name, parameter in _TABLE.items() if name != 'failsafe'}
    port: str = _TABLE['port'].default  # of which it tells what was sent there
    baud: int = _TABLE['baud'].default
    config_id: int = _TABLE['config_id'].default
    link_timeout: float = _TABLE['link_timeout'].default
    poll_rates: tuple[float, ...] = tuple(_TABLE['poll_rates'].default)
    message_rates: tuple[float, ...] = tuple(_TABLE['message_rates'].default)
    estop_states: frozenset[CommandState] = frozenset(
        _STATES[text] for text in _TABLE['estop_states'].default
    )
    lost_link_is_stop: bool = _TABLE['lost_link_is_stop'].default
    first_input_nibble: int = _TABLE['first_input_nibble'].default
    axes: tuple[AxisInput, ...] = ()
    buttons: tuple[ButtonInput, ...] = ()
    plausible_us: tuple[int, ...] = tuple(_TABLE['plausible_us'].default)
    tolerate_faulty_axes: bool = _TABLE['tolerate_faulty_axes'].default
    servos: tuple[Servo, ...] = ()
    failsafe: Failsafe = _FAILSAFE
    command_rate: float = _TABLE['command_rate'].default
    command_timeout: float = _TABLE['command_timeout'].default
    keep_aux_outputs: bool = _TABLE['keep_aux_outputs'].default
    lockout_on_start: bool = _TABLE['lockout_on_start'].default

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in _LISTS:
            _TABLE[name].validate(list(getattr(self, name)))
        rate = max(self.poll_rates[0], self.message_rates[0])
        if rate and 2.0 / rate > self.link_timeout:  # neither: the menu's, which is not told
            raise ValueError(
                f'poll_rates, message_rates: status at {rate:g} Hz is too rare for a link_timeout '
                f'of {self.link_timeout:g} s: one lost message must not be a stop'
            )
        _check_different('axes, buttons', [each.name for each in (*self.axes, *self.buttons)])
        _check_different('servos', [servo.name for servo in self.servos])
        _check_channels(self.servos)
        for axis in self.axes:
            self._check_plausible(f'{axis.prefix}: min_us and max_us', axis.min_us, axis.max_us)
        for button in self.buttons:  # a pulse can be above each, and not above each
            first, last = button.thresholds_us[0], button.thresholds_us[-1]
            self._check_plausible(f'{button.prefix}: thresholds_us', first, last + 1)
        if CommandState.MS_1_5 in self.estop_states and not self.lost_link_is_stop:
            raise ValueError("lost_link_is_stop = false contradicts '1.5 ms' in estop_states")
        if self.failsafe is Failsafe.PULSE:
            raise ValueError('failsafe: a pulse needs an output with a name, see servos')
        holds = Failsafe.HOLD in (self.failsafe, *(servo.failsafe for servo in self.servos))
        rates = [max(self.poll_rates[n], self.message_rates[n]) for n in (1, 2)]
        if holds and min(rates) < _OFTEN:
            raise ValueError(
                "poll_rates, message_rates: the failsafe 'hold' needs channel source and pulse "
                f'outputs at {_OFTEN:g} Hz or more in one of them, or an output would follow its '
                'own echo, or lose its pulse'
            )

    def _check_plausible(self, what: str, least: int, greatest: int) -> None:
        low, high = self.plausible_us
        if not low <= least <= greatest <= high:
            raise ValueError(f'{what} must be within plausible_us, {low}-{high}')

    @property
    def has_controls(self) -> bool:
        """Pulse inputs are sticks or buttons."""
        return bool(self.axes or self.buttons)

    @property
    def stop_states(self) -> frozenset[CommandState]:
        """States of the command channel that are a stop."""
        return self.estop_states | ({CommandState.MS_1_5} if self.lost_link_is_stop else set())

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Settings:
        """Return what the parameters say. :raises ValueError: what cannot be."""
        lists: dict[str, Any] = {name: tuple(values[name]) for name in _LISTS}
        return cls(
            estop_states=frozenset(_STATES[text] for text in names_of(values, 'estop_states')),
            axes=axes_of(values),
            buttons=buttons_of(values),
            servos=servos_of(values),
            failsafe=Failsafe(values['failsafe']),
            **lists,
            **cls.named(values),
        )

    def line_warnings(self, configuration: Configuration) -> list[Coded]:
        """Say which direction asks more of the line than it carries (3.4)."""
        received = zip(_sizes(configuration), self.poll_rates, self.message_rates, strict=True)
        polls = (OVERHEAD * rate for rate in self.poll_rates)
        command = (OVERHEAD + 2 * configuration.outputs) * self.command_rate
        return [
            *self._budget('from', (size * max(rates) for size, *rates in received)),
            *self._budget('to', (command, *polls)),
        ]

    def _budget(self, which: str, bytes_per_second: Iterable[float]) -> list[Coded]:
        bits = BITS_PER_BYTE * sum(bytes_per_second)
        if bits <= self.baud:
            return []
        text = (
            f'messages {which} the SSC need {bits:.0f} bit/s, the line has {self.baud}: lower '
            'poll_rates, command_rate or the rates in the menu of the SSC'
        )
        return [Coded('ssc.line.full', text)]


def _check_different(name: str, values: Sequence[str]) -> None:
    if len(set(values)) < len(values):
        raise ValueError(f'{name}: {list(values)} must all differ')


def _check_channels(servos: Sequence[Servo]) -> None:
    users: dict[int, str] = {}
    for servo in servos:
        other = users.setdefault(servo.channel, servo.name)
        if other != servo.name:
            raise ValueError(f'servo.{servo.name}.channel = {servo.channel}: is that of {other}')


def _sizes(configuration: Configuration) -> tuple[int, ...]:
    """Return the bytes of the frames of REPEATED."""
    outputs, inputs = configuration.outputs, configuration.inputs
    words = sum(isinstance(function, MEASURING) for function in configuration.aux)
    payloads = (2, outputs, 2 * outputs, 2 * inputs, 2 + 2 * words)
    return tuple(OVERHEAD + payload for payload in payloads)
