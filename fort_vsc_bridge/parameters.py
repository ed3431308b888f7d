# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the FORT VSC bridge beside those that all bridges share."""

from collections.abc import Callable
import re

from bridge_core.parameters import DEADBAND, Parameter, TOLERATE_FAULTY_AXES
from fort_vsc_bridge.protocol.can import CanIds, MAX_IDENTIFIER
from fort_vsc_bridge.protocol.frames import BAUD
from fort_vsc_bridge.protocol.values import MAX_MAGNITUDE

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


def _hid_devices(names: list[str]) -> None:
    for name in names:
        if name != 'none' and not re.fullmatch('[0-9a-fA-F]{4}:[0-9a-fA-F]{4}', name):
            raise ValueError(
                "allowed is vendor:product in hexadecimal, such as '2a99:d002', or none"
            )


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
        f'serial: {description} -1 leaves it as it is.',
        unit=unit,
        minimum=LEAVE,
        maximum=maximum,
        check=check,
    )


def _identifier(name: str, description: str, section: str = '') -> Parameter:
    return Parameter(
        f'can.{name}',
        CanIds().by_name[name],
        f'can: identifier of {description}',
        minimum=0,
        maximum=MAX_IDENTIFIER,
        section=section,
        hex_digits=8,
    )


PARAMETERS = (
    Parameter(
        'transport',
        'serial',
        'How the VSC is joined: serial (USB or RS232, both speak the packet protocol), can '
        '(J1939), hid (USB game controller). What another one needs is not looked at.',
        choices=('serial', 'can', 'hid'),
        section='the port',
    ),
    Parameter(
        'port',
        '/dev/fort_vsc',
        'serial: device file, or socket://host:port, or rfc2217://host:port; the udev rule makes '
        '/dev/fort_vsc for USB, RS232 is /dev/ttyS0, /dev/ttyUSB0 ... hid: hidraw device; the '
        'udev rule makes /dev/fort_vsc_hid.',
    ),
    Parameter(
        'baud',
        BAUD,
        'serial: of the RS232 port; the VSC has but one (manual 7), and USB ignores it.',
        'bit/s',
        9600,
        4_000_000,
    ),
    Parameter(
        'interface',
        'socketcan',
        "can: python-can's name of a kind of interface: socketcan, slcan ...",
    ),
    Parameter('channel', 'can0', 'can: which one, such as can0, or /dev/ttyACM0 for slcan.'),
    Parameter(
        'bitrate',
        0,
        'can: for interfaces that take one, such as slcan; 0: as the interface is set. The VSC '
        'takes 40000 to 1000000, 250000 as a rule (table 6).',
        unit='bit/s',
        minimum=0,
        maximum=1_000_000,
    ),
    Parameter(
        'hid.devices',
        ['2a99:d002', 'ffff:f005'],
        'hid: USB vendor:product, in hexadecimal, of what is taken for a VSC (ffff:f005: older '
        'ones); any other hidraw device is refused. none takes a FIFO, a pty or a file, too, such '
        'as the simulator makes: only for tests.',
        check=_hid_devices,
    ),
    _identifier(
        'left_basic',
        'left X, Y, pad (J1939 basic joystick 1), from the VSC. An Akron monitor on the same bus '
        'obeys the default, past the mux.',
        section="CAN identifiers, 29 bits, as set in the VSC with the maker's tool (table 34)",
    ),
    _identifier(
        'left_extended',
        'left Z (extended joystick 1), from the VSC. An Akron monitor obeys this default, too.',
    ),
    _identifier('right_basic', 'right X, Y, pad (basic joystick 2), from the VSC.'),
    _identifier('right_extended', 'right Z (extended joystick 2), from the VSC.'),
    _identifier('heartbeat', 'mode, autonomy mode, e-stop indication, from the VSC.'),
    _identifier('remote_status', 'battery and radio of the remote, from the VSC.'),
    _identifier('feedback_value', 'values, display mode, rumble, to the VSC.'),
    _identifier('feedback_string', 'names and text, in three parts of 6 characters, to the VSC.'),
    Parameter(
        'vsc_heartbeat_rate',
        10.0,
        'can: heartbeats of one VSC (table 34). Half as many more in a second are of two VSCs on '
        'one bus, and ~/estop is true.',
        'Hz',
        1.0,
        100.0,
    ),
    Parameter(
        'link_timeout',
        0.25,
        'Without a heartbeat of the VSC for this long, ~/estop is true. One comes every 50 ms '
        '(can: 100 ms; hid: a report every 62.5 ms); the limit must be above that. One missing is '
        'noise, several are a fault.',
        unit='s',
        minimum=0.06,
        maximum=5.0,
        section='timeouts',
    ),
    Parameter(
        'transition_time',
        2.0,
        'A mode outside table 12 is a stop at once (~/estop). It is the own stop of the VSC '
        "(~/own_estop), which may be passed on to another device's chain, only when it has "
        'lasted for this long: it may be one between two modes.',
        's',
        0.0,
        10.0,
    ),
    Parameter(
        'heartbeat_rate',
        20.0,
        'serial: how often our heartbeat is sent. Where User E-STOP Timeout is on, the VSC stops '
        'after 500 ms without one (manual 7.3.4): keep several within that.',
        unit='Hz',
        minimum=4.0,
        maximum=20.0,
    ),
    Parameter(
        'software_estop_timeout',
        0.25,
        'serial: ~/software_estop, once heard, counts as true when it is older than this.',
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
        'Magnitude that becomes 1.0 in ~/joy; a stick held at its stop reads 1023. Smaller: full '
        'output before the end of the way.',
        minimum=100,
        maximum=MAX_MAGNITUDE,
        section='the sticks',
    ),
    DEADBAND,
    TOLERATE_FAULTY_AXES,
    Parameter(
        'read_identity',
        False,
        'serial: ask for serial number and firmware, into the device diagnostic. The manual has '
        "nothing of it. The VSC's setup is unlocked first, as a public driver does; nothing is "
        'written.',
        section='what the VSC is',
    ),
    Parameter(
        'configure_device',
        False,
        'Allow writes to the EEPROM of VSC and remote, where device.* differs from what is there. '
        'False: nothing in device.* is written, for every write wears it.',
        section='what VSC and remote keep in EEPROM',
    ),
    _setting(
        'inactivity_pause_minutes',
        'key 80, time without a touch until an inactivity pause, 1 or more.',
        11,
        'min',
        _minutes,
    ),
    _setting(
        'auto_off_enable',
        'key 81, 0 or 1 (as delivered: 1): remote off 2 min after an inactivity pause.',
        1,
    ),
    _setting(
        'orientation_pause_enable',
        'key 82, 0 or 1 (as delivered: 1): pause when the remote tips over.',
        1,
    ),
    _setting(
        'free_fall_pause_enable',
        'key 83, 0 or 1 (as delivered: 1): pause when the remote falls.',
        1,
    ),
    _setting(
        'inactivity_pause_enable',
        'key 84, 0 or 1 (as delivered: 1): pause when nobody touches the remote.',
        1,
    ),
    _setting(
        'user_estop_timeout',
        'key 85, User E-STOP Timeout, 0 or 1 (as delivered: 0): stop without our heartbeat for '
        '500 ms. With 1, ending this node stops the machine.',
        1,
    ),
    _setting(
        'joystick_interval_ms',
        'interval of the sticks, 20 to half of link_timeout (as delivered: 20).',
        65535,
        'ms',
        _interval,
    ),
    _setting(
        'heartbeat_interval_ms',
        "interval of the VSC's heartbeat, 20 to half of link_timeout (as delivered: 50).",
        65535,
        'ms',
        _interval,
    ),
    _setting(
        'gps_interval_ms',
        'interval of the GPS sentences, 20 or more (as delivered: about 1000), 0: off.',
        65535,
        'ms',
        _interval_or_off,
    ),
    _setting(
        'remote_status_interval_ms',
        'interval of battery and radio strength, 20 or more, 0: off (as delivered). 1000 will do '
        'for ~/battery.',
        65535,
        'ms',
        _interval_or_off,
    ),
)
