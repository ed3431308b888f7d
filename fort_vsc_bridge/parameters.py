"""The parameters of the FORT VSC bridge beside those that all bridges share."""

from collections.abc import Callable

from bridge_core.parameters import Parameter
from fort_vsc_bridge.protocol import BAUD
from fort_vsc_bridge.protocol import CanIds
from fort_vsc_bridge.protocol import MAX_IDENTIFIER
from fort_vsc_bridge.protocol import MAX_MAGNITUDE

LEAVE = -1  # do not touch this setting of the device


def _minutes(value: int) -> None:
    if value == 0:
        raise ValueError('allowed is 1 to 11, or -1')


def _interval(value: int) -> None:
    if value != LEAVE and value < 20:
        raise ValueError('allowed is 20 to 65535, or -1')


def _interval_or_off(value: int) -> None:
    if value not in (LEAVE, 0) and value < 20:
        raise ValueError('allowed is 20 to 65535, 0 for off, or -1')


def _setting(
    name: str,
    description: str,
    maximum: int,
    unit: str = '',
    check: Callable[[int], None] | None = None,
) -> Parameter:
    return Parameter(
        f'device.{name}',
        LEAVE,
        f'{description} Needs configure_device; -1 leaves it as it is.',
        unit=unit,
        minimum=LEAVE,
        maximum=maximum,
        check=check,
    )


def _identifier(name: str, description: str) -> Parameter:
    default = CanIds().by_name[name]
    text = f'CAN identifier, 29 bits: {description}.'
    return Parameter(f'can.{name}', default, text, minimum=0, maximum=MAX_IDENTIFIER)


PARAMETERS = (
    Parameter(
        'transport',
        'serial',
        'How it is joined: serial (USB or RS232), can (J1939), hid (USB game controller).',
        choices=('serial', 'can', 'hid'),
    ),
    Parameter(
        'port',
        '/dev/fort_vsc',
        'serial: device file, or socket://host:port, or rfc2217://host:port. hid: hidraw device.',
    ),
    Parameter(
        'baud',
        BAUD,
        'Of the RS232 port; the VSC has but one (manual 7).',
        'bit/s',
        1200,
        4_000_000,
    ),
    Parameter('interface', 'socketcan', "can: python-can's name of a kind of interface."),
    Parameter('channel', 'can0', 'can: which one, such as can0, or /dev/ttyACM0 for slcan.'),
    Parameter(
        'bitrate',
        0,
        'can: where the interface takes one; 0: as it is set. 250000 as a rule (table 6).',
        unit='bit/s',
        minimum=0,
        maximum=1_000_000,
    ),
    _identifier('left_basic', 'left thumb stick and pad'),
    _identifier('left_extended', 'left finger stick'),
    _identifier('right_basic', 'right thumb stick and pad'),
    _identifier('right_extended', 'right finger stick'),
    _identifier('heartbeat', "the VSC's heartbeat"),
    _identifier('remote_status', 'battery and radio of the remote'),
    _identifier('feedback_value', 'values to the VSC'),
    _identifier('feedback_string', 'names and text to the VSC'),
    Parameter(
        'link_timeout',
        0.25,
        'Without a heartbeat of the VSC for this long, ~/estop is true. One comes every 50 ms '
        '(can: 100 ms; hid: a report every 63 ms).',
        unit='s',
        minimum=0.06,
        maximum=5.0,
    ),
    Parameter(
        'heartbeat_rate',
        20.0,
        'serial: how often our heartbeat goes out; the limit of the VSC is 500 ms (manual 7.3.4).',
        unit='Hz',
        minimum=4.0,
        maximum=20.0,
    ),
    Parameter(
        'software_estop_timeout',
        0.25,
        'serial: ~/software_estop, once it was heard, counts as true when it is older than this.',
        unit='s',
        minimum=0.05,
        maximum=5.0,
    ),
    Parameter(
        'require_software_estop',
        False,
        'serial: ask the VSC to stop from the start, until ~/software_estop is heard.',
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
    _setting(
        'inactivity_pause_minutes', 'Key 80: pause after this long, 1 to 11.', 11, 'min', _minutes
    ),
    _setting('auto_off_enable', 'Key 81: power off 2 min after an inactivity pause, 0 or 1.', 1),
    _setting('orientation_pause_enable', 'Key 82: pause when the remote tips over, 0 or 1.', 1),
    _setting('free_fall_pause_enable', 'Key 83: pause when the remote falls, 0 or 1.', 1),
    _setting('inactivity_pause_enable', 'Key 84: pause when nobody touches it, 0 or 1.', 1),
    _setting('user_estop_timeout', 'Key 85: stop without our heartbeat for 500 ms, 0 or 1.', 1),
    _setting(
        'joystick_interval_ms', 'Interval of the sticks, 20 or more.', 65535, 'ms', _interval
    ),
    _setting(
        'heartbeat_interval_ms',
        "Interval of the VSC's heartbeat, 20 or more.",
        65535,
        'ms',
        _interval,
    ),
    _setting(
        'gps_interval_ms',
        'Interval of the GPS sentences, 20 or more, 0 for off.',
        65535,
        'ms',
        _interval_or_off,
    ),
    _setting(
        'remote_status_interval_ms',
        'Interval of battery and radio strength, 20 or more, 0 for off (as delivered).',
        65535,
        'ms',
        _interval_or_off,
    ),
)
