# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the FORT VSC bridge beside those that all bridges share."""

from collections.abc import Callable
import re

from bridge_core.parameters import (
    check_topic,
    DEADBAND,
    line_age_limit,
    Parameter,
    TOLERATE_FAULTY_AXES,
)
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
        f'device.{name}', LEAVE, f'serial: {description}', unit, LEAVE, maximum, check=check
    )


def _identifier(name: str, description: str, section: str = '') -> Parameter:
    return Parameter(
        f'can.{name}',
        CanIds().by_name[name],
        f'can: {description}',
        minimum=0,
        maximum=MAX_IDENTIFIER,
        section=section,
        hex_digits=8,
    )


PARAMETERS = (
    Parameter(
        'transport',
        'serial',
        'serial (USB or RS232), can (J1939) or hid (USB game controller). Parameters of the '
        'others are ignored.',
        choices=('serial', 'can', 'hid'),
        section='the port',
    ),
    Parameter(
        'port',
        '/dev/fort_vsc',
        'serial: device file, socket://host:port or rfc2217://host:port. hid: hidraw device, '
        '/dev/fort_vsc_hid by the udev rule.',
    ),
    Parameter(
        'baud',
        BAUD,
        'serial: of the RS232 port (manual 7); USB ignores it.',
        'bit/s',
        9600,
        4_000_000,
    ),
    Parameter(
        'interface', 'socketcan', "can: python-can's kind of interface: socketcan, slcan ..."
    ),
    Parameter('channel', 'can0', 'can: can0, or /dev/ttyACM0 for slcan.'),
    Parameter(
        'bitrate',
        0,
        'can: for slcan and the like; 0: as it is set. The VSC takes 40000 to 1000000, 250000 as '
        'a rule (table 6).',
        'bit/s',
        0,
        1_000_000,
    ),
    Parameter(
        'hid.devices',
        ['2a99:d002', 'ffff:f005'],
        'hid: USB vendor:product, in hexadecimal; any other device is refused. none: also a FIFO, '
        'a pty or a file, for tests only.',
        check=_hid_devices,
    ),
    _identifier(
        'left_basic',
        'left X, Y, pad. An Akron monitor on this bus obeys the default, past the mux.',
        section="CAN identifiers, 29 bits, as set in the VSC with the maker's tool (table 34)",
    ),
    _identifier('left_extended', 'left Z. An Akron monitor obeys it, too.'),
    _identifier('right_basic', 'right X, Y, pad.'),
    _identifier('right_extended', 'right Z.'),
    _identifier('heartbeat', 'mode, autonomy mode, e-stop indication.'),
    _identifier('remote_status', 'battery and radio of the remote.'),
    _identifier('feedback_value', 'values, display mode, rumble, to the VSC.'),
    _identifier('feedback_string', 'names and text, to the VSC.'),
    Parameter(
        'vsc_heartbeat_rate',
        10.0,
        'can: heartbeats of one VSC (table 34). Half as many more are of two VSCs: a stop.',
        'Hz',
        2.0,
        100.0,
    ),
    Parameter(
        'link_timeout',
        0.25,
        'Without a heartbeat of the VSC for this long, ~/estop is true. One comes every 50 ms '
        '(can: 100 ms; hid: 62.5 ms).',
        's',
        0.06,
        5.0,
        section='timeouts',
    ),
    line_age_limit(
        'socket, rfc2217: ~/estop is true while what comes may be older; half of it is a '
        'warning. 0: off.',
    ),
    Parameter(
        'transition_time',
        2.0,
        'A mode outside table 12 sets ~/estop at once, and ~/own_estop after this long.',
        's',
        0.0,
        10.0,
    ),
    Parameter(
        'heartbeat_rate',
        20.0,
        'serial: of our heartbeat. Keep several within the 500 ms of User E-STOP Timeout (7.3.4).',
        'Hz',
        4.0,
        20.0,
    ),
    Parameter(
        'software_estop_timeout',
        0.25,
        'serial: ~/software_estop, once heard, counts as true when it is older than this.',
        's',
        0.05,
        5.0,
    ),
    Parameter(
        'require_software_estop',
        False,
        'serial: ask the VSC to stop from the start, until ~/software_estop is heard.',
    ),
    Parameter(
        'axis_full_scale',
        MAX_MAGNITUDE,
        'Magnitude that becomes 1.0 in ~/joy; a stick at its end reads 1023.',
        minimum=100,
        maximum=MAX_MAGNITUDE,
        section='the sticks',
    ),
    DEADBAND,
    TOLERATE_FAULTY_AXES,
    Parameter(
        'show_status',
        '',
        "serial, can: the mux's status, such as safety_mux/status, which the remote shows, with a "
        "rumble at a stop and at a refused deadman. Empty: off, and the display is the device's.",
        check=check_topic,
        fixed=True,
        section='the display',
    ),
    Parameter(
        'read_identity',
        False,
        "serial: ask for serial number and firmware. It unlocks the VSC's setup, as a public "
        'driver does and no manual says. Nothing is written.',
        section='what the VSC is',
    ),
    Parameter(
        'configure_device',
        False,
        'Write device.* to the EEPROM of VSC and remote where it differs. Every write wears it.',
        section='what VSC and remote keep in EEPROM; -1 leaves a setting as it is',
    ),
    _setting(
        'inactivity_pause_minutes',
        'key 80, 1 or more until an inactivity pause.',
        11,
        'min',
        _minutes,
    ),
    _setting('auto_off_enable', 'key 81 (delivered: 1): off 2 min after an inactivity pause.', 1),
    _setting('orientation_pause_enable', 'key 82 (delivered: 1): pause when tipped over.', 1),
    _setting('free_fall_pause_enable', 'key 83 (delivered: 1): pause when it falls.', 1),
    _setting('inactivity_pause_enable', 'key 84 (delivered: 1): pause when not touched.', 1),
    _setting(
        'user_estop_timeout',
        'key 85, User E-STOP Timeout (delivered: 0): stop without our heartbeat for 500 ms. With '
        '1, ending this node stops the machine.',
        1,
    ),
    _setting(
        'joystick_interval_ms',
        'of the sticks, 20 to half of link_timeout (delivered: 20).',
        65535,
        'ms',
        _interval,
    ),
    _setting(
        'heartbeat_interval_ms',
        "of the VSC's heartbeat, 20 to half of link_timeout (delivered: 50).",
        65535,
        'ms',
        _interval,
    ),
    _setting(
        'gps_interval_ms',
        'of GPS sentences, 20 or more (delivered: about 1000), 0: off.',
        65535,
        'ms',
        _interval_or_off,
    ),
    _setting(
        'remote_status_interval_ms',
        'of battery and radio strength, 20 or more, 0: off (as delivered). 1000 will do.',
        65535,
        'ms',
        _interval_or_off,
    ),
)
