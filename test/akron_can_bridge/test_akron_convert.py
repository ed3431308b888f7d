# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Joy, joint states, limits and outputs of the Akron bridge."""

import math
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from sensor_msgs.msg import Joy

from akron_can_bridge import convert
from akron_can_bridge.protocol import (
    BasicJoystick,
    DigitalInputs,
    DigitalOutputs,
    ElevationSoftLimits,
    ExtendedJoystick,
    MiniOutputs,
    Name,
    PositionLimit,
    RotationSoftLimits,
)
from akron_can_bridge.session.drive import Command, REST
from stage.akron_frames import VECTORS
from stage.talkers import values_of

STAMP = Time(sec=3)
NEUTRAL = '0100010000000000'
NO_TARGETS = 'FFFFFFFFFFFF0000'
GOLDEN = {vector['is']: bytes.fromhex(vector['data']) for vector in VECTORS}


def command(joy: Joy, *, extended: bool = False) -> tuple[BasicJoystick, ExtendedJoystick]:
    """Convert with a switch for each button, and targets allowed."""
    switches = range(1, 17 if extended else 13)
    return convert.command(joy, switches, extended=extended, automatic=True)


def sent(axes: list[float], buttons: list[int] | None = None, **options: Any) -> tuple[str, str]:
    """Return the two frames' data that a Joy becomes, in hexadecimal."""
    basic, extended = command(Joy(axes=axes, buttons=buttons or []), **options)
    return basic.to_bytes().hex().upper(), extended.to_bytes().hex().upper()


def pressed(*numbers: int) -> list[int]:
    return [int(number in numbers) for number in range(16)]


# -- commands -------------------------------------------------------------------------------------


BASIC, EXTENDED = (GOLDEN[f'{name} joystick'].hex().upper() for name in ('basic', 'extended'))
NAN = math.nan
SENT: list[tuple[list[float], list[int], str, str]] = [
    # Axes, buttons, and the two frames; targets are allowed where there are more than two axes.
    ([0.0, 0.0], [], NEUTRAL, NO_TARGETS),
    ([-0.0, 0.0004], [0] * 12, NEUTRAL, NO_TARGETS),
    # The manual's: 50 % right, 40 % back, switch 2. Left and forward are positive in Joy.
    ([-0.5, -0.4], pressed(1), BASIC, NO_TARGETS),
    ([0.0, 0.0, -0.5, -0.4], pressed(14), NEUTRAL, EXTENDED),
    # By hand: 1000 is 3E8 hex; left is 04, right 10, forward 10, back 04.
    ([1.0, 1.0], [], '04FA10FA00000000', NO_TARGETS),
    ([1.05, -1.05], [], '04FA04FA00000000', NO_TARGETS),
    ([-1.05, 1.05], [], '10FA10FA00000000', NO_TARGETS),
    # A grip at 0 is a target, if not all are.
    ([0.0, 0.0, 0.0004], [], NEUTRAL, '0100FFFFFFFF0000'),
    ([0.0, 0.0, 0.5, 0.0], [], NEUTRAL, '047D0100FFFF0000'),
    ([0.0, 0.0, 0.0, 0.0], [], NEUTRAL, NO_TARGETS),
    # What lies beyond is not looked at.
    ([0.0] * 5 + [NAN], [0] * 16 + [7], NEUTRAL, NO_TARGETS),
]


@pytest.mark.parametrize(('axes', 'buttons', 'basic', 'extended'), SENT)
def test_joy_becomes_two_frames(
    axes: list[float], buttons: list[int], basic: str, extended: str
) -> None:
    assert sent(axes, buttons, extended=len(axes) > 2) == (basic, extended)


def test_what_lies_beyond_the_basic_joystick_is_not_looked_at() -> None:
    assert sent([0.0, 0.0, NAN, 9.0], [0] * 12 + [7, 7]) == (NEUTRAL, NO_TARGETS)


def test_grips_that_are_left_out_are_no_targets() -> None:
    assert sent([0.0, 0.0], extended=True) == (NEUTRAL, NO_TARGETS)


@pytest.mark.parametrize('number', range(12))
def test_each_button_is_its_switch(number: int) -> None:
    basic, extended = sent([0.0, 0.0], pressed(number))
    assert (int(basic, 16) ^ int(NEUTRAL, 16)) == 1 << 22 - 2 * number
    assert extended == NO_TARGETS


def test_buttons_press_nothing_unless_they_are_given_a_switch() -> None:
    everything = Joy(axes=[0.0, 0.0], buttons=[1] * 16)
    for switches in ([], [0], [0] * 16):
        assert convert.command(everything, switches, extended=True) == (REST.basic, REST.extended)
    odd = Joy(axes=[0.0, 0.0], buttons=[7, 0, 1])  # whatever the first one means to its sender
    basic, _ = convert.command(odd, [0, 2, 10])
    assert basic.to_bytes().hex().upper() == '0100010000000010'


def test_target_is_refused_unless_automatic_motion_is_allowed() -> None:
    with pytest.raises(ValueError, match='set automatic_motion'):
        convert.command(Joy(axes=[0.0, 0.0, 0.1]), [], extended=True)
    basic, extended = convert.command(Joy(axes=[0.0, 0.0, 0.0, 0.0]), [], extended=True)
    assert Command(basic, extended) == REST
    assert convert.command(Joy(axes=[0.0, 0.0, 0.1]), [])[0] == REST.basic


@pytest.mark.parametrize(
    ('axes', 'buttons', 'text'),
    [
        ([], [], '0 axes; x and y are needed'),
        ([0.0], [], '1 axes'),
        ([math.nan, 0.0], [], 'axis 0 is nan'),
        ([0.0, math.inf], [], 'axis 1 is inf'),
        ([0.0, -1.06], [], 'axis 1 is -1.06'),
        ([1.06, 0.0], [], 'axis 0 is 1.06'),
        ([0.0, 0.0], [0, 2], 'button 1 is 2'),
        ([0.0, 0.0], [-1], 'button 0 is -1'),
        ([0.0, 0.0, 0.0, math.nan], [], 'axis 3'),
        ([0.0, 0.0, 0.0, 1.06], [], 'axis 3'),
    ],
)
def test_nonsense_is_refused_in_words(axes: list[float], buttons: list[int], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        command(Joy(axes=axes, buttons=buttons), extended=len(axes) > 2)


# -- what comes -----------------------------------------------------------------------------------


def test_joystick_on_the_bus_becomes_a_joy() -> None:
    switches = tuple(number in (2, 15) for number in range(1, 17))
    joy = convert.joy((500, -400, 1023, 0, -1000), switches, STAMP, 'stick')
    assert list(joy.axes) == [-0.5, pytest.approx(-0.4), -1.0, 0.0, -1.0]
    assert list(joy.buttons) == pressed(1, 14)
    assert (joy.header.stamp, joy.header.frame_id) == (STAMP, 'stick')
    assert math.copysign(1.0, joy.axes[3]) == 1.0


def test_deadband_leaves_no_step() -> None:
    joy = convert.joy((50, 100, 550, 0, 0), (False,) * 16, STAMP, '', deadband=0.1)
    assert list(joy.axes) == [0.0, 0.0, -0.5, 0.0, 0.0]


def test_joint_states_are_in_rad_with_nan_for_what_is_not_known() -> None:
    state = convert.joint_state((0.5, None), ('pan', 'tilt'), STAMP, 'base')
    assert list(state.name) == ['pan', 'tilt']
    assert state.position[0] == -0.5  # right; left is positive
    assert math.isnan(state.position[1])
    assert (state.header.stamp, state.header.frame_id) == (STAMP, 'base')
    turned = convert.joint_state((0.5, -0.2), ('pan', 'tilt'), STAMP, '', inverted=(True, False))
    assert list(turned.position) == [0.5, -0.2]
    plain = convert.joint_state((0.5, -0.2), ('pan', 'tilt'), STAMP, '')
    assert list(plain.position) == [-0.5, -0.2]  # right, down; left and up are positive


@pytest.mark.parametrize('inverted', [(False, False), (True, True)])
def test_joint_at_zero_is_never_minus_zero(inverted: tuple[bool, bool]) -> None:
    state = convert.joint_state((0.0, 0.0), ('pan', 'tilt'), STAMP, '', inverted=inverted)
    assert [math.copysign(1.0, position) for position in state.position] == [1.0, 1.0]


def test_limits_are_the_manuals() -> None:
    status = convert.limits(
        PositionLimit.from_bytes(GOLDEN['position']),
        RotationSoftLimits.from_bytes(GOLDEN['rotation soft limits']),
        ElevationSoftLimits.from_bytes(GOLDEN['elevation soft limits']),
        'PIN',
        1032,
    )
    told = values_of(status)
    assert told['left soft limit (deg)'] == '-30'
    assert told['right soft limit (deg)'] == '45'
    assert told['oscillating'] == 'true'
    assert told['down soft limit (deg)'] == '-20'
    assert told['up soft limit (deg)'] == '90'
    assert told['calibrated'] == 'true'
    assert told['operational error'] == 'false'
    stops = {key: value for key, value in told.items() if key.endswith('hard stop')}
    assert len(stops) == 10
    assert stops['axis 5 + (open) hard stop'] == 'true'
    assert list(stops.values()).count('true') == 1
    assert status.level == DiagnosticStatus.WARN
    assert status.message == 'at a hard stop: axis 5 + (open)'
    assert status.hardware_id == 'PIN'


def test_limits_without_a_reached_one_or_any_at_all() -> None:
    free = convert.limits(None, None, ElevationSoftLimits(-20.0, 90.0), '')
    assert (free.level, free.message) == (DiagnosticStatus.OK, 'at no hard stop')
    broken = PositionLimit.from_bytes(bytes.fromhex('010002000F000041'))
    told = values_of(convert.limits(broken, None, None, ''))
    assert (told['rotation position'], told['elevation position']) == ('error', 'not available')
    none = convert.limits(None, None, None, '')
    assert (none.level, none.message) == (DiagnosticStatus.STALE, 'not sent')


def test_outputs_and_inputs_are_the_manuals() -> None:
    status = convert.outputs(
        DigitalOutputs.from_bytes(GOLDEN['digital outputs']),
        MiniOutputs.from_bytes(GOLDEN['mini universal outputs']),
        DigitalInputs.from_bytes(GOLDEN['digital inputs']),
        'PIN',
    )
    on = [key for key, value in values_of(status).items() if value == 'true']
    assert on == [
        *('enable', 'active', 'discharge', 'handheld LED', 'panel LED'),
        *('6033: device active', '6033: riser extended', '6039: allowed in collision zone'),
    ]
    assert values_of(status)['riser command'] == '0'
    assert status.level == DiagnosticStatus.OK
    assert convert.outputs(None, None, None, '').level == DiagnosticStatus.STALE


def test_faulted_riser_is_a_warning() -> None:
    mini = MiniOutputs.from_bytes(bytes.fromhex('84C000'))
    status = convert.outputs(None, mini, None, '')
    assert (status.level, status.message) == (DiagnosticStatus.WARN, '6033: device faulted')
    status = convert.outputs(DigitalOutputs.from_bytes(GOLDEN['digital outputs']), None, None, '')
    assert (status.level, status.message) == (DiagnosticStatus.OK, 'ok')


NAME = Name(1035, 326, function=66, industry_group=1)


@pytest.mark.parametrize(
    ('address', 'namesake', 'level', 'message'),
    [
        (0x80, None, DiagnosticStatus.OK, '1032AE100801035 at 80'),
        (None, None, DiagnosticStatus.STALE, 'no unit has an address'),
        (0x80, Name(1, 0), DiagnosticStatus.WARN, 'another device claims our address'),
    ],
)
def test_device_says_who_the_unit_is_and_who_claims_our_address(
    address: int | None, namesake: Name | None, level: bytes, message: str
) -> None:
    status = convert.device('1032AE100801035', 1032, address, NAME, namesake, 0x38, 'mine')
    assert (status.level, status.message, status.hardware_id) == (level, message, 'mine')
    values = values_of(status)
    assert values['unit'] == '1032AE100801035'
    assert values['NAME'] == f'{NAME.value:016X}'
    assert values['manufacturer'] == '326 (Akron Brass)'
    assert values['own address'] == '38'
    claimed = 'nobody' if namesake is None else 'NAME 0000000000000001'
    assert values['own address claimed by'] == claimed


def test_device_that_was_not_heard_has_no_name() -> None:
    status = convert.device('', 0, 0x80, None, None, 0x38, 'mine')
    values = values_of(status)
    assert (status.message, values['NAME']) == ('a unit at 80', 'not heard')
    assert values['unit'] == 'not announced'
    assert 'manufacturer' not in values
