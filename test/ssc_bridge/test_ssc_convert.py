# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Between pulses, counts and ROS messages."""

from collections.abc import Callable
from dataclasses import replace
import math
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import MultiArrayLayout, UInt16MultiArray

from ssc_bridge import convert
from ssc_bridge.channels import AuxChannel, AxisInput
from ssc_bridge.protocol import (
    CommandState,
    DigitalInput,
    Measurement,
    PulseAccumulator,
    PulseOutput,
    TIME_BASES_US,
    TimerInput,
    UnknownFunction,
)
from stage.talkers import values_of


def axis(**changes: Any) -> AxisInput:
    return AxisInput(**{'name': 'turn', 'channel': 2, 'deadband': 0.0, **changes})


LOPSIDED = axis(min_us=1100, centre_us=1400, max_us=2000)


# -- sticks ---------------------------------------------------------------------------------------


TURNED, WIDE = replace(LOPSIDED, reversed=True), axis(deadband=0.1)
POSITIONS = [  # axis, pulse, position: each side has its own scale
    *((LOPSIDED, us, -1.0) for us in (700, 1100)),
    (LOPSIDED, 1250, -0.5),
    (LOPSIDED, 1399, -1 / 300),
    (LOPSIDED, 1400, 0.0),
    (LOPSIDED, 1401, 1 / 600),
    (LOPSIDED, 1700, 0.5),
    *((LOPSIDED, us, 1.0) for us in (2000, 2300)),
    (LOPSIDED, None, 0.0),
    (TURNED, 1100, 1.0),
    (TURNED, 1700, -0.5),
    # The deadband begins without a step.
    *((WIDE, us, 0.0) for us in (1450, 1550)),
    (WIDE, 1551, 0.002 / 0.9),
    (WIDE, 2000, 1.0),
]


@pytest.mark.parametrize(('control', 'us', 'value'), POSITIONS)
def test_position_of_an_axis(control: AxisInput, us: int | None, value: float) -> None:
    assert convert.position(control, us) == pytest.approx(value)


def test_joy_has_axes_buttons_and_header() -> None:
    stamp = Time(sec=3)
    axes = (LOPSIDED, axis(reversed=True))
    message = convert.joy((2000, None), (1, 2), axes, stamp, 'remote')
    assert list(message.axes) == [1.0, 0.0]
    assert math.copysign(1.0, message.axes[1]) == 1.0
    assert list(message.buttons) == [1, 2]
    assert (message.header.stamp, message.header.frame_id) == (stamp, 'remote')


# -- pulses and servos ----------------------------------------------------------------------------


def test_invalid_pulse_is_told_from_no_pulse() -> None:
    assert list(convert.pulses((1500, None, 0)).data) == [1500, 32768, 0]


def test_command_states_in_words() -> None:
    texts = [convert.command_state(state).data for state in (*CommandState, None)]
    assert texts == ['no signal', '1 ms', '1.5 ms', '2 ms', 'unknown']


def test_pulse_command_begins_at_its_offset() -> None:
    message = UInt16MultiArray(layout=MultiArrayLayout(data_offset=1), data=[9, 1500, 1600])
    assert convert.pulse_command(message) == [1500, 1600]


NAMES = ['pan', 'tilt']
SERVO_COMMANDS = [
    (JointState(name=['tilt'], position=[0.5]), {'tilt': 0.5}),
    (JointState(position=[0.1, 0.2]), {'pan': 0.1, 'tilt': 0.2}),
    (JointState(name=['pan'], velocity=[0.5]), {'pan': 0.5}),
    (JointState(name=['pan'], effort=[0.5]), {'pan': 0.5}),
]


@pytest.mark.parametrize(('message', 'positions'), SERVO_COMMANDS)
def test_servos_by_name_or_all_in_order(message: Any, positions: dict[str, float]) -> None:
    assert convert.servo_command(message, NAMES) == positions


def offset(count: int, *data: int) -> UInt16MultiArray:
    return UInt16MultiArray(layout=MultiArrayLayout(data_offset=count), data=data)


REJECTED = [  # a request, and why it is rejected
    (lambda: convert.pulse_command(offset(4, 9, 1500, 1600)), 'data_offset'),
    (lambda: convert.pulse_command(offset(0)), '1 to 24 are needed, not 0'),
    (lambda: convert.pulse_command(offset(1, 1500)), '1 to 24 are needed, not 0'),
    *(
        ((lambda message=message: convert.servo_command(message, NAMES)), text)
        for message, text in (
            (JointState(name=['pan', 'pan'], position=[0.0, 0.0]), 'twice'),
            (JointState(name=['pan'], position=[0.0, 0.0]), 'values'),
            (JointState(name=['pan'], position=[0.0], velocity=[0.0]), 'one of'),
            (JointState(name=['pan']), 'one of'),
            (JointState(position=[0.0]), 'values'),
            (JointState(name=[f'{n:01000}' for n in range(3000)]), 'no servo'),
        )
    ),
    *(
        ((lambda pair=pair: convert.aux_requests(KeyValue(key=pair[0], value=pair[1]))), text)
        for pair, text in (
            *(((key, 'high'), 'a key such as') for key in ('4', '.level', 'x.level', '-1.level')),
            (('', ''), 'a key such as'),
            (('4.volume', '1'), 'a key such as'),
            (('x' * 3_000_000, ''), 'a key such as'),
            (('4.level', 'up'), 'is no level'),
            (('4.level', ''), 'is no level'),
            *(
                (('5.pulse', value), 'is no time')
                for value in ('long', '1_0', '\u0661', 'inf', 'nan')
            ),
            (('4.level,3.level', 'high'), '1 values for 2 keys'),
            (('4.level', 'high,low'), '2 values for 1 keys'),
            (('4.level,', 'high,'), 'a key such as'),
            *(
                ((f'{number}.level', 'high'), 'no aux .* only 1 to 6')
                for number in ('0', '7', '7' * 5000)
            ),
        )
    ),
]


@pytest.mark.parametrize(('convert_it', 'text'), REJECTED)
def test_request_without_sense_is_told_in_few_words(
    convert_it: Callable[[], Any], text: str
) -> None:
    with pytest.raises(ValueError, match=text) as rejection:
        convert_it()
    assert len(str(rejection.value)) < 500


# -- auxiliary channels ---------------------------------------------------------------------------

# The manual's table of measurement ranges (3.2.3.2): time base, least Hz and rpm, greatest Hz.
RANGES = [
    (1, 61.04, 3662.11, 10000.00),
    (2, 30.52, 1831.05, 5000.00),
    (4, 15.26, 915.53, 2500.00),
    (8, 7.63, 457.76, 1250.00),
    (16, 3.81, 228.88, 625.00),
    (32, 1.91, 114.44, 312.50),
    (64, 0.95, 57.22, 156.25),
    (128, 0.48, 28.61, 78.13),
]


def timer_values(timer: TimerInput, measurement: Measurement) -> dict[str, str]:
    return convert.aux_values(AuxChannel(timer, True, measurement))


@pytest.mark.parametrize(('time_base', 'least_hz', 'least_rpm', 'greatest_hz'), RANGES)
@pytest.mark.parametrize('rising', [False, True])
def test_frequencies_at_the_limits_of_the_manuals_table(
    time_base: int, least_hz: float, least_rpm: float, greatest_hz: float, rising: bool
) -> None:
    timer = TimerInput(rising, rising, time_base)
    slowest = timer_values(timer, Measurement(0x3FFF))
    assert float(slowest['frequency (Hz)']) == pytest.approx(least_hz, abs=0.006)
    assert float(slowest['speed (rpm)']) == pytest.approx(least_rpm, rel=1e-4)
    assert float(slowest['period (s)']) == pytest.approx(16383 * time_base * 1e-6)
    fastest = timer_values(timer, Measurement(100))  # 1 % accuracy
    assert float(fastest['frequency (Hz)']) == pytest.approx(greatest_hz, abs=0.006)


@pytest.mark.parametrize('time_base', TIME_BASES_US)
@pytest.mark.parametrize(
    ('start', 'stop', 'name'),
    [
        (True, True, 'period'),
        (False, False, 'period'),
        (True, False, 'high'),
        (False, True, 'low'),
    ],
)
def test_edges_say_what_is_measured(start: bool, stop: bool, name: str, time_base: int) -> None:
    values = timer_values(TimerInput(start, stop, time_base), Measurement(2))
    assert float(values[f'{name} (s)']) == pytest.approx(2e-6 * time_base)
    assert ('frequency (Hz)' in values) == (name == 'period')


PERIOD = TimerInput(True, True, 1)
NO_NUMBER = 'period (s) = unknown | frequency (Hz) = unknown | speed (rpm) = unknown'
COUNTED = AuxChannel(PulseAccumulator(True), False, Measurement(7), 19)
COUNTS = 'pulses since the last message = 7 | pulses in total = 19'
AUX_VALUES: list[tuple[AuxChannel, str, str]] = [
    # A channel, its function in words, and what else is told of it.
    (AuxChannel(DigitalInput(), False), 'Dig In', 'level = low'),
    (AuxChannel(PulseOutput(), False), 'Pulse Out (1us,f,+)', 'level = low'),
    (AuxChannel(UnknownFunction(0x1F), True), 'unknown (0x001F)', 'level = high'),
    (  # the manual's example, 3.2.3.2: 1000 counts of 16 us are 16000 us
        AuxChannel(TimerInput(True, False, 16), True, Measurement(1000)),
        'Timer In (16us,+,-)',
        'level = high | state = running | high (s) = 0.016000',
    ),
    *(
        (
            AuxChannel(PERIOD, True, Measurement(500, running, over_range)),
            'Timer In (1us,+,+)',
            f'level = high | state = {state} | {NO_NUMBER}',
        )
        for running, over_range, state in (
            (True, True, 'over-range'),
            (False, True, 'over-range'),
            (False, False, 'stopped'),
        )
    ),
    (COUNTED, 'PulAcc In (+)', f'level = low | state = counting | {COUNTS}'),
]


@pytest.mark.parametrize(('channel', 'function', 'values'), AUX_VALUES)
def test_aux_channel_in_words(channel: AuxChannel, function: str, values: str) -> None:
    told = dict(each.split(' = ') for each in values.split(' | '))
    assert convert.aux_values(channel) == {'function': function, **told}
    message = convert.aux_inputs([channel], 'name', 'hardware')
    assert (message.level, message.message) == (DiagnosticStatus.OK, 'ok')
    assert values_of(message)['aux 1 function'] == function


def test_lost_pulses_are_a_warning() -> None:
    measured = Measurement(0x3FFF, over_range=True)
    full = AuxChannel(PulseAccumulator(True), False, measured, 16383, overflowed=True)
    others = [AuxChannel(DigitalInput(), True)] * 5
    message = convert.aux_inputs([*others, full], 'ssc_bridge: aux', 'port')
    assert message.level == DiagnosticStatus.WARN
    assert 'aux 6 lost pulses' in message.message
    assert values_of(message)['aux 6 pulses in total'] == 'at least 16383'
    assert values_of(message)['aux 6 state'] == 'over-range'


@pytest.mark.parametrize(
    ('key', 'value', 'expected'),
    [
        ('4.level', 'high', (4, 'level', 1.0)),
        ('4.level', 'low', (4, 'level', 0.0)),
        ('1.level', '1', (1, 'level', 1.0)),
        ('2.level', '0', (2, 'level', 0.0)),
        ('3.level', 'true', (3, 'level', 1.0)),
        ('6.level', 'false', (6, 'level', 0.0)),
        ('5.pulse', '0.0015', (5, 'pulse', 0.0015)),
        ('5.period', '2e-2', (5, 'period', 0.02)),
        ('4.level, 5.pulse', 'high, 0.0015', (4, 'level', 1.0, 5, 'pulse', 0.0015)),
    ],
)
def test_request_for_auxiliary_outputs(key: str, value: str, expected: Any) -> None:
    requests = convert.aux_requests(KeyValue(key=key, value=value))
    assert tuple(each for request in requests for each in request) == expected


def test_sources_of_the_outputs_by_number() -> None:
    message = convert.channel_sources(('SERIAL', 'PIN 2 (nibble 1)'), 'name', 'hardware')
    assert values_of(message) == {'output 1': 'SERIAL', 'output 2': 'PIN 2 (nibble 1)'}
    assert (message.level, message.message) == (DiagnosticStatus.OK, 'ok')
    none = convert.channel_sources((), 'name', 'hardware')
    assert (none.level, none.message) == (DiagnosticStatus.STALE, 'unknown')
