# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Between the unit's values and ROS messages; pure functions.

In Joy left and forward are positive, on the wire right and forward are. Joint positions follow
REP-103, left and up positive, unless ``inverted`` turns them round; on the wire right is positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntFlag
import math
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState, Joy

from akron_can_bridge.protocol import (
    AKRON_BRASS,
    Axis,
    AXIS_USAGE,
    BasicJoystick,
    DEVICE_TYPES,
    DigitalInputs,
    DigitalOutputs,
    ElevationSoftLimits,
    ExtendedJoystick,
    FLAG_NAMES,
    FULL_SCALE,
    HARD_STOP_NAMES,
    MiniOutput,
    MiniOutputs,
    Name,
    Position,
    PositionLimit,
    RotationSoftLimits,
    Status,
    UNAVAILABLE,
)
from bridge_core.convert import joy_message, scaled

_BEYOND = 1.05  # a Joy axis further out than this is a fault of its sender
_SIGNS = (-1.0, 1.0, -1.0, 1.0, 1.0)  # x, y, grip_x, grip_y, theta
_BASIC_AXES, _ALL_AXES = 2, 5
_BASIC_SWITCHES, _ALL_SWITCHES = 12, 16
_STOP = ' hard stop'
_STATUS_WORDS = {
    Status.OFF: 'false',
    Status.ON: 'true',
    Status.ERROR: 'error',
    Status.NOT_AVAILABLE: 'not available',
}


def command(
    message: Joy, switches: Sequence[int], *, extended: bool = False, automatic: bool = False
) -> tuple[BasicJoystick, ExtendedJoystick]:
    """
    Return a Joy as what a joystick sends.

    Axes: x, y, then with ``extended`` the targets grip_x, grip_y and theta; one that is left out
    is no target, and neither are all of them at 0: a Joy at rest starts no journey. What lies
    beyond is not looked at.

    :param switches: the switch that each button presses, 0 for none.
    :param automatic: let it have a target.
    :raises ValueError: fewer than two axes, a value that is not a number or beyond -1.05 to 1.05,
        a button that is neither 0 nor 1, a forbidden target. The text is for the sender.
    """
    if len(message.axes) < _BASIC_AXES:
        raise ValueError(f'{len(message.axes)} axes; x and y are needed')
    has_target = extended and any(message.axes[_BASIC_AXES:_ALL_AXES])
    if has_target and not automatic:
        raise ValueError(
            'axes 2 to 4 are a Point Aim target; let them be 0, or set automatic_motion'
        )
    axes = message.axes[: _ALL_AXES if has_target else _BASIC_AXES]
    given = [
        _deflection(number, value, sign)
        for number, (sign, value) in enumerate(zip(_SIGNS, axes, strict=False))
    ]
    x, y, grip_x, grip_y, theta = given + [UNAVAILABLE] * (_ALL_AXES - len(given))
    pressed = _pressed(message.buttons, switches)
    statuses = tuple(Status(number in pressed) for number in range(1, _ALL_SWITCHES + 1))
    basic = BasicJoystick(x, y, statuses[:_BASIC_SWITCHES])
    return basic, ExtendedJoystick(grip_x, grip_y, theta, statuses[_BASIC_SWITCHES:])


def _deflection(number: int, value: float, sign: float) -> Axis:
    if not abs(value) <= _BEYOND:  # so that NaN does not pass
        raise ValueError(f'axis {number} is {value:g}; allowed is -1 to 1')
    return Axis.of(round(sign * max(-1.0, min(1.0, value)) * FULL_SCALE))


def _pressed(buttons: Sequence[int], switches: Sequence[int]) -> set[int]:
    """Return the switches of the buttons that are pressed."""
    pressed = set()
    for number, (button, switch) in enumerate(zip(buttons, switches, strict=False)):
        if switch and button not in (0, 1):
            raise ValueError(f'button {number} is {button}; allowed is 0 or 1')
        if switch and button:
            pressed.add(switch)
    return pressed


def joy(
    axes: Sequence[int],
    switches: Sequence[bool],
    stamp: Time,
    frame_id: str,
    *,
    deadband: float = 0.0,
) -> Joy:
    """
    Return a joystick on the bus as a Joy of 5 axes and 16 buttons.

    :param axes: x, y, grip_x, grip_y, theta in 0.1 %, right and forward positive.
    """
    values = (
        sign * scaled(value, FULL_SCALE, deadband)
        for sign, value in zip(_SIGNS, axes, strict=True)
    )
    return joy_message(list(values), switches, stamp, frame_id)


def joint_state(
    positions: Sequence[float | None],
    names: Sequence[str],
    stamp: Time,
    frame_id: str,
    *,
    inverted: Sequence[bool] = (False, False),
) -> JointState:
    """
    Return rotation and elevation in rad; NaN where the unit does not vouch for one.

    :param positions: right and up positive. :param inverted: right, down are positive in the
        message instead of left, up.
    """
    message = JointState(name=list(names))
    message.header.stamp = stamp
    message.header.frame_id = frame_id
    wire = (not inverted[0], inverted[1])
    message.position = [
        math.nan if value is None else (-value if turned else value) + 0.0
        for value, turned in zip(positions, wire, strict=True)
    ]
    return message


def limits(
    position: PositionLimit | None,
    rotation: RotationSoftLimits | None,
    elevation: ElevationSoftLimits | None,
    hardware_id: str,
    device_type: int = 0,
) -> DiagnosticStatus:
    """
    Return hard stops, soft limits in degrees and calibration.

    The level is WARN at a hard stop, and STALE while nothing is sent.
    """
    reached, values = [], {}
    if position is not None:
        values = _stops(position, device_type)
        reached = [k.removesuffix(_STOP) for k, text in values.items() if text == 'true']
        values |= {
            'calibrated': _STATUS_WORDS[position.calibration],
            'operational error': _STATUS_WORDS[position.operational_error],
            'rotation position': _position_text(position.rotation),
            'elevation position': _position_text(position.elevation),
        }
    if rotation is not None:
        values['left soft limit (deg)'] = f'{rotation.left_deg:g}'
        values['right soft limit (deg)'] = f'{rotation.right_deg:g}'
        values['oscillating'] = _bool(rotation.oscillating)
    if elevation is not None:
        values['down soft limit (deg)'] = f'{elevation.down_deg:g}'
        values['up soft limit (deg)'] = f'{elevation.up_deg:g}'
    warning = f'at a hard stop: {", ".join(reached)}' if reached else ''
    return _status('limits', hardware_id, values, warning, 'at no hard stop')


def _stops(position: PositionLimit, device_type: int) -> dict[str, str]:
    """Return all hard stops, named by what the axes of the device are used for."""
    usage = [f' ({way})' for axis in AXIS_USAGE.get(device_type, ()) for way in axis]
    usage += [''] * (len(HARD_STOP_NAMES) - len(usage))
    return {
        f'{name}{way}{_STOP}': _STATUS_WORDS[stop]
        for name, way, stop in zip(HARD_STOP_NAMES, usage, position.hard_stops, strict=True)
    }


def outputs(
    outputs: DigitalOutputs | None,
    mini: MiniOutputs | None,
    inputs: DigitalInputs | None,
    hardware_id: str,
) -> DiagnosticStatus:
    """
    Return the digital outputs of types 83 and 84 and the inputs of 85, each bit by its name.

    The level is WARN where a 6033 reports a fault, and STALE while nothing is sent.
    """
    values: dict[str, str] = {}
    if outputs is not None:
        values = _bits(outputs.outputs) | {'riser command': str(outputs.riser)}
    warning = ''
    if mini is not None:
        values |= _bits(mini.outputs, '6033: ')
        if MiniOutput.DEVICE_FAULTED in mini.outputs:
            warning = '6033: device faulted'
    if inputs is not None:
        values |= _bits(inputs.inputs, '6039: ')
    return _status('outputs', hardware_id, values, warning, 'ok')


def device(
    pin: str,
    device_type: int,
    address: int | None,
    name: Name | None,
    namesake: Name | None,
    own_address: int,
    hardware_id: str,
) -> DiagnosticStatus:
    """
    Return who the unit is on the bus.

    The level is STALE while it has no address, and WARN where another device claims ours.
    """
    at = 'none' if address is None else f'{address:02X}'
    values = {
        'unit': pin or 'not announced',
        'type': DEVICE_TYPES.get(device_type, 'not known'),
        'address': at,
        'NAME': 'not heard' if name is None else f'{name.value:016X}',
        'own address': f'{own_address:02X}',
        'own address claimed by': 'nobody' if namesake is None else f'NAME {namesake.value:016X}',
    }
    if name is not None:
        maker = ' (Akron Brass)' if name.manufacturer == AKRON_BRASS else ''
        values |= {
            'manufacturer': f'{name.manufacturer}{maker}',
            'identity': str(name.identity),
            'function': str(name.function),
            'claims any address': _bool(name.arbitrary_address_capable),
        }
    if address is None:
        return _status('device', hardware_id, values, stale='no unit has an address')
    warning = '' if namesake is None else 'another device claims our address'
    return _status('device', hardware_id, values, warning, f'{pin or "a unit"} at {at}')


def _status(
    name: str,
    hardware_id: str,
    values: dict[str, str],
    warning: str = '',
    good: str = '',
    stale: str = '',
) -> DiagnosticStatus:
    """Return a status with the level and the message of the first text that holds."""
    stale = stale or ('not sent' if not values else '')
    status = DiagnosticStatus(name=name, hardware_id=hardware_id)
    status.message = stale or warning or good
    status.level = DiagnosticStatus.STALE if stale else DiagnosticStatus.WARN
    if not (stale or warning):
        status.level = DiagnosticStatus.OK
    status.values = [KeyValue(key=key, value=text) for key, text in values.items()]
    return status


def _bits(flags: IntFlag, prefix: str = '') -> dict[str, str]:
    names = FLAG_NAMES[type(flags)].items()
    return {f'{prefix}{name}': _bool(flag in flags) for flag, name in names}


def _bool(value: Any) -> str:
    return 'true' if value else 'false'


def _position_text(position: Position) -> str:
    return 'ok' if position.fault is None else _STATUS_WORDS[position.fault]
