"""The parameters of the VM-110 bridge beside those that all bridges share."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence
import ipaddress
from typing import Any

from bridge_core.parameters import Parameter
from vm110_bridge.protocol import AXIS_NAMES
from vm110_bridge.protocol import Crc
from vm110_bridge.protocol import MAX_BURST_DATA

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


def _address(text: str) -> ipaddress.IPv4Address:
    try:
        return ipaddress.IPv4Address(text)
    except ValueError:
        raise ValueError('allowed is an IPv4 address, such as 192.168.1.10') from None


PARAMETERS = (
    Parameter(
        'group',
        '239.255.42.20',
        'Multicast address, as configured in the BU (manual 2.2).',
        check=_check_group,
    ),
    Parameter(
        'input_port',
        5825,
        'UDP port that the BU sends to; ours to it is always 2 higher (manual 2.2).',
        minimum=1,
        maximum=0xFFFF - OUTPUT_PORT_OFFSET,
    ),
    Parameter('ttl', 1, 'Multicast TTL; 1 stays in this network.', minimum=0, maximum=255),
    Parameter(
        'interface_address',
        '',
        'IPv4 address of the network interface to the BU. Empty: the one that the routing table '
        'names.',
        check=_check_interface,
    ),
    Parameter(
        'allowed_sources',
        [''],
        'IPv4 addresses that are listened to; datagrams from others are counted and dropped. '
        'Empty: any.',
        check=_check_sources,
    ),
    Parameter(
        'bu_id',
        0,
        'Unique ID of the base unit. 0: the first one heard, and no other until the node is '
        'activated again.',
        minimum=0,
        maximum=0xFFFF,
    ),
    Parameter(
        'crc',
        'auto',
        'How the manual means its CRC (3.3). auto: as in the first VRPI that one of them lets '
        'pass.',
        choices=('auto', *(crc.value for crc in Crc)),
    ),
    Parameter(
        'link_timeout',
        0.5,
        'Without a VRPI for this long, ~/estop is true. One comes every 125 ms.',
        unit='s',
        minimum=0.15,
        maximum=5.0,
    ),
    Parameter(
        'output_period',
        0.1,
        'How often VRPO are sent. The BU opens its relays after 2 s without.',
        unit='s',
        minimum=0.05,
        maximum=0.2,
    ),
    Parameter(
        'periodic_output_size',
        0,
        'Bytes of periodic data as configured in the BU; other lengths are refused, and zeros '
        'sent until the first. 0: whatever ~/periodic_output brings.',
        unit='bytes',
        minimum=0,
        maximum=MAX_OUTPUT,
    ),
    Parameter(
        'first_packet_number',
        0,
        'Packet number of the first VRPO of a burst; the manual (4.2) does not say.',
        minimum=0,
        maximum=1,
    ),
    Parameter(
        'hold_output_timeout',
        0.25,
        '~/hold_output, once it was heard, counts as true when it is older than this.',
        unit='s',
        minimum=0.05,
        maximum=5.0,
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
        'Deliver commands although no remote is armed. False: they are dropped.',
    ),
    Parameter(
        'command_timeout',
        2.0,
        'A command to the RU (VRCO) that is not acknowledged for this long is given up.',
        unit='s',
        minimum=0.2,
        maximum=60.0,
    ),
    Parameter(
        'axis_inverted',
        [False],
        'Turn the sign round, one for all joysticks or one each: left and forward are to be '
        'positive in Joy.',
        check=_check_inverted,
    ),
    Parameter(
        'deadband', 0.0, 'Deflection up to which an axis is 0 in Joy.', minimum=0.0, maximum=0.5
    ),
    Parameter(
        'tolerate_faulty_axes',
        False,
        'Let the sound controls count although a joystick is out of its range. False makes the '
        'whole Joy neutral then.',
    ),
)


def axis_signs(values: Mapping[str, Any]) -> tuple[bool, ...]:
    """Return ``axis_inverted``, one an axis."""
    flags = values['axis_inverted']
    return tuple(flags) * (len(AXIS_NAMES) // len(flags))
