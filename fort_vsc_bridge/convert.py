# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Between the VSC's values and ROS messages; pure functions.

NMEA sentences are read here in a few lines: two sentences and six fields do not earn a dependency.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
import re
import reprlib

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import KeyValue
from sensor_msgs.msg import BatteryState, Joy, JoyFeedback, NavSatFix, NavSatStatus
from std_msgs.msg import Int8, String

from bridge_core.convert import joy_message, scaled, unknown_battery
from bridge_core.numerals import check_range, whole_number
from fort_vsc_bridge.protocol.messages import NAME_SIZE, RemoteStatus, UserFeedbackName
from fort_vsc_bridge.protocol.values import (
    AutonomyMode,
    INT32,
    MAX_MAGNITUDE,
    Mode,
    mode_name,
    TEXT_KEYS,
)

# The device counts X to the right; in ROS left is positive. Y (forward) and Z stay.
_SIGNS = (-1.0, 1.0, 1.0, -1.0, 1.0, 1.0)
_LONGEST_TEXT = len(TEXT_KEYS) * (NAME_SIZE + len('\r\n'))
_HIGH_STRENGTH = 2  # of the radio (7.3.3)


def joy(
    axes: Sequence[int],
    buttons: Sequence[bool],
    stamp: Time,
    frame_id: str,
    *,
    axis_full_scale: int = MAX_MAGNITUDE,
    deadband: float = 0.0,
) -> Joy:
    """
    Return a Joy of 6 axes (left X Y Z, right X Y Z) and 8 buttons, in the order of the protocol.

    Left and forward are positive. See bridge_core.convert.scaled for the parameters.
    """
    values = (
        sign * scaled(value, axis_full_scale, deadband)
        for sign, value in zip(_SIGNS, axes, strict=True)
    )
    return joy_message(list(values), buttons, stamp, frame_id)


def mode_string(mode: Mode | AutonomyMode | int | None) -> String:
    """Return 'Operational' and the like, 'Unknown (0x33)', or 'None' without a fresh heartbeat."""
    return String(data=mode_name(mode))


def battery_state(status: RemoteStatus | None, stamp: Time, frame_id: str) -> BatteryState:
    """Return the remote's battery; ``present`` is false where nothing is known of it."""
    message = unknown_battery('remote', stamp, frame_id)
    if status is None:
        return message
    message.present = True
    if status.battery_percent is not None:
        message.percentage = status.battery_percent / 100.0
    message.power_supply_status = _supply_status(status)
    return message


def radio_strength(status: RemoteStatus | None) -> Int8:
    """Return the strength as perceived by the VSC, 0 low to 2 high; -1 where it is not known."""
    strength = -1 if status is None else status.strength_vsc
    return Int8(data=strength if strength <= _HIGH_STRENGTH else -1)


def _supply_status(status: RemoteStatus) -> int:
    if not status.charging:
        return int(BatteryState.POWER_SUPPLY_STATUS_DISCHARGING)
    if status.battery_percent == 100:
        return int(BatteryState.POWER_SUPPLY_STATUS_FULL)
    return int(BatteryState.POWER_SUPPLY_STATUS_CHARGING)


def user_value(key: int, value: int) -> KeyValue:
    """Return a user value as two decimal numbers in text."""
    return KeyValue(key=str(key), value=str(value))


def key_and_value(message: KeyValue) -> tuple[int, int]:
    """Return key and value of a request. :raises ValueError: if one is not a whole number."""
    return _whole(message.key, 'key'), _whole(message.value, 'value')


def key_and_text(message: KeyValue) -> tuple[int, str]:
    """Return key and text of a request. :raises ValueError: no whole number, or no name."""
    request = UserFeedbackName(_whole(message.key, 'key'), message.value)
    return request.key, request.name


def display_text(message: String) -> tuple[str]:
    """Return the lines that are asked for. :raises ValueError: more than can be shown."""
    if len(message.data) > _LONGEST_TEXT:
        raise ValueError(
            f'the display has {len(TEXT_KEYS)} lines of {NAME_SIZE} characters, '
            f'and the text {len(message.data)} characters'
        )
    return (message.data,)


def _whole(text: str, what: str) -> int:
    try:
        value = whole_number(text)
    except ValueError:
        raise ValueError(f'{what} must be a whole number, not {reprlib.repr(text)}') from None
    check_range(what, value, *INT32)
    return value


def rumble_sides(message: JoyFeedback) -> tuple[bool, bool]:
    """
    Return whether the left (id 0) and the right (id 1) motor are asked for.

    The motors know only on, for 750 ms: an intensity above 0 is on.

    :raises ValueError: for another type or id, or an intensity that is not 0 to 1.
    """
    if message.type != JoyFeedback.TYPE_RUMBLE:
        raise ValueError(f'only rumble (type {JoyFeedback.TYPE_RUMBLE}), not type {message.type}')
    if message.id not in (0, 1):
        raise ValueError(f'the motors are 0 (left) and 1 (right), not {message.id}')
    if not 0.0 <= message.intensity <= 1.0:
        raise ValueError(f'intensity must be 0 to 1, not {message.intensity}')
    on = message.intensity > 0.0
    return on and message.id == 0, on and message.id == 1


# -- NMEA 0183 ------------------------------------------------------------------------------------

# By GGA's quality and RMC's mode: autonomous, differential, precise, RTK fixed, RTK float. What is
# not listed is no fix: 6 E estimated, 7 M manual, 8 S simulated, 0 N none.
_QUALITY = {
    **dict.fromkeys('1A3P', NavSatStatus.STATUS_FIX),
    **dict.fromkeys('2D', NavSatStatus.STATUS_SBAS_FIX),
    **dict.fromkeys('4R5F', NavSatStatus.STATUS_GBAS_FIX),
}
_SERVICES = {
    'GL': NavSatStatus.SERVICE_GLONASS,
    'GA': NavSatStatus.SERVICE_GALILEO,
    'GB': NavSatStatus.SERVICE_COMPASS,
    'BD': NavSatStatus.SERVICE_COMPASS,
}


_ADDRESS = re.compile('[$][^P,][^,]{4},')  # talker and type; P: a maker's own
_MOST_DEGREES = {2: 90.0, 3: 180.0}  # by the digits of the whole ones


def nmea_fields(sentence: str) -> list[str] | None:
    """
    Return the fields, the first being talker and type; None for a bad or missing checksum.

    A missing one counts as bad: a sentence that was cut short looks just like that.
    """
    body, _, check = sentence.strip().partition('*')
    if not body.startswith('$'):
        return None
    total = 0
    for character in body[1:]:
        total ^= ord(character)
    return body[1:].split(',') if check.upper() == f'{total:02X}' else None


def nmea_type(sentence: str) -> str:
    """Return 'GGA', 'RMC' and the like; empty if it is none. Does not look at the checksum."""
    return sentence[3:6] if _ADDRESS.match(sentence) else ''


def nav_sat_fix(sentence: str, stamp: Time, frame_id: str) -> NavSatFix | None:
    """
    Return the position in a GGA or RMC sentence; None for any other or an unsound one.

    Without a fix the status says so and the position is NaN. The altitude is above the ellipsoid,
    so it needs GGA with height and geoid separation, else it is NaN.
    """
    fields, kind = nmea_fields(sentence), nmea_type(sentence.strip())
    if fields is None:
        return None
    try:
        if kind == 'GGA':
            position = _gga(fields)
        elif kind == 'RMC':
            position = _rmc(fields)
        else:
            return None
    except (ValueError, IndexError):
        return None
    message = NavSatFix()
    message.header.stamp = stamp
    message.header.frame_id = frame_id
    message.status.service = _SERVICES.get(fields[0][:2], NavSatStatus.SERVICE_GPS)
    message.status.status, message.latitude, message.longitude, message.altitude = position
    message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_UNKNOWN
    return message


_RMC_MODE = 12  # its field
_NO_POSITION = (NavSatStatus.STATUS_NO_FIX, math.nan, math.nan, math.nan)


def _gga(fields: list[str]) -> tuple[int, float, float, float]:
    status = _QUALITY.get(fields[6])
    if status is None:
        return _NO_POSITION
    altitude = math.nan
    if fields[9] and fields[11]:
        altitude = _number(fields[9]) + _number(fields[11])
    return (status, *_position(fields[2:6]), altitude)


def _rmc(fields: list[str]) -> tuple[int, float, float, float]:
    has_mode = len(fields) > _RMC_MODE  # since edition 2.3 of the standard
    status = _QUALITY.get(fields[_RMC_MODE] if has_mode else 'A')
    if fields[2] != 'A' or status is None:
        return _NO_POSITION
    return (status, *_position(fields[3:7]), math.nan)


def _position(fields: list[str]) -> tuple[float, float]:
    """Return latitude and longitude in degrees from value, N/S, value, E/W."""
    latitude = _degrees(fields[0], fields[1], 'NS', 2)
    return latitude, _degrees(fields[2], fields[3], 'EW', 3)


def _degrees(text: str, side: str, sides: str, digits: int) -> float:
    """Return degrees from ddmm.mmm or dddmm.mmm. :raises ValueError: if it is not one."""
    whole, rest = text[:digits], text[digits:]
    sound = whole.isdecimal() and rest[:2].isdecimal()  # neither has a sign or a point
    minutes = _number(rest)
    degrees = _number(whole) + minutes / 60.0 if sound else math.inf
    if side not in tuple(sides) or minutes >= 60.0 or degrees > _MOST_DEGREES[digits]:
        raise ValueError(f'not a position: {text} {side}')
    return degrees if side == sides[0] else -degrees


def _number(text: str) -> float:
    """Return a plain decimal number; Python's inf, nan, 1e5 and 1_0 are none."""
    if not text or text.strip('0123456789.-'):
        raise ValueError(f'not a number: {text!r}')
    return float(text)
