# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Between the SSC's values and ROS messages; pure functions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math
import reprlib

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import String, UInt16MultiArray

from bridge_core.convert import joy_message, scaled
from bridge_core.numerals import decimal_number
from ssc_bridge.channels import AuxChannel, AuxRequest, AxisInput
from ssc_bridge.protocol import (
    AUX_CHANNELS,
    CommandState,
    INVALID_PULSE,
    Measurement,
    PulseCommand,
    TimerInput,
)

UNKNOWN = 'unknown'
_LEVELS = {'high': True, 'low': False, 'true': True, 'false': False, '1': True, '0': False}
_AUX_NUMBERS = tuple(map(str, range(1, AUX_CHANNELS + 1)))
_AUX_KEY = 'a key such as "4.level", "5.pulse" or "5.period" is needed'


def position(axis: AxisInput, us: int | None) -> float:
    """Return an axis, -1 to 1, from its pulse; 0 where there is no pulse to believe."""
    if us is None:
        return 0.0
    offset = us - axis.centre_us
    end = axis.max_us if offset > 0 else axis.min_us
    value = scaled(offset, abs(end - axis.centre_us), axis.deadband)
    return -value if axis.reversed else value


def joy(
    us: Sequence[int | None],
    buttons: Sequence[int],
    axes: Sequence[AxisInput],
    stamp: Time,
    frame_id: str,
) -> Joy:
    """Return a Joy. :param us: pulse of each axis; None: it is neutral."""
    positions = [position(axis, pulse) for axis, pulse in zip(axes, us, strict=True)]
    return joy_message(positions, buttons, stamp, frame_id)


def pulses(us: Iterable[int | None]) -> UInt16MultiArray:
    """Return pulses, µs, channel 1 first; an invalid one is 32768, which no pulse can be."""
    return UInt16MultiArray(data=[INVALID_PULSE if pulse is None else pulse for pulse in us])


def command_state(state: CommandState | None) -> String:
    """Return 'no signal', '1 ms', '1.5 ms', '2 ms', or 'unknown' without a fresh status."""
    return String(data=UNKNOWN if state is None else state.text)


def pulse_command(message: UInt16MultiArray) -> list[int]:
    """
    Return the pulses of a request, µs.

    :raises ValueError: its data_offset is beyond them, or they are none that the SSC can be asked.
    """
    offset = message.layout.data_offset
    if offset > len(message.data):
        raise ValueError(f'data_offset {offset}, but there are {len(message.data)} pulses')
    return list(PulseCommand(tuple(message.data[offset:])).us)


def servo_command(message: JointState, servos: Sequence[str]) -> dict[str, float]:
    """
    Return the position of each servo that a request names; without names, of all in order.

    Taken from the one field that is filled: position, or what a mux sends, velocity or effort.

    :raises ValueError: for unknown or doubled names, or another number of values than names.
    """
    names = list(message.name) or list(servos)
    if unknown := set(names).difference(servos):
        raise ValueError(f'no servo {reprlib.repr(min(unknown))}; there are {list(servos)}')
    if len(set(names)) < len(names):
        raise ValueError(f'a servo is named twice: {reprlib.repr(names)}')
    filled = [field for field in (message.position, message.velocity, message.effort) if field]
    if len(filled) != 1:
        raise ValueError(f'one of position, velocity and effort is needed, not {len(filled)}')
    if len(filled[0]) != len(names):
        raise ValueError(f'{len(filled[0])} values for the servos {reprlib.repr(names)}')
    return dict(zip(names, map(float, filled[0]), strict=True))


def aux_requests(message: KeyValue) -> list[AuxRequest]:
    """
    Return what to set: keys such as '4.level', and values, each with commas between.

    :raises ValueError: another key, a value that is none, or not as many of one as of the other.
    """
    keys, values = message.key.split(','), message.value.split(',')
    if len(keys) != len(values):
        raise ValueError(f'{len(values)} values for {len(keys)} keys: {reprlib.repr(message.key)}')
    return [_aux_request(*map(str.strip, pair)) for pair in zip(keys, values, strict=True)]


def _aux_request(key: str, value: str) -> AuxRequest:
    number, dot, what = key.partition('.')
    if not (dot and number.isdecimal() and what in ('level', 'pulse', 'period')):
        raise ValueError(f'{reprlib.repr(key)}: {_AUX_KEY}')
    if number not in _AUX_NUMBERS:
        raise ValueError(f'there is no aux {reprlib.repr(number)}, only 1 to {AUX_CHANNELS}')
    if what == 'level':
        if value not in _LEVELS:
            raise ValueError(f'{reprlib.repr(value)} is no level: high or low is needed')
        return AuxRequest(int(number), what, float(_LEVELS[value]))
    try:
        return AuxRequest(int(number), what, decimal_number(value))
    except ValueError as error:
        raise ValueError(f'{reprlib.repr(value)} is no time in seconds') from error


def channel_sources(sources: Sequence[str], name: str, hardware_id: str) -> DiagnosticStatus:
    """Return the source of each output in the manual's words; STALE if none is known."""
    return DiagnosticStatus(
        level=DiagnosticStatus.OK if sources else DiagnosticStatus.STALE,
        name=name,
        message='ok' if sources else UNKNOWN,
        hardware_id=hardware_id,
        values=[KeyValue(key=f'output {n}', value=text) for n, text in enumerate(sources, 1)],
    )


def aux_inputs(channels: Iterable[AuxChannel], name: str, hardware_id: str) -> DiagnosticStatus:
    """Return all auxiliary channels in words and SI units."""
    values: dict[str, str] = {}
    lost = []
    for number, channel in enumerate(channels, 1):
        values |= {f'aux {number} {key}': text for key, text in aux_values(channel).items()}
        if channel.overflowed:
            lost.append(f'aux {number} lost pulses: its counter has overflowed; poll it faster')
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if lost else DiagnosticStatus.OK,
        name=name,
        message='; '.join(lost) or 'ok',
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


def aux_values(channel: AuxChannel) -> dict[str, str]:
    """Return what one auxiliary channel is, what its pin is, and what it has measured."""
    function, measurement = channel.function, channel.measurement
    values = {'function': function.text, 'level': 'high' if channel.level else 'low'}
    if measurement is None:
        return values
    if isinstance(function, TimerInput):
        return values | _timer_values(function, measurement)
    return values | {
        'state': 'over-range' if measurement.over_range else 'counting',
        'pulses since the last message': str(measurement.counts),
        'pulses in total': f'{"at least " if channel.overflowed else ""}{channel.total}',
    }


def _timer_values(timer: TimerInput, measurement: Measurement) -> dict[str, str]:
    """Return state and times; 'unknown' where there is nothing that could be believed."""
    seconds = measurement.counts * timer.time_base_us * 1e-6
    state = 'running'
    if measurement.over_range:
        state, seconds = 'over-range', math.nan
    elif not measurement.running:
        state, seconds = 'stopped', math.nan
    what = 'period' if timer.measures_period else 'high' if timer.start_rising else 'low'
    values = {'state': state, f'{what} (s)': _number(seconds, '.6f')}
    if timer.measures_period:
        hertz = 1.0 / seconds if seconds else math.nan  # 0 counts: too fast for the time base
        values |= {'frequency (Hz)': _number(hertz), 'speed (rpm)': _number(60.0 * hertz)}
    return values


def _number(value: float, form: str = '.3f') -> str:
    return f'{value:{form}}' if math.isfinite(value) else UNKNOWN
