# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the VM-110 bridge beside those that all bridges share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import ipaddress
from typing import Any

from bridge_core.parameters import DEADBAND, line_age_limit, Parameter, TOLERATE_FAULTY_AXES
from vm110_bridge.protocol import AXIS_NAMES, Crc, MAX_BURST_DATA, SWITCH_NAMES

OUTPUT_PORT_OFFSET = 2  # the output port is always input + 2 (manual 2.2)
MAX_OUTPUT = 32 * MAX_BURST_DATA  # bytes of periodic data: a burst is sent in one go


def _check_group(text: str) -> None:
    if not _address(text).is_multicast:
        raise ValueError('allowed is an IPv4 multicast address, such as 239.255.42.20')


def _check_interface(text: str) -> None:
    if text:
        _address(text)


def _check_sources(texts: Sequence[str]) -> None:
    for text in texts:
        _check_interface(text)


def _check_inverted(flags: Sequence[bool]) -> None:
    if len(flags) not in (1, len(AXIS_NAMES)):
        raise ValueError('allowed is one value, or one for each of 4 axes')


def _check_leds(numbers: Sequence[int]) -> None:
    if len(set(numbers)) < len(numbers):
        raise ValueError('allowed is each switch once')


def _address(text: str) -> ipaddress.IPv4Address:
    try:
        return ipaddress.IPv4Address(text)
    except ValueError:
        raise ValueError('allowed is an IPv4 address, such as 192.168.1.10') from None


PARAMETERS = (
    Parameter(
        'group',
        '239.255.42.20',
        'IPv4 multicast address, as configured in the BU (manual 2.2).',
        check=_check_group,
        section='the network',
    ),
    Parameter(
        'input_port',
        5825,
        'UDP port that the BU sends to; ours to it is always 2 higher (manual 2.2).',
        minimum=1,
        maximum=0xFFFF - OUTPUT_PORT_OFFSET,
    ),
    Parameter(
        'ttl',
        1,
        'Multicast TTL; 1 stays in this network, 2 crosses one router.',
        minimum=0,
        maximum=255,
    ),
    Parameter(
        'interface_address',
        '',
        "IPv4 address of this computer's interface to the BU. Empty: as the routing table says.",
        check=_check_interface,
    ),
    Parameter(
        'allowed_sources',
        [''],
        "IPv4 addresses that are listened to; others are counted and dropped. ['']: any.",
        check=_check_sources,
    ),
    Parameter(
        'bu_id',
        0,
        'Unique ID of the BU. 0: the first one heard, until the node is activated again.',
        minimum=0,
        maximum=0xFFFF,
    ),
    Parameter(
        'sender_ports',
        'one',
        'UDP ports that the BU sends from; the manual does not say. one: another port is another '
        'sender. many: another IPv4 address is.',
        choices=('one', 'many'),
    ),
    Parameter(
        'crc',
        'auto',
        'Which of two readings of the CRC in the manual (3.3) holds. auto: that of the first '
        'VRPI; nothing is sent until then.',
        choices=('auto', *(crc.value for crc in Crc)),
    ),
    Parameter(
        'link_timeout',
        0.5,
        'Without a VRPI for this long, ~/estop is true. One comes every 0.125 s.',
        unit='s',
        minimum=0.15,
        maximum=5.0,
        section='timeouts and periods',
    ),
    line_age_limit(
        '~/estop is true while VRPI come this much later than before; half of it is a warning. '
        '0: off. A delay from the start on is not seen.',
    ),
    Parameter(
        'output_period',
        0.1,
        'Time between two VRPO (5.1.2 recommends this range). The BU opens its relays after 2 s '
        'without.',
        unit='s',
        minimum=0.05,
        maximum=0.2,
    ),
    Parameter(
        'hold_output_timeout',
        0.25,
        '~/hold_output, once heard, counts as true when it is older than this.',
        unit='s',
        minimum=0.05,
        maximum=5.0,
    ),
    Parameter(
        'command_timeout',
        2.0,
        'When a command to the remote unit (VRCO) is given up.',
        unit='s',
        minimum=0.2,
        maximum=60.0,
    ),
    Parameter(
        'periodic_output_size',
        0,
        'Periodic data as configured in the BU: other lengths are refused, and zeros sent until '
        'the first. 0: whatever ~/periodic_output brings.',
        unit='bytes',
        minimum=0,
        maximum=MAX_OUTPUT,
        section='what is sent and taken',
    ),
    Parameter(
        'first_packet_number',
        0,
        'Packet number of the first VRPO of a burst; the manual (4.2) does not say.',
        minimum=0,
        maximum=1,
    ),
    Parameter(
        'acknowledge',
        'auto',
        'When a command is acknowledged (VRAO). auto: once it was published, and not while nobody '
        'subscribes to ~/command. always: then, too. explicit: when ~/command_done names its ID.',
        choices=('auto', 'always', 'explicit'),
    ),
    Parameter(
        'accept_unarmed_commands',
        False,
        'Deliver commands although no remote is armed.',
    ),
    Parameter(
        'axis_inverted',
        [False],
        'Turn the sign round, one for all four joysticks or one each: left and forward are '
        'positive in ~/joy.',
        check=_check_inverted,
        section='the sticks',
    ),
    Parameter(
        'led_switches',
        [0],
        'Switches that are push buttons with an LED; [0]: none. The BU adds 2 to these while the '
        'LED is lit (manual 4.1.5); ~/joy has 0 or 1.',
        minimum=0,
        maximum=len(SWITCH_NAMES),
        check=_check_leds,
    ),
    DEADBAND,
    TOLERATE_FAULTY_AXES,
)


def axis_signs(values: Mapping[str, Any]) -> tuple[bool, ...]:
    """Return ``axis_inverted``, one an axis."""
    flags = values['axis_inverted']
    return tuple(flags) * (len(AXIS_NAMES) // len(flags))
