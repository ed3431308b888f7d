"""The parameters of the FORT VSC bridge beside those that all bridges share."""

from collections.abc import Mapping
from typing import Any

from bridge_core.parameters import Parameter
from fort_vsc_bridge.protocol import BAUD
from fort_vsc_bridge.protocol import MAX_MAGNITUDE
from fort_vsc_bridge.session import DeviceSettings

LEAVE = -1  # do not touch this setting of the device


def _setting(name: str, description: str, maximum: int, unit: str = '') -> Parameter:
    return Parameter(
        f'device.{name}',
        LEAVE,
        f'{description} Needs configure_device; -1 leaves it as it is.',
        unit=unit,
        minimum=LEAVE,
        maximum=maximum,
    )


PARAMETERS = (
    Parameter(
        'transport', 'serial', 'How the VSC is joined: its USB or RS232 port.', choices=('serial',)
    ),
    Parameter(
        'port', '/dev/fort_vsc', 'Device file, or socket://host:port, or rfc2217://host:port.'
    ),
    Parameter(
        'baud',
        BAUD,
        'Of the RS232 port; the VSC has but one (manual 7).',
        'bit/s',
        1200,
        4_000_000,
    ),
    Parameter(
        'link_timeout',
        0.25,
        'Without a heartbeat of the VSC for this long, ~/estop is true. It sends one every 50 ms.',
        unit='s',
        minimum=0.06,
        maximum=5.0,
    ),
    Parameter(
        'heartbeat_rate',
        20.0,
        'How often our heartbeat goes to the VSC; its own limit for it is 500 ms (manual 7.3.4).',
        unit='Hz',
        minimum=4.0,
        maximum=20.0,
    ),
    Parameter(
        'software_estop_timeout',
        0.25,
        '~/software_estop, once it was heard, counts as true when it is older than this.',
        unit='s',
        minimum=0.05,
        maximum=5.0,
    ),
    Parameter(
        'axis_full_scale',
        MAX_MAGNITUDE,
        'Magnitude that becomes 1.0 in Joy; a stick held at its stop reads 1023.',
        minimum=100,
        maximum=MAX_MAGNITUDE,
    ),
    Parameter(
        'deadband', 0.0, 'Deflection up to which an axis is 0 in Joy.', minimum=0.0, maximum=0.5
    ),
    Parameter(
        'tolerate_faulty_axes',
        False,
        'Let the sound controls count although the remote calls others broken or absent. False '
        'makes the whole Joy neutral then.',
    ),
    Parameter(
        'configure_device',
        False,
        'Allow writes to the EEPROM of VSC and remote, where device.* differs from what is there.',
    ),
    _setting('inactivity_pause_minutes', 'Key 80: pause after this long, 1 to 11.', 11, 'min'),
    _setting('auto_off_enable', 'Key 81: power off 2 min after an inactivity pause, 0 or 1.', 1),
    _setting('orientation_pause_enable', 'Key 82: pause when the remote tips over, 0 or 1.', 1),
    _setting('free_fall_pause_enable', 'Key 83: pause when the remote falls, 0 or 1.', 1),
    _setting('inactivity_pause_enable', 'Key 84: pause when nobody touches it, 0 or 1.', 1),
    _setting('user_estop_timeout', 'Key 85: stop without our heartbeat for 500 ms, 0 or 1.', 1),
    _setting('joystick_interval_ms', 'Interval of the sticks, 20 or more.', 65535, 'ms'),
    _setting('heartbeat_interval_ms', "Interval of the VSC's heartbeat, 20 or more.", 65535, 'ms'),
    _setting(
        'gps_interval_ms', 'Interval of the GPS sentences, 20 or more, 0 for off.', 65535, 'ms'
    ),
    _setting(
        'remote_status_interval_ms',
        'Interval of battery and radio strength, 20 or more, 0 for off (as delivered).',
        65535,
        'ms',
    ),
)
_SWITCHES = (
    'auto_off_enable',
    'orientation_pause_enable',
    'free_fall_pause_enable',
    'inactivity_pause_enable',
    'user_estop_timeout',
)


def device_settings(values: Mapping[str, Any]) -> DeviceSettings:
    """Return what the device is to be set to. :raises ValueError: a value that it cannot take."""
    wanted = {
        name.removeprefix('device.'): value
        for name, value in values.items()
        if name.startswith('device.') and value != LEAVE
    }
    return DeviceSettings(
        **{name: bool(value) if name in _SWITCHES else value for name, value in wanted.items()}
    )
